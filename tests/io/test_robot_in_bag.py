# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What a viewer needs to draw a bag: robot description and joint states."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from rb_sim.io.bag.bag_sink import BagSink
from rb_sim.io.messages.robot_description import JointTable
from rb_sim.mechanics.samples import Input, SampleLayout, empty_block
from rb_sim.scene.load import load_scene

SPIN = 400.0
"""[rad/s]: more than half a turn between two samples."""

WHEEL = {
    "bodies": {
        "wheel": {"mass": 1.0, "shape": {"type": "disk", "radius": 0.2, "axis_B": [0, 0, 1]}}
    },
    "constraints": {"axle": {"type": "fixed_axis", "body": "wheel", "axis_B": [0, 0, 1]}},
    "effects": {"weight": {"type": "gravity"}},
}


def messages(bag: Path, topic: str) -> list:
    """All of a topic, decoded by rosbags."""
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        mine = [c for c in reader.connections if c.topic == topic]
        rows = reader.messages(mine) if mine else ()  # of no connections it gives all messages
        return [reader.deserialize(data, c.msgtype) for c, _, data in rows]


def test_what_is_latched_comes_first_and_is_for_who_comes_late(record):
    bag = record()
    with (bag / "bag_0.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        order = [channel.topic for _, channel, _ in reader.iter_messages()]
        channels = {c.topic: c.metadata for c in reader.get_summary().channels.values()}
    latched = ["/rb_sim/description", "/robot_description", "/rb_sim/markers"]
    assert order[:3] == latched and not set(order[3:]) & set(latched)
    latched.append("/rb_sim/joint_states")
    info = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    of_rosbag2 = {t["topic_metadata"]["name"]: t for t in info["topics_with_message_count"]}
    for topic, metadata in channels.items():
        durability = "transient_local" if topic in latched else "volatile"
        for profiles in (
            yaml.safe_load(metadata["offered_qos_profiles"]),
            of_rosbag2[topic]["topic_metadata"]["offered_qos_profiles"],
        ):
            assert [profile["durability"] for profile in profiles] == [durability]


def test_the_description_is_that_of_the_scene(record):
    bag = record()
    (document,) = messages(bag, "/robot_description")
    robot = ElementTree.fromstring(document.data)
    assert {link.get("name") for link in robot.iter("link")} >= {"world", "ball", "door"}
    assert robot.find("link[@name='ball']/visual/geometry/sphere").get("radius") == "0.1"
    assert robot.find("joint[@name='hinge']").get("type") == "continuous"
    (reported,) = messages(bag, "/rb_sim/description")
    assert json.loads(reported.data)["constraints"] == {"floor": "rolling", "hinge": "fixed_axis"}


def test_the_markers_are_the_shapes_in_the_frames_of_the_bodies(record):
    (array,) = messages(record(), "/rb_sim/markers")
    ball, door = array.markers
    assert (ball.header.frame_id, door.header.frame_id) == ("ball", "door")
    assert (ball.type, door.type) == (2, 1) and ball.frame_locked
    assert (ball.scale.x, ball.scale.z) == (0.2, 0.2)
    assert (door.scale.x, door.scale.y, door.scale.z) == (0.6, 0.04, 1.0)
    assert (door.pose.position.x, door.pose.position.z) == (0.3, 0.5)
    assert (ball.id, door.id) == (0, 1) and ball.color.a == 1.0


def test_odometry_is_recorded_where_it_is_asked_for(record):
    assert not messages(record("without"), "/rb_sim/door/odometry")
    bag = record(odometry=True)
    odometry = messages(bag, "/rb_sim/door/odometry")
    poses, twists = (messages(bag, f"/rb_sim/door/{name}") for name in ("pose", "twist"))
    assert len(odometry) == len(poses) == 200
    one, pose, twist = odometry[77], poses[77].pose, twists[77].twist
    assert (one.header.frame_id, one.child_frame_id) == ("world", "door")
    assert str(one.header) == str(poses[77].header) and str(one.pose.pose) == str(pose)
    q = pose.orientation
    turn = Rotation.from_quat([q.x, q.y, q.z, q.w])
    for name in ("linear", "angular"):
        own, world = (getattr(of, name) for of in (one.twist.twist, twist))
        mine = turn.apply([own.x, own.y, own.z])
        np.testing.assert_allclose(mine, [world.x, world.y, world.z], atol=1e-12)


def test_the_state_of_the_node_is_recorded_when_it_changes(tmp_path, scene, layout, samples):
    sink = BagSink(tmp_path / "bag", split_duration=0.5)
    sink.open(scene, layout)
    sink.note_state("paused")
    sink.write(samples(30))
    sink.note_state("running")
    sink.write(samples(60, start=0.3))
    sink.close()
    texts = [m.data for m in messages(tmp_path / "bag", "/rb_sim/state")]
    assert texts == ["paused", "running", "running"]  # once more in the second file
    with AnyReader([tmp_path / "bag"], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as bag:
        mine = [c for c in bag.connections if c.topic == "/rb_sim/state"]
        times = [time * 1e-9 for _, time, _ in bag.messages(mine)]
    np.testing.assert_allclose(times, [0.0, 0.29, 0.5], atol=1e-9)


def test_the_namespace_of_the_node_is_that_of_its_description(tmp_path, scene, layout, samples):
    sink = BagSink(tmp_path / "bag", namespace="/lab/robot1")
    sink.open(scene, layout)
    sink.write(samples(3))
    sink.close()
    assert len(messages(tmp_path / "bag", "/lab/robot_description")) == 1
    assert len(messages(tmp_path / "bag", "/lab/robot1/joint_states")) == 3


def wheel(n: int, first: int = 0):
    """Samples at 100 Hz of a wheel that turns at SPIN."""
    scene = load_scene(WHEEL)
    layout = SampleLayout(("wheel",), ("axle",), ("wheel",), ())
    block = empty_block(n, layout)
    block.t[:] = (first + np.arange(n)) / 100.0
    block.orientation[:, 0] = Rotation.from_rotvec(
        np.outer(SPIN * block.t, [0.0, 0.0, 1.0])
    ).as_quat()
    block.angular_velocity[:, 0] = [0.0, 0.0, SPIN]
    return scene, layout, block


@pytest.mark.parametrize("pieces", [1, 7])
def test_joint_states_count_turns_however_the_samples_come(tmp_path, pieces):
    scene, layout, block = wheel(70)
    sink = BagSink(tmp_path / "bag")
    sink.open(scene, layout)
    size = 70 // pieces
    for first in range(0, 70, size):
        sink.write(wheel(size, first)[2])
    sink.close()
    found = messages(tmp_path / "bag", "/rb_sim/joint_states")
    assert {tuple(message.name) for message in found} == {("axle",)}
    np.testing.assert_allclose([m.position[0] for m in found], SPIN * block.t, atol=1e-9)
    np.testing.assert_allclose([m.velocity[0] for m in found], SPIN, rtol=1e-12)
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in found]
    np.testing.assert_allclose(stamps, block.t, atol=1e-9)


def test_a_scene_without_joints_has_no_joint_states(tmp_path):
    _, layout, block = wheel(5)
    sink = BagSink(tmp_path / "bag")
    sink.open(load_scene({**WHEEL, "constraints": {}}), layout)
    sink.write(block)
    sink.close()
    assert not messages(tmp_path / "bag", "/rb_sim/joint_states")
    assert len(messages(tmp_path / "bag", "/robot_description")) == 1


ARM = 0.2
"""Of the arm on the slider: from its origin to its pin [m]."""

SLIDER = {
    "bodies": {
        "slider": {
            "mass": 1.0,
            "inertia": [1.0, 1.0, 1.0],
            "center_of_mass": [0.3, 0.0, 0.1],
            "position": [1.0, 2.0, 3.0],
            "orientation": {"axis": [1.0, 2.0, 3.0], "angle": 0.8},
        },
        "arm": {"mass": 1.0, "inertia": [1.0, 1.0, 1.0]},
        "ring": {"mass": 1.0, "inertia": [1.0, 1.0, 1.0]},
    },
    "constraints": {
        "pin": {
            "type": "fixed_axis",
            "body": "arm",
            "parent": "slider",
            "point_B": [ARM, 0.0, 0.0],
            "axis_B": [0.0, 1.0, 0.0],
        },
        "rail": {
            "type": "translation",
            "body": "slider",
            "point_B": [0.0, 0.5, 0.0],
            "guide": {"type": "line", "direction": [0.0, -3.0, 4.0]},
        },
        "track": {
            "type": "translation",
            "body": "ring",
            "guide": {"type": "circle", "center": [1.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0],
                      "radius": 1.0},
        },
    },
    "effects": {"weight": {"type": "gravity"}},
}  # fmt: skip
ALONG = np.array([0.0, -0.6, 0.8])


def slider(n: int = 30):
    """Samples at 100 Hz of a slider with s = t - 2 t^2, and of an arm that turns on it at 3 rad/s;
    displacement, speed and the poses of the bodies' origins."""
    scene = load_scene(SLIDER)
    layout = SampleLayout(
        ("slider", "arm", "ring"), ("pin", "rail", "track"), ("arm", "slider", "ring"), ()
    )
    block = empty_block(n, layout)
    t = block.t[:] = np.arange(n) / 100.0
    way, speed = t - 2.0 * t**2, 1.0 - 4.0 * t
    block.linear_velocity[:, 0] = np.outer(speed, ALONG)
    fixed = Rotation.from_quat(scene.bodies["slider"].orientation)
    turned = Rotation.from_rotvec(np.outer(3.0 * t, [0.0, 1.0, 0.0]))
    block.orientation[:, 0], block.orientation[:, 1] = fixed.as_quat(), turned.as_quat()
    block.angular_velocity[:, 1] = [0.0, 3.0, 0.0]
    origin = np.array([1.0, 2.0, 3.0]) + np.outer(way, ALONG)
    block.position[:, 0] = origin + fixed.apply([0.3, 0.0, 0.1])
    block.position[:, 1] = origin - turned.apply([ARM, 0.0, 0.0])
    block.orientation[:, 2] = [0.0, 0.0, 0.0, 1.0]
    return scene, layout, block, (way, speed), (origin, block.position[:, 1])


def placed(robot: ElementTree.Element, link: str, positions: dict[str, float]):
    """Origin and orientation of a link in the world, as robot_state_publisher finds them."""
    place, turn = np.zeros(3), Rotation.identity()
    while link != "world":
        (joint,) = [j for j in robot.iter("joint") if j.find("child").get("link") == link]
        origin = joint.find("origin")
        of_xyz, of_rpy = (np.array(origin.get(k).split(), dtype=float) for k in ("xyz", "rpy"))
        at, by = of_xyz, Rotation.from_euler("xyz", of_rpy)
        if joint.get("type") in ("prismatic", "continuous"):
            axis = np.array(joint.find("axis").get("xyz").split(), dtype=float)
            value = positions[joint.get("name")]
            if joint.get("type") == "prismatic":
                at = at + by.apply(value * axis)
            else:
                by = by * Rotation.from_rotvec(value * axis)
        place, turn, link = at + by.apply(place), by * turn, joint.find("parent").get("link")
    return place, turn


def test_a_linear_guide_is_a_prismatic_joint_that_joint_states_move(tmp_path):
    """The URDF's tree with the positions of joint_states gives the bodies' own poses."""
    scene, layout, block, (way, speed), (slider_at, arm_at) = slider()
    sink = BagSink(tmp_path / "bag")
    sink.open(scene, layout)
    sink.write(block)
    sink.close()
    states = messages(tmp_path / "bag", "/rb_sim/joint_states")
    assert {tuple(state.name) for state in states} == {("pin", "rail")}
    np.testing.assert_allclose([s.position[1] for s in states], way, atol=1e-14)
    np.testing.assert_allclose([s.velocity[1] for s in states], speed, atol=1e-14)
    (document,) = messages(tmp_path / "bag", "/robot_description")
    robot = ElementTree.fromstring(document.data)
    assert robot.find("joint[@name='ring/free']").get("type") == "floating"
    rail = robot.find("joint[@name='rail']")
    assert rail.get("type") == "prismatic"
    limit = {key: float(value) for key, value in rail.find("limit").attrib.items()}
    assert limit["lower"] < -1e6 < 1e6 < limit["upper"]
    assert limit["effort"] > 1e6 and limit["velocity"] > 1e6
    for k, state in enumerate(states):
        positions = dict(zip(state.name, state.position, strict=True))
        for i, (name, at) in enumerate((("slider", slider_at), ("arm", arm_at))):
            place, turn = placed(robot, name, positions)
            np.testing.assert_allclose(place, at[k], atol=1e-12)
            own = Rotation.from_quat(block.orientation[k, i])
            assert (own.inv() * turn).magnitude() < 1e-12


def test_a_displacement_begins_anew_after_a_reset():
    scene, layout, block, (way, _), _ = slider()
    block = replace(block, inputs=(Input(10, 0.0, ""),))
    found = JointTable(scene, layout).values(block)[:, 1]
    np.testing.assert_allclose(found[:10], way[:10], atol=1e-14)
    np.testing.assert_allclose(found[10:], way[10:] - way[10], atol=1e-14)
