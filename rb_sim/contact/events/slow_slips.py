"""Slips on rigid supports, too slow for steps to tell where they go: friction goes on as before.

A slip below some tolerances of an adaptive method has, at the stages of a step, a direction that is
but their error.  Friction goes on along the last one that was none, and most slips, about to end,
are gone before that matters.  Where one goes on, as on a pad close to a hinge, and turns by p,
friction takes mu N s (1 - cos p) less power than it should, s the slip; no error estimate sees it.
"""

from __future__ import annotations

import numpy as np

from rb_sim.contact.events.grazes import BEGAN, LAG, LAG_TIME, NOT_TAKEN, PUSHED
from rb_sim.contact.events.missed import speed_apart
from rb_sim.contact.system.bodies import STOPPED, line_of, may_creep
from rb_sim.contact.system.creep import rubs
from rb_sim.contact.system.touch import (
    AHEAD,
    FORCE,
    KINETIC,
    SLIP,
)
from rb_sim.engine.systems.many_bodies import BODY, MASS, PARENT, vec
from rb_sim.maths.jit import inline
from rb_sim.maths.vectors import norm, scale, sub

LASTING = 10.0
"""Times the impulse that would end a slip by which friction has acted where the slip goes on."""
LAGS, ERRORS = 0.1, 3.0
"""Speed of the energy that friction should have taken, over the body's as its slip became slow, and
in slips that are lost in errors. It is told where it is above both; 0.1 is 0.01 of the energy."""


@inline
def note_slow_slips(system, doubts, grid):
    """Note what friction has missed in the last step, of slips that are lost in errors and turned.

    After the levels at its end, before what the next one starts from is noted.
    """
    touch, slow = system.touch, doubts.grazes
    for c in range(touch.shape[0]):
        slip = vec(touch, c, SLIP)
        size = norm(slip)
        followed = size > system.still or may_creep(system, c)
        if not rubs(touch, c) or followed or size <= STOPPED * system.speed:
            slow[c, PUSHED] = slow[c, NOT_TAKEN] = 0.0
            continue
        b = lighter(system, c)
        mass, push = system.bodies[b, MASS], touch[c, KINETIC] * touch[c, FORCE]
        if slow[c, PUSHED] == 0.0:
            slow[c, BEGAN] = speed_apart(grid.y0, np.zeros_like(grid.y0), b, doubts.missed)
        turn = norm(sub(scale(1.0 / size, slip), vec(touch, c, AHEAD)))
        slow[c, PUSHED] += push * (grid.t1 - grid.t0)
        slow[c, NOT_TAKEN] += push * (grid.t1 - grid.t0) * size * 0.5 * turn * turn
        if slow[c, PUSHED] > LASTING * mass * system.still:
            speed = (2.0 * slow[c, NOT_TAKEN] / mass) ** 0.5
            share = speed / slow[c, BEGAN] if slow[c, BEGAN] > speed else 1.0
            if speed > ERRORS * system.still and share > max(slow[c, LAG], LAGS):
                slow[c, LAG], slow[c, LAG_TIME] = share, grid.t0


@inline
def lighter(system, c):
    """The one of the two bodies of contact c whose mass is smaller; the world has none."""
    line = line_of(system, c)
    b, parent = system.lines[line, BODY], system.lines[line, PARENT]
    if parent >= 0 and system.bodies[parent, MASS] < system.bodies[b, MASS]:
        return parent
    return b
