"""Dormand-Prince 8(5,3) (Hairer, Norsett, Wanner I, section II.10): increment and its error."""

from __future__ import annotations

import math

import numpy as np

from rb_sim.graph.functions import maximum, sqrt, where
from rb_sim.loops.compiled import call_law, part, step
from rb_sim.loops.methods import dopri853_coefficients as published
from rb_sim.loops.rows import AT, SLOPES, size_of

STAGES = 12
A = np.zeros((STAGES, STAGES))
for _i, _row in enumerate(published.A):
    A[_i, : len(_row)] = _row
B, C = np.array(published.B), np.array(published.C)
E5, E3 = np.array(published.E5), np.array(published.E3)
OVERFLOWS = 1e300
"""Sum of squares of estimates from which on their quotient, over infinity, would be no error."""


@step(STAGES)
def dopri853(law, jacobian, n, t, y, h, p, dy, work):
    """The estimate of DOP853, e5^2 / sqrt(e5^2 + e3^2 / 100), root mean square over y.

    Each coordinate's error is relative to max(1, |y_i|), or less where it moves by little.
    """
    at, k = part(work, AT * n), part(work, SLOPES * n)
    call_law(law, t, y, p, k)
    for i in range(1, STAGES):
        for m in range(n):
            at[m] = A[i, 0] * k[m]
        for j in range(1, i):
            a = A[i, j]
            if a != 0.0:
                for m in range(n):
                    at[m] += a * k[j * n + m]
        for m in range(n):
            at[m] = y[m] + h * at[m]
        call_law(law, t + C[i] * h, at, p, part(k, i * n))
    e5, e3 = 0.0, 0.0
    for m in range(n):
        s, s5, s3 = 0.0, 0.0, 0.0
        for j in range(STAGES):
            s += B[j] * k[j * n + m]
            s5 += E5[j] * k[j * n + m]
            s3 += E3[j] * k[j * n + m]
        dy[m] = h * s
        scale = h / size_of(n, y, work, m)
        e5 += (scale * s5) ** 2
        e3 += (scale * s3) ** 2
    if e5 == 0.0 and e3 == 0.0:
        return 0.0
    total = e5 + 0.01 * e3
    return e5 / math.sqrt(total * n) if total < OVERFLOWS else OVERFLOWS


def combination(weights, slopes):
    """For each coordinate the weighted sum of its slopes."""
    terms = [(float(w), k) for w, k in zip(weights, slopes, strict=False) if w != 0.0]
    sums = [0.0] * len(slopes[0])
    for w, k in terms:
        sums = [s + w * x for s, x in zip(sums, k, strict=True)]
    return sums


@dopri853.on_tuples
def dopri853_traced(rate, t, y, h, velocities):
    slopes = [rate(t, y)]
    for i in range(1, STAGES):
        move = combination(A[i], slopes)
        at = tuple(a + h * m for a, m in zip(y, move, strict=True))
        slopes.append(rate(t + float(C[i]) * h, at))
    dy = tuple(h * m for m in combination(B, slopes))
    e5, e3 = 0.0, 0.0
    estimates = zip(y, combination(E5, slopes), combination(E3, slopes), strict=True)
    for a, s5, s3 in estimates:
        scale = h / maximum(1.0, abs(a))
        e5, e3 = e5 + (scale * s5) ** 2, e3 + (scale * s3) ** 2
    total = e5 + 0.01 * e3
    none = total <= 0.0
    error = where(none, 0.0, e5 / sqrt(where(none, 1.0, total) * len(y)))
    return dy, where(total < OVERFLOWS, error, OVERFLOWS)
