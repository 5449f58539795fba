# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""CDR against two independent implementations: rclpy (Fast CDR) and rosbags."""

from __future__ import annotations

import json
import random
import sys
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from rb_sim.io.messages import cdr
from rb_sim.io.messages import cdr as types

STAMP = 12 * cdr.NANO + 345_678_901
FRAMES = ["", "w", "ab", "abc", "world", "hinge/A/anchor", "x" * 29]
STORE = get_typestore(Stores.ROS2_JAZZY)
NUMBERS = [random.Random(1).uniform(-9, 9) for _ in range(60)]


def cases():
    """(ROS type, codec or bytes, expected fields as a flat list)."""
    for frame in FRAMES:
        yield types.POSE_STAMPED, cdr.pose_stamped(frame), [frame]
        yield types.TWIST_STAMPED, cdr.twist_stamped(frame), [frame]
        yield types.WRENCH_STAMPED, cdr.wrench_stamped(frame), [frame]
        pairs = [("world", frame), (frame, "ball"), ("a", "b")]
        yield types.TF_MESSAGE, cdr.tf_message(pairs), [name for pair in pairs for name in pair]
        names = [frame, "b", "cde"]
        yield types.JOINT_STATE, cdr.joint_state(frame, names), [frame, *names]
    yield types.TF_MESSAGE, cdr.tf_message([]), []
    yield types.FLOAT64, cdr.float64(), []
    yield types.CLOCK, cdr.clock(), []


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
    if ros_type == types.TF_MESSAGE:
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
    assert STORE.deserialize_cdr(data, types.STRING).data == text
    serialization = pytest.importorskip("rclpy.serialization", reason="no ROS here")
    assert serialization.deserialize_message(data, ros_class(types.STRING)).data == text


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
    array = STORE.deserialize_cdr(data, types.DIAGNOSTIC_ARRAY)
    assert array.header.stamp.sec * cdr.NANO + array.header.stamp.nanosec == stamp
    (status,) = array.status
    assert (status.level, status.name, status.message) == (0, name, message)
    assert {pair.key: pair.value for pair in status.values} == values
    assert bytes(STORE.serialize_cdr(array, types.DIAGNOSTIC_ARRAY)) == data
    for end in range(len(cdr.HEADER), len(data) - 1):
        with pytest.raises(ValueError, match="."):
            cdr.read_diagnostic(data[:end])


@pytest.mark.parametrize("arguments", DIAGNOSTICS)
def test_rclpy_reads_diagnostics_and_writes_the_same(arguments):
    serialization = pytest.importorskip("rclpy.serialization", reason="no ROS here")
    data = cdr.diagnostic(*arguments)
    array = serialization.deserialize_message(data, ros_class(types.DIAGNOSTIC_ARRAY))
    same_but_for_padding(bytes(serialization.serialize_message(array)), data)


@pytest.mark.parametrize("number", [0, 2, 255])
def test_uint8(number):
    data = cdr.uint8().pack(STAMP, [number])
    assert STORE.deserialize_cdr(data, types.UINT8).data == number
    assert cdr.uint8().unpack(data) == [number]
    serialization = pytest.importorskip("rclpy.serialization", reason="no ROS here")
    assert serialization.deserialize_message(data, ros_class(types.UINT8)).data == number


def test_stamp():
    codec = cdr.pose_stamped("world")
    rows = np.frombuffer(codec.pack(STAMP, NUMBERS[:7]), np.uint8)[None]
    assert codec.unpack_stamps(rows).tolist() == [STAMP]
    assert codec.unpack_rows(rows).tolist() == [list(NUMBERS[:7])]


def test_padding_is_zero():
    """Strings of 1 and 8 bytes leave 7 and 0 bytes of padding; equal calls give equal bytes."""
    for frame in FRAMES:
        codec = cdr.pose_stamped(frame)
        head = 4 + 8 + 4 + len(frame) + 1
        data = codec.pack(STAMP, NUMBERS[:7])
        assert data[head:-56] == bytes(-(head - 4) % 8)
        assert data == codec.pack(STAMP, NUMBERS[:7])


@pytest.mark.parametrize("ros_type", sorted(types.TYPE_HASHES))
def test_type_hash_and_fields_are_those_of_ros(ros_type):
    assert STORE.hash_rihs01(ros_type) == types.TYPE_HASHES[ros_type]
    for name in types.FIELDS:
        theirs = [field for field, _ in STORE.fielddefs[name][1]]
        assert [line.split()[1] for line in types.FIELDS[name]] == theirs


@pytest.mark.parametrize("ros_type", sorted(types.TYPE_HASHES))
def test_installed_ros_agrees(ros_type):
    package, _, name = ros_type.split("/")
    path = Path(sys.prefix) / "share" / package / "msg" / f"{name}.json"
    if not path.exists():
        pytest.skip(f"{package} is not installed")
    hashes = {h["type_name"]: h["hash_string"] for h in json.loads(path.read_text())["type_hashes"]}
    assert hashes[ros_type] == types.TYPE_HASHES[ros_type]


def test_schema_text_lists_every_type_once():
    text = types.schema_text(types.TF_MESSAGE)
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
