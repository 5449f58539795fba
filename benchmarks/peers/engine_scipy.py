# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""SciPy's integrators on hand-written minimal equations in plain Python."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.peers import equations
from benchmarks.peers.engine import Run, Samples, Way, tolerances
from benchmarks.peers.scenes import Array, Scene

PACKAGE = "scipy"
KIND = "equations"

_FLOATS = equations.Functions(math.sin, math.cos, math.sqrt)


def ways(scene: Scene) -> list[Way]:
    """DOP853 and LSODA over their relative tolerance."""
    forms = list(equations.forms(scene))
    return [Way(f"{m}/{form}", tolerances(3, 13)) for form in forms for m in ("DOP853", "LSODA")]


def build(scene: Scene, method: str, knob: float) -> Run:
    """The equations of `method`, relative and absolute tolerance `knob`."""
    return _Solve(scene, method, knob)


class _Solve(Run):
    def __init__(self, scene: Scene, method: str, tolerance: float) -> None:
        self._scene, self._tolerance = scene, tolerance
        self._method, form = method.split("/")
        self._equations = equations.forms(scene)[form]
        rates = self._equations.rates
        self._rates = lambda t, y: rates(t, y.tolist(), _FLOATS)

    def start(self) -> None:
        self._t, self._y = 0.0, np.array(self._equations.start)

    def advance(self, t: float) -> None:
        self._y = self._solve(t, None).y[:, -1]
        self._t = t

    def pose(self) -> tuple[Array, Array]:
        position, quaternion = self._equations.pose(np.array([self._t]), self._y[None])
        return position[0], quaternion[0]

    def samples(self, times: Array) -> Samples:
        self.start()
        return equations.samples(self._equations, times, self._solve(times[-1], times).y.T)

    def _solve(self, end: float, times: Array | None):
        span, tolerance = (self._t, end), self._tolerance
        return solve_ivp(
            self._rates, span, self._y, self._method, times, rtol=tolerance, atol=tolerance
        )
