"""The grid of steps of bodies in contact: where it stands, and one step more.

As in `loops.record`, with states as arrays of their own: an event cuts a step short.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from rb_sim.contact.events.stiff import IMPLICIT_ORDER, LEAST_IMPLICIT, shortened
from rb_sim.contact.grid import Grid
from rb_sim.contact.system.swings import step_of_swings
from rb_sim.engine.system import settle
from rb_sim.loops.adaptive import next_length
from rb_sim.loops.attempt import root
from rb_sim.loops.compiled import call_step, part, pointer
from rb_sim.loops.places import FINE, NOT_FINITE, STEP_UNDERFLOW, ULPS
from rb_sim.loops.rows import DY
from rb_sim.loops.tables import address
from rb_sim.maths.jit import inline

PARTS = 64
"""Most steps in which a state inside a step is looked for that one step does not find."""


class Stepping(NamedTuple):
    """A method as the loop sees it; `setting` is that of `loops.record`, and last 1 for an implicit
    method."""

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
    n, room = y.shape[0], pointer(work)
    if is_implicit(work):
        return call_step(
            method.implicit, method.rate, method.jacobian, n, t, pointer(y), h, address(system),
            part(room, DY * n), room,
        )  # fmt: skip
    return call_step(
        method.step, method.rate, 0, n, t, pointer(y), h, address(system), part(room, DY * n), room
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
