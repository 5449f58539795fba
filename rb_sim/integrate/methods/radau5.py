# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Radau IIA of order 5: L-stable, for stiff springs, strong damping and extreme mass ratios.

It needs the Jacobian of traced laws.
"""

from __future__ import annotations

import math
import sys
from typing import NamedTuple

import numpy as np

from rb_sim.integrate.layout import AT, size_of
from rb_sim.integrate.methods.collocation import (
    MATRICES,
    ORDER_1,
    RIGHT,
    STALLED,
    F,
    Z,
    find_stages,
    solve_factored,
    transformed,
)
from rb_sim.numerics.kernels import call_law, part, step

# Radau IIA of order 5 with three stages: L-stable, so that decayed components do not limit the
# step.
#
# Hairer & Wanner, Solving Ordinary Differential Equations II, section IV.8: stages by simplified
# Newton with one real and one complex factorisation a step, and the error estimate filtered twice
# by the real one (equations 8.20 and 8.21), which stays bounded for any stiffness.


R6 = math.sqrt(6.0)
A = (
    ((88 - 7 * R6) / 360, (296 - 169 * R6) / 1800, (-2 + 3 * R6) / 225),
    ((296 + 169 * R6) / 1800, (88 + 7 * R6) / 360, (-2 - 3 * R6) / 225),
    ((16 - R6) / 36, (16 + R6) / 36, 1 / 9),
)
C = np.array(((4 - R6) / 10, (4 + R6) / 10, 1.0))
VALUES, BASIS, INVERSE = transformed(A)
E = np.array((-(13 + 7 * R6) / 3, (-13 + 7 * R6) / 3, -1 / 3))
"""Weights of the stages in the error estimate, times 1 / gamma_0 (equation 8.19)."""


SLIPS_STALLED = 1e-13
"""As STALLED, for slow slips whose direction follows from their velocity: they are differences
of velocities up to 1e10 times larger."""


@step(8, implicit=sys.maxsize)
def radau5(law, jacobian, n, t, y, h, p, dy, work):
    """Step with an error estimate of order 3: root mean square over y, relative as that of
    dopri853."""
    return radau(law, jacobian, n, t, y, h, p, dy, work, STALLED)


@step(8, implicit=sys.maxsize)
def radau5_of_slips(law, jacobian, n, t, y, h, p, dy, work):
    """As radau5, for bodies in contact with slow slip."""
    return radau(law, jacobian, n, t, y, h, p, dy, work, SLIPS_STALLED)


def radau(law, jacobian, n, t, y, h, p, dy, work, stalled):
    """Write one step into dy; returns its error. stalled: as in `find_stages`."""
    if not find_stages(law, jacobian, C, VALUES, BASIS, INVERSE, n, t, y, h, p, work, stalled):
        for m in range(n):
            dy[m] = math.nan
        return math.inf
    at, slope, x, z = (
        part(work, AT * n),
        part(work, F * n),
        part(work, RIGHT * n),
        part(work, Z * n),
    )
    call_law(law, t, y, p, slope)
    error = 0.0
    for _ in range(2):
        for m in range(n):
            estimate = E[0] * z[m] + E[1] * z[n + m] + E[2] * z[2 * n + m]
            x[m] = slope[m] + estimate / h
        solve_factored(n, part(work, MATRICES * n), part(work, ORDER_1 * n), x)
        error = 0.0
        for m in range(n):
            at[m] = y[m] + x[m]
            error += (x[m] / size_of(n, y, work, m)) ** 2
        call_law(law, t, at, p, slope)
    for m in range(n):
        dy[m] = z[2 * n + m]
    return math.sqrt(error / n)


class Radau5(NamedTuple):
    """Radau IIA with a fixed step [s]."""

    step: float


class AdaptiveRadau5(NamedTuple):
    """Radau IIA with steps by a local tolerance, relative to max(1, |y|) of each coordinate;
    largest step [s]."""

    tolerance: float
    largest_step: float
