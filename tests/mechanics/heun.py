# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Heun's method of order 2 (1900): what somebody adds as a method, one file and one line."""

from __future__ import annotations

from typing import NamedTuple

from rb_sim.integrate.layout import AT, SLOPES
from rb_sim.numerics.kernels import call_law, part, step


class Heun(NamedTuple):
    """Fixed step [s]."""

    step: float


@step(2)
def heun(law, jacobian, n, t, y, h, p, dy, work):
    """dy = h (f(t, y) + f(t + h, y + h f(t, y))) / 2."""
    at, first, second = part(work, AT * n), part(work, SLOPES * n), part(work, (SLOPES + 1) * n)
    call_law(law, t, y, p, first)
    for i in range(n):
        at[i] = y[i] + h * first[i]
    call_law(law, t + h, at, p, second)
    for i in range(n):
        dy[i] = 0.5 * h * (first[i] + second[i])
    return 0.0
