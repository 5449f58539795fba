"""Which contacts touch at an instant, and how fast they move over their support."""

from __future__ import annotations

from rb_sim.contact.geometry.rims_on_cylinders import ABSENT
from rb_sim.contact.system.touch import (
    BILATERAL,
    COMPLIANT,
    GAP,
    GAP_RATE,
    NORMAL,
    SENSE,
    SLIP,
    TURN,
)
from rb_sim.engine.systems.many_bodies import vec
from rb_sim.maths.jit import inline
from rb_sim.maths.vectors import dot, norm, scale, sub

TOUCHING = 1e-10
"""Gap, relative to the scene's length, at which surfaces touch."""
STILL = 1e-10
"""Speed, relative to the scene's, that is none: of approach, of slip, of turning."""


@inline
def speed_that_is_none(system):
    """[m/s]."""
    return STILL * system.speed


@inline
def turn_that_is_none(system):
    """[rad/s]."""
    return STILL * system.speed / system.length


@inline
def touches(system, c):
    """True if contact c is rigid and its surfaces touch."""
    touch = system.touch
    if touch[c, COMPLIANT] == 1.0 or touch[c, SENSE] == ABSENT:
        return False
    return touch[c, GAP] <= TOUCHING * system.length or touch[c, BILATERAL] == 1.0


@inline
def find_touching(system, room):
    """The contacts that touch take part; returns the one of them that approaches fastest, or -1."""
    touch, fastest = system.touch, -1
    for c in range(touch.shape[0]):
        here = touches(system, c)
        room.taking_part[c] = 1 if here else 0
        if here and (fastest < 0 or touch[c, GAP_RATE] < touch[fastest, GAP_RATE]):
            fastest = c
    return fastest


@inline
def slip_speed(system, c):
    """[m/s]."""
    return norm(vec(system.touch, c, SLIP))


@inline
def turning(system, c):
    """Relative angular velocity of contact c: (across the normal, along it) [rad/s]."""
    turn, n = vec(system.touch, c, TURN), vec(system.touch, c, NORMAL)
    about = dot(turn, n)
    return sub(turn, scale(about, n)), about
