"""The grid of steps of bodies in contact: where it stands, and one step more.

As in `integrate.loop`, with states as arrays of their own: an event cuts a step short.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from rb_sim.contact.events.stick_transition import STOP_PART, own_rate, time_to_stop
from rb_sim.contact.grid_motion import Grid
from rb_sim.integrate.attempt import root
from rb_sim.integrate.layout import DY, FINE, NOT_FINITE, STEP_UNDERFLOW, ULPS, address
from rb_sim.integrate.loop import next_length
from rb_sim.mechanics.contact.contact_bodies import FREE, SHARP, least_slip
from rb_sim.mechanics.contact.contact_table import (
    AT_SLIP,
    CREEPS,
    EVENT_FUNCTIONS_BEFORE,
    SLIDE,
    SLIP,
    STIFF,
)
from rb_sim.mechanics.contact.creep import slides_on_what_gives
from rb_sim.mechanics.contact.near_flat_rims import step_of_swings
from rb_sim.mechanics.system import settle
from rb_sim.mechanics.systems.many_bodies import vec
from rb_sim.numerics.kernels import call_step, inline, part, pointer
from rb_sim.numerics.vectors import norm

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
LEAST_IMPLICIT = 1e-12
"""Tolerance of these steps at the least: their stages are solved to a tenth of it (SLIPS_STALLED),
and below that the estimate is rounding, which shorter steps only add up."""


@inline
def note_stiffness(system, y):
    """The rates at which friction turns slips that go on, where a step starts: on what gives way; a
    slip on a rigid support that is as slow goes on as before."""
    touch = system.touch
    for c in range(touch.shape[0]):
        touch[c, STIFF] = 0.0
        if not slides_on_what_gives(touch, c):
            continue
        least = SHARP * least_slip(system, c) / system.speed
        level = SHARP * norm(vec(touch, c, SLIP)) / system.speed
        if touch[c, CREEPS] > 0.0:
            touch[c, STIFF] = own_rate(system, y, c, AT_SLIP) / max(level, least)
        elif least < touch[c, EVENT_FUNCTIONS_BEFORE + AT_SLIP] < FREE:
            rate = own_rate(system, y, c, AT_SLIP) / level
            lasts = rate * time_to_stop(touch, c, AT_SLIP, SLIDE) > LASTS
            touch[c, STIFF] = rate if lasts else 0.0


@inline
def shortened(system, tried):
    """(whether a step of this length is an implicit one, its length); it ends before slips do."""
    touch, rate, soon = system.touch, 0.0, FREE
    for c in range(touch.shape[0]):
        rate = max(rate, touch[c, STIFF])
        soon = min(soon, time_to_stop(touch, c, AT_SLIP, SLIDE))
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


@inline
def copy(to, of):
    """The numbers of `of`, in `to`."""
    for i in range(of.shape[0]):
        to[i] = of[i]
    return to


@inline
def finite(y):
    """True if no coordinate is NaN or infinite."""
    total = 0.0
    for i in range(y.shape[0]):
        total += y[i]
    return total - total == 0.0


@inline
def is_implicit(work):
    """True if the step at hand is an implicit one for stiff slips: its last row says so."""
    return work[work.shape[0] - 1, 0] == 1.0


@inline
def choose_step(method, system, t0, t, h, work):
    """(length, end) of a step from t0 to t, of length h: an implicit one where slow slips are
    stiff, which ends before a slip does."""
    due, tried = False, h
    if method.implicit:
        due, tried = shortened(system, h)
    work[work.shape[0] - 1, 0] = 1.0 if due else 0.0
    return tried, t if tried == h else t0 + tried


@inline
def length_of_next(method, h, error, work):
    """The step to try after one of length h with this error; 0 for steps of fixed length."""
    s = method.setting
    if s[1] == 0.0:
        return 0.0
    order = IMPLICIT_ORDER if is_implicit(work) else s[3]
    return next_length((s[0], s[1], s[2], order), h, error)


@inline
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


@inline
def attempt(method, system, t, y, h, work):
    """As `increment`, with the error in units of the tolerance; 0 for a fixed step."""
    error = increment(method, system, t, y, h, work)
    tolerance = method.setting[1]
    if is_implicit(work):
        tolerance = max(tolerance, LEAST_IMPLICIT)
    return error / tolerance if tolerance > 0.0 else 0.0


@inline
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


@inline
def add_increment(y, c, work):
    """y + the increment in `work`, compensated, in place."""
    for i in range(y.shape[0]):
        d = work[DY, i] + c[i]
        s = y[i] + d
        c[i] = d - (s - y[i])
        y[i] = s


@inline
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
    while True:
        if t > stop - ULPS * abs(stop):
            t = stop
        tried = t - t0 if adaptive or t == stop else h
        if adaptive:
            tried, t = choose_step(method, system, t0, t, tried, work)
        error = attempt(method, system, t0, y0, tried, work)
        h_next = length_of_next(method, tried, error, work)
        accepted = error <= 1.0 or not adaptive or tried <= 2.0 * least
        if accepted or not tried > 4.0 * ULPS * max(abs(t0), 1e-3):
            break
        if error - error != 0.0:  # too long for other reasons than rounding
            least = 0.0
        h, rejected = max(h_next, least), rejected + 1
        t = t0 + h
    if adaptive and t == stop and h_next < h:
        h_next = h
    if rejected > grid.rejected:
        h_next = min(h_next, tried)
    y1, c1 = grid.y1, grid.c1
    add_increment(y1, c1, work)
    settle(system, t, y1)
    after = Grid(
        grid.origin, grid.steps + 1, rejected, t0, y0, c0, t, y1, c1, h_next, grid.y, grid.c
    )
    if not finite(y1):
        return after, NOT_FINITE
    return after, FINE if accepted else STEP_UNDERFLOW


@inline
def branch(method, system, grid, t, work, y, c):
    """y = the state at t, by one step from t0; c is work space."""
    copy(y, grid.y0)
    copy(c, grid.c0)
    increment(method, system, grid.t0, grid.y0, t - grid.t0, work)
    add_increment(y, c, work)
    settle(system, t, y)


@inline
def reach(method, system, grid, t, work, y, c):
    """As `branch`, in 2, 4 .. PARTS equal steps where one gives no finite state: an implicit method
    may have no solution in one step to t though it has one in the step to t1."""
    branch(method, system, grid, t, work, y, c)
    parts = 2
    while parts <= PARTS and not finite(y):
        copy(y, grid.y0)
        copy(c, grid.c0)
        h = (t - grid.t0) / parts
        for i in range(parts):
            increment(method, system, grid.t0 + i * h, y, h, work)
            add_increment(y, c, work)
            settle(system, grid.t0 + (i + 1) * h, y)
        parts *= 2


@inline
def state_at(method, system, grid, t, work):
    """The state at t, with t0 <= t <= t1; not finite where the method finds none."""
    slack = ULPS * abs(t)
    if t >= grid.t1 - slack:
        return copy(grid.y, grid.y1)
    if t <= grid.t0 + slack:
        return copy(grid.y, grid.y0)
    reach(method, system, grid, t, work, grid.y, grid.c)
    return grid.y
