# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Wrong scenes get one line; the command writes a table, JSON and a picture."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from matplotlib.text import Text

from rb_sim.base.errors import RbSimError, SceneError
from rb_sim.cli.verbs.statics import statics
from rb_sim.equilibrium.statics import solve
from rb_sim.equilibrium.statics_picture import draw
from rb_sim.scene.load import load_statics
from tests.equilibrium.scenes import UP, ladder, table

CONFIG = Path(__file__).parents[2] / "config" / "statics"

BODY = {"bodies": {"b": {"mass": 1.0}}}
CONTACT = {"type": "contact", "body": "b", "point_B": [0, 0, 0], "normal_A": UP}


def with_support(**changes):
    return BODY | {"supports": {"s": {k: v for k, v in (CONTACT | changes).items() if v != "-"}}}


@pytest.mark.parametrize(
    "scene, key, words",
    [
        ({}, "bodies", "missing"),
        ({"bodies": {"b": {"mass": -1.0}}}, "bodies.b.mass", "a number >= 0"),
        (with_support(type="rope"), "supports.s.type", "string"),
        (with_support(body="c"), "supports.s.body", "a body of the scene: one of b"),
        (with_support(parent="b"), "supports.s.parent", "another body"),
        (with_support(friction=-0.1), "supports.s.friction", "coefficient of friction >= 0"),
        (with_support(friction="sticky"), "supports.s.friction", "smooth, rough or"),
        (with_support(friction=True), "supports.s.friction", "smooth, rough or"),
        (with_support(normal_A=[0, 0, 0]), "supports.s.normal_A", "not all zero"),
        (with_support(normal_A="-"), "supports.s", "one normal"),
        (with_support(normal_B=UP), "supports.s", "one normal"),
        (with_support(point_B="-"), "supports.s", "point_B"),
        (with_support(point_A=[0, 0, 0.1]), "supports.s.point_A", "they are 0.1 m apart"),
        (
            BODY
            | {"supports": {"s": CONTACT}, "constraints": {"s": {"type": "free", "body": "b"}}},
            "supports.s",
            "another name: constraints have one called s",
        ),
        (
            BODY | {"supports": {"s": {"type": "hinge", "body": "b", "axis_A": UP, "axis_B": UP}}},
            "supports.s",
            "at most one of",
        ),
        (BODY | {"loads": {"g": {"type": "gravity", "bodies": ["c"]}}}, "loads.g.bodies[0]", "b"),
    ],
)
def test_one_line_names_key_and_what_is_allowed(scene, key, words):
    with pytest.raises(SceneError) as caught:
        load_statics(scene)
    text = str(caught.value)
    assert caught.value.key == key
    assert words in text and "\n" not in text


@pytest.mark.parametrize(
    ("support", "words"),
    [
        ({"type": "string", "point_A": [0, 0, 0]}, "coincide at the start"),
        ({"type": "rod", "point_A": [0, 0, 0]}, "coincide at the start"),
        (
            {"type": "hinge", "point_B": [0, 0, 1], "point_A": [0, 0, 2]},
            "the initial position violates it by",
        ),
    ],
)
def test_ends_that_do_not_fit_are_refused(support, words):
    with pytest.raises(SceneError, match=words) as caught:
        solve(load_statics(BODY | {"supports": {"s": support | {"body": "b"}}}))
    assert caught.value.key == "constraints.s"


def test_command_writes_table_json_and_picture(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")
    assert statics(CONFIG / "table_offset.yaml", tmp_path / "out") == 0
    printed = capsys.readouterr().out
    assert "indeterminate" in printed and "leg_1" in printed and "10 to 258.1 N" in printed
    answer = json.loads((tmp_path / "out" / "statics.json").read_text())
    assert answer["verdict"] == "indeterminate"
    assert answer["reactions"]["leg_2"]["along_N"] == pytest.approx(104.05)
    assert answer["reactions"]["leg_2"]["along_range_N"] == pytest.approx([0.0, 248.1])
    assert (tmp_path / "out" / "statics.png").read_bytes().startswith(b"\x89PNG")


def test_command_says_what_gives(tmp_path, capsys):
    path = tmp_path / "loose.yaml"
    path.write_text("bodies: {b: {mass: 1.0}}\nloads: {g: {type: gravity}}\n")
    assert statics(path) == 1
    assert "no equilibrium: the force balance of body 'b' along -z fails" in (
        " ".join(capsys.readouterr().out.split())
    )


def test_folder_that_cannot_be_written(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(RbSimError, match="is not a folder; must be one"):
        statics(CONFIG / "table_offset.yaml", blocked)


def test_json_has_no_infinities(tmp_path):
    path = tmp_path / "jam.yaml"
    path.write_text(json.dumps(ladder(0.5, "rough", "rough")))
    assert statics(path, tmp_path / "out") == 0
    answer = json.loads((tmp_path / "out" / "statics.json").read_text())
    assert answer["reactions"]["floor"]["along_range_N"][1] is None


def drawn_texts(figure):
    return [text.get_text() for text in figure.axes[0].texts]


def test_picture_shows_each_reaction_and_load():
    for path in sorted(CONFIG.glob("*.yaml")):
        scene = load_statics(path)
        result = solve(scene)
        texts = " ".join(drawn_texts(draw(scene, result)))
        for name in (*scene.constraints, *scene.effects):
            assert name in texts, f"{path.name}: {name}"


def test_picture_of_a_scene_without_equilibrium():
    legs = [(0.8, 0.5, 0.0), (-0.8, 0.5, 0.0), (-0.8, -0.5, 0.0), (0.8, -0.5, 0.0)]
    scene = load_statics(table(legs, (0.0, 0.0, -400.0), (0.9, 0.1, 0.0)))
    figure = draw(scene, solve(scene))
    shown = [text.get_text() for text in figure.findobj(Text)]
    assert any("no equilibrium" in text for text in shown)
    texts = drawn_texts(figure)
    assert any("load" in text for text in texts)
    assert {"N2", "N3"} <= set(texts) and "N1" not in texts  # what lifts is named
