# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""One step of bodies in contact: how long it may be, and how it is taken on the grid.

As in `integrate.loop`, with states as arrays of their own: an event cuts a step short.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.contact.grid_motion import Grid
from rb_sim.integrate.attempt import root
from rb_sim.integrate.layout import DY, FINE, NOT_FINITE, STEP_UNDERFLOW, ULPS, address
from rb_sim.integrate.loop import next_length
from rb_sim.mechanics.contact.accelerations import slides_on_compliant
from rb_sim.mechanics.contact.contact_bodies import (
    AT_ROLL,
    AT_SLIP,
    CLOSED,
    CREEPS,
    EVENT_FUNCTIONS_BEFORE,
    EVENT_KINDS,
    EVENT_RATES_BEFORE,
    FREE,
    NUDGE,
    POINT,
    ROLL,
    ROLL_DIRECTION,
    ROLL_ENDS,
    ROLLING_ARM,
    SHARP,
    SLIDE,
    SLIP,
    SLIP_DIRECTION,
    SLIP_ENDS,
    STATIC,
    STIFF,
    first_row_of,
    least_slip,
)
from rb_sim.mechanics.contact.contact_kinematics import SLIDING
from rb_sim.mechanics.contact.event_functions import (
    natural_force,
    natural_turning,
    rolling,
    step_of_swings,
)
from rb_sim.mechanics.system import project
from rb_sim.mechanics.systems.many_bodies import BODY, INVERSE, MASS, PARENT, state_of, vec
from rb_sim.numerics.kernels import call_step, part, pointer
from rb_sim.numerics.vectors import dot, norm, sub

# Where steps come near the end, or the beginning, of a slip or of a rolling.
#
# As |s| falls, friction turns the slip sideways ever faster: its rate is some a / |s|, with a what
# friction itself gives the slip [m/s^2].  A step of fixed length that goes on across the end, or is
# too long for that rate, turns it aside at its stages; it misses zero by some a h, and so does each
# step after it.  Steps towards that instant take a part of the time that is left, each; an adaptive
# method sees by its error that they have to.  Where a slip begins, or stays slow, a step that has
# turned it is made again, as long as that rate allows.


STOP_PART, LEAST_PART, LEAST_TURNED = 0.75, 0.04, 0.001
"""Parts of the time in which a slip would vanish at its present rate that one step may take: if
nothing turns it aside, however fast friction may do so, and however fast it does."""
LAST_STEP, ENDED = 1e-10, 1e-13
"""Remaining times of a slip (natural units): at LAST_STEP one more step ends it, at ENDED it has
ended."""
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
"""Sine of the angle by which a slip may turn in a step and still count as straight, so that its
direction is known."""


def time_to_stop(table, c, i, mode):
    """Time after which the slip or the rolling of contact c, event function i, would vanish at its
    present rate; FREE if it does not slow down."""
    level, rate = table[c, EVENT_FUNCTIONS_BEFORE + i], table[c, EVENT_RATES_BEFORE + i]
    slides = table[c, CLOSED] == 1.0 and table[c, mode] == SLIDING
    slows = slides and level < FREE and rate < -FAINT
    return max(-level / rate, 0.0) if slows else FREE


def lightness(system, y, b, p):
    """(acceleration that a force of 1 N at p gives p at most, angular acceleration that a torque of
    1 N m gives at most) of body b; 0 of the world."""
    if b < 0:
        return 0.0, 0.0
    turns = vec(system.bodies, b, INVERSE)
    about, r = turns[0] + turns[1] + turns[2], sub(p, state_of(y, b).p_WC)
    return 1.0 / system.bodies[b, MASS] + about * dot(r, r), about


def own_rate(system, y, c, i):
    """a, what friction itself gives the slip or the rolling of contact c, in the units of its event
    function i [1/s]."""
    table, k = system.contact_table, first_row_of(system, c)
    p = vec(table, c, POINT)
    moves_B, turns_B = lightness(system, y, system.row_table[k, BODY], p)
    moves_A, turns_A = lightness(system, y, system.row_table[k, PARENT], p)
    normal_force = abs(table[c, EVENT_FUNCTIONS_BEFORE]) * natural_force(system)
    if i == AT_SLIP:
        return SHARP / system.speed * table[c, STATIC] * normal_force * (moves_B + moves_A)
    return table[c, ROLLING_ARM] * normal_force * (turns_B + turns_A) / natural_turning(system)


def was_turned(system, c, i, sine):
    """True if the last step has turned the slip or the rolling of contact c by more than that."""
    table = system.contact_table
    if i == AT_SLIP:
        now, before = vec(table, c, SLIP), vec(table, c, SLIP_DIRECTION)
    else:
        now, before = rolling(table, c), vec(table, c, ROLL_DIRECTION)
    return dot(now, before) < (1.0 - 0.5 * sine * sine) * norm(now) * norm(before)


def longest_step(system, y, c, i, mode, h):
    """The longest step from y, up to h, that the slip or the rolling of contact c allows."""
    table, level = system.contact_table, system.contact_table[c, EVENT_FUNCTIONS_BEFORE + i]
    slides = table[c, CLOSED] == 1.0 and table[c, mode] == SLIDING and level < FREE
    left = time_to_stop(table, c, i, mode)
    if not slides or left * system.speed <= LAST_STEP * system.length:
        return min(left, h)
    own = own_rate(system, y, c, i)
    turned = TURNS * level / own if own > 0.0 else h
    aside = was_turned(system, c, i, STRAIGHT)
    if left < FREE:
        least = LEAST_TURNED if aside else LEAST_PART
        return min(max(turned, least * left), STOP_PART * left)
    return max(turned, TURNS * SLOW * h) if aside else h


def is_followed(method):
    """True for steps of fixed length of an explicit method.  An implicit one is stable, but may
    have no solution across the end: where it fails, `steps.shorter_step` comes near it."""
    return method.setting[1] == 0.0 and method.setting[4] == 0.0


def before_noise(method, system, grid, implicit):
    """Where the last step of an adaptive method has to end, at the latest, lest errors keep alive a
    slip that ends and is hardly faster than they are: one that has turned it is made again."""
    last = grid.t1
    if method.setting[4] != 0.0 or implicit:
        return last
    table, velocity_tolerance = (
        system.contact_table,
        SHARP * system.velocity_tolerance / system.speed,
    )
    for c in range(table.shape[0]):
        level = table[c, EVENT_FUNCTIONS_BEFORE + AT_SLIP]
        slides = table[c, CLOSED] == 1.0 and table[c, SLIDE] == SLIDING
        if (
            slides
            and velocity_tolerance < level <= FAST * velocity_tolerance
            and was_turned(system, c, AT_SLIP, ASIDE)
        ):
            own = own_rate(system, grid.y0, c, AT_SLIP)
            if -table[c, EVENT_RATES_BEFORE + AT_SLIP] * SLOWEST > own > 0.0:
                last = min(last, grid.t0 + CALM * level / own)
    return last


def before_stop(method, system, grid, implicit):
    """Where the last step has to end, at the latest, for what slips or rolls slowly.

    implicit: it was an implicit one of a method that is explicit elsewhere."""
    last, h = grid.t1, method.setting[0]
    if method.setting[1] != 0.0:
        return before_noise(method, system, grid, implicit)
    if not is_followed(method):
        return last
    for c in range(system.contact_table.shape[0]):
        slip = longest_step(system, grid.y0, c, AT_SLIP, SLIDE, h)
        roll = longest_step(system, grid.y0, c, AT_ROLL, ROLL, h)
        last = min(last, grid.t0 + min(slip, roll))
    return last


def stop_that_is_due(method, system, t):
    """Code of the event that a slip or a rolling ends, to which steps of fixed length have come at
    t; or -1.  After `look_ahead`.  What is left may be less than the clock resolves."""
    if not is_followed(method):
        return -1
    soon = max(ENDED * system.length / system.speed, ULPS * abs(t))
    for c in range(system.contact_table.shape[0]):
        if time_to_stop(system.contact_table, c, AT_SLIP, SLIDE) <= soon:
            return EVENT_KINDS * c + SLIP_ENDS
        if time_to_stop(system.contact_table, c, AT_ROLL, ROLL) <= soon:
            return EVENT_KINDS * c + ROLL_ENDS
    return -1


# Slow slips that go on: friction turns them faster than explicit steps follow.
#
# Near the end of a slip s the rate at which friction turns it, a / |s|, grows, but the slip is over
# after some |s| / a as well.  A slip that stays slow, as of corners of what rocks on a support that
# gives way, makes the equations stiff: there an adaptive explicit method hands its steps over to an
# implicit one, Radau IIA of order 5, with its own error estimate and the same tolerance.


LASTS = 20.0
"""Times |s| / a after which a slip would end at its present rate: one that ends before costs an
explicit method few steps."""
LONG = 2.0
"""Times |s| / a that a step may take before it is an implicit one; an explicit method of order 8 is
stable up to 6, and a is taken for one to four times what it is."""
IMPLICIT_ORDER = 4.0
"""Of the error estimate of the implicit step."""


def note_stiffness(system, y):
    """The rates at which friction turns slips that go on, where a step starts: on what gives way; a
    slip on a rigid support that is as slow goes on as before."""
    table = system.contact_table
    for c in range(table.shape[0]):
        table[c, STIFF] = 0.0
        if not slides_on_compliant(table, c):
            continue
        least = SHARP * least_slip(system, c) / system.speed
        level = SHARP * norm(vec(table, c, SLIP)) / system.speed
        if table[c, CREEPS] > 0.0:
            table[c, STIFF] = own_rate(system, y, c, AT_SLIP) / max(level, least)
        elif least < table[c, EVENT_FUNCTIONS_BEFORE + AT_SLIP] < FREE:
            rate = own_rate(system, y, c, AT_SLIP) / level
            lasts = rate * time_to_stop(table, c, AT_SLIP, SLIDE) > LASTS
            table[c, STIFF] = rate if lasts else 0.0


def shortened(system, tried):
    """(whether a step of this length is an implicit one, its length); it ends before slips do."""
    table, rate, soon = system.contact_table, 0.0, FREE
    for c in range(table.shape[0]):
        rate = max(rate, table[c, STIFF])
        soon = min(soon, time_to_stop(table, c, AT_SLIP, SLIDE))
    if rate * tried > LONG:
        tried = min(tried, STOP_PART * soon)
    return rate * tried > LONG, tried


PARTS = 64
"""Most steps in which a state inside a step is looked for that one step does not find."""


class Stepping(NamedTuple):
    """A method as the loop sees it; `setting` is that of `integrate.loop`, and last 1 for an
    implicit method."""

    step: Any
    """address of its step, or the function."""
    rate: Any
    """address of the rate of bodies in contact, or the function."""
    setting: tuple[float, float, float, float, float]
    implicit: Any
    """address of the step that is taken where slow slips are stiff, or the function; 0 for none."""
    jacobian: Any
    """address of the rate's Jacobian, or the function."""


def copy(to, of):
    """The numbers of `of`, in `to`."""
    for i in range(of.shape[0]):
        to[i] = of[i]
    return to


def finite(y):
    """True if no coordinate is NaN or infinite."""
    total = 0.0
    for i in range(y.shape[0]):
        total += y[i]
    return total - total == 0.0


def is_implicit(work):
    """True if the step at hand is an implicit one for stiff slips: its last row says so."""
    return work[work.shape[0] - 1, 0] == 1.0


def choose_step(method, system, t0, t, h, work):
    """(length, end) of a step from t0 to t, of length h: an implicit one where slow slips are
    stiff, which ends before a slip does."""
    due, tried = False, h
    if method.implicit:
        due, tried = shortened(system, h)
    work[work.shape[0] - 1, 0] = 1.0 if due else 0.0
    return tried, t if tried == h else t0 + tried


def length_of_next(method, h, error, work):
    """The step to try after one of length h with this error; 0 for steps of fixed length."""
    s = method.setting
    if s[1] == 0.0:
        return 0.0
    order = IMPLICIT_ORDER if is_implicit(work) else s[3]
    return next_length((s[0], s[1], s[2], order), h, error)


def increment(method, system, t, y, h, work):
    """dy over one step of length h from (t, y) into its row of `work`; returns the error
    estimate, relative to the tolerance 1."""
    n, workspace = y.shape[0], pointer(work)
    if is_implicit(work):
        return call_step(
            method.implicit, method.rate, method.jacobian, n, t, pointer(y), h, address(system),
            part(workspace, DY * n), workspace,
        )  # fmt: skip
    return call_step(
        method.step,
        method.rate,
        0,
        n,
        t,
        pointer(y),
        h,
        address(system),
        part(workspace, DY * n),
        workspace,
    )


def attempt(method, system, t, y, h, work):
    """As `increment`, with the error in units of the tolerance; 0 for a fixed step."""
    error = increment(method, system, t, y, h, work)
    tolerance = method.setting[1]
    if is_implicit(work):
        # Stages are solved to a tenth of it (SLIPS_STALLED): below, the estimate is rounding.
        tolerance = max(tolerance, COMPUTED_ROUNDING)
    return error / tolerance if tolerance > 0.0 else 0.0


def first_length(method, system, t, y, work):
    """A trial step of the largest length, cut by its own error estimate until that is within."""
    h, order = method.setting[2], method.setting[3]
    for _ in range(60):
        error = attempt(method, system, t, y, h, work)
        if error <= 1.0:
            return h
        if error - error == 0.0:
            h *= min(0.5, max(0.01, 0.9 / root(order, error)))
        else:
            h *= 0.01
    return h


def add_increment(y, c, work):
    """y + the increment in `work`, compensated, in place."""
    for i in range(y.shape[0]):
        d = work[DY, i] + c[i]
        s = y[i] + d
        c[i] = d - (s - y[i])
        y[i] = s


def advance_grid(method, system, grid, stop, work):
    """(grid one step further, status); no step goes beyond `stop`."""
    setting = method.setting
    adaptive = setting[1] > 0.0
    t0, h, rejected = grid.t1, setting[0], grid.rejected
    y0, c0 = copy(grid.y0, grid.y1), copy(grid.c0, grid.c1)
    t, least = grid.origin + (grid.steps + 1) * h, 0.0
    if adaptive:
        h, least = grid.h, step_of_swings(system)
        h = max(least, h if h > 0.0 else first_length(method, system, t0, y0, work))
        t = t0 + h
    y1, c1 = grid.y1, grid.c1
    while True:
        if t > stop - ULPS * abs(stop):
            t = stop
        tried = t - t0 if adaptive or t == stop else h
        if adaptive:
            tried, t = choose_step(method, system, t0, t, tried, work)
        error = attempt(method, system, t0, y0, tried, work)
        accepted = error <= 1.0 or not adaptive or tried <= 2.0 * least
        spent = not tried > 4.0 * ULPS * max(abs(t0), 1e-3)
        if accepted or spent:
            add_increment(y1, c1, work)
            project(system, t, y1)
            if spent or not adaptive or finite(y1):
                break
            # no state on the constraints is near: the error is too large, whatever its estimate
            error = math.nan
            copy(y1, y0)
            copy(c1, c0)
        if error - error != 0.0:  # too long for other reasons than rounding
            least = 0.0
        h, rejected = max(length_of_next(method, tried, error, work), least), rejected + 1
        t = t0 + h
    h_next = length_of_next(method, tried, error, work)
    if adaptive and t == stop and h_next < h:
        h_next = h
    if rejected > grid.rejected:
        h_next = min(h_next, tried)
    after = Grid(
        grid.origin, grid.steps + 1, rejected, t0, y0, c0, t, y1, c1, h_next, grid.y, grid.c
    )
    if not finite(y1):
        return after, NOT_FINITE
    return after, FINE if accepted else STEP_UNDERFLOW


def branch(method, system, grid, t, work, y, c):
    """y = the state at t, by one step from t0, whose error in units of the tolerance is returned; c
    is work space."""
    copy(y, grid.y0)
    copy(c, grid.c0)
    error = attempt(method, system, grid.t0, grid.y0, t - grid.t0, work)
    add_increment(y, c, work)
    project(system, t, y)
    return error


def reach(method, system, grid, t, work, y, c):
    """As `branch`, in 2, 4 .. PARTS equal steps where one keeps the tolerance less than they do, or
    has no finite state.

    The step to t1 may keep it and a shorter one not, whose stages are nearer to where a rim lies
    flat or a slip turns; an implicit method may have no solution in one step to t.
    """
    error = branch(method, system, grid, t, work, y, c)
    parts, last = 2, FREE
    while parts <= PARTS and not (finite(y) and (error <= 1.0 or error >= last)):
        last = error if error < FREE else FREE
        copy(y, grid.y0)
        copy(c, grid.c0)
        h, error = (t - grid.t0) / parts, 0.0
        for i in range(parts):
            error = max(error, attempt(method, system, grid.t0 + i * h, y, h, work))
            add_increment(y, c, work)
            project(system, grid.t0 + (i + 1) * h, y)
        parts *= 2
    return error


def state_at(method, system, grid, t, work):
    """The state at t, with t0 <= t <= t1; not finite where the method finds none."""
    slack = ULPS * abs(t)
    if t >= grid.t1 - slack:
        return copy(grid.y, grid.y1)
    if t <= grid.t0 + slack:
        return copy(grid.y, grid.y0)
    reach(method, system, grid, t, work, grid.y, grid.c)
    return grid.y
