"""Flights that an instant begins: how long they may be."""

from __future__ import annotations

import math

from rb_sim.contact.events.bounces import acceleration_along
from rb_sim.contact.events.touching import TOUCHING, speed_that_is_none
from rb_sim.contact.system.accelerations import contact_accelerations
from rb_sim.contact.system.bodies import line_of
from rb_sim.contact.system.touch import CLOSED, DRAGS, GAP, GAP_RATE
from rb_sim.maths.jit import inline

HELD_DOWN = 1e-6
"""Acceleration towards the support, in natural units, with which a contact that has just been left
would be pressed again at once."""
LANDED = 2.4
"""Times to the top of a flight after which it is over, also where its fall changes a little."""
LOW = 1e-10
"""Height of a flight, relative to the scene's length, which rounding of the gap may hide."""


@inline
def time_of_flights(system, room, t, y, fixed):
    """(time within which the flights that begin here have to be looked at [s], inf where there are
    none; 0, or 1 + a contact whose drag lifts off what falls back at once).

    A flight is to end within it.  One that is so low that rounding may hide it has to be cut at
    its top, as any where steps are fixed.
    """
    touch, length, dragged = system.touch, math.inf, 0
    near, natural = TOUCHING * system.length, system.speed**2 / system.length
    contact_accelerations(system, t, y)
    for c in range(touch.shape[0]):
        if touch[c, CLOSED] != 0.0 or abs(touch[c, GAP]) > near:
            continue
        fall = -acceleration_along(system, room, line_of(system, c))
        rise = touch[c, GAP_RATE]
        if fall > 0.0 and rise > speed_that_is_none(system):
            hidden = fixed or 0.5 * rise * rise < LOW * fall * system.length
            length = min(length, (1.0 if hidden else LANDED) * rise / fall)
        elif touch[c, DRAGS] == 1.0 and fall > HELD_DOWN * natural and dragged == 0:
            dragged = 1 + c
    return length, dragged
