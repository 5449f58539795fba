# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Laws are kept for equal systems, and for these alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.many_body_scenes import chain
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping
from rb_sim.simulation.simulation import Simulation


def laws_of(scene: dict[str, Any]) -> Any:
    return compile_scene(scene_from_mapping(scene)).laws


def heavier(scene: dict[str, Any]) -> dict[str, Any]:
    """The scene with one mass that differs in its last bit."""
    bodies = scene["bodies"]
    bodies["b0"]["mass"] = float(np.nextafter(bodies["b0"]["mass"], 2.0))
    return scene


@pytest.mark.parametrize("links", [1, 2])
def test_the_same_scene_has_the_same_laws_whatever_its_method(links):
    first = laws_of(chain(links))
    other = chain(links)
    other["simulation"] = {"duration": 1.0, "rate": 7.0, "method": "taylor", "tolerance": 1e-9}
    assert laws_of(other) is first
    assert laws_of(heavier(chain(links))) is not first


def test_commands_of_one_run_do_not_reach_another_of_the_same_scene():
    scene = chain(2, duration=0.05)
    scene["effects"]["hand"] = {"type": "commanded_wrench", "body": "b1"}
    alone = Simulation(scene_from_mapping(scene)).run(watched=False).position["b1"]
    pushed, still = (Simulation(scene_from_mapping(scene)) for _ in range(2))
    pushed.apply_wrench("b1", force=[3.0, 2.0, 1.0], torque=[0.0, 0.0, 0.0])
    for _ in range(5):
        pushed.advance(0.01)
        still.advance(0.01)
    assert abs(pushed.sample().position["b1"][0] - alone[-1]).max() > 1e-4
    assert_allclose(still.sample().position["b1"][0], alone[-1], atol=1e-15)
