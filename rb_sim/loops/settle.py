"""How a state is brought back to where it belongs at the end of a step.

The increment is added without loss of digits, quaternions become units again, and the bodies come
back to the manifold of their constraints.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from rb_sim.loops.compiled import call_law, helper, part
from rb_sim.loops.manifold import LOST, NEAR, correct_positions, position_error, return_to_positions
from rb_sim.loops.places import BACK, GAP, LENGTH, POSITION, SETTLE, VELOCITY
from rb_sim.loops.rows import AT


@helper
def accumulate(n, y, dy, carry):
    """y + dy by Kahan's compensated summation, in place: rounding does not grow with the steps."""
    for i in range(n):
        d = dy[i] + carry[i]
        s = y[i] + d
        carry[i] = d - (s - y[i])
        y[i] = s


@helper
def copy(n, to, of):
    for i in range(n):
        to[i] = of[i]


class ByLaws(NamedTuple):
    """The lines of a scene as laws: GAP tells their largest error, POSITION is a step to them."""

    laws: Any
    p: Any
    at: Any
    """room for n coordinates."""
    n: Any


@position_error.register(ByLaws)
def error_by_laws(way, t, y):
    call_law(way.laws[GAP], t, y, way.p, way.at)
    return way.at[0], 0


@correct_positions.register(ByLaws)
def correct_by_laws(way, t, y, lines):
    call_law(way.laws[POSITION], t, y, way.p, way.at)
    copy(way.n, y, way.at)


@helper
def project(laws, setting, n, t, y, p, work):
    """y with unit quaternions on the manifold of the constraints, in place; NaN if out of reach.

    The velocity goes to the nearest admissible one once the position is reached.
    """
    at, length = part(work, AT * n), setting[LENGTH]
    worst, _ = return_to_positions(ByLaws(laws, p, at, n), t, y, length, NEAR)
    if not worst <= LOST * length:
        y[0] = math.nan
    call_law(laws[VELOCITY], t, y, p, at)
    copy(n, y, at)


@helper
def settle(laws, setting, n, t, y, p, work):
    """y brought back to where it belongs, in place."""
    if laws[BACK]:
        at = part(work, AT * n)  # and into the row after it, DY: the increment is used up
        call_law(laws[BACK], t, y, p, at)
        if at[n] <= NEAR * setting[LENGTH]:
            copy(n, y, at)
            return
    if laws[SETTLE]:
        call_law(laws[SETTLE], t, y, p, part(work, AT * n))
        copy(n, y, part(work, AT * n))
    if laws[POSITION]:
        project(laws, setting, n, t, y, p, work)
