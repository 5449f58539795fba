# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A tolerance means the same at every size: oscillators from a metre to a nanometre."""

from __future__ import annotations

import math
from typing import Any

import pytest

from rb_sim.base.errors import SceneError
from rb_sim.scene.load import scene_from_mapping
from rb_sim.scene.place import scaled_tolerance, size_of


def oscillator(amplitude: float, mass: float = 1.0) -> dict[str, Any]:
    """x = amplitude cos(10 t), mass on a spring to the origin."""
    return {
        "bodies": {"bob": {"mass": mass, "inertia": [mass] * 3, "position": [amplitude, 0.0, 0.0]}},
        "effects": {"spring": {"type": "spring", "body": "bob", "stiffness": 100.0 * mass}},
        "simulation": {"duration": 2.0, "rate": 5.0},
    }


def test_a_scene_of_metres_keeps_its_tolerance() -> None:
    assert scaled_tolerance(scene_from_mapping(oscillator(1.0)), 1e-10) == 1e-10
    fall = {
        "bodies": {"b": {"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}},
        "effects": {"g": {"type": "gravity"}},
    }
    assert scaled_tolerance(scene_from_mapping(fall), 1e-10) == 1e-10


def test_a_scene_without_any_size_keeps_its_tolerance() -> None:
    nut = {"mass": 1.0, "inertia": [1.0, 2.0, 3.0], "angular_velocity": [0.1, 2.0, 0.1]}
    assert scaled_tolerance(scene_from_mapping({"bodies": {"nut": nut}}), 1e-10) == 1e-10


def test_a_scene_that_turns_is_not_asked_for_more_than_a_quaternion_has() -> None:
    mapping = oscillator(1e-9)
    mapping["bodies"]["bob"]["angular_velocity"] = [1.0, 0.0, 0.0]
    assert scaled_tolerance(scene_from_mapping(mapping), 1e-10) == 1e-16


def test_the_size_is_that_of_what_the_scene_names() -> None:
    mapping = oscillator(1e-6)
    mapping["simulation"]["duration"] = 1.0
    assert math.isclose(size_of(scene_from_mapping(mapping)), 1e-6)


@pytest.mark.parametrize("tolerance", [1e-30, 9e-17])
def test_a_tolerance_below_what_doubles_resolve_is_refused(tolerance: float) -> None:
    mapping = oscillator(1.0)
    mapping["simulation"]["tolerance"] = tolerance
    with pytest.raises(SceneError, match=r"tolerance: got .* must be at least 1e-16"):
        scene_from_mapping(mapping)
