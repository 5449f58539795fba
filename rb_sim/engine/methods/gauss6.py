"""Gauss collocation of order 6 (3 stages): the structure-preserving method for long runs.

Symplectic and symmetric; it keeps every quadratic invariant of the equations exactly (Hairer,
Lubich, Wanner, Geometric Numerical Integration, section IV.2): |q|^2, and since the height of a
body point is quadratic in q, the energy of a free body and of a heavy top; elsewhere the energy
error stays bounded.  The stages are found by fixed-point iteration to round-off, so the step must
resolve the fastest motion (it converges for h |df/dy| below about 1).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from rb_sim.engine.methods.method import AT, DY, FRESH, increment
from rb_sim.engine.methods.tuples import compile_source, copy, linear, unpacked, vector
from rb_sim.engine.system import rate, rate_into
from rb_sim.maths.jit import by_type

R15 = math.sqrt(15.0)
A = (
    (5 / 36, 2 / 9 - R15 / 15, 5 / 36 - R15 / 30),
    (5 / 36 + R15 / 24, 2 / 9, 5 / 36 - R15 / 24),
    (5 / 36 + R15 / 30, 2 / 9 + R15 / 15, 5 / 36),
)
B = (5 / 18, 4 / 9, 5 / 18)
C = (0.5 - R15 / 10, 0.5, 0.5 + R15 / 10)
ITERATIONS = 50
ROUND_OFF = 4e-16


class Gauss6(NamedTuple):
    """Fixed step [s]."""

    step: float


def _step(system, t, y, h, work):
    """The increment of one Gauss step; NaN where the iteration does not converge."""


def _of_tuple(n: int) -> Any:
    lines = ["def implementation(system, t, y, h, work):", unpacked("y", n, "y")]
    lines.append(unpacked("k0", n, "rate(system, t, y)"))
    lines += [unpacked(f"k{i}", n, vector(n, lambda j: f"k0_{j}")) for i in (1, 2)]
    lines += ["    last = inf", f"    for sweep in range({ITERATIONS}):"]
    for i in range(3):
        row = list(enumerate(A[i]))
        at = vector(n, lambda j, row=row: f"y_{j} + h*({linear(row, j)})")
        lines.append("    " + unpacked(f"n{i}", n, f"rate(system, t + {C[i]!r}*h, {at})"))
    lines.append("        change = 0.0")
    for j in range(n):
        moved = " + ".join(f"abs(n{i}_{j} - k{i}_{j})" for i in range(3))
        lines.append(f"        change = max(change, h*({moved})/(1.0 + abs(y_{j})))")
    for i in range(3):
        lines.append("    " + unpacked(f"k{i}", n, vector(n, lambda j, i=i: f"n{i}_{j}")))
    lines.append(f"        if change <= {ROUND_OFF!r} or (change >= last and change < 1e-13):")
    weights = list(enumerate(B))
    lines.append(f"            return {vector(n, lambda j: f'h*({linear(weights, j)})')}")
    lines.append("        last = change")
    lines.append(f"    return {vector(n, lambda j: 'nan')}")
    return compile_source("\n".join(lines), "implementation", rate=rate, inf=math.inf, nan=math.nan)


_A, _B, _C = np.array(A), np.array(B), np.array(C)


def _of_array(system, t, y, h, work):
    n = y.shape[0]
    slopes, fresh, at, dy = work, work[FRESH : FRESH + 3], work[AT], work[DY]
    rate_into(system, t, y, slopes[0])
    copy(slopes[1], slopes[0])
    copy(slopes[2], slopes[0])
    last = math.inf
    for _ in range(ITERATIONS):
        change = 0.0
        for i in range(3):
            for m in range(n):
                at[m] = y[m] + h * (
                    _A[i, 0] * slopes[0, m] + _A[i, 1] * slopes[1, m] + _A[i, 2] * slopes[2, m]
                )
            rate_into(system, t + _C[i] * h, at, fresh[i])
        for i in range(3):
            for m in range(n):
                change = max(change, h * abs(fresh[i, m] - slopes[i, m]) / (1.0 + abs(y[m])))
                slopes[i, m] = fresh[i, m]
        if change <= ROUND_OFF or (change >= last and change < 1e-12):
            for m in range(n):
                dy[m] = h * (_B[0] * slopes[0, m] + _B[1] * slopes[1, m] + _B[2] * slopes[2, m])
            return dy
        last = change
    for m in range(n):
        dy[m] = math.nan
    return dy


def _choose(system, t, y, h, work):
    return _of_array if hasattr(y, "ndim") else _of_tuple(len(y))


def _run(system, t, y, h, work):
    return _choose(system, t, y, h, work)(system, t, y, h, work)


step = by_type(_step, _choose, _run)


@increment.register(Gauss6)
def gauss6_increment(method, system, t, y, h, work):
    return step(system, t, y, h, work)
