# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Commanded wrenches: what is reported of them is what acts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim.base.errors import RbSimError
from rb_sim.scene.compile import compile_scene
from rb_sim.simulation.scene_in_motion import Commands
from tests.interpreted import interpreted

FORCE, TORQUE = [1.0, -2.0, 0.5], [0.3, 0.1, -0.2]
MASS = 1.5


def commanded() -> Any:
    """Two samples, very close, of a body that is turned, under a command in its own axes."""
    from rb_sim import Simulation, load_scene

    body = {
        "mass": MASS,
        "inertia": [0.2, 0.2, 0.2],
        "orientation": {"axis": [1.0, 2.0, 2.0], "angle": 1.1},
    }
    scene = {
        "bodies": {"b": body},
        "effects": {"hand": {"type": "commanded_wrench", "body": "b"}},
        "simulation": {"duration": 1.0, "tolerance": 1e-12},
    }
    simulation = Simulation(load_scene(scene))
    simulation.apply_wrench("b", FORCE, TORQUE, "body")
    return simulation.run(1e-6, 1e6).block


def test_a_command_in_body_axes_is_reported_in_the_worlds() -> None:
    block = interpreted(commanded)
    turn = Rotation.from_rotvec(1.1 / 3.0 * np.array([1.0, 2.0, 2.0]))
    assert_allclose(block.command[0, 0], [*turn.apply(FORCE), *turn.apply(TORQUE)], rtol=1e-12)
    push = MASS * (block.linear_velocity[1, 0] - block.linear_velocity[0, 0]) / 1e-6
    assert_allclose(push, block.command[0, 0, :3], rtol=1e-6)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1e101, 1e300])
def test_what_no_double_can_square_is_no_command(value: float) -> None:
    """A box on the ground stayed as if nothing pushed it with 1e155 N."""
    from rb_sim import load_scene

    box = {"mass": 1.0, "inertia": [0.1, 0.1, 0.1]}
    hand = {"hand": {"type": "commanded_wrench", "body": "box"}}
    commands = Commands(compile_scene(load_scene({"bodies": {"box": box}, "effects": hand})))
    for force, torque in (([0.0, value, 0.0], [0.0] * 3), ([0.0] * 3, [value, 0.0, 0.0])):
        with pytest.raises(RbSimError, match=r"must be 3 finite numbers, none beyond 1e\+100"):
            commands.read("box", force, torque, "world")
    assert commands.read("box", [1e100] * 3, [0.0] * 3, "world").force_W == (1e100,) * 3


def recorded() -> list[tuple[float, str, tuple[float, ...]]]:
    """The commands of a run in which the same one came three times, and its motion's energy."""
    from rb_sim import Simulation, load_scene

    box = {"mass": 1.0, "inertia": [0.1, 0.1, 0.1]}
    hand = {"hand": {"type": "commanded_wrench", "body": "box"}}
    simulation = Simulation(load_scene({"bodies": {"box": box}, "effects": hand}))
    given = []
    for _ in range(3):
        simulation.apply_wrench("box", [2.0, 0.0, 0.0], [0.0] * 3)
        given += simulation.take_inputs()
        simulation.advance(0.1)
    return [(one.t, one.body, one.force) for one in given]


def test_a_command_that_is_in_force_already_is_recorded_with_its_time() -> None:
    """A bag has commands as they came."""
    found = interpreted(recorded)
    assert [one[1:] for one in found] == [("box", (2.0, 0.0, 0.0))] * 3
    assert_allclose([one[0] for one in found], [0.0, 0.1, 0.2], rtol=1e-12)
