# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Messages are read by the schema in the file: fields that are not needed are passed over."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from mcap.writer import Writer
from rosbags.typesys import Stores, get_typestore

from rb_sim.bags.analysis.recorded_run import analyze
from rb_sim.bags.readings import READ, Readings, fields_of
from rb_sim.bags.tracks import tracks_of_bag
from rb_sim.io.messages.cdr import schema_text
from tests.bags.analysis import foreign

STORE = get_typestore(Stores.ROS2_JAZZY)
LINE = "=" * 80
HEADER = f"""{LINE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{LINE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
POSE = f"""{LINE}
MSG: geometry_msgs/Pose
Point position
Quaternion orientation
{LINE}
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
{LINE}
MSG: geometry_msgs/Quaternion
float64 x 0
float64 y 0
float64 z 0
float64 w 1
"""


@pytest.mark.parametrize("ros_type", sorted(set(READ) & set(STORE.types)))
def test_without_a_schema_a_type_has_the_fields_of_ros2s_own(ros_type):
    text, _ = STORE.generate_msgdef(ros_type, ros_version=2)
    assert fields_of(ros_type, text) == fields_of(ros_type, schema_text(ros_type))


def bag(path, schema: str, payloads: list[bytes]):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="somebody")
        kind = writer.register_schema("geometry_msgs/msg/PoseStamped", "ros2msg", schema.encode())
        channel = writer.register_channel("/body", "cdr", kind)
        for k, payload in enumerate(payloads):
            time = 10_000_000 * k
            writer.add_message(channel, time, b"\0\1\0\0" + payload, time)
        writer.finish()
    return path


def message(k: int) -> bytes:
    """uint8 quality, string source, stamp, frame, float32[2] extra, pose, uint16[] tail."""
    out = bytearray()

    def put(size: int, data: bytes) -> None:
        out.extend(bytes(-len(out) % size) + data)

    def text(value: str) -> None:
        put(4, struct.pack("<I", len(value) + 1))
        out.extend(value.encode() + b"\0")

    put(1, bytes([k % 3]))
    text("camera")
    put(4, struct.pack("<iI", 0, 10_000_000 * k))
    text("map")
    put(4, struct.pack("<2f", k, -k))
    for value in (k, 2.0 * k, 3.0, 0.0, 0.0, 0.0, 1.0):
        put(8, struct.pack("<d", value))
    put(4, struct.pack("<I", 2))
    put(2, struct.pack("<2H", k, 7))
    return bytes(out)


def test_fields_that_somebody_added_are_passed_over(tmp_path):
    schema = (
        "uint8 FAST=1  # a constant\nuint8 quality\nstring source\nstd_msgs/Header header\n"
        "float32[2] extra\ngeometry_msgs/Pose pose\nuint16[] tail\n" + HEADER + POSE
    )
    readings = Readings(bag(tmp_path / "x.mcap", schema, [message(k) for k in range(20)]))
    values = np.concatenate([piece.values for piece in readings.pieces()])
    k = np.arange(20.0)
    np.testing.assert_array_equal(values[:, :3], np.c_[k, 2.0 * k, 3.0 + 0.0 * k])
    assert not [note for note in readings.notes if "left out" in note]


@pytest.mark.parametrize(
    ("fields", "line"),
    [
        ("std_msgs/Header header\n", "lacks pose"),
        ("std_msgs/Header header\nOther pose\n", "does not define Other"),
    ],
)
def test_a_schema_without_what_is_needed_is_refused_in_one_line(tmp_path, fields, line):
    readings = Readings(bag(tmp_path / "x.mcap", fields + HEADER + POSE, [message(1)]))
    assert not list(readings.pieces())
    (note,) = [note for note in readings.notes if note.startswith("/body: skipped: ")]
    assert line in note and "\n" not in note


def test_fields_in_another_order_are_read_as_what_they_are(tmp_path):
    """A copy with w first, as many libraries have it, and the header and its frame last."""
    pose = POSE.replace("float64 w 1\n", "").replace("float64 x 0\n", "float64 w\nfloat64 x\n")
    stamp, frame = "builtin_interfaces/Time stamp\n", "string frame_id\n"
    header = HEADER.replace(stamp + frame, frame + stamp)
    schema = "geometry_msgs/Pose pose\nstd_msgs/Header header\n" + header + pose
    values = (1.0, 2.0, 3.0, 0.8, 0.0, 0.6, 0.0)
    data = struct.pack("<7d", *values) + struct.pack("<I4s", 4, b"map") + struct.pack("<iI", 7, 5)
    readings = Readings(bag(tmp_path / "x.mcap", schema, [data]))
    (piece,) = readings.pieces()
    np.testing.assert_array_equal(piece.values[0, :7], (1.0, 2.0, 3.0, 0.0, 0.6, 0.0, 0.8))
    assert piece.t[0] == pytest.approx(7.000000005)


def test_single_precision_is_refused(tmp_path):
    schema = "std_msgs/Header header\ngeometry_msgs/Pose pose\n" + HEADER + POSE
    readings = Readings(
        bag(tmp_path / "x.mcap", schema.replace("float64 y\n", "float32 y\n"), [message(1)])
    )
    assert not list(readings.pieces())
    assert any("pose.position.y in its schema is float32" in note for note in readings.notes)


# Bags of others whose `nanosec` holds microseconds or milliseconds.


def written(folder, unit: int, rate: float, n: int = 250):
    """A motion whose stamps hold the part of each second in units of `unit` nanoseconds."""
    t = 0.25 + np.arange(n) / rate
    wrong = np.floor(t) + np.round(t % 1.0 * 1e9 / unit) * 1e-9
    position, q = foreign.swing(n, rate)[1:]

    def pose(k, p, attitude):
        return foreign.pose_stamped(wrong[round((k - t[0]) * rate)], p, attitude)

    return foreign.write(folder, pose, t, position, q), t


@pytest.mark.parametrize(
    ("unit", "name"), [(1, ""), (1_000, "microseconds"), (1_000_000, "milliseconds")]
)
@pytest.mark.parametrize("rate", [20.0, 100.0])
def test_the_unit_of_nanosec_is_recognised_by_the_times_of_the_log(tmp_path, unit, name, rate):
    bag, t = written(tmp_path / "bag", unit, rate)
    found = tracks_of_bag(bag)
    np.testing.assert_allclose(found.bodies["/body"].t - foreign.EPOCH, t, atol=1e-6)
    said = [note for note in found.notes if "nanosec" in note]
    assert len(said) == bool(name) and all(f"holds {name}" in note for note in said)
    rates = analyze(bag).figures["/body"].rates.as_dict()
    assert rates["rate"] == pytest.approx(rate, rel=1e-6) and rates["gaps"] == 0


def test_stamps_that_nobody_has_set_are_the_times_of_the_log(tmp_path):
    t = 0.25 + np.arange(100) / 50.0
    position, q = foreign.swing(100, 50.0)[1:]

    def pose(k, p, attitude):
        return foreign.pose_stamped(-foreign.EPOCH, p, attitude)

    found = tracks_of_bag(foreign.write(tmp_path / "bag", pose, t, position, q))
    np.testing.assert_allclose(found.bodies["/body"].t - foreign.EPOCH, t, atol=1e-6)
    assert found.notes == ["/body: its stamps are zero: times of the log are taken"]


def test_a_simulation_that_begins_at_zero_keeps_its_stamps(tmp_path):
    t = np.arange(100) / 50.0

    def pose(k, p, attitude):
        return foreign.pose_stamped(k - foreign.EPOCH, p, attitude)

    found = tracks_of_bag(foreign.write(tmp_path / "bag", pose, t, *foreign.swing(100, 50.0)[1:]))
    np.testing.assert_allclose(found.bodies["/body"].t, t, atol=1e-9)
    assert found.notes == []


def test_messages_at_whole_seconds_are_what_they_say(tmp_path):
    """Their `nanosec` is 0, in every unit."""
    bag, t = written(tmp_path / "bag", 1, 1.0, 20)
    found = tracks_of_bag(bag)
    assert found.notes == [] and np.allclose(found.bodies["/body"].t - foreign.EPOCH, t)
