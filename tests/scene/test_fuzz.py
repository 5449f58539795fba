# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Random damage to valid scenes: the outcome is a Scene or one line, never anything else."""

from __future__ import annotations

import copy
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

from rb_sim.base.errors import SceneError
from rb_sim.catalogue import constraints, effects
from rb_sim.scene.listing import list_scenes
from rb_sim.scene.load import load_scene, scene_from_mapping
from rb_sim.scene.schema import Scene
from rb_sim.scene.yaml_reader import parse

EVERY_KIND = """
bodies:
  a: {mass: 1, shape: {type: cylinder, radius: 0.1, length: 1, axis_B: [0, 1, 0]}}
  b:
    mass: 1
    shape: {type: box, size: [1, 2, 3], center_B: [0, 0, 1]}
    center_of_mass: [0, 0, 1]
  c: {mass: 1, inertia: [[1, 0, 0], [0, 1, 0.1], [0, 0.1, 1]], shape: {type: rod, length: 1}}
  d:
    mass: 1
    shape: {type: ellipsoid, semi_axes: [1, 2, 3]}
    orientation: {axis: [1, 0, 0], angle: 1}
constraints:
  free: {type: free, body: a}
  point: {type: fixed_point, body: a, parent: b, point_B: [0, 0, 0], point_A: [0, 0, 0]}
  axis: {type: fixed_axis, body: a, axis_B: [0, 0, 1]}
  line: {type: translation, body: b, guide: {type: line, direction: [1, 0, 0]}}
  circle:
    type: translation
    body: b
    guide: {type: circle, center: [0, 0, 0], normal: [0, 0, 1], radius: 1}
  curve:
    type: translation
    body: b
    guide: {type: curve, points: [[0, 0, 0], [1, 0, 0], [2, 1, 0], [3, 0, 0]]}
  roll: {type: rolling, body: a, normal_A: [0, 0, 1], point_A: [0, 0, 0]}
  rope: {type: distance, body: c, parent: d, point_A: [0, 0, 0], length: 2}
  table: {type: plane, body: c, normal_A: [0, 0, 1]}
  upright: {type: parallel, body: c, axis_B: [0, 0, 1]}
  glue: {type: weld, body: c, parent: d}
  knife: {type: velocity, body: d, linear: [0, 1, 0]}
  leash: {type: string, body: d, point_A: [0, 0, 1], length: 3, compliance: {stiffness: 10}}
  floor:
    type: contact
    body: d
    surface: {type: plane, point: [0, 0, -9], normal: [0, 0, 1]}
    friction: {type: coulomb, static: 0.5, kinetic: 0.4}
    restitution: 0.3
    rolling_resistance: 0.01
    spinning_resistance: 0.01
    motion: {type: turntable, rate: 3.0, axis: [0, 0, 1]}
  bumper:
    type: contact
    body: c
    parent: b
    surface: {type: cylinder, axis: [0, 0, 1], radius: 20, side: inside}
    points: [[0, 0, 0.5], [0, 0, -0.5]]
    friction: {type: viscous, coefficient: 0.1, per_normal: true}
    compliance: {stiffness: 1.0e4, damping: 1}
effects:
  weight: {type: gravity, acceleration: [0, 0, -9.81], bodies: [a, b]}
  drag: {type: linear_drag, body: a, coefficient: 0.1}
  air: {type: quadratic_drag, body: a, coefficient: 0.1}
  oil: {type: angular_damping, body: a, coefficient: 0.1}
  spring: {type: spring, body: a, parent: b, stiffness: 10, damping: 1, rest_length: 1}
  twist: {type: torsion_spring, body: a, axis_B: [0, 0, 1], stiffness: 1}
  push: {type: wrench, body: a, force: [1, 0, 0], frame: body}
  series: {type: wrench_table, body: a, times: [0, 1], forces: [[0, 0, 0], [1, 0, 0]]}
  drive: {type: commanded_wrench, body: a}
simulation: {duration: 1, method: gauss6, step: 1e-3, rate: 10}
"""

TEXTS = [EVERY_KIND, *(scene.path.read_text(encoding="utf-8") for scene in list_scenes())]
SCENES: list[Any] = [parse(text, "valid") for text in TEXTS]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One folder for all the damaged files."""
    return tmp_path_factory.mktemp("damaged")


odd_values = st.one_of(
    st.sampled_from(
        [None, True, False, 0, -1, 10**400, -(10**5000), math.nan, math.inf, 1e308, 5e-324, -0.0]
    ),
    st.sampled_from(
        ["", "world", "a", "sphere", "rk4", "[key]", "type", "1e-3", "a\nb", "\u2028", "{"]
    ),
    st.sampled_from(
        [[], {}, [[]], [0, 0, 0], [0, 0, 0, 0], [1e200] * 3, {"type": "box"}, [None] * 3]
    ),
    st.sampled_from([{"axis": [0, 0, 0], "angle": 1}, {"type": {}}, {"": ""}, {"type": "line"}]),
    st.integers(),
    st.floats(),
    st.text(max_size=10),
    st.lists(st.floats(allow_nan=False), max_size=5),
    st.sampled_from(["x" * 5000, {"k" * 5000: 1}, list(range(3000))]),
)
odd_keys = st.sampled_from(["", "type", "body", "mass", "[key]", "\n", "a.b", "0", "x" * 5000])


def places(data: Any, path: tuple = ()) -> list[tuple]:
    """Paths of all entries below `data`."""
    entries = data.items() if isinstance(data, dict) else enumerate(data)
    found = []
    for key, value in entries:
        found.append((*path, key))
        if isinstance(value, (dict, list)):
            found += places(value, (*path, key))
    return found


@st.composite
def damaged(draw: st.DrawFn) -> Any:
    """A valid scene with one to three entries replaced, removed, renamed or doubled."""
    data = copy.deepcopy(draw(st.sampled_from(SCENES)))
    for _ in range(draw(st.integers(1, 3))):
        options = places(data)
        if not options:
            break
        *above, key = draw(st.sampled_from(options))
        at = data
        for part in above:
            at = at[part]
        action = draw(st.sampled_from(["replace", "replace", "remove", "rename", "double"]))
        if action == "replace":
            at[key] = copy.deepcopy(draw(odd_values))
        elif action == "remove":
            del at[key]
        elif isinstance(at, list):
            at.append(copy.deepcopy(at[key]))
        else:
            new = draw(odd_keys) if action == "rename" else f"{key}2"
            at[new] = at.pop(key) if action == "rename" else copy.deepcopy(at[key])
    return data


def outcome(build: Any) -> None:
    """A consistent Scene, or a SceneError of one printable line."""
    try:
        scene = build()
    except SceneError as error:
        text = str(error)
        assert text.isprintable(), text
        assert len(text) < 4000
        event("refused")
        return
    assert isinstance(scene, Scene)
    for body in scene.bodies.values():
        assert np.isfinite(body.inertia).all()
        assert abs(math.hypot(*body.orientation) - 1.0) < 1e-14
    assert (scene.simulation.step is None) != (scene.simulation.tolerance is None)
    event("accepted")


def test_the_undamaged_scenes_are_valid() -> None:
    for data, text in zip(SCENES, TEXTS, strict=True):
        assert scene_from_mapping(data).bodies == scene_from_mapping(text).bodies
    assert len(SCENES) > 3


def test_every_kind_is_damaged() -> None:
    scene = load_scene(EVERY_KIND)
    assert {spec.type for spec in scene.constraints.values()} == set(constraints.SPECS)
    assert {spec.type for spec in scene.effects.values()} == set(effects.SPECS)


@settings(max_examples=600, deadline=None)
@given(damaged())
def test_damaged_mapping(data: Any) -> None:
    outcome(lambda: scene_from_mapping(data))


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_damaged_text(data: st.DataObject) -> None:
    text = data.draw(st.sampled_from(TEXTS))
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(text)))
        cut = data.draw(st.integers(0, 5))
        text = text[:at] + data.draw(st.text(max_size=4)) + text[at + cut :]
    outcome(lambda: scene_from_mapping(text))


@settings(max_examples=100, deadline=None)
@given(st.data())
def test_damaged_file(folder: Path, data: st.DataObject) -> None:
    raw = bytearray(data.draw(st.sampled_from(TEXTS)).encode())
    for _ in range(data.draw(st.integers(1, 4))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    path = folder / "damaged.yaml"
    path.write_bytes(bytes(raw))
    outcome(lambda: load_scene(path))


@settings(max_examples=200, deadline=None)
@given(
    st.dictionaries(
        st.sampled_from(["step", "tolerance", "method", "duration", "rate", "stepp"]),
        odd_values | st.sampled_from(["euler", "gauss6", "dopri853", "auto", 1e-3]),
    )
)
def test_odd_overrides(overrides: dict[str, Any]) -> None:
    outcome(lambda: load_scene(EVERY_KIND, **overrides))
