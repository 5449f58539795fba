# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The classical Runge-Kutta method of order 4 (Kutta 1901)."""

from __future__ import annotations

from typing import NamedTuple

from rb_sim.integrate.layout import AT, SLOPES
from rb_sim.numerics.kernels import call_law, part, step

# Step of the classical Runge-Kutta method.


@step(4)
def rk4(law, jacobian, n, t, y, h, p, dy, work):
    """Write the change of y over one step into dy; returns 0, as there is no error estimate.

    law: address of (t, y, p, dy/dt); work: workspace of n numbers a row.
    """
    at = part(work, AT * n)
    k1, k2 = part(work, SLOPES * n), part(work, (SLOPES + 1) * n)
    k3, k4 = part(work, (SLOPES + 2) * n), part(work, (SLOPES + 3) * n)
    half, sixth = 0.5 * h, h / 6.0
    call_law(law, t, y, p, k1)
    for i in range(n):
        at[i] = y[i] + half * k1[i]
    call_law(law, t + half, at, p, k2)
    for i in range(n):
        at[i] = y[i] + half * k2[i]
    call_law(law, t + half, at, p, k3)
    for i in range(n):
        at[i] = y[i] + h * k3[i]
    call_law(law, t + h, at, p, k4)
    for i in range(n):
        dy[i] = sixth * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i])
    return 0.0


@rk4.on_tuples
def rk4_traced(rate, t, y, h, velocities):
    """The step on tuples, for traced laws: (change of y, 0)."""
    half = 0.5 * h
    k1 = rate(t, y)
    k2 = rate(t + half, tuple(a + half * k for a, k in zip(y, k1, strict=True)))
    k3 = rate(t + half, tuple(a + half * k for a, k in zip(y, k2, strict=True)))
    k4 = rate(t + h, tuple(a + h * k for a, k in zip(y, k3, strict=True)))
    sixth = h / 6.0
    slopes = zip(k1, k2, k3, k4, strict=True)
    return tuple(sixth * (a + 2.0 * (b + c) + d) for a, b, c, d in slopes), 0.0


class Rk4(NamedTuple):
    """Classical Runge-Kutta method with a fixed step [s]."""

    step: float
