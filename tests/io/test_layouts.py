# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim layout`: files in the programs' formats, whose topics and fields bags have."""

from __future__ import annotations

import json
import os
import re
from functools import reduce
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from rb_sim.base.errors import RbSimError
from rb_sim.cli.verbs.scenes import layout
from rb_sim.io.layouts import MOST_BODIES, MOST_REACTIONS, shown
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import load_scene
from tests.bags.scenes import record_run

pytestmark = pytest.mark.filterwarnings("ignore::rb_sim.base.errors.SceneWarning")

STORE = get_typestore(Stores.ROS2_JAZZY)

WORKSHOP = """\
description: a box that is pushed on a floor, a cart on a rail, a door on a hinge
bodies:
  left-box:
    mass: 2.0
    shape: {type: box, size: [0.3, 0.2, 0.1]}
    position: [0, 0, 0.05]
  door:
    mass: 3.0
    shape: {type: box, size: [0.6, 0.04, 1.0], center_B: [0.3, 0, 0.5]}
    center_of_mass: [0.3, 0, 0.5]
    position: [0.5, 0.5, 0]
    angular_velocity: [0, 0, 1]
  cart:
    mass: 1.0
    shape: {type: box, size: [0.2, 0.2, 0.2]}
    position: [0, -1, 0.5]
    linear_velocity: [0.5, 0, 0]
constraints:
  rail: {type: translation, body: cart, guide: {type: line, direction: [1, 0, 0]}}
  floor: {type: contact, body: left-box, friction: {type: coulomb, static: 0.4}}
  hinge: {type: fixed_axis, body: door, axis_B: [0, 0, 1], bearing_distance: 0.8}
effects:
  weight: {type: gravity}
  drive: {type: commanded_wrench, body: left-box}
simulation: {duration: 0.1, rate: 50}
"""
FORMATS = ("foxglove.json", "plotjuggler.xml", "rviz")


@pytest.fixture(scope="module")
def messages(tmp_path_factory) -> dict[str, object]:
    """The last message of each topic of a run, as another reader of bags has it."""
    folder = record_run(WORKSHOP, tmp_path_factory.mktemp("run") / "bag")
    with Reader(folder) as reader:
        return {
            connection.topic: STORE.deserialize_cdr(raw, connection.msgtype)
            for connection, _, raw in reader.messages()
        }


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> dict[str, str]:
    """The layouts of the same scene, by format."""
    folder = tmp_path_factory.mktemp("layouts")
    (folder / "workshop.yaml").write_text(WORKSHOP)
    assert layout(str(folder / "workshop.yaml"), folder / "out") == 0
    return {form: (folder / "out" / f"workshop.{form}").read_text() for form in FORMATS}


def named(value: object, name: str) -> object:
    """A field of a message, or one entry of it: position[0]."""
    field, _, index = name.rstrip("]").partition("[")
    found = getattr(value, field)
    return found[int(index)] if index else found


def test_all_topics_of_the_layouts_are_recorded(messages):
    scene = load_scene(WORKSHOP)
    topics = shown(scene, compile_scene(scene).layout).topics
    assert topics <= set(messages) | {"/rb_sim/contact_events"}  # nothing happens in 0.1 s
    wrenches = {t for t, m in messages.items() if "Wrench" in type(m).__name__}
    assert wrenches - topics == {"/rb_sim/reactions/floor", "/rb_sim/reactions/hinge"}  # totals
    assert {t for t, m in messages.items() if "JointState" in type(m).__name__} <= topics


def test_foxglove_plots_numbers_of_the_messages(files, messages):
    text = json.loads(files["foxglove.json"])
    plots = [panel for key, panel in text["configById"].items() if key.startswith("Plot!")]
    paths = [path["value"] for plot in plots for path in plot["paths"]]
    of_joints = {
        path["label"]: path["value"]
        for plot in plots
        for path in plot["paths"]
        if path["value"].startswith("/rb_sim/joint_states")
    }
    joints = messages["/rb_sim/joint_states"].name  # type: ignore[attr-defined]
    assert joints == ["rail", "hinge"]
    assert of_joints == {n: f"/rb_sim/joint_states.position[{k}]" for k, n in enumerate(joints)}
    assert "/rb_sim/left_box/pose.pose.position.z" in paths
    for path in paths:
        topic, *fields = path.split(".")
        assert isinstance(float(reduce(named, fields, messages[topic])), float), path  # type: ignore[arg-type]
    transitions = text["configById"]["StateTransitions!contacts"]["paths"]
    assert [float(messages[p["value"].removesuffix(".data")].data) for p in transitions]  # type: ignore[attr-defined]
    scene = text["configById"]["3D!scene"]
    assert scene["topics"]["/tf"]["visible"]
    assert "<robot" in messages[scene["layers"]["shapes"]["topic"]].data  # type: ignore[attr-defined]


def test_foxglove_lays_out_every_panel_once(files):
    text = json.loads(files["foxglove.json"])
    assert {"configById", "globalVariables", "userNodes", "playbackConfig", "layout"} == set(text)

    def leaves(node: object) -> list[str]:
        if isinstance(node, str):
            return [node]
        assert isinstance(node, dict)
        assert node["direction"] in ("row", "column") and 0 < node["splitPercentage"] < 100
        return leaves(node["first"]) + leaves(node["second"])

    placed = leaves(text["layout"])
    placed += [p for tab in text["configById"]["Tab!plots"]["tabs"] for p in leaves(tab["layout"])]
    assert sorted(placed) == sorted(text["configById"])


def test_plotjuggler_plots_numbers_of_the_messages(files, messages):
    root = ElementTree.fromstring(files["plotjuggler.xml"])
    assert root.tag == "root" and root[0].tag == "tabbed_widget"
    for splitter in root.iter("DockSplitter"):
        sizes = splitter.attrib["sizes"].split(";")
        assert len(splitter) == int(splitter.attrib["count"]) == len(sizes)
        assert all(area.tag == "DockArea" and area[0].tag == "plot" for area in splitter)
    curves = [curve.attrib["name"] for curve in root.iter("curve")]
    assert len(curves) == len(set(curves)) > 20
    # as the program names a number of a joint
    joints = {f"/rb_sim/joint_states/{name}/position" for name in ("rail", "hinge")}
    assert joints <= set(curves)
    for name in set(curves) - joints:
        topic = max((t for t in messages if name.startswith(f"{t}/")), key=len)
        fields = name.removeprefix(f"{topic}/").split("/")
        assert isinstance(float(reduce(named, fields, messages[topic])), float), name  # type: ignore[arg-type]


def test_rviz_shows_topics_of_the_right_type(files, messages):
    text = yaml.safe_load(files["rviz"])["Visualization Manager"]
    kinds = {"Pose": "PoseStamped", "Wrench": "WrenchStamped"}
    seen = []
    for display in text["Displays"]:
        kind = display["Class"].removeprefix("rviz_default_plugins/")
        seen.append(kind)
        if kind in kinds:
            assert type(messages[display["Topic"]["Value"]]).__name__.endswith(kinds[kind])
    assert {"Grid", "TF", "RobotModel", "MarkerArray", "Pose", "Wrench"} == set(seen)
    assert (
        seen.count("Wrench") == 8 + 2 + 1 + 1
    )  # corners of the box, bearings, the rail, the command
    model = next(d for d in text["Displays"] if d["Class"].endswith("RobotModel"))
    assert model["Description Topic"]["Durability Policy"] == "Transient Local"
    assert "<robot" in messages[model["Description Topic"]["Value"]].data  # type: ignore[attr-defined]
    assert text["Global Options"]["Fixed Frame"] == messages["/rb_sim/door/pose"].header.frame_id  # type: ignore[attr-defined]


def test_the_arrow_of_the_weight_has_the_size_of_the_scene(files):
    text = yaml.safe_load(files["rviz"])["Visualization Manager"]
    wrench = next(d for d in text["Displays"] if d["Class"].endswith("Wrench"))
    length = wrench["Force Arrow Scale"] * 5.0 * 9.81
    assert 0.2 < length < 2.5 and text["Views"]["Current"]["Distance"] > 1.0


def test_of_many_bodies_the_first_are_shown_and_it_is_said(tmp_path, capsys):
    balls = {
        f"ball{k}": {
            "mass": 1.0,
            "shape": {"type": "sphere", "radius": 0.1},
            "position": [0.3 * k, 0, 1],
        }
        for k in range(30)
    }
    floor = {"type": "contact", "body": "all"}
    data = {"bodies": balls, "constraints": {"floor": floor}, "effects": {"g": {"type": "gravity"}}}
    (tmp_path / "many.yaml").write_text(yaml.safe_dump(data))
    layout(str(tmp_path / "many.yaml"), tmp_path)
    reported = capsys.readouterr().err
    assert f"note: bodies: the first {MOST_BODIES} of 30\n" in reported
    assert f"note: reactions: the first {MOST_REACTIONS} of 30\n" in reported
    text = (tmp_path / "many.plotjuggler.xml").read_text()
    assert len(set(re.findall(r"/rb_sim/(ball\d+)/pose/", text))) == MOST_BODIES


def test_one_clear_line_where_it_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("nothing")
    for name in ("file", "pipe", "link"):
        with pytest.raises(RbSimError, match=f"{name}: is not a folder; must be one, or a name"):
            layout("pendulum", tmp_path / name)
    with pytest.raises(RbSimError, match="does not exist"):
        layout("pendulums", Path(tmp_path))
