# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""States set in the middle of a run, against runs that start there and against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim import Simulation
from rb_sim.base.errors import RbSimError
from rb_sim.scene.load import scene_from_mapping

PENDULUM = {
    "bodies": {"rod": {"mass": 1.0, "shape": {"type": "rod", "length": 1.0, "axis_B": [1, 0, 0]}}},
    "constraints": {
        "hinge": {
            "type": "fixed_axis", "body": "rod", "point_B": [-0.5, 0, 0], "axis_B": [0, 1, 0],
            "point_A": [-0.5, 0, 0], "axis_A": [0, 1, 0],
        },
    },
    "effects": {
        "weight": {"type": "gravity"}, "drive": {"type": "commanded_wrench", "body": "rod"},
    },
    "simulation": {"method": "rk4", "step": 1e-3},
}  # fmt: skip
ANGLE, RATE = 0.3, 2.0


def there() -> dict[str, list[float]]:
    """The pendulum turned by ANGLE about y, turning at RATE."""
    arm = 0.5 * np.array([np.cos(ANGLE), 0.0, -np.sin(ANGLE)])
    return {
        "position": (arm - [0.5, 0, 0]).tolist(),
        "orientation": [0.0, np.sin(ANGLE / 2), 0.0, np.cos(ANGLE / 2)],
        "linear_velocity": np.cross([0.0, RATE, 0.0], arm).tolist(),
        "angular_velocity": [0.0, RATE, 0.0],
    }


def test_a_pendulum_goes_on_as_one_that_starts_there():
    simulation = Simulation(scene_from_mapping(PENDULUM))
    simulation.advance(0.4)
    simulation.set_state({"rod": there()})
    rod = PENDULUM["bodies"]["rod"] | there()
    fresh = Simulation(scene_from_mapping(PENDULUM | {"bodies": {"rod": rod}}))
    for torque in (0.0, 3.0):
        for one in (simulation, fresh):
            one.apply_wrench("rod", [0, 0, 0], [0, torque, 0])
            one.advance(0.35)
        assert simulation.time == pytest.approx(fresh.time + 0.4)
        a, b = simulation.state, fresh.state
        np.testing.assert_allclose(a.position["rod"], b.position["rod"], atol=1e-11)
        np.testing.assert_allclose(a.angular_velocity["rod"], b.angular_velocity["rod"], atol=1e-10)
        one, other = simulation.sample().reaction["hinge"], fresh.sample().reaction["hinge"]
        np.testing.assert_allclose(one.force, other.force, atol=1e-9)
    simulation.reset()
    assert simulation.time == 0.0
    np.testing.assert_allclose(simulation.state.position["rod"], np.zeros(3), atol=1e-15)


@pytest.mark.parametrize(
    ("bodies", "words"),
    [
        ({"moon": {}}, "must be one or more of rod"),
        ({}, "must be one or more of rod"),
        ({"rod": {"speed": [0, 0, 0]}}, "rod: got 'speed'; must be one of position"),
        ({"rod": {"position": [0, 0]}}, "rod.position: got"),
        ({"rod": {"linear_velocity": [0, 0, 1e101]}}, "3 finite numbers, none beyond 1e.100"),
        ({"rod": {"orientation": [0, 0, 0, 1.1]}}, "length 1.1; must be 1"),
        ({"rod": {"position": [0, 0, 1]}}, "constraints.hinge: the given position violates"),
    ],
)
def test_what_cannot_be_set_changes_nothing(bodies, words):
    simulation = Simulation(scene_from_mapping(PENDULUM))
    simulation.advance(0.1)
    before = simulation.sample().block
    with pytest.raises(RbSimError, match=words):
        simulation.set_state(bodies)
    np.testing.assert_array_equal(simulation.sample().block.position, before.position)


def test_a_ball_is_lifted_and_falls_again_while_a_command_holds():
    scene = {
        "bodies": {"ball": {"mass": 0.5, "shape": {"type": "sphere", "radius": 0.05},
            "position": [0, 0, 0.05]}},
        "constraints": {"floor": {"type": "contact", "body": "ball", "restitution": 0.5}},
        "effects": {"weight": {"type": "gravity"},
            "drive": {"type": "commanded_wrench", "body": "ball"}},
        "simulation": {"method": "dopri853", "tolerance": 1e-10},
    }  # fmt: skip
    simulation = Simulation(scene_from_mapping(scene))
    simulation.apply_wrench("ball", [0, 0, 1.0], [0, 0, 0])
    simulation.advance(0.5)
    with pytest.raises(RbSimError, match="floor: overlap of 0.02 m"):
        simulation.set_state({"ball": {"position": [0, 0, 0.03]}})
    simulation.set_state({"ball": {"position": [0, 0, 1.05]}})
    a = 9.81 - 1.0 / 0.5
    fall = np.sqrt(2.0 / a)
    simulation.advance(fall + 0.1)
    assert [event.kind for event in simulation.events] == ["impact"]
    assert simulation.events[0].t == pytest.approx(0.5 + fall, abs=1e-8)
    rises = 0.5 * a * fall * 0.1 - 0.5 * a * 0.01
    assert simulation.state.position["ball"][2] == pytest.approx(0.05 + rises, abs=1e-7)
