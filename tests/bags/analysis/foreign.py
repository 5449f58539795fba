# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bags of somebody else, written with rosbags or mcap: messages, and a body in a known motion."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer as Mcap
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
EPOCH = 1_700_000_000
POSE, TWIST = "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TwistStamped"
WRENCH, TF = "geometry_msgs/msg/WrenchStamped", "tf2_msgs/msg/TFMessage"
ODOMETRY = "nav_msgs/msg/Odometry"


def swing(n: int = 400, rate: float = 100.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """t, position of a harmonic motion along x, and a spin of 0.8 rad/s about z."""
    t = np.arange(n) / rate
    position = np.c_[0.5 * np.sin(3.0 * t), 0.1 * np.ones(n), 0.2 * t]
    q = np.c_[np.zeros(n), np.zeros(n), np.sin(0.4 * t), np.cos(0.4 * t)]
    return t, position, q


def made(kind: str, *values: Any, **fields: Any) -> Any:
    """A message of a type of geometry_msgs or, by its full name, of another package."""
    return STORE.types[kind if "/" in kind else f"geometry_msgs/msg/{kind}"](*values, **fields)


def vector(values: Any) -> Any:
    return made("Vector3", *map(float, values))


def header(t: float, frame: str) -> Any:
    whole, part = divmod(round(t * 1e9), 1_000_000_000)
    stamp = made("builtin_interfaces/msg/Time", sec=EPOCH + whole, nanosec=part)
    return made("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def pose_of(p: Any, q: Any) -> Any:
    point = made("Point", *map(float, p))
    return made("Pose", position=point, orientation=made("Quaternion", *map(float, q)))


def pose_stamped(t: float, p: Any, q: Any, frame: str = "map") -> tuple[str, Any]:
    return POSE, made(POSE, header=header(t, frame), pose=pose_of(p, q))


def twist_stamped(t: float, v: Any, w: Any, frame: str) -> tuple[str, Any]:
    twist = made("Twist", linear=vector(v), angular=vector(w))
    return TWIST, made(TWIST, header=header(t, frame), twist=twist)


def wrench_stamped(
    t: float, frame: str, force: Any, torque: Any = (0.0, 0.0, 0.0)
) -> tuple[str, Any]:
    wrench = made("Wrench", force=vector(force), torque=vector(torque))
    return WRENCH, made(WRENCH, header=header(t, frame), wrench=wrench)


def transforms(t: float, *entries: tuple[str, str, Any, Any]) -> tuple[str, Any]:
    """Of each: parent, child, position, quaternion."""
    found = []
    for parent, child, p, q in entries:
        turn = made("Quaternion", *map(float, q))
        one = made("Transform", translation=vector(p), rotation=turn)
        stamped = {"header": header(t, parent), "child_frame_id": child, "transform": one}
        found.append(made("TransformStamped", **stamped))
    return TF, made(TF, transforms=found)


def tf(t: float, p: Any, q: Any, child: str = "drone") -> tuple[str, Any]:
    return transforms(t, ("map", child, p, q), ("map", "camera_link", p, q))


def odometry(
    t: float, p: Any, q: Any, v: Any = (0.0, 0.0, 0.0), w: Any = (0.0, 0.0, 0.8)
) -> tuple[str, Any]:
    none = np.zeros(36)
    pose = made("PoseWithCovariance", pose=pose_of(p, q), covariance=none)
    twist = made("Twist", linear=vector(v), angular=vector(w))
    moving = made("TwistWithCovariance", twist=twist, covariance=none)
    about = {"header": header(t, "odom"), "child_frame_id": "base_link"}
    return ODOMETRY, made(ODOMETRY, **about, pose=pose, twist=moving)


Entry = tuple[float, str, str, Any]
"""Time [s], topic, type and message."""


def record(
    folder: Path, entries: Iterable[Entry], plugin: StoragePlugin = StoragePlugin.MCAP,
    mode: CompressionMode | None = None,
) -> Path:  # fmt: skip
    """A bag of these messages, in this order, as rosbags writes it."""
    writer = Writer(folder, version=9, storage_plugin=plugin)
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections: dict[str, Any] = {}
        for t, topic, kind, message in entries:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            data = bytes(STORE.serialize_cdr(message, kind))
            writer.write(connections[topic], round((EPOCH + t) * 1e9), data)
        if not connections:
            writer.add_connection("/body", POSE, typestore=STORE)
    return folder


def write(folder: Path, make=pose_stamped, t=None, position=None, q=None, **options) -> Path:
    """A bag of one topic /body from times [s], positions and quaternions."""
    motion = [
        own if given is None else given
        for own, given in zip(swing(**options), (t, position, q), strict=True)
    ]
    return record(folder, ((x[0], "/body", *make(*x)) for x in zip(*motion, strict=False)))


class Bag:
    """Messages of any type in channels of any number, as the package mcap writes them."""

    def __init__(self, writer: Mcap) -> None:
        self.writer, self.n = writer, 0
        self._channels: dict[tuple[str, str, int], int] = {}

    def add(self, topic: str, kind: str, message: object, t: float, channel: int = 0) -> None:
        key = topic, kind, channel
        if key not in self._channels:
            schema = self.writer.register_schema(kind, "ros2msg", b"")
            self._channels[key] = self.writer.register_channel(topic, "cdr", schema)
        data = message if isinstance(message, bytes) else STORE.serialize_cdr(message, kind)
        stamp = round((EPOCH + t) * 1e9)
        self.writer.add_message(self._channels[key], stamp, bytes(data), stamp, self.n)
        self.n += 1


@contextmanager
def writing(path: Path, **options: object) -> Iterator[Bag]:
    with path.open("wb") as file:
        writer = Mcap(file, **options)  # type: ignore[arg-type]
        writer.start(profile="ros2", library="somebody")
        yield Bag(writer)
        writer.finish()
