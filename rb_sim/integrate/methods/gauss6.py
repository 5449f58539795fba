# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Gauss collocation of order 6 (3 stages): structure-preserving, for long runs.

Symplectic and symmetric; it keeps every quadratic invariant of the equations exactly (Hairer,
Lubich, Wanner, Geometric Numerical Integration, section IV.2): |q|^2, and since the height of a
body point is quadratic in q, the energy of a free body and of a heavy top; for other systems the
energy error stays bounded.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rb_sim.base.rounding import COMPUTED_ROUNDING, TWO_ULPS
from rb_sim.integrate.layout import AT, SLOPES
from rb_sim.integrate.methods.collocation import STALLED as CONVERGED
from rb_sim.integrate.methods.collocation import Z, find_stages, transformed
from rb_sim.numerics.kernels import call_law, part, step

# Gauss collocation of order 6 with three stages, by fixed-point iteration up to rounding (Hairer,
# Lubich, Wanner, Geometric Numerical Integration, section IV.2).


R15 = math.sqrt(15.0)
A = np.array(
    (
        (5 / 36, 2 / 9 - R15 / 15, 5 / 36 - R15 / 30),
        (5 / 36 + R15 / 24, 2 / 9, 5 / 36 - R15 / 24),
        (5 / 36 + R15 / 30, 2 / 9 + R15 / 15, 5 / 36),
    )
)
B = np.array((5 / 18, 4 / 9, 5 / 18))
C = np.array((0.5 - R15 / 10, 0.5, 0.5 + R15 / 10))
VALUES, BASIS, INVERSE = transformed(A)
END = B @ np.linalg.inv(A)
"""Weights of the stages in dy: h b^T F with F = A^-1 Z / h, free of the rounding of a stiff law."""
ITERATIONS = 50
GAIN = 0.5
"""Ratio of a sweep's change to the previous one up to which the fixed-point iteration goes on."""
MOST_COORDINATES = 26
"""Most coordinates with Newton's method (two bodies): a larger Jacobian takes too long to compile
for a method that seldom needs it (radau5 always does)."""


@step(3, implicit=MOST_COORDINATES)
def gauss6(law, jacobian, n, t, y, h, p, dy, work):
    """Step by fixed-point iteration; Newton's method if that converges slowly; NaN if both fail."""
    at, k, fresh = part(work, AT * n), part(work, SLOPES * n), part(work, (SLOPES + 3) * n)
    call_law(law, t, y, p, k)
    for m in range(n):
        k[n + m] = k[m]
        k[2 * n + m] = k[m]
    last = math.inf
    for _ in range(ITERATIONS):
        for i in range(3):
            for m in range(n):
                slope = A[i, 0] * k[m] + A[i, 1] * k[n + m] + A[i, 2] * k[2 * n + m]
                at[m] = y[m] + h * slope
            call_law(law, t + C[i] * h, at, p, part(fresh, i * n))
        change = 0.0
        for m in range(n):
            moved = 0.0
            for i in range(3):
                moved += abs(fresh[i * n + m] - k[i * n + m])
                k[i * n + m] = fresh[i * n + m]
            change = max(change, h * moved / (1.0 + abs(y[m])))
        if change <= TWO_ULPS or (change >= last and change < COMPUTED_ROUNDING):
            for m in range(n):
                dy[m] = h * (B[0] * k[m] + B[1] * k[n + m] + B[2] * k[2 * n + m])
            return 0.0
        if jacobian and not change <= GAIN * last and not change < COMPUTED_ROUNDING:
            break
        last = change
    if jacobian and find_stages(
        law, jacobian, C, VALUES, BASIS, INVERSE, n, t, y, h, p, work, CONVERGED
    ):
        z = part(work, Z * n)
        for m in range(n):
            dy[m] = END[0] * z[m] + END[1] * z[n + m] + END[2] * z[2 * n + m]
        return 0.0
    for m in range(n):
        dy[m] = math.nan
    return 0.0


class Gauss6(NamedTuple):
    """Gauss collocation with a fixed step [s]."""

    step: float
