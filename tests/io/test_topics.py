# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The table of topics: names that ROS takes, frames, and the body origin against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from rb_sim.base.errors import SinkError
from rb_sim.io.messages.cdr import stamp_of
from rb_sim.io.messages.topics import TopicTable
from rb_sim.mechanics.samples import SampleLayout
from rb_sim.scene.load import load_scene

STORE = get_typestore(Stores.ROS2_JAZZY)


def messages(table: TopicTable, block, sample: int) -> dict:
    """topic -> message of one sample, decoded by rosbags."""
    stamp, row, events = list(table.messages(block))[sample]
    assert not events
    assert stamp == round(block.t[sample] * 1e9)
    return {
        topic.name: STORE.deserialize_cdr(data, topic.ros_type)
        for topic, data in zip(table.topics, row, strict=True)
    }


def xyz(vector) -> list[float]:
    return [vector.x, vector.y, vector.z]


def test_names_and_types(scene, layout):
    assert {t.name: t.ros_type.split("/")[-1] for t in TopicTable(scene, layout).topics} == {
        "ball/pose": "PoseStamped",
        "ball/twist": "TwistStamped",
        "door/pose": "PoseStamped",
        "door/twist": "TwistStamped",
        "ball/wrench_applied": "WrenchStamped",
        "reactions/floor": "WrenchStamped",
        "reactions/hinge": "WrenchStamped",
        "reactions/hinge/A": "WrenchStamped",
        "reactions/hinge/B": "WrenchStamped",
        "energy": "Float64",
        "energy/kinetic": "Float64",
        "energy/potential": "Float64",
        "power": "Float64",
        "residual": "Float64",
        "/tf": "TFMessage",
        "/clock": "Clock",
    }


def test_ros_takes_the_names(scene, layout):
    names = pytest.importorskip("rclpy.validate_full_topic_name", reason="no ROS here")
    for topic in TopicTable(scene, layout).topics:
        assert names.validate_full_topic_name(topic.full_name("/lab/rb_sim"))
    odd = SampleLayout(("A__b_",), ("c__9_/B",), ("A__b_",), ("A__b_",))
    lone = load_scene({"bodies": {"A__b_": {"mass": 1, "inertia": [1, 1, 1]}}})
    for topic in TopicTable(lone, odd).topics:
        assert names.validate_full_topic_name(topic.full_name())


def test_skipped_topics_are_not_packed(scene, layout, samples):
    table = TopicTable(scene, layout, skip={"/tf", "/clock", "energy/kinetic"})
    assert not {"/tf", "/clock", "energy/kinetic"} & {t.name for t in table.topics}
    instant = next(table.messages(samples(1)))
    assert len(instant.messages) == len(table.topics)


def test_pose_and_twist_are_those_of_the_body_origin(scene, layout, samples):
    """p_O = p_C - R r_OC, v_O = v_C - w x R r_OC, with rotation matrices of scipy."""
    block = samples(5)
    for sample in range(5):
        found = messages(TopicTable(scene, layout), block, sample)
        for i, name in enumerate(layout.bodies):
            R = Rotation.from_quat(block.orientation[sample, i]).as_matrix()
            w_W = R @ block.angular_velocity[sample, i]
            r_W = R @ np.array(scene.bodies[name].center_of_mass)
            pose, twist = found[f"{name}/pose"], found[f"{name}/twist"]
            assert pose.header.frame_id == twist.header.frame_id == "world"
            close(xyz(pose.pose.position), block.position[sample, i] - r_W)
            q = pose.pose.orientation
            assert [q.x, q.y, q.z, q.w] == block.orientation[sample, i].tolist()
            close(xyz(twist.twist.angular), w_W)
            velocity = block.linear_velocity[sample, i] - np.cross(w_W, r_W)
            close(xyz(twist.twist.linear), velocity)


def close(found, expected) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-15)


def test_pendulum_on_its_origin_publishes_a_point_at_rest():
    """The origin of a body that swings about it does not move, wherever its centre of mass is."""
    from rb_sim.mechanics.samples import empty_block

    body = {"mass": 2, "inertia": [1, 1, 1], "center_of_mass": [0, 0, -0.5]}
    scene = load_scene({"bodies": {"bob": body}})
    layout = SampleLayout(("bob",), (), (), ())
    block = empty_block(1, layout)
    angle, rate = 0.7, 1.3  # about y
    block.orientation[0, 0] = [0, np.sin(angle / 2), 0, np.cos(angle / 2)]
    block.angular_velocity[0, 0] = [0, rate, 0]
    block.position[0, 0] = [-0.5 * np.sin(angle), 0, -0.5 * np.cos(angle)]
    block.linear_velocity[0, 0] = [-0.5 * rate * np.cos(angle), 0, 0.5 * rate * np.sin(angle)]
    found = messages(TopicTable(scene, layout), block, 0)
    close(xyz(found["bob/pose"].pose.position), [0, 0, 0])
    close(xyz(found["bob/twist"].twist.linear), [0, 0, 0])
    close(xyz(found["bob/twist"].twist.angular), [0, rate, 0])


def test_wrenches_act_at_the_origin_of_their_frame(scene, layout, samples):
    block = samples(3)
    found = messages(TopicTable(scene, layout), block, 2)
    transforms = {t.child_frame_id: t for t in found["/tf"].transforms}
    assert {t.header.frame_id for t in transforms.values()} == {"world"}
    for i, name in enumerate(layout.reactions):
        wrench = found[f"reactions/{name}"]
        assert wrench.header.frame_id == f"{name}/anchor"
        assert xyz(wrench.wrench.force) == block.reaction_force[2, i].tolist()
        assert xyz(wrench.wrench.torque) == block.reaction_torque[2, i].tolist()
        frame = transforms[f"{name}/anchor"].transform
        assert xyz(frame.translation) == block.anchor[2, i].tolist()
        assert [*xyz(frame.rotation), frame.rotation.w] == [0, 0, 0, 1]
    applied = found["ball/wrench_applied"]
    assert applied.header.frame_id == "ball/origin"
    assert [*xyz(applied.wrench.force), *xyz(applied.wrench.torque)] == block.command[2, 0].tolist()
    origin = transforms["ball/origin"].transform
    assert xyz(origin.translation) == xyz(found["ball/pose"].pose.position)
    door = transforms["door"].transform
    assert xyz(door.translation) == xyz(found["door/pose"].pose.position)
    assert [*xyz(door.rotation), door.rotation.w] == block.orientation[2, 1].tolist()
    assert len(transforms) == len(found["/tf"].transforms) == 7


def test_scalars_and_clock(scene, layout, samples):
    block = samples(4)
    found = messages(TopicTable(scene, layout), block, 3)
    assert found["energy"].data == block.kinetic_energy[3] + block.potential_energy[3]
    assert found["energy/kinetic"].data == block.kinetic_energy[3]
    assert found["power"].data == block.power[3]
    assert found["residual"].data == block.residual[3]
    assert (found["/clock"].clock.sec, found["/clock"].clock.nanosec) == (0, 30_000_000)


def test_two_sources_of_one_topic_are_refused():
    scene = load_scene({"bodies": {"reactions": {"mass": 1, "inertia": [1, 1, 1]}}})
    layout = SampleLayout(("reactions",), ("pose",), ("reactions",), ())
    with pytest.raises(SinkError, match="^topic /rb_sim/reactions/pose: two sources"):
        TopicTable(scene, layout)


def test_stamps_are_rounded_not_cut(scene, layout, samples):
    """1.001 s is 1000999999.9999999 ns in floating point; its stamp ends in 1000000."""
    block = samples(3)
    block = replace(block, t=np.array([1.001, 1.005, 2.003]))
    table = TopicTable(scene, layout)
    stamps = [stamp for stamp, *_ in table.messages(block)]
    assert stamps == [1_001_000_000, 1_005_000_000, 2_003_000_000]
    assert stamp_of(1.001) == 1_001_000_000
