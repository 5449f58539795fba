# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Names as CAD programs give them: kept in the scene, changed where ROS allows less."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
import yaml

from rb_sim import SceneError, SceneWarning, Simulation, Trajectory, load_scene
from rb_sim.base.errors import RbSimError
from rb_sim.base.names import keys_of, ros_name
from rb_sim.scene.values import with_value

BODY = {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}}
CAD = {
    "bodies": {
        "left-wheel": BODY | {"position": [0, 0, 0.2]},
        "2nd gear (1)": BODY | {"position": [1, 0, 1]},
        "Räder.v1.2": BODY | {"position": [2, 0, 1], "angular_velocity": [0, 1, 0]},
    },
    "constraints": {
        "floor-1": {"type": "contact", "body": "left-wheel"},
        "hinge:1": {"type": "fixed_axis", "body": "Räder.v1.2", "axis_B": [0, 1, 0]},
    },
    "effects": {
        "g+1": {"type": "gravity"},
        "drive 1": {"type": "commanded_wrench", "body": "2nd gear (1)"},
    },
    "simulation": {"duration": 0.3, "rate": 50},
}


def scene(data: dict[str, Any] = CAD) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        return load_scene(data)


@pytest.mark.parametrize(
    ("name", "called"),
    [
        ("left-wheel", "left_wheel"),
        ("2nd_gear", "x2nd_gear"),
        ("a  b", "a_b"),
        ("v1.2", "v1_2"),
        ("arm:1+wheel (2)", "arm_1_wheel_2"),
        ("Räder", "Rader"),
        ("轮", "u8f6e"),
        ("a__b_", "a__b_"),
        ("轮" * 64, ("u8f6e" * 64)[:64]),
    ],
)
def test_what_ros_calls_a_name(name: str, called: str) -> None:
    assert ros_name(name) == called


def test_one_line_says_which_names_are_changed() -> None:
    with pytest.warns(SceneWarning) as found:
        load_scene(CAD)
    (line,) = (str(each.message) for each in found)
    assert "left-wheel -> left_wheel, 2nd gear (1) -> x2nd_gear_1" in line
    assert "Räder.v1.2 -> Rader_v1_2" in line and "hinge:1 -> hinge_1" in line
    assert "g+1" not in line  # no topic is called as an effect is


@pytest.mark.parametrize("section", ["bodies", "constraints"])
def test_two_names_that_ros_would_call_the_same_are_refused(section: str) -> None:
    names = {"a-b": BODY, "a b": BODY} if section == "bodies" else {"ball": BODY}
    pins = {"a-b": {"type": "fixed_point", "body": "ball"}, "a.b": {"type": "free", "body": "ball"}}
    data = {"bodies": names} | ({} if section == "bodies" else {"constraints": pins})
    with pytest.raises(SceneError, match="topics call both a-b and a.b a_b"):
        load_scene(data)


@pytest.mark.parametrize("name", ["world", "world."])
def test_no_body_takes_the_frame_of_the_world(name: str) -> None:
    with pytest.raises(SceneError, match="must be another name"):
        load_scene({"bodies": {name: BODY}})


@pytest.mark.parametrize(
    "name", ["_a", "-a", "a ", "a/b", "a[0]", "a=b", "a\\b", 'a"', "", "a,b", "a$b"]
)
def test_what_is_no_name_is_refused(name: str) -> None:
    with pytest.raises(SceneError, match="must be a name: a letter or digit, then letters"):
        load_scene({"bodies": {name: BODY}})


def test_a_bag_brings_the_names_of_the_scene_back(tmp_path) -> None:
    from rosbags.highlevel import AnyReader

    from rb_sim.io.bag.bag_sink import BagSink

    simulation = Simulation(scene())
    sink = BagSink(tmp_path / "bag")
    sink.open(simulation.scene, simulation.layout)
    simulation.advance(0.1)
    simulation.apply_wrench("2nd gear (1)", (1, 0, 0), (0, 0, 0), frame="body")
    run = simulation.run()
    sink.write(run.block)
    sink.close({})
    with AnyReader([tmp_path / "bag"]) as reader:
        topics = set(reader.topics)
        (tf, *_) = reader.messages(c for c in reader.connections if c.topic == "/tf")
        frames = {
            each.child_frame_id for each in reader.deserialize(tf[2], tf[0].msgtype).transforms
        }
    assert {"/rb_sim/left_wheel/pose", "/rb_sim/x2nd_gear_1/wrench_applied"} <= topics
    assert {"/rb_sim/reactions/hinge_1/A", "/rb_sim/contacts/floor_1/state"} <= topics
    assert {"left_wheel", "x2nd_gear_1/origin", "hinge_1/B/anchor"} <= frames
    again = Trajectory.from_bag(tmp_path / "bag")
    assert set(again.position) == set(CAD["bodies"])
    np.testing.assert_allclose(again.position["Räder.v1.2"], run.position["Räder.v1.2"], atol=1e-12)
    np.testing.assert_array_equal(again.reaction["floor-1"].force, run.reaction["floor-1"].force)


def test_a_change_finds_any_name_and_a_number_in_a_list() -> None:
    data = with_value(CAD, "bodies.2nd gear (1).mass=3")
    data = with_value(data, 'bodies["Räder.v1.2"].position[2]=4')
    assert data["bodies"]["2nd gear (1)"]["mass"] == 3
    assert data["bodies"]["Räder.v1.2"]["position"] == [2, 0, 4]
    with pytest.raises(RbSimError, match=r"there is no 3; must be \[0\] to \[2\]"):
        with_value(CAD, "bodies.left-wheel.position[3]=1")


@pytest.mark.parametrize("name", CAD["bodies"])
def test_the_key_of_an_error_is_a_path_to_what_is_wrong(name: str) -> None:
    bodies = CAD["bodies"] | {name: BODY | {"mass": -1.0}}
    with pytest.raises(SceneError) as error:
        load_scene(CAD | {"bodies": bodies})
    assert keys_of(error.value.key) == ("bodies", name, "mass")


def test_a_sweep_varies_a_body_of_any_name(tmp_path) -> None:
    from rb_sim.sweeps.one_run import PlanRunner
    from rb_sim.sweeps.plan import load_plan

    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(CAD))
    vary = {"path": 'bodies["Räder.v1.2"].mass', "list": [1.0, 2.0]}
    plan = {
        "scene": str(tmp_path / "scene.yaml"),
        "vary": {"m": vary},
        "outputs": {"weight": 'last(reaction["hinge:1"].force.z)'},
    }
    with pytest.warns(SceneWarning, match="Rader_v1_2"):
        runner = PlanRunner(load_plan(plan))
    row, _ = runner.run({"m": 2.0})
    assert row["weight"] == pytest.approx(2.0 * 9.80665, rel=1e-3)
