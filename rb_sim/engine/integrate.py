"""The one kernel that Python calls: carry a system over a grid of steps and sample on the way.

The grid of steps does not depend on when samples are taken.  A sample between two grid points is
one more step of the method from the grid point before it, so it has the method's full order and
costs nothing where no sample is asked for; a run split in two equals the run in one, bit for bit.
"""

from __future__ import annotations

import numpy as np

from rb_sim.engine.grid import Grid
from rb_sim.engine.methods.dopri853 import AdaptiveDopri853, Dopri853
from rb_sim.engine.methods.euler import Euler
from rb_sim.engine.methods.gauss6 import Gauss6
from rb_sim.engine.methods.method import (
    WORK_ROWS,
    attempt,
    first_step,
    increment,
    next_step,
)
from rb_sim.engine.methods.rk4 import Rk4
from rb_sim.engine.methods.tuples import accumulate, copy, finite
from rb_sim.engine.system import inside, sample, settle
from rb_sim.maths.jit import dispatch, entry, inline

FINE, NOT_FINITE, STEP_UNDERFLOW, LEFT_DOMAIN = 0, 1, 2, 3
UNFINISHED = 9
"""Status of a call that ends after PIECE_STEPS: called again it goes on as if it had not ended."""
PIECE_STEPS = 2048
"""Of one call, so that the caller can look at signals and limits however dense the steps are."""
ULPS = 1e-15
"""Instants closer than this, relative to the time itself, are one instant."""


def workspace(coordinates: int) -> np.ndarray:
    """Room for the stages of any method on this many coordinates; no step allocates."""
    return np.zeros((WORK_ROWS, coordinates))


@dispatch
def advance_grid(method, system, grid, stop, work):
    """(grid one step further, status); no step goes beyond `stop`."""


@inline
def stepped(system, grid, t, y0, c0, dy, h_next, rejected):
    """The grid after the increment dy has been accepted; t is its new end."""
    y1, c1 = accumulate(grid.y1, dy, grid.c1)
    y1 = settle(system, t, y1)
    status = FINE
    if not finite(y1):
        status = NOT_FINITE
    elif not inside(system, y1):
        status = LEFT_DOMAIN
    after = Grid(
        grid.origin, grid.steps + 1, rejected, grid.t1, y0, c0, t, y1, c1, h_next, grid.y, grid.c
    )
    return after, status


@advance_grid.register(Euler, Rk4, Dopri853, Gauss6)
def advance_fixed(method, system, grid, stop, work):
    t0 = grid.t1
    t = grid.origin + (grid.steps + 1) * method.step
    if t > stop - ULPS * abs(stop):
        t = stop
    y0, c0 = copy(grid.y0, grid.y1), copy(grid.c0, grid.c1)
    h = method.step
    if t == stop:
        h = t - t0
    dy = increment(method, system, t0, y0, h, work)
    return stepped(system, grid, t, y0, c0, dy, 0.0, 0)


@advance_grid.register(AdaptiveDopri853)
def advance_adaptive(method, system, grid, stop, work):
    t0, h, rejected = grid.t1, grid.h, grid.rejected
    y0, c0 = copy(grid.y0, grid.y1), copy(grid.c0, grid.c1)
    if h == 0.0:
        h = first_step(method, system, t0, y0, work)
    while True:
        t = t0 + h
        if t > stop - ULPS * abs(stop):
            t = stop
        tried = t - t0
        dy, error = attempt(method, system, t0, y0, tried, work)
        accepted, h_next = next_step(method, tried, error)
        if accepted or not tried > 4.0 * ULPS * max(abs(t0), 1e-3):
            break
        h, rejected = h_next, rejected + 1
    if t == stop and h_next < h:
        h_next = h
    if rejected > grid.rejected:
        h_next = min(h_next, tried)
    after, status = stepped(system, grid, t, y0, c0, dy, h_next, rejected)
    if not accepted and status == FINE:
        status = STEP_UNDERFLOW
    return after, status


@inline
def state_at(method, system, grid, t, work):
    """The state at t, with t0 <= t <= t1."""
    slack = ULPS * abs(t)
    if t >= grid.t1 - slack:
        return copy(grid.y, grid.y1)
    if t <= grid.t0 + slack:
        return copy(grid.y, grid.y0)
    y, c = copy(grid.y, grid.y0), copy(grid.c, grid.c0)
    dy = increment(method, system, grid.t0, grid.y0, t - grid.t0, work)
    y, c = accumulate(y, dy, c)
    return settle(system, t, y)


@entry
def record(method, system, grid, times, stop, sampling, out, work):
    """Integrate to each of `times` (increasing, not before t0) and write samples if `sampling`.

    Returns (grid, status, number of times reached); grid.y is the state at the last of them.
    """
    status = FINE
    reached = 0
    last = grid.steps + PIECE_STEPS
    for i in range(times.shape[0]):
        t = times[i]
        while grid.t1 < t - ULPS * abs(t):
            if grid.steps >= last:
                status = UNFINISHED
                break
            grid, status = advance_grid(method, system, grid, stop, work)
            if status != FINE:
                break
        if status != FINE:
            break
        y = state_at(method, system, grid, t, work)
        grid = Grid(
            grid.origin, grid.steps, grid.rejected, grid.t0, grid.y0, grid.c0,
            grid.t1, grid.y1, grid.c1, grid.h, y, grid.c,
        )  # fmt: skip
        if sampling:
            sample(system, t, y, out[i])
        reached += 1
    return grid, status, reached
