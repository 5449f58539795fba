# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""heyoka's compiled Taylor integrator on hand-written minimal equations: the speed limit."""

from __future__ import annotations

import heyoka
import numpy as np

from benchmarks.peers import equations
from benchmarks.peers.engine import Run, Samples, Way
from benchmarks.peers.scenes import Array, Scene

PACKAGE = "heyoka"
KIND = "equations"

_SYMBOLS = equations.Functions(heyoka.sin, heyoka.cos, heyoka.sqrt)


def ways(scene: Scene) -> list[Way]:
    """The Taylor method over its tolerance; its order grows as the tolerance shrinks."""
    ladder = tuple(10.0 ** (-0.5 * n) for n in range(2, 32))
    return [Way(f"Taylor/{form}", ladder) for form in equations.forms(scene)]


def build(scene: Scene, method: str, knob: float) -> Run:
    """Compile the integrator of the form named by `method` for tolerance `knob`."""
    return _Taylor(scene, method.split("/")[1], knob)


class _Taylor(Run):
    def __init__(self, scene: Scene, form: str, tolerance: float) -> None:
        self._equations = equations.forms(scene)[form]
        start = self._equations.start
        variables = heyoka.make_vars(*[f"y{n}" for n in range(len(start))])
        rates = self._equations.rates(heyoka.time, variables, _SYMBOLS)
        system = list(zip(variables, rates, strict=True))
        self._integrator = heyoka.taylor_adaptive(system, start, tol=tolerance)

    def start(self) -> None:
        self._integrator.time = 0.0
        self._integrator.state[:] = self._equations.start

    def advance(self, t: float) -> None:
        self._integrator.propagate_until(t)

    def pose(self) -> tuple[Array, Array]:
        t, y = np.array([self._integrator.time]), self._integrator.state[None]
        position, quaternion = self._equations.pose(t, y)
        return position[0], quaternion[0]

    def samples(self, times: Array) -> Samples:
        self.start()
        states = self._integrator.propagate_grid(times)[-1]
        return equations.samples(self._equations, times, states)
