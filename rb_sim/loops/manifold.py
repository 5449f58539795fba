"""Newton's iteration on the positions g(q) = 0 of constraint lines.

Whoever has lines registers two kernels for a class of its own: what the largest error is, and one
step of the iteration. When it ends is said here alone.
"""

from __future__ import annotations

import math

from rb_sim.compiler.dispatch import dispatch
from rb_sim.loops.compiled import helper

POSITION_SWEEPS = 8
ON_MANIFOLD = 2e-15
"""Position error, relative to the scene's length, at which Newton's iteration ends: round-off."""
NEAR = 1e-9
"""Position error, relative to the scene's length, from which one step of Newton's iteration, whose
error is its square, ends at round-off; above it more steps follow."""
LOST = 1e-6
"""Position error before the last sweep, relative to the scene's length, above which the iteration
has not converged and the state becomes NaN."""


@dispatch
def position_error(way, t, y):
    """The largest position error of the lines at (t, y) [m], and which lines they are, as
    `correct_positions` takes them."""
    raise TypeError(f"{type(way)}: no lines")


@dispatch
def correct_positions(way, t, y, lines):
    """One step of Newton's iteration on the position errors just met, in place."""
    raise TypeError(f"{type(way)}: no lines")


@helper
def return_to_positions(way, t, y, length, near):
    """y with g(q) = 0, in place; position first: the velocities stay as they are.

    The iteration ends at round-off, when it gains no more, or after a step from within `near` of
    the scene's length (0: never). Returns the largest error that it met last [m], and whether the
    lines that it measured last are those of y.
    """
    worst, last = 0.0, math.inf
    for _ in range(POSITION_SWEEPS):
        worst, lines = position_error(way, t, y)
        if worst <= ON_MANIFOLD * length or not worst < last:
            return worst, True
        last = worst
        correct_positions(way, t, y, lines)
        if worst <= near * length:
            break
    return worst, False
