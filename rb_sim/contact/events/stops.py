"""Where steps of fixed length come near the end of a slip or of a rolling.

As |s| falls, friction turns the slip sideways ever faster: its rate is some a / |s|, with a what
friction itself gives the slip [m/s^2].  A step of fixed length that goes on across the end, or is
too long for that rate, turns it aside at its stages; it misses zero by some a h, and so does each
step after it.  Steps towards that instant take a part of the time that is left, each; an adaptive
method sees by its error that they have to.
"""

from __future__ import annotations

from rb_sim.contact.system.bodies import EVENT_KINDS, FREE, ROLL_ENDS, SHARP, SLIP_ENDS, line_of
from rb_sim.contact.system.levels import natural_force, natural_turning
from rb_sim.contact.system.terms import SLIDING
from rb_sim.contact.system.touch import (
    AT_ROLL,
    AT_SLIP,
    CLOSED,
    LEVELS_BEFORE,
    POINT,
    ROLL,
    ROLLING_ARM,
    SLIDE,
    SLOPES_BEFORE,
    STATIC,
)
from rb_sim.engine.systems.many_bodies import BODY, INVERSE, MASS, PARENT, state_of, vec
from rb_sim.maths.jit import inline, plain
from rb_sim.maths.vectors import dot, sub

STOP_PART, LEAST_PART = 0.75, 0.04
"""Parts of the time in which a slip would vanish at its present rate that one step may take: if
nothing turns it aside, and however fast friction does."""
LAST_STEP, ENDED = 1e-10, 1e-13
"""Times (natural units) that are left at which one step more ends a slip, and at which it has."""
TURNS = 1.5
"""Of |s| / a, what a step may take: an explicit method of order 4 is stable up to 2.8."""


@inline
def time_to_stop(touch, c, i, mode):
    """Time after which the slip or the rolling of contact c, event function i, would vanish at its
    present rate; FREE if it does not slow down."""
    level, rate = touch[c, LEVELS_BEFORE + i], touch[c, SLOPES_BEFORE + i]
    slows = touch[c, CLOSED] == 1.0 and touch[c, mode] == SLIDING and level < FREE and rate < 0.0
    return max(-level / rate, 0.0) if slows else FREE


@inline
def lightness(system, y, b, p):
    """(acceleration that a force of 1 N at p gives p at most, angular acceleration that a torque of
    1 N m gives at most) of body b; 0 of the world."""
    if b < 0:
        return 0.0, 0.0
    turns = vec(system.bodies, b, INVERSE)
    about, r = turns[0] + turns[1] + turns[2], sub(p, state_of(y, b).p_WC)
    return 1.0 / system.bodies[b, MASS] + about * dot(r, r), about


@inline
def step_to_stop(system, y, c, i, mode):
    """The longest step from y towards the end of the slip or of the rolling of contact c."""
    touch, k = system.touch, line_of(system, c)
    left = time_to_stop(touch, c, i, mode)
    if left == FREE or left * system.speed <= LAST_STEP * system.length:
        return left
    p = vec(touch, c, POINT)
    moves_B, turns_B = lightness(system, y, system.lines[k, BODY], p)
    moves_A, turns_A = lightness(system, y, system.lines[k, PARENT], p)
    push = abs(touch[c, LEVELS_BEFORE]) * natural_force(system)
    if i == AT_SLIP:
        own = SHARP / system.speed * touch[c, STATIC] * push * (moves_B + moves_A)
    else:
        own = touch[c, ROLLING_ARM] * push * (turns_B + turns_A) / natural_turning(system)
    turned = TURNS * touch[c, LEVELS_BEFORE + i] / own if own > 0.0 else left
    return min(max(turned, LEAST_PART * left), STOP_PART * left)


@inline
def is_followed(method):
    """True for steps of fixed length of an explicit method.  An implicit one is stable, but may
    have no solution across the end: where it fails, `steps.shorter_step` comes near it."""
    return method.setting[1] == 0.0 and method.setting[4] == 0.0


@plain
def before_stop(method, system, grid):
    """Where a step of fixed length has to end, at the latest, for what slips or rolls and stops."""
    last = grid.t1
    if not is_followed(method):
        return last
    for c in range(system.touch.shape[0]):
        slip = step_to_stop(system, grid.y0, c, AT_SLIP, SLIDE)
        roll = step_to_stop(system, grid.y0, c, AT_ROLL, ROLL)
        last = min(last, grid.t0 + min(slip, roll))
    return last


@plain
def stop_that_is_due(method, system):
    """Code of the event that a slip or a rolling ends, to which steps of fixed length have come; or
    -1.  After `look_ahead`."""
    if not is_followed(method):
        return -1
    soon = ENDED * system.length / system.speed
    for c in range(system.touch.shape[0]):
        if time_to_stop(system.touch, c, AT_SLIP, SLIDE) <= soon:
            return EVENT_KINDS * c + SLIP_ENDS
        if time_to_stop(system.touch, c, AT_ROLL, ROLL) <= soon:
            return EVENT_KINDS * c + ROLL_ENDS
    return -1
