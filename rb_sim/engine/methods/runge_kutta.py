"""Explicit Runge-Kutta steps for any tableau (Hairer, Norsett, Wanner I, section II.1)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rb_sim.engine.methods.tuples import compile_source, linear, vector
from rb_sim.engine.system import rate, rate_into
from rb_sim.maths.jit import by_type, inline


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
    """Source lines that compute the slopes k0 ... k<s-1> for a tuple y of length n."""
    lines = ["    k0 = rate(system, t, y)"]
    for i in range(1, len(tableau.b)):
        row = terms(tableau.a[i])
        at = vector(n, lambda j, row=row: f"y[{j}] + h*({linear(row, j)})")
        lines.append(f"    k{i} = rate(system, t + {tableau.c[i]!r}*h, {at})")
    return lines


def tuple_step(tableau: Tableau, n: int, with_errors: bool) -> Any:
    """Generated step for a tuple of length n: the increment, and the error vectors if asked."""
    lines = ["def implementation(system, t, y, h, work):", *stage_lines(tableau, n)]
    results = [tableau.b, *(tableau.errors if with_errors else ())]
    vectors = [vector(n, lambda i, w=w: f"h*({linear(terms(w), i)})") for w in results]
    lines.append(f"    return {', '.join(vectors)}")
    return compile_source("\n".join(lines), "implementation", rate=rate)


def array_step(tableau: Tableau, with_errors: bool) -> Any:
    """Step for an array y with the slopes in work.slopes and the increment in work.dy."""
    s = len(tableau.b)
    a = np.zeros((s, s))
    for i, row in enumerate(tableau.a):
        a[i, : len(row)] = row
    b, c = np.array(tableau.b), np.array(tableau.c)
    weights = np.array(tableau.errors) if with_errors else np.zeros((0, s))

    def implementation(system, t, y, h, work):
        n = y.shape[0]
        slopes, at, dy = work.slopes, work.at, work.dy
        for i in range(s):
            at[:] = y
            for j in range(i):
                if a[i, j] != 0.0:
                    for m in range(n):
                        at[m] += h * a[i, j] * slopes[j, m]
            rate_into(system, t + c[i] * h, at, slopes[i])
        dy[:] = 0.0
        for j in range(s):
            if b[j] != 0.0:
                for m in range(n):
                    dy[m] += h * b[j] * slopes[j, m]
        for e in range(weights.shape[0]):
            work.errors[e, :] = 0.0
            for j in range(s):
                if weights[e, j] != 0.0:
                    for m in range(n):
                        work.errors[e, m] += h * weights[e, j] * slopes[j, m]
        return dy

    return implementation


def _step(system, t, y, h, work):
    """One Runge-Kutta step: the increment, followed by the error vectors if asked for."""


def runge_kutta(tableau: Tableau, with_errors: bool = False) -> Any:
    """step(system, t, y, h, work) for this tableau.

    For a tuple y it returns the increment (a tuple of the increment and the error vectors if
    with_errors); for an array it fills work.dy and work.errors.
    """
    of_array = array_step(tableau, with_errors)
    of_tuple: dict[int, Any] = {}

    def choose(system, t, y, h, work):
        if hasattr(y, "ndim"):
            return of_array
        n = len(y)
        if n not in of_tuple:
            of_tuple[n] = tuple_step(tableau, n, with_errors)
        return of_tuple[n]

    def run(system, t, y, h, work):
        return choose(system, t, y, h, work)(system, t, y, h, work)

    return by_type(_step, choose, run, fused=False)


@inline
def scaled_norm2(dy_error, y, dy, tolerance):
    """sum of squares of error_i / (tolerance max(1, |y_i|, |y_i + dy_i|)), for arrays and tuples."""
    total = 0.0
    for i in range(len(y)):
        size = max(1.0, abs(y[i]), abs(y[i] + dy[i]))
        ratio = dy_error[i] / (tolerance * size)
        total += ratio * ratio
    return total
