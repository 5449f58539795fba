# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What a step leaves at its end: free flight, bodies moved apart, and the torques that are told."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim import Simulation, load_scene
from tests.contact.scenes import ball, box, scene, touch

FAR = {"type": "plane", "point": [0.0, 0.0, -100.0]}


def run(mapping: dict[str, Any], step: float, duration: float) -> Any:
    options = {"method": "time_stepping", "step": step, "duration": duration, "rate": 1.0 / step}
    return Simulation(load_scene(mapping | {"simulation": options})).run(check=False)


@pytest.mark.parametrize("step", [0.01, 0.1])
def test_what_nothing_touches_falls_exactly(step: float) -> None:
    """Drifts at the old and the new velocity are the parabola; a spin keeps its energy."""
    start = {"linear_velocity": [0.3, -0.2, 1.0], "angular_velocity": [1.0, 2.0, -0.5]}
    thrown = box([0.1, 0.2, 0.4], [0.0, 0.0, 5.0], **start)
    found = run(scene(thrown, touch(surface=FAR)), step, 0.5)
    t = found.t[:, None]
    fall = np.array([0.0, 0.0, -9.81])
    way = [0.0, 0.0, 5.0] + t * np.array(start["linear_velocity"]) + 0.5 * t * t * fall
    assert_allclose(found.position["body"], way, atol=1e-12)
    assert_allclose(found.energy, found.energy[0], rtol=1e-9)


def test_two_balls_that_meet_in_a_long_step_are_moved_apart_by_their_masses() -> None:
    """They end side by side, and their common centre goes its way."""
    bodies = {
        "a": ball([0.0, 0.0, 0.0], linear_velocity=[1.0, 0.0, 0.0]),
        "b": ball([0.31, 0.08, 0.0], linear_velocity=[-2.0, 0.0, 0.0], mass=3.0),
    }
    meet = touch("b", parent="a", surface={"type": "shape"})
    found = run(scene(bodies, {"meet": meet}, gravity=False), 0.02, 0.2)
    a, b = found.position["a"], found.position["b"]
    apart = np.linalg.norm(b - a, axis=1) - 0.2
    assert apart.min() > -1e-12
    assert found.reaction["meet"].force.any()
    centre = 0.25 * a + 0.75 * b
    expected = centre[0] + found.t[:, None] * np.array([-1.25, 0.0, 0.0])
    assert_allclose(centre, expected, atol=1e-12)


def test_a_stack_that_is_dropped_flat_ends_without_overlap() -> None:
    """Of three bodies between each other, after an impact far longer than a step of its own."""
    bodies = {f"b{i}": ball([0.0, 0.0, 0.1 + 0.21 * i + 0.3]) for i in range(3)}
    on = {f"on{i}": touch(f"b{i}", parent=f"b{i - 1}", surface={"type": "shape"}) for i in (1, 2)}
    found = run(scene(bodies, {"floor": touch("b0")} | on), 0.05, 0.6)
    z = np.array([found.position[f"b{i}"][:, 2] for i in range(3)])
    assert z[0].min() > 0.1 - 1e-10
    assert np.diff(z, axis=0).min() > 0.2 - 1e-10
    assert_allclose(z[:, -1], [0.1, 0.3, 0.5], atol=1e-9)


def test_a_floor_holds_a_box_that_is_pushed_aside_with_force_and_torque() -> None:
    """All corners together: weight and push, and the torque of the push about the centre."""
    push = {"type": "wrench", "body": "body", "force": [1.0, 0.0, 0.0], "point_B": [0.0, 0.0, 0.15]}
    resting = scene(box([0.2, 0.2, 0.4], [0.0, 0.0, 0.2]), touch(mu=0.6), push=push)
    found = run(resting, 0.01, 0.2).reaction["floor"]
    about = found.torque[-1] + np.cross(found.anchor[-1] - [0.0, 0.0, 0.2], found.force[-1])
    assert_allclose(found.force[-1], [-1.0, 0.0, 9.81], atol=1e-9)
    assert_allclose(about, [0.0, -0.15, 0.0], atol=1e-9)
