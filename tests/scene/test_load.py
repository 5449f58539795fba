# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Scenes from files, text and mappings; overrides; and the one line that says what is wrong."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rb_sim.base.errors import SceneError
from rb_sim.scene.load import load_scene, scene_from_mapping

Broken = Callable[[str, str], str]


def test_file(tmp_path: Path, valid: str) -> None:
    path = tmp_path / "rolling.yaml"
    path.write_text(valid, encoding="utf-8")
    scene = load_scene(path)
    assert (scene.name, scene.file, scene.text) == ("rolling", str(path), valid)
    assert scene.description == "a ball on a floor and a rod"
    assert list(scene.bodies) == ["ball", "rod"]
    assert scene.constraints["tip"].type == "fixed_point"  # type: ignore[attr-defined]
    assert scene.effects["weight"].acceleration == (0.0, 0.0, -9.81)  # type: ignore[attr-defined]
    assert scene == load_scene(str(path))


def test_text_and_mapping_give_the_same_scene(valid: str) -> None:
    from_text = load_scene(valid)
    ball = {"mass": np.float64(2.0), "shape": {"type": "sphere", "radius": 0.1}}
    rod = {
        "mass": 1.5,
        "inertia": np.diag([0.2, 0.2, 0.01]),
        "center_of_mass": (0, 0, 0.5),
        "orientation": {"axis": np.array([0, 0, 1]), "angle": 0.3},
    }
    from_mapping = scene_from_mapping(
        {
            "description": "a ball on a floor and a rod",
            "bodies": {"ball": ball | {"position": [0, 0, 0.1]}, "rod": rod},
            "constraints": {
                name: spec.model_dump() for name, spec in from_text.constraints.items()
            },
            "effects": {"weight": {"type": "gravity", "bodies": ["ball", "rod"]}},
            "simulation": {"duration": np.int64(2), "step": 1e-3, "method": "rk4", "rate": 50},
        }
    )
    assert from_mapping.bodies == from_text.bodies
    assert from_mapping.constraints == from_text.constraints
    assert from_mapping.simulation == from_text.simulation
    assert scene_from_mapping(from_mapping.text).bodies == from_text.bodies


def test_headings_with_nothing_below_say_nothing() -> None:
    scene = load_scene(
        "bodies: {a: {mass: 1, inertia: [1, 1, 1]}}\nconstraints:\neffects:\nsimulation:\n"
    )
    assert scene.constraints == scene.effects == {}
    assert scene.simulation.tolerance == 1e-10


@pytest.mark.parametrize("value", ["{rpy: [0, 0.1, 0]}", "[0, 0.1, 0]", "{roll: 0.1}"])
def test_roll_pitch_yaw_are_answered_with_their_conversion(value: str) -> None:
    text = f"bodies: {{a: {{mass: 1, inertia: [1, 1, 1], orientation: {value}}}}}"
    with pytest.raises(SceneError, match=r"from_euler\('xyz', rpy\)"):
        load_scene(f"{text}\n")


MESSAGES = [
    ("mass: 2", "mass: -2", "bodies.ball.mass: got -2; must be a number > 0"),
    ("mass: 2", "mass: true", "bodies.ball.mass: got true; must be a number"),
    ("mass: 2", "mass:", "bodies.ball.mass: got nothing; must be a number"),
    ("mass: 2\n", "\n", "bodies.ball.mass: is missing; must be a number"),
    (
        "type: sphere",
        "type: spere",
        "bodies.ball.shape.type: got 'spere'; must be sphere, or one of box, cylinder, disk, "
        "ellipsoid, rod",
    ),
    (
        "    inertia: [0.2, 0.2, 0.01]\n",
        "",
        "bodies.rod.inertia: is missing; must be given unless the body has a shape",
    ),
    (
        "inertia: [0.2, 0.2, 0.01]",
        "shape: {type: rod, length: 1}",
        "bodies.rod.center_of_mass: got [0, 0, 0.5]; must be the centre of the shape, "
        "[0.0, 0.0, 0.0]; set shape.center_B: [0.0, 0.0, 0.5], or give inertia",
    ),
    (
        "{axis: [0, 0, 1], angle: 0.3}",
        "[0, 0, 0, 0]",
        "bodies.rod.orientation: got [0, 0, 0, 0]; must be a quaternion [x, y, z, w], not all zero",
    ),
    (
        "body: ball",
        "body: bal",
        "constraints.floor.body: got 'bal'; must be a body of the scene: ball or rod",
    ),
    (
        "parent: ball",
        "parent: rod",
        "constraints.tip.parent: got 'rod'; must be another body than the constrained one",
    ),
    (
        "parent: ball",
        "parent: world",
        "constraints.tip.parent: got 'world'; must be a body of the scene: one of ball, rod; omit "
        "parent for the world",
    ),
    (
        "bodies: [ball, rod]",
        "bodies: []",
        "effects.weight.bodies: got []; must be at least one body; omit bodies for all of them",
    ),
    (
        "bodies: [ball, rod]",
        "bodies: [ball, rd]",
        "effects.weight.bodies[1]: got 'rd'; must be a body of the scene: rod or ball",
    ),
    (
        "{type: fixed_point, body: rod,",
        "{body: rod,",
        "constraints.tip.type: is missing; must be one of contact, distance, fixed_axis, "
        "fixed_point, free, parallel, plane, rolling, string, translation, velocity, weld",
    ),
    (
        "step: 1e-3, method: rk4",
        "step: 1e-3, tolerance: 1e-3",
        "simulation.step: got 0.001; must be omitted if tolerance is given",
    ),
]


@pytest.mark.parametrize(("old", "new", "expected"), MESSAGES)
def test_message(broken: Broken, old: str, new: str, expected: str) -> None:
    assert broken(old, new) == expected


def test_no_bodies() -> None:
    for text in ("bodies:\n", "bodies: {}\n", "effects: {}\n", "bodies: [a]\n"):
        with pytest.raises(SceneError, match=r"bodies: .* of at least one body"):
            load_scene(text)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    folder = tmp_path / "folder.yaml"
    folder.mkdir()
    fifo = tmp_path / "fifo.yaml"
    os.mkfifo(fifo)
    latin = tmp_path / "latin.yaml"
    latin.write_bytes(b"description: caf\xe9\n")
    big = tmp_path / "big.yaml"
    big.write_bytes(b"#" * (4 * 1024 * 1024 + 1))
    empty = tmp_path / "empty.yaml"
    empty.write_bytes(b"")
    for path, part in (
        (tmp_path / "none.yaml", "does not exist"),
        (folder, "is a folder"),
        (fifo, "is not a regular file"),
        (latin, "must be UTF-8 text, but has byte 0xe9 at offset 16"),
        (big, "is larger than 4 MiB"),
        (empty, "is empty"),
        (Path("a\0b"), "cannot be read"),
        (Path("/proc/self/mem"), "cannot be read: Input/output error"),
        (Path("x" * 300), "cannot be read: File name too long"),
    ):
        with pytest.raises(SceneError, match=part) as caught:
            load_scene(path)
        assert len(str(caught.value).splitlines()) == 1


def test_bom_is_no_text(tmp_path: Path, valid: str) -> None:
    path = tmp_path / "bom.yaml"
    path.write_text(valid, encoding="utf-8-sig")
    assert load_scene(path).text == valid


def test_mappings_hold_plain_data_only() -> None:
    loop: dict = {}
    loop["bodies"] = loop
    for data, part in (
        ({1: 2}, "got the key 1; must be text"),
        ({"bodies": {"a": object()}}, "bodies.a: got an object of type object; must be"),
        (loop, "is nested deeper than 32 levels"),
        (3, "a scene must be a mapping"),
    ):
        with pytest.raises(SceneError, match=part):
            scene_from_mapping(data)  # type: ignore[arg-type]


def options(text: str, **overrides: object) -> tuple:
    simulation = load_scene(text, **overrides).simulation
    return simulation.method, simulation.step, simulation.tolerance


def simulated(line: str) -> str:
    return f"bodies: {{a: {{mass: 1, inertia: [1, 1, 1]}}}}\nsimulation: {line}\n"


@pytest.mark.parametrize(
    ("line", "overrides", "expected"),
    [
        ("{}", {}, ("dopri853", None, 1e-10)),
        ("{method: gauss6}", {}, ("gauss6", 1e-3, None)),
        ("{step: 0.01}", {}, ("dopri853", 0.01, None)),
        ("{tolerance: 1e-6}", {"step": 0.1}, ("dopri853", 0.1, None)),
        ("{step: 0.01}", {"tolerance": 1e-6}, ("dopri853", None, 1e-6)),
        ("{tolerance: 1e-6}", {"method": "rk4"}, ("rk4", 1e-3, None)),
        ("{step: 0.01}", {"method": "rk4"}, ("rk4", 0.01, None)),
        ("{step: 0.01, method: rk4}", {"method": "dopri853"}, ("dopri853", 0.01, None)),
        ("{method: gauss6}", {"method": "dopri853"}, ("dopri853", None, 1e-10)),
        ("{tolerance: 1e-6}", {"method": "auto"}, ("auto", None, 1e-6)),
        (
            "{method: rk4, step: 0.01}",
            {"method": "auto", "tolerance": 1e-4},
            ("auto", None, 1e-4),
        ),
        ("{method: auto, tolerance: 1e-6}", {"method": "euler"}, ("euler", 1e-3, None)),
        ("{tolerance: 1e-6}", {"method": None, "step": None}, ("dopri853", None, 1e-6)),
    ],
)
def test_override_is_coherent(line: str, overrides: dict, expected: tuple) -> None:
    assert options(simulated(line), **overrides) == expected


def test_override_of_duration_and_rate(valid: str) -> None:
    scene = load_scene(valid, duration=np.float64(7), rate=5)
    assert (scene.simulation.duration, scene.simulation.rate) == (7.0, 5.0)
    assert scene.simulation.step == 1e-3
    assert (scene.name, scene.text) == ("scene", valid)


@pytest.mark.parametrize(
    ("line", "overrides", "expected"),
    [
        ("{}", {"step": -1}, "step: got -1; must be a number > 0"),
        ("{}", {"rate": "5"}, "rate: got '5'; must be a number"),
        ("{}", {"rate": 1e12}, "rate: got 1000000000000.0; must be a number <= 1e+09"),
        ("{}", {"duration": float("inf")}, "duration: got inf; must be a finite number"),
        (
            "{}",
            {"step": 0.1, "tolerance": 0.1},
            "step: got 0.1; must be omitted if tolerance is given",
        ),
        (
            "{method: rk4}",
            {"tolerance": 0.1},
            "tolerance: got 0.1; must be omitted for method rk4, which has a fixed step "
            "(give step, or use dopri853, radau5, taylor or auto)",
        ),
        (
            "{step: 0.1}",
            {"method": "auto"},
            "tolerance: is missing; must be given for method auto: a number > 0",
        ),
        (
            "{tolerance: 1e-3, method: auto}",
            {"step": 0.1},
            "step: got 0.1; must be omitted for method auto, which needs a tolerance",
        ),
        (
            "{}",
            {"stepp": 0.1},
            "stepp: unknown option; must be step, or one of duration, method, rate, tolerance",
        ),
    ],
)
def test_bad_override(line: str, overrides: dict, expected: str) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(simulated(line), **overrides)
    assert str(caught.value) == expected


WRONG = {
    "misspelt key": {"simulation": {"durations": 1.0}},
    "misspelt section": {"contacts": {}},
    "value": {"simulation": {"rate": -4.0}},
    "body": {"bodies": {"a": {"mass": -1.0, "inertia": [1, 1, 1]}}},
    "type": {"effects": {"pull": {"type": "gravitation"}}},
    "the same entry": {"constraints": {"pin": {"point": [0, 0, 0]}}},
}
"""By kind: what else is wrong with a scene one constraint of which names no body of it."""


@pytest.mark.parametrize("kind", WRONG)
def test_all_errors_of_a_scene_are_named_at_once(kind: str) -> None:
    """An unknown body is named beside errors of every other kind, each entry's with its key."""
    scene: dict = {
        "bodies": {"a": {"mass": 1.0, "inertia": [1, 1, 1]}},
        "constraints": {"pin": {"type": "fixed_point", "body": "b"}},
        "effects": {"push": {"type": "wrench", "body": "c", "force": [1, 0, 0]}},
    }
    for section, entries in WRONG[kind].items():
        for name, entry in entries.items():
            of: Any = scene.setdefault(section, {})
            of[name] = of[name] | entry if section == "constraints" else entry
        scene.setdefault(section, entries)
    with pytest.raises(SceneError) as caught:
        load_scene(scene)
    text = str(caught.value)
    assert "pin.body: got 'b'; must be a body of the scene: one of a" in text
    assert "push.body: got 'c'; must be a body of the scene: one of a" in text
    assert text.count("must be") == 3, text


def test_override_does_not_hide_an_error_of_the_file(valid: str) -> None:
    with pytest.raises(SceneError, match=r"simulation.method: got 'rk5'"):
        load_scene(valid.replace("rk4", "rk5"), method="rk4")


@pytest.mark.parametrize(
    ("entry", "line"),
    [
        (
            {"type": "translation", "guide": "line"},
            "guide: got 'line'; .*NAME is line .direction., or",
        ),
        ({"type": "translation", "guide": 3}, "guide: got 3; .*NAME is one of circle "),
        ({"type": "contact", "surface": "plane"}, "surface: got 'plane'; .*NAME is plane, or one"),
    ],
)
def test_a_word_in_place_of_a_mapping_is_answered_with_the_types(entry: dict, line: str) -> None:
    for with_shape in ("sphere", 3):
        body = {"mass": 1.0, "shape": with_shape}
        scene = {"bodies": {"b": body}, "constraints": {"it": entry | {"body": "b"}}}
        with pytest.raises(SceneError, match=rf"constraints\.it\.{line}") as caught:
            load_scene(scene)
        assert re.search(r"bodies\.b\.shape: got .*NAME is (sphere|one of)", str(caught.value))


def test_a_number_in_place_of_a_mapping_is_answered_with_its_keys() -> None:
    with pytest.raises(SceneError) as caught:
        load_scene({"bodies": {"a": 5, "b": {"mass": -1.0, "inertia": [1, 1, 1]}}})
    assert "bodies.a: got 5; must be a mapping {mass: ...}; bodies.b.mass" in str(caught.value)


def test_a_table_of_wrenches_names_its_times_and_rows() -> None:
    table = {"type": "wrench_table", "body": "b"}
    effects = {
        "a": table | {"times": [0, 1, 0.5], "forces": [[0, 0, 0]] * 3},
        "c": table | {"times": [0, 1], "torques": [[0, 0, 0]]},
    }
    with pytest.raises(SceneError) as caught:
        load_scene({"bodies": {"b": {"mass": 1.0, "inertia": [1, 1, 1]}}, "effects": effects})
    assert "effects.a.times: got [0, 1, 0.5]; must be numbers that increase" in str(caught.value)
    assert "effects.c.torques: got [[0, 0, 0]]; must be one row for each of the 2 times" in str(
        caught.value
    )
