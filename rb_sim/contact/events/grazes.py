"""Impacts that the step or the tolerance may have missed: a gap came near zero and grew again.

A gap that dips to g and bends by a at its least is wrong by no more than e (see `order`).  Where
g < e the surfaces may as well have met, at a speed of up to sqrt(2 a (e - g)): missed, an impact
leaves the motion wrong by as much from there on, which is far more than the e of places.  Where the
nearest face changes there, as for a corner that passes an edge, they meet at the speed of the gap.
Where another point of the same plane holds, as of a rim that rolls nearly flat, e is of angles.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rb_sim.contact.events.order import error_beside, error_of, held_beside, missed_way
from rb_sim.contact.events.touching import TOUCHING
from rb_sim.contact.geometry.rims_on_cylinders import ABSENT
from rb_sim.contact.system.levels import in_rigid_flight
from rb_sim.contact.system.swings import turned_by_rounding
from rb_sim.contact.system.touch import LEVELS_BEFORE, SENSE, SLOPES_BEFORE
from rb_sim.maths.cubic import cubic_at, cubic_minimum
from rb_sim.maths.jit import inline

SPEED, TIME, PUSHED, BEGAN, NOT_TAKEN, LAG, LAG_TIME, ROUNDED, ROUNDED_TIME = range(9)
GRAZES_WIDTH = 9
"""Columns by contact: largest speed of an impact that may have been missed [m/s], its time [s]; of
a slip that is lost in errors (see `slow_slips`) friction since then [N s], the body's speed then
[m/s], what friction has not taken since [J]; the largest share of that speed, its time [s]; the
largest angle [rad] by which rounding has turned the lean of a rim (see `swings`), its time [s]."""


class Doubts(NamedTuple):
    """How far bodies may be from where they ought to be at a step, and what that leaves open."""

    grazes: Any
    """(contacts, GRAZES_WIDTH)."""
    missed: Any
    """what steps of fixed length miss, by body, see `missed`."""
    elapsed: float
    """time since the start [s]."""
    allowed: float
    """by the tolerance, to all steps so far; 0 of steps of fixed length."""


@inline
def error_of_gap(system, doubts, y, c):
    """By how much the gap of contact c may be wrong, in lengths of the scene; 0 where a dip of it
    in the step is not one in flight."""
    touch = system.touch
    if not in_rigid_flight(touch, c) or touch[c, LEVELS_BEFORE] <= TOUCHING:
        return 0.0
    if touch[c, SENSE] == ABSENT or not touch[c, SLOPES_BEFORE] < 0.0:
        return 0.0
    far = np.empty(doubts.missed.shape[0])
    for b in range(far.shape[0]):
        far[b] = missed_way(doubts.missed, b, doubts.elapsed)
    error, held = error_of(system, far, y, c, doubts.allowed), held_beside(system, c)
    if held >= 0:
        error = min(error, error_beside(system, far, y, c, held, doubts.allowed))
    return error / system.length


@inline
def speed_of_dip(a, ra, b, rb, width, error):
    """Speed, in lengths of the scene, at which what dips as the cubic and is wrong by `error` may
    have met zero; 0 where it does not come so near.

    It bends by what its rate changes by: the cubic of a step of Euler's method, whose places and
    velocities are of different instants, bends otherwise.
    """
    s = cubic_minimum(a, ra, b, rb, width) if error > 0.0 else -1.0
    if not s > 0.0:
        return 0.0
    least, _ = cubic_at(a, ra, b, rb, width, s)
    bend = (rb - ra) / width
    return (2.0 * bend * (error - least)) ** 0.5 if least < error else 0.0


@inline
def note_graze(system, doubts, c, t, speed, error):
    """Keep the speed, in lengths of the scene, if it is the largest of the contact so far, and more
    than what velocities are wrong by where places are by `error`."""
    strikes = speed * system.length
    if strikes > max(doubts.grazes[c, SPEED], error * system.speed):
        doubts.grazes[c, SPEED], doubts.grazes[c, TIME] = strikes, t


@inline
def note_rounded_leans(system, doubts, t):
    """Note how far rounding turns the leans of rims that hardly miss flat, in the step from t."""
    for c in range(system.touch.shape[0]):
        turned = turned_by_rounding(system.touch, c)
        if turned > doubts.grazes[c, ROUNDED]:
            doubts.grazes[c, ROUNDED], doubts.grazes[c, ROUNDED_TIME] = turned, t
