# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The schema in a file is that of ROS 2, or its messages are refused in one line."""

from __future__ import annotations

import pytest
from mcap.writer import Writer
from rosbags.typesys import Stores, get_typestore

from rb_sim.bags.readings import KINDS, Readings, check_schema

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


@pytest.mark.parametrize("ros_type", sorted(set(KINDS) & set(STORE.types)))
def test_ros2s_own_schemas_are_known(ros_type):
    text, _ = STORE.generate_msgdef(ros_type, ros_version=2)
    check_schema(ros_type, "uint8 FAST=1  # a constant\n# a comment\n" + text)


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


POSES = "std_msgs/Header header\ngeometry_msgs/Pose pose\n" + HEADER + POSE


@pytest.mark.parametrize(
    ("before", "after", "name"),
    [
        ("geometry_msgs/Pose pose\n", "", "geometry_msgs/msg/PoseStamped"),
        ("geometry_msgs/Pose pose\n", "geometry_msgs/Pose pose\nuint16[] tail\n", "PoseStamped"),
        ("string frame_id\n", "string frame_id\nuint32 seq\n", "Header"),
        ("MSG: geometry_msgs/Point\n", "MSG: geometry_msgs/Other\n", "Point"),
        ("float64 y\n", "float32 y\n", "Point"),
        ("float64 x\nfloat64 y\n", "float64 y\nfloat64 x\n", "Point"),
    ],
)
def test_another_schema_is_refused_in_one_line(tmp_path, before, after, name):
    schema = POSES.replace(before, after, 1)
    assert schema != POSES
    readings = Readings(bag(tmp_path / "x.mcap", schema, [bytes(84)]))
    assert not list(readings.pieces())
    (note,) = [note for note in readings.notes if note.startswith("/body: skipped: ")]
    assert f"{name} is not that of ROS 2" in note and "\n" not in note
