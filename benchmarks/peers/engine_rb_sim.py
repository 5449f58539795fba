# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""rb_sim itself: every method over its steps or tolerances, through the public interface."""

from __future__ import annotations

import numpy as np

from benchmarks.peers.engine import Run, Samples, Way, steps, tolerances
from benchmarks.peers.scenes import Array, Scene
from rb_sim import Simulation, load_scene
from rb_sim.mechanics.methods import METHODS
from rb_sim.scene.compile import compile_scene

PACKAGE = "rb_sim"
KIND = "rb_sim"


def ways(scene: Scene) -> list[Way]:
    """Every method that suits the scene over its steps or tolerances, and what auto chooses."""
    system = compile_scene(load_scene(scene.path)).system
    able = {name: entry for name, entry in METHODS.items() if entry.suits(system)}
    ladder = steps(scene)
    fixed = [Way(f"{name}/step", ladder) for name, entry in able.items() if entry.fixed]
    ladder = tuple(10.0 ** (-0.5 * n) for n in range(4, 32))
    adaptive = [Way(f"{name}/tolerance", ladder) for name, entry in able.items() if entry.adaptive]
    return [*fixed, *adaptive, Way("auto/tolerance", tolerances(1, 13))]


def build(scene: Scene, method: str, knob: float) -> Run:
    """The scene file with the method and step [s] or tolerance; compiled before it is timed."""
    return _RbSim(scene, method, knob)


class _RbSim(Run):
    def __init__(self, scene: Scene, method: str, knob: float) -> None:
        name, control = method.split("/")
        # the other control is taken out of the file's own choice
        options = {"method": name, "step": None, "tolerance": None, control: knob}
        self._scene = scene
        self._simulation = Simulation(load_scene(scene.path, **options))
        (self._body,) = self._simulation.layout.bodies
        self._simulation.warm()

    def start(self) -> None:
        self._simulation.reset()
        self._end = 0.0

    def advance(self, t: float) -> None:
        self._simulation.advance(t - self._end)
        self._end = t

    def pose(self) -> tuple[Array, Array]:
        state = self._simulation.state
        return np.array(state.position[self._body]), np.array(state.orientation[self._body])

    def samples(self, times: Array) -> Samples:
        self.start()
        # dense output: sampling does not change the steps
        run = self._simulation.run(self._scene.duration, 1.0 / self._scene.interval)
        return Samples(run.t, run.position[self._body], run.orientation[self._body])
