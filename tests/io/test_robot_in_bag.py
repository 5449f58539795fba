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

from rb_sim.io.bag.sink import BagSink
from rb_sim.io.messages.joints import JointTable
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
    latched = ["/rb_sim/description", "/robot_description"]
    assert order[:2] == latched and not set(order[2:]) & set(latched)
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
    (told,) = messages(bag, "/rb_sim/description")
    assert json.loads(told.data)["constraints"] == {"floor": "rolling", "hinge": "fixed_axis"}


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


def test_joint_states_begin_anew_after_a_reset():
    scene, layout, block = wheel(20)
    block = replace(block, inputs=(Input(10, 0.0, ""),))
    angles = JointTable(scene, layout).values(block)[:, 0]
    np.testing.assert_allclose(angles[:10], SPIN * block.t[:10], atol=1e-9)
    np.testing.assert_allclose(angles[10:], SPIN * (block.t[10:] - block.t[10]), atol=1e-9)


def test_a_scene_without_joints_has_no_joint_states(tmp_path):
    _, layout, block = wheel(5)
    sink = BagSink(tmp_path / "bag")
    sink.open(load_scene({**WHEEL, "constraints": {}}), layout)
    sink.write(block)
    sink.close()
    assert not messages(tmp_path / "bag", "/rb_sim/joint_states")
    assert len(messages(tmp_path / "bag", "/robot_description")) == 1
