# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Semi-implicit (symplectic) Euler method, order 1: common in game engines, kept as the baseline.

Velocities first, v1 = v0 + h a(q0, v0), then the configuration with the new velocities.
"""

from __future__ import annotations

from typing import NamedTuple

from rb_sim.integrate.layout import AT, IS_VELOCITY, SLOPES
from rb_sim.numerics.kernels import call_law, part, step

# Semi-implicit (symplectic) Euler: v1 = v0 + h a(q0, v0), then q with the new velocities.


@step(2)
def euler(law, jacobian, n, t, y, h, p, dy, work):
    """Write the change of y over one step into dy; returns 0, as there is no error estimate.

    law: address of (t, y, p, dy/dt); work: workspace of n numbers a row.
    """
    first, at = part(work, SLOPES * n), part(work, AT * n)
    call_law(law, t, y, p, first)
    for i in range(n):
        dy[i] = h * first[i]
        at[i] = y[i]
        if work[IS_VELOCITY * n + i] != 0.0:
            at[i] += dy[i]
    call_law(law, t, at, p, first)
    for i in range(n):
        if work[IS_VELOCITY * n + i] == 0.0:
            dy[i] = h * first[i]
    return 0.0


@euler.on_tuples
def euler_traced(rate, t, y, h, velocities):
    """The step on tuples, for traced laws: (change of y, 0)."""
    first = rate(t, y)
    at = tuple(a + h * k if v else a for a, k, v in zip(y, first, velocities, strict=True))
    last = rate(t, at)
    slopes = zip(first, last, velocities, strict=True)
    return tuple(h * (a if v else b) for a, b, v in slopes), 0.0


class Euler(NamedTuple):
    """Semi-implicit Euler with a fixed step [s]."""

    step: float
