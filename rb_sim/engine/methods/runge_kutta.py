"""Explicit Runge-Kutta steps for any tableau (Hairer, Norsett, Wanner I, section II.1)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rb_sim.engine.methods.method import AT, DY
from rb_sim.engine.methods.tuples import compile_source, copy, linear, unpacked, vector
from rb_sim.engine.system import rate, rate_into
from rb_sim.maths.jit import by_type, plain


class Tableau(NamedTuple):
    """Coefficients of an explicit method of s stages."""

    order: int
    a: tuple[tuple[float, ...], ...]
    """strictly lower triangle, row i has i entries."""
    b: tuple[float, ...]
    c: tuple[float, ...]
    errors: tuple[tuple[float, ...], ...] = ()
    """weights of the embedded error estimates, if any."""


def terms(row: tuple[float, ...]) -> list[tuple[int, float]]:
    return [(j, float(value)) for j, value in enumerate(row) if value != 0.0]


def stage_lines(tableau: Tableau, n: int) -> list[str]:
    """Source lines that compute the slopes k<stage>_<i> for a tuple y of length n."""
    lines = [unpacked("y", n, "y"), unpacked("k0", n, "rate(system, t, y)")]
    for i in range(1, len(tableau.b)):
        row = terms(tableau.a[i])
        at = vector(n, lambda j, row=row: f"y_{j} + h*({linear(row, j)})")
        lines.append(unpacked(f"k{i}", n, f"rate(system, t + {tableau.c[i]!r}*h, {at})"))
    return lines


def tuple_step(tableau: Tableau, n: int) -> Any:
    """Generated step for a tuple of length n: the increment."""
    lines = ["def implementation(system, t, y, h, work):", *stage_lines(tableau, n)]
    lines.append(f"    return {vector(n, lambda i: f'h*({linear(terms(tableau.b), i)})')}")
    return compile_source("\n".join(lines), "implementation", rate=rate)


def tuple_attempt(tableau: Tableau, n: int) -> Any:
    """Generated step with error estimates for a tuple of length n.

    Returns the increment and, for each estimate, the sum of squares of
    error_i / max(1, |y_i|).
    """
    lines = ["def implementation(system, t, y, h, work):", *stage_lines(tableau, n)]
    for i in range(n):
        lines.append(f"    d_{i} = h*({linear(terms(tableau.b), i)})")
        lines.append(f"    scale_{i} = h / max(1.0, abs(y_{i}))")
    sums = []
    for weights in tableau.errors:
        name = f"e{len(sums)}"
        for i in range(n):
            lines.append(f"    {name}_{i} = scale_{i}*({linear(terms(weights), i)})")
        sums.append(" + ".join(f"{name}_{i}*{name}_{i}" for i in range(n)))
    lines.append(f"    return {vector(n, lambda i: f'd_{i}')}, {', '.join(sums)}")
    return compile_source("\n".join(lines), "implementation", rate=rate)


def array_slopes(tableau: Tableau) -> Any:
    """Stages for an array y: slopes and increment in rows of work; a call of its own."""
    s = len(tableau.b)
    a = np.zeros((s, s))
    for i, row in enumerate(tableau.a):
        a[i, : len(row)] = row
    b, c = np.array(tableau.b), np.array(tableau.c)

    def implementation(system, t, y, h, work):
        n = y.shape[0]
        at, dy = work[AT], work[DY]
        for i in range(s):
            copy(at, y)
            for j in range(i):
                if a[i, j] != 0.0:
                    for m in range(n):
                        at[m] += h * a[i, j] * work[j, m]
            rate_into(system, t + c[i] * h, at, work[i])
        for m in range(n):
            dy[m] = 0.0
        for j in range(s):
            if b[j] != 0.0:
                for m in range(n):
                    dy[m] += h * b[j] * work[j, m]
        return dy

    return plain(implementation)


def array_attempt(tableau: Tableau) -> Any:
    """As tuple_attempt, for an array y and two estimates."""
    stages = array_slopes(tableau)
    s = len(tableau.b)
    first, second = (np.array(weights) for weights in tableau.errors)

    def implementation(system, t, y, h, work):
        dy = stages(system, t, y, h, work)
        total_1, total_2 = 0.0, 0.0
        for m in range(y.shape[0]):
            e1, e2 = 0.0, 0.0
            for j in range(s):
                e1 += first[j] * work[j, m]
                e2 += second[j] * work[j, m]
            scale = h / max(1.0, abs(y[m]))
            total_1 += (scale * e1) ** 2
            total_2 += (scale * e2) ** 2
        return dy, total_1, total_2

    return plain(implementation)


def _step(system, t, y, h, work):
    """One Runge-Kutta step: the increment (an array fills work[DY])."""


def _by_length(stub: Any, of_array: Any, of_tuple: Any) -> Any:
    """by_type on whether y is an array or a tuple of some length."""
    generated: dict[int, Any] = {}

    def call(system, t, y, h, work):
        return of_array(system, t, y, h, work)

    def choose(system, t, y, h, work):
        if hasattr(y, "ndim"):
            return call
        n = len(y)
        if n not in generated:
            generated[n] = of_tuple(n)
        return generated[n]

    def run(system, t, y, h, work):
        return choose(system, t, y, h, work)(system, t, y, h, work)

    return by_type(stub, choose, run)


def runge_kutta(tableau: Tableau) -> Any:
    """step(system, t, y, h, work) -> increment, for this tableau."""
    return _by_length(_step, array_slopes(tableau), lambda n: tuple_step(tableau, n))


def embedded_runge_kutta(tableau: Tableau) -> Any:
    """step(system, t, y, h, work) -> (increment, e1, e2) with the squared error estimates."""
    return _by_length(_step, array_attempt(tableau), lambda n: tuple_attempt(tableau, n))
