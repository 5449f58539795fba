"""Where steps come near the end, or the beginning, of a slip or of a rolling.

As |s| falls, friction turns the slip sideways ever faster: its rate is some a / |s|, with a what
friction itself gives the slip [m/s^2].  A step of fixed length that goes on across the end, or is
too long for that rate, turns it aside at its stages; it misses zero by some a h, and so does each
step after it.  Steps towards that instant take a part of the time that is left, each; an adaptive
method sees by its error that they have to.  Where a slip begins, or stays slow, a step that has
turned it is made again, as long as that rate allows.
"""

from __future__ import annotations

from rb_sim.integrate.layout import ULPS
from rb_sim.mechanics.contact.contact_bodies import (
    EVENT_KINDS,
    FREE,
    NUDGE,
    ROLL_ENDS,
    SHARP,
    SLIP_ENDS,
    line_of,
)
from rb_sim.mechanics.contact.contact_kinematics import SLIDING
from rb_sim.mechanics.contact.contact_table import (
    AT_ROLL,
    AT_SLIP,
    CLOSED,
    EVENT_FUNCTIONS_BEFORE,
    EVENT_RATES_BEFORE,
    POINT,
    ROLL,
    ROLL_DIRECTION,
    ROLLING_ARM,
    SLIDE,
    SLIP,
    SLIP_DIRECTION,
    STATIC,
)
from rb_sim.mechanics.contact.event_functions import natural_force, natural_turning, rolling
from rb_sim.mechanics.systems.many_bodies import BODY, INVERSE, MASS, PARENT, state_of, vec
from rb_sim.numerics.kernels import inline
from rb_sim.numerics.vectors import dot, norm, sub

STOP_PART, LEAST_PART, LEAST_TURNED = 0.75, 0.04, 0.001
"""Parts of the time in which a slip would vanish at its present rate that one step may take: if
nothing turns it aside, however fast friction may do so, and however fast it does."""
LAST_STEP, ENDED = 1e-10, 1e-13
"""Times (natural units) that are left at which one step more ends a slip, and at which it has."""
FAINT = 10.0 * NUDGE * SHARP
"""Rate at which a slip or a rolling falls that may be the error of its nudge: one that has just
begun does not slow down for it."""
TURNS = 1.5
"""Of |s| / a, what a step may take: an explicit method of order 4 is stable up to 2.8."""
CALM = 5.0
"""The same of an adaptive method of order 8, stable up to 6, where a is taken for one to four times
what it is.  At the bound of stability errors turn a slip e of theirs to and fro by e / |s|, which
holds up what ends it by half of a (e / |s|)^2."""
FAST = 30.0
"""Times the slip whose direction is lost in errors, beyond which they turn it by too little."""
SLOWEST = 1e4
"""Times that what ends a slip may be less than a; where it is less, too many such steps do."""
SLOW = 1e-3
"""Part of a h below which a slip that does not slow down allows no shorter steps."""
ASIDE = 1e-2
"""Sine of the angle up to which errors turn a slip that ends by too little to hold up its end."""
STRAIGHT = 1e-6
"""Sine of the angle up to which a step has not turned a slip: its direction is not lost in it."""


@inline
def time_to_stop(touch, c, i, mode):
    """Time after which the slip or the rolling of contact c, event function i, would vanish at its
    present rate; FREE if it does not slow down."""
    level, rate = touch[c, EVENT_FUNCTIONS_BEFORE + i], touch[c, EVENT_RATES_BEFORE + i]
    slides = touch[c, CLOSED] == 1.0 and touch[c, mode] == SLIDING
    slows = slides and level < FREE and rate < -FAINT
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
def own_rate(system, y, c, i):
    """a, what friction itself gives the slip or the rolling of contact c, in the units of its event
    function i [1/s]."""
    touch, k = system.touch, line_of(system, c)
    p = vec(touch, c, POINT)
    moves_B, turns_B = lightness(system, y, system.lines[k, BODY], p)
    moves_A, turns_A = lightness(system, y, system.lines[k, PARENT], p)
    push = abs(touch[c, EVENT_FUNCTIONS_BEFORE]) * natural_force(system)
    if i == AT_SLIP:
        return SHARP / system.speed * touch[c, STATIC] * push * (moves_B + moves_A)
    return touch[c, ROLLING_ARM] * push * (turns_B + turns_A) / natural_turning(system)


@inline
def was_turned(system, c, i, sine):
    """True if the last step has turned the slip or the rolling of contact c by more than that."""
    touch = system.touch
    if i == AT_SLIP:
        now, before = vec(touch, c, SLIP), vec(touch, c, SLIP_DIRECTION)
    else:
        now, before = rolling(touch, c), vec(touch, c, ROLL_DIRECTION)
    return dot(now, before) < (1.0 - 0.5 * sine * sine) * norm(now) * norm(before)


@inline
def longest_step(system, y, c, i, mode, h):
    """The longest step from y, up to h, that the slip or the rolling of contact c allows."""
    touch, level = system.touch, system.touch[c, EVENT_FUNCTIONS_BEFORE + i]
    slides = touch[c, CLOSED] == 1.0 and touch[c, mode] == SLIDING and level < FREE
    left = time_to_stop(touch, c, i, mode)
    if not slides or left * system.speed <= LAST_STEP * system.length:
        return min(left, h)
    own = own_rate(system, y, c, i)
    turned = TURNS * level / own if own > 0.0 else h
    aside = was_turned(system, c, i, STRAIGHT)
    if left < FREE:
        least = LEAST_TURNED if aside else LEAST_PART
        return min(max(turned, least * left), STOP_PART * left)
    return max(turned, TURNS * SLOW * h) if aside else h


@inline
def is_followed(method):
    """True for steps of fixed length of an explicit method.  An implicit one is stable, but may
    have no solution across the end: where it fails, `steps.shorter_step` comes near it."""
    return method.setting[1] == 0.0 and method.setting[4] == 0.0


@inline
def before_noise(method, system, grid, implicit):
    """Where the last step of an adaptive method has to end, at the latest, lest errors keep alive a
    slip that ends and is hardly faster than they are: one that has turned it is made again."""
    last = grid.t1
    if method.setting[4] != 0.0 or implicit:
        return last
    touch, still = system.touch, SHARP * system.still / system.speed
    for c in range(touch.shape[0]):
        level = touch[c, EVENT_FUNCTIONS_BEFORE + AT_SLIP]
        slides = touch[c, CLOSED] == 1.0 and touch[c, SLIDE] == SLIDING
        if slides and still < level <= FAST * still and was_turned(system, c, AT_SLIP, ASIDE):
            own = own_rate(system, grid.y0, c, AT_SLIP)
            if -touch[c, EVENT_RATES_BEFORE + AT_SLIP] * SLOWEST > own > 0.0:
                last = min(last, grid.t0 + CALM * level / own)
    return last


@inline
def before_stop(method, system, grid, implicit):
    """Where the last step has to end, at the latest, for what slips or rolls slowly.

    implicit: it was an implicit one of a method that is explicit elsewhere."""
    last, h = grid.t1, method.setting[0]
    if method.setting[1] != 0.0:
        return before_noise(method, system, grid, implicit)
    if not is_followed(method):
        return last
    for c in range(system.touch.shape[0]):
        slip = longest_step(system, grid.y0, c, AT_SLIP, SLIDE, h)
        roll = longest_step(system, grid.y0, c, AT_ROLL, ROLL, h)
        last = min(last, grid.t0 + min(slip, roll))
    return last


@inline
def stop_that_is_due(method, system, t):
    """Code of the event that a slip or a rolling ends, to which steps of fixed length have come at
    t; or -1.  After `look_ahead`.  What is left may be less than the clock resolves."""
    if not is_followed(method):
        return -1
    soon = max(ENDED * system.length / system.speed, ULPS * abs(t))
    for c in range(system.touch.shape[0]):
        if time_to_stop(system.touch, c, AT_SLIP, SLIDE) <= soon:
            return EVENT_KINDS * c + SLIP_ENDS
        if time_to_stop(system.touch, c, AT_ROLL, ROLL) <= soon:
            return EVENT_KINDS * c + ROLL_ENDS
    return -1
