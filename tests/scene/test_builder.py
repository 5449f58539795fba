# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Shipped names, mappings and the builder lead to the same scene."""

from __future__ import annotations

import pytest

import rb_sim
from rb_sim import SceneBuilder, SceneError, load_scene


def test_a_bare_name_is_a_shipped_scene(tmp_path, monkeypatch):
    path = next(scene.path for scene in rb_sim.scenes() if scene.name == "heavy_top")
    assert load_scene("heavy_top") == load_scene(path)
    assert load_scene("heavy_top", method="rk4").simulation.method == "rk4"
    with pytest.raises(SceneError, match="did you mean heavy_top"):
        load_scene("heavy_tops")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "heavy_top").write_text("bodies: {mine: {mass: 1, inertia: [1, 1, 1]}}")
    assert list(load_scene("heavy_top").bodies) == ["mine"]  # a file of that name comes first


def test_the_builder_says_the_same_as_a_file():
    builder = (
        SceneBuilder("door", description="a door on its hinge")
        .body("door", mass=3.0, inertia=[1.0, 1.0, 0.5], angular_velocity=[0, 0, 2.0])
        .constraint("hinge", "fixed_axis", body="door", axis_B=[0, 0, 1])
        .effect("weight", "gravity")
        .simulate(duration=1.0, method="rk4", step=1e-3)
    )
    text = """
    description: a door on its hinge
    bodies: {door: {mass: 3.0, inertia: [1.0, 1.0, 0.5], angular_velocity: [0, 0, 2.0]}}
    constraints: {hinge: {type: fixed_axis, body: door, axis_B: [0, 0, 1]}}
    effects: {weight: {type: gravity}}
    simulation: {duration: 1.0, method: rk4, step: 0.001}
    """
    built = builder.build().model_dump()
    assert built == load_scene(text).model_dump() == load_scene(builder.as_dict()).model_dump()
    assert load_scene(builder.as_yaml()).model_dump() == built
    assert builder.build().name == "door"
    assert builder.build(tolerance=1e-9, method="dopri853").simulation.step is None


def test_the_builder_names_what_is_wrong():
    builder = SceneBuilder("door").body("door", mass=-3.0, inertia=[1, 1, 1])
    with pytest.raises(SceneError, match=r"^door: bodies.door.mass: got -3.0; must be"):
        builder.build()


def test_the_builder_tells_what_it_has_and_takes_no_name_twice():
    builder = SceneBuilder("arm")
    assert repr(builder) == "<SceneBuilder arm: nothing yet>"
    builder.body("arm", mass=1.0, inertia=[1, 1, 1]).effect("weight", "gravity")
    assert repr(builder) == "<SceneBuilder arm: bodies: arm; effects: weight>"
    with pytest.raises(SceneError, match="arm: bodies.arm: is given twice"):
        builder.body("arm", mass=2.0, inertia=[1, 1, 1])
    with pytest.raises(SceneError, match="arm: effects.weight: is given twice"):
        builder.effect("weight", "gravity")
