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
from rb_sim.contact.problem import copy, finite
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

# Fixed steps near the end or the start of a slip or rolling.
#
# As the slip speed |s| falls, friction turns the slip faster and faster, at about the rate a / |s|,
# with a the acceleration of the slip by friction [m/s^2]. A fixed step that passes the end, or is
# too long for that rate, turns the slip at its stages, misses zero by about a h, and so does every
# later step. Steps towards the end therefore take only part of the remaining time. (Adaptive
# methods are limited by their error estimate.) While a slip starts, or stays slow, a step that has
# turned it is repeated with the length that the rate allows.


STOP_PART, LEAST_PART, LEAST_TURNED = 0.75, 0.04, 0.001
"""Step relative to the time in which a slip would end at its present rate. STOP_PART: largest, of a
straight slip; LEAST_PART, LEAST_TURNED: smallest, of a straight slip and of one that turns."""
LAST_STEP, ENDED = 1e-10, 1e-13
"""Remaining times of a slip (natural units): at LAST_STEP one more step ends it, at ENDED it has
ended."""
FAINT = 10.0 * NUDGE * SHARP
"""Rate of slowing down that may be only the error of a numerical derivative."""
TURNS = 1.5
"""Longest step relative to |s| / a: an explicit method of order 4 is stable up to 2.8."""
SLOW = 1e-3
"""Smallest slip, relative to a h, for which steps are shortened if it does not slow down."""
STRAIGHT = 1e-6
"""Sine of the angle up to which a slip that turns in a step counts as straight."""


def time_to_stop(table, c, i, mode):
    """Time in which the slip or rolling of contact c (event function i) would end at its present
    rate; FREE if it does not slow down."""
    level, rate = table[c, EVENT_FUNCTIONS_BEFORE + i], table[c, EVENT_RATES_BEFORE + i]
    slides = table[c, CLOSED] == 1.0 and table[c, mode] == SLIDING
    slows = slides and level < FREE and rate < -FAINT
    return max(-level / rate, 0.0) if slows else FREE


def lightness(system, y, b, p):
    """(largest acceleration of the point p of body b per force at p [1/kg], largest angular
    acceleration per torque [1/(kg m^2)]); 0 for the world."""
    if b < 0:
        return 0.0, 0.0
    turns = vec(system.bodies, b, INVERSE)
    about, r = turns[0] + turns[1] + turns[2], sub(p, state_of(y, b).p_WC)
    return 1.0 / system.bodies[b, MASS] + about * dot(r, r), about


def own_rate(system, y, c, i):
    """The rate a at which friction changes the slip or rolling of contact c, in units of its event
    function i [1/s]."""
    table, k = system.contact_table, first_row_of(system, c)
    p = vec(table, c, POINT)
    moves_B, turns_B = lightness(system, y, system.row_table[k, BODY], p)
    moves_A, turns_A = lightness(system, y, system.row_table[k, PARENT], p)
    normal_force = abs(table[c, EVENT_FUNCTIONS_BEFORE]) * natural_force(system)
    if i == AT_SLIP:
        return SHARP / system.speed * table[c, STATIC] * normal_force * (moves_B + moves_A)
    return table[c, ROLLING_ARM] * normal_force * (turns_B + turns_A) / natural_turning(system)


def was_turned(system, c, i):
    """Whether the last step has turned the slip or rolling of contact c."""
    table = system.contact_table
    if i == AT_SLIP:
        now, before = vec(table, c, SLIP), vec(table, c, SLIP_DIRECTION)
    else:
        now, before = rolling(table, c), vec(table, c, ROLL_DIRECTION)
    return dot(now, before) < (1.0 - 0.5 * STRAIGHT * STRAIGHT) * norm(now) * norm(before)


def longest_step(system, y, c, i, mode, h):
    """The longest step from y, up to h, that the slip or the rolling of contact c allows."""
    table, level = system.contact_table, system.contact_table[c, EVENT_FUNCTIONS_BEFORE + i]
    slides = table[c, CLOSED] == 1.0 and table[c, mode] == SLIDING and level < FREE
    left = time_to_stop(table, c, i, mode)
    if not slides or left * system.speed <= LAST_STEP * system.length:
        return min(left, h)
    own = own_rate(system, y, c, i)
    turned = TURNS * level / own if own > 0.0 else h
    aside = was_turned(system, c, i)
    if left < FREE:
        least = LEAST_TURNED if aside else LEAST_PART
        return min(max(turned, least * left), STOP_PART * left)
    return max(turned, TURNS * SLOW * h) if aside else h


def is_followed(method):
    """Whether the method is explicit with fixed steps. An implicit one is stable, but may have no
    solution across the end of a slip; then `event_steps.shorter_step` comes near it."""
    return method.setting[1] == 0.0 and method.setting[4] == 0.0


def before_stop(method, system, grid):
    """Latest end of the last step, for slow slips and rolling."""
    last, h = grid.t1, method.setting[0]
    if not is_followed(method):
        return last
    for c in range(system.contact_table.shape[0]):
        slip = longest_step(system, grid.y0, c, AT_SLIP, SLIDE, h)
        roll = longest_step(system, grid.y0, c, AT_ROLL, ROLL, h)
        last = min(last, grid.t0 + min(slip, roll))
    return last


def stop_that_is_due(method, system, t):
    """Code of the end of a slip or rolling that fixed steps have reached at t; or -1. Call after
    `look_ahead`. The remaining time may be less than the resolution of t."""
    if not is_followed(method):
        return -1
    soon = max(ENDED * system.length / system.speed, ULPS * abs(t))
    for c in range(system.contact_table.shape[0]):
        if time_to_stop(system.contact_table, c, AT_SLIP, SLIDE) <= soon:
            return EVENT_KINDS * c + SLIP_ENDS
        if time_to_stop(system.contact_table, c, AT_ROLL, ROLL) <= soon:
            return EVENT_KINDS * c + ROLL_ENDS
    return -1


# Slow slips that last: friction turns them too fast for explicit steps.
#
# Near the end of a slip the rate a / |s| at which friction turns it grows, but the slip ends after
# about |s| / a. A slip that stays slow, such as that of the corners of a body that rocks on a
# compliant support, makes the equations stiff. Adaptive explicit methods then use implicit steps,
# Radau IIA of order 5, with its own error estimate and the same tolerance.


LASTS = 20.0
"""A slip lasts if it would end after this multiple of |s| / a at its present rate."""
LONG = 2.0
"""Longest explicit step relative to |s| / a: an explicit method of order 8 is stable up to 6, and a
is overestimated by a factor of one to four."""
IMPLICIT_ORDER = 4.0
"""Order of the error estimate of the implicit step."""


def note_stiffness(system, y):
    """Set STIFF, the rate at which friction turns a lasting slip, at the start of a step; only on
    compliant supports, since slow slips on rigid ones keep their direction."""
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


PARTS = 64
"""Maximum number of equal steps for a state inside a step, if one step finds none."""


class Stepping(NamedTuple):
    """A method for the loop; `setting`: as in `integrate.loop`, then 1 for an implicit method."""

    step: Any
    """address of its step, or the function."""
    rate: Any
    """address of the rate of bodies in contact, or the function."""
    setting: tuple[float, float, float, float, float]
    implicit: Any
    """address of the step for stiff slow slips, or the function; 0: none."""
    jacobian: Any
    """address of the rate's Jacobian, or the function."""


def is_implicit(work):
    """Whether the present step is an implicit one for stiff slips, by the last row of `work`."""
    return work[work.shape[0] - 1, 0] == 1.0


def choose_step(method, system, t0, t, h, work):
    """(length, end) of a step from t0 to t of length h: an implicit one if slow slips are stiff,
    which ends before they do."""
    table, rate, soon, tried = system.contact_table, 0.0, FREE, h
    if method.implicit:
        for c in range(table.shape[0]):
            rate = max(rate, table[c, STIFF])
            soon = min(soon, time_to_stop(table, c, AT_SLIP, SLIDE))
    if rate * tried > LONG:
        tried = min(tried, STOP_PART * soon)
    work[work.shape[0] - 1, 0] = 1.0 if rate * tried > LONG else 0.0
    return tried, t if tried == h else t0 + tried


def length_of_next(method, h, error, work):
    """The step to try after one of length h with this error; 0 for fixed steps."""
    s = method.setting
    if s[1] == 0.0:
        return 0.0
    order = IMPLICIT_ORDER if is_implicit(work) else s[3]
    return next_length((s[0], s[1], s[2], order), h, error)


def attempt(method, system, t, y, h, work):
    """Write dy over a step of length h from (t, y) into its row of `work`; returns the error
    estimate in units of the tolerance, 0 for a fixed step."""
    n, workspace, tolerance = y.shape[0], pointer(work), method.setting[1]
    if is_implicit(work):
        # Stages are solved to a tenth of it (SLIPS_STALLED): below, the estimate is rounding.
        tolerance = max(tolerance, COMPUTED_ROUNDING)
        error = call_step(
            method.implicit, method.rate, method.jacobian, n, t, pointer(y), h, address(system),
            part(workspace, DY * n), workspace,
        )  # fmt: skip
    else:
        error = call_step(
            method.step, method.rate, 0, n, t, pointer(y), h, address(system),
            part(workspace, DY * n), workspace,
        )  # fmt: skip
    return error / tolerance if tolerance > 0.0 else 0.0


def first_length(method, system, t, y, work):
    """The first step: the largest one, reduced until its error estimate is within the tolerance."""
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
    """Add the increment in `work` to y with compensated summation, in place."""
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
            # no state on the constraints is near: the step is rejected whatever its estimate
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
    """Write the state at t, by one step from t0, to y; c: its low digits. Returns the error of the
    step in units of the tolerance."""
    copy(y, grid.y0)
    copy(c, grid.c0)
    error = attempt(method, system, grid.t0, grid.y0, t - grid.t0, work)
    add_increment(y, c, work)
    project(system, t, y)
    return error


def reach(method, system, grid, t, work, y, c):
    """As `branch`, by 2, 4 .. PARTS equal steps if one has no finite state, or an error above the
    tolerance that more steps reduce.

    A step to t may have a larger error than the longer one to t1, if its stages are nearer to an
    instant at which a rim lies flat or a slip turns. An implicit method may have no solution for
    the step to t although it has one for the step to t1.
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
    """The state at t, with t0 <= t <= t1; not finite if the method finds none."""
    slack = ULPS * abs(t)
    if t >= grid.t1 - slack:
        return copy(grid.y, grid.y1)
    if t <= grid.t0 + slack:
        return copy(grid.y, grid.y0)
    reach(method, system, grid, t, work, grid.y, grid.c)
    return grid.y
