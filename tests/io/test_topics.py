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

import random
from dataclasses import replace

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from rb_sim.base.errors import SinkError
from rb_sim.io.messages import cdr
from rb_sim.io.messages.cdr import stamp_of
from rb_sim.io.messages.packing import FIELDS
from rb_sim.io.messages.topics import TopicTable
from rb_sim.mechanics.samples import (
    ARRAYS,
    SampleLayout,
    SampleRow,
    block_of_rows,
    centers_of_mass,
    empty_block,
    origins,
    row_width,
)
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


# Messages from one buffer are those that each topic's layout gives field by field.


NAMES = tuple(f"heap/{k}" for k in range(1, 301))
LAYOUT = SampleLayout(
    bodies=("top", "nut"),
    reactions=("pin", *NAMES),
    reaction_bodies=("top",) + ("nut",) * 300,
    commanded=("nut",),
    contacts=NAMES,
)
SCENE = {
    "bodies": {
        "top": {"mass": 1.0, "inertia": [1, 1, 1], "center_of_mass": [0.1, 0.2, 0.3]},
        "nut": {"mass": 2.0, "inertia": [1, 2, 3]},
    }
}


@pytest.mark.parametrize("n", [1, 7])
@pytest.mark.parametrize("skip", [(), ("/tf", "power")])
def test_packed_at_once_or_field_by_field(n: int, skip: tuple[str, ...]) -> None:
    """300 contacts: more than an octet counts."""
    scene, chance = load_scene(SCENE), np.random.default_rng(5)
    empty = empty_block(n, LAYOUT)
    block = replace(
        empty,
        **{name: chance.normal(size=getattr(empty, name).shape) for name in ARRAYS},
    )
    block = replace(
        block,
        t=np.array([0.0, 0.1, 0.3, 2.0, 1e5, 2e9, 2.1e9])[7 - n :],
        contact_state=chance.integers(0, 3, size=block.contact_state.shape).astype(float),
    )
    table = TopicTable(scene, LAYOUT, skip)
    motion = origins(block, centers_of_mass(scene.bodies, LAYOUT.bodies))
    fields = (motion.position, block.orientation, *motion[1:], block.energy)
    fields += tuple(getattr(block, name) for name in FIELDS)
    source = np.hstack([np.tile([0.0, 1.0], (n, 1)), *(field.reshape(n, -1) for field in fields)])
    for k, instant in enumerate(table.messages(block)):
        assert instant.stamp == round(block.t[k] * 1e9)
        states = iter(block.contact_state[k].astype(int).tolist())
        for topic, data in zip(table.topics, instant.messages, strict=True):
            octet = topic.name.endswith("/state")
            numbers = [next(states)] if octet else source[k, list(topic.columns)].tolist()
            assert data == topic.codec.pack(instant.stamp, numbers), topic.name


def test_rows_of_the_kernel_give_the_bytes_of_their_blocks() -> None:
    """Centres of mass beside the origin, quaternions a little off unit length, signed zeros."""
    scene, chance = load_scene(SCENE), np.random.default_rng(6)
    table, samples = TopicTable(scene, LAYOUT), []
    for t in (0.0, 0.3, 2e9):
        row = chance.normal(size=row_width(LAYOUT))
        row[chance.integers(0, 26, size=5)] = (0.0, -0.0, 1.0, -1.0, 0.5)
        row[-len(LAYOUT.contacts) :] = chance.integers(0, 3, size=len(LAYOUT.contacts))
        sample = SampleRow(t, row, chance.normal(size=(1, 6)))
        expected = list(table.messages(sample.block(LAYOUT)))
        assert table.messages_of_rows([sample]) == expected
        samples.append(sample)
    assert table.messages_of_rows(samples) == list(table.messages(block_of_rows(samples, LAYOUT)))


# CDR against two independent implementations: rclpy (Fast CDR) and rosbags.


STAMP = 12 * cdr.NANO + 345_678_901
FRAMES = ["", "w", "ab", "abc", "world", "hinge/A/anchor", "x" * 29]

NUMBERS = [random.Random(1).uniform(-9, 9) for _ in range(60)]


def cases():
    """(ROS type, codec or bytes, expected fields as a flat list)."""
    for frame in FRAMES:
        yield cdr.POSE_STAMPED, cdr.codec(cdr.POSE_STAMPED, frame), [frame]
        yield cdr.TWIST_STAMPED, cdr.codec(cdr.TWIST_STAMPED, frame), [frame]
        yield cdr.WRENCH_STAMPED, cdr.codec(cdr.WRENCH_STAMPED, frame), [frame]
        pairs = [("world", frame), (frame, "ball"), ("a", "b")]
        frames = [name for pair in pairs for name in pair]
        yield cdr.TF_MESSAGE, cdr.codec(cdr.TF_MESSAGE, *frames, lengths=[len(pairs)]), frames
        names = [frame, "b", "cde"]
        codec = cdr.codec(cdr.JOINT_STATE, frame, *names, lengths=[len(names)] * 4)
        yield cdr.JOINT_STATE, codec, [frame, *names]
    yield cdr.TF_MESSAGE, cdr.codec(cdr.TF_MESSAGE, lengths=[0]), []
    yield cdr.FLOAT64, cdr.codec(cdr.FLOAT64), []
    yield cdr.CLOCK, cdr.codec(cdr.CLOCK), []


CASES = list(cases())
IDS = [f"{ros_type.split('/')[-1]}-{k}" for k, (ros_type, *_) in enumerate(CASES)]


def leaves(message) -> list:
    """All primitive fields of a message in order, of rclpy's as of rosbags' classes."""
    if isinstance(message, str | float | int | np.generic):
        return [message]
    if isinstance(message, list | tuple | np.ndarray) or hasattr(message, "typecode"):
        return [leaf for item in message for leaf in leaves(item)]
    if hasattr(message, "get_fields_and_field_types"):
        fields = message.get_fields_and_field_types()
    else:
        fields = message.__dataclass_fields__
    return [leaf for name in fields if name[0] != "_" for leaf in leaves(getattr(message, name))]


def check(found: list, texts: list[str], codec: cdr.Codec) -> None:
    """The fields are the stamp, the texts and the numbers, each in order."""
    assert [f for f in found if isinstance(f, str)] == texts
    numbers = [float(f) for f in found if isinstance(f, float | np.floating)]
    assert numbers == NUMBERS[: codec.size]
    whole = [f for f in found if isinstance(f, int | np.integer)]
    assert whole == [12, 345_678_901] * (len(whole) // 2)


@pytest.mark.parametrize(("ros_type", "codec", "texts"), CASES, ids=IDS)
def test_rosbags_reads_what_is_packed(ros_type, codec, texts):
    data = codec.pack(STAMP, NUMBERS[: codec.size])
    message = STORE.deserialize_cdr(data, ros_type)
    check(leaves(message), texts, codec)
    assert bytes(STORE.serialize_cdr(message, ros_type)) == data


@pytest.mark.parametrize(("ros_type", "codec", "texts"), CASES, ids=IDS)
def test_rclpy_reads_what_is_packed_and_writes_the_same(ros_type, codec, texts):
    serialization = pytest.importorskip("rclpy.serialization", reason="no ROS here")
    if ros_type == cdr.TF_MESSAGE:
        pytest.importorskip("tf2_msgs.msg", reason="tf2_msgs is not among the ROS wheels")
    kind = ros_class(ros_type)
    data = codec.pack(STAMP, NUMBERS[: codec.size])
    message = serialization.deserialize_message(data, kind)
    check(leaves(message), texts, codec)
    same_but_for_padding(bytes(serialization.serialize_message(message)), data)


def ros_class(ros_type: str):
    package, _, name = ros_type.split("/")
    return getattr(pytest.importorskip(f"{package}.msg", reason="no ROS here"), name)


def same_but_for_padding(theirs: bytes, ours: bytes) -> None:
    """Equal but for garbage where `ours` has zeros: between the fields and at the end."""
    assert len(ours) <= len(theirs) < len(ours) + 4
    assert all(b in (a, 0) for a, b in zip(theirs, ours, strict=False))


@pytest.mark.parametrize("text", ["", "a", "héllo ∮", "x" * 100])
def test_string(text):
    data = cdr.string(text)
    assert STORE.deserialize_cdr(data, cdr.STRING).data == text
    serialization = pytest.importorskip("rclpy.serialization", reason="no ROS here")
    assert serialization.deserialize_message(data, ros_class(cdr.STRING)).data == text


@pytest.mark.parametrize(("ros_type", "codec", "texts"), CASES, ids=IDS)
def test_unpack_undoes_pack(ros_type, codec, texts):
    data = codec.pack(STAMP, NUMBERS[: codec.size])
    assert codec.unpack(data) == NUMBERS[: codec.size]
    with pytest.raises(ValueError, match="bytes instead of"):
        codec.unpack(data + b"\0")


DIAGNOSTICS = [
    (STAMP, "floor", "impact", {"t": "12.3456789012", "impulse_x": "-1e-17"}),
    (0, "", "stops rolling", {}),
    (1, "hé", "x", {"abc": "", "": "abcd"}),
]


@pytest.mark.parametrize("arguments", DIAGNOSTICS)
def test_diagnostic(arguments):
    stamp, name, message, values = arguments
    data = cdr.diagnostic(*arguments)
    assert cdr.read_diagnostic(data) == arguments
    array = STORE.deserialize_cdr(data, cdr.DIAGNOSTIC_ARRAY)
    assert array.header.stamp.sec * cdr.NANO + array.header.stamp.nanosec == stamp
    (status,) = array.status
    assert (status.level, status.name, status.message) == (0, name, message)
    assert {pair.key: pair.value for pair in status.values} == values
    assert bytes(STORE.serialize_cdr(array, cdr.DIAGNOSTIC_ARRAY)) == data
    for end in range(len(cdr.HEADER), len(data) - 1):
        with pytest.raises(ValueError, match="."):
            cdr.read_diagnostic(data[:end])


@pytest.mark.parametrize("arguments", DIAGNOSTICS)
def test_rclpy_reads_diagnostics_and_writes_the_same(arguments):
    serialization = pytest.importorskip("rclpy.serialization", reason="no ROS here")
    data = cdr.diagnostic(*arguments)
    array = serialization.deserialize_message(data, ros_class(cdr.DIAGNOSTIC_ARRAY))
    same_but_for_padding(bytes(serialization.serialize_message(array)), data)


@pytest.mark.parametrize("number", [0, 2, 255])
def test_uint8(number):
    data = cdr.codec(cdr.UINT8).pack(STAMP, [number])
    assert STORE.deserialize_cdr(data, cdr.UINT8).data == number
    assert cdr.codec(cdr.UINT8).unpack(data) == [number]
    serialization = pytest.importorskip("rclpy.serialization", reason="no ROS here")
    assert serialization.deserialize_message(data, ros_class(cdr.UINT8)).data == number


@pytest.mark.parametrize("ros_type", sorted(cdr.TYPE_HASHES))
def test_type_hash_and_fields_are_those_of_ros(ros_type):
    assert STORE.hash_rihs01(ros_type) == cdr.TYPE_HASHES[ros_type]
    for name in cdr.FIELDS:
        theirs = [field for field, _ in STORE.fielddefs[name][1]]
        assert [line.split()[1] for line in cdr.FIELDS[name]] == theirs


def test_schema_text_lists_every_type_once():
    text = cdr.schema_text(cdr.TF_MESSAGE)
    parts = text.split("=" * 80 + "\n")
    assert parts[0] == "geometry_msgs/TransformStamped[] transforms\n"
    assert [part.splitlines()[0] for part in parts[1:]] == [
        "MSG: geometry_msgs/TransformStamped",
        "MSG: std_msgs/Header",
        "MSG: geometry_msgs/Transform",
        "MSG: builtin_interfaces/Time",
        "MSG: geometry_msgs/Vector3",
        "MSG: geometry_msgs/Quaternion",
    ]
