# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bags of somebody else, written with rosbags: a body in a known motion, whole and spoilt."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
EPOCH = 1_700_000_000


def swing(n: int = 400, rate: float = 100.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """t, position of a harmonic motion along x, and a spin of 0.8 rad/s about z."""
    t = np.arange(n) / rate
    position = np.c_[0.5 * np.sin(3.0 * t), 0.1 * np.ones(n), 0.2 * t]
    q = np.c_[np.zeros(n), np.zeros(n), np.sin(0.4 * t), np.cos(0.4 * t)]
    return t, position, q


def header(t: float, frame: str):
    types = STORE.types
    whole, part = divmod(round(t * 1e9), 1_000_000_000)
    stamp = types["builtin_interfaces/msg/Time"](sec=EPOCH + whole, nanosec=part)
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def pose_of(p, q):
    types = STORE.types
    point = types["geometry_msgs/msg/Point"](*map(float, p))
    return types["geometry_msgs/msg/Pose"](
        position=point, orientation=types["geometry_msgs/msg/Quaternion"](*map(float, q))
    )


def pose_stamped(t, p, q):
    kind = "geometry_msgs/msg/PoseStamped"
    return kind, STORE.types[kind](header=header(t, "map"), pose=pose_of(p, q))


def tf(t, p, q, child: str = "drone"):
    types = STORE.types
    transform = types["geometry_msgs/msg/Transform"](
        translation=types["geometry_msgs/msg/Vector3"](*map(float, p)),
        rotation=types["geometry_msgs/msg/Quaternion"](*map(float, q)),
    )
    stamped = types["geometry_msgs/msg/TransformStamped"]
    one = stamped(header=header(t, "map"), child_frame_id=child, transform=transform)
    other = stamped(header=header(t, "map"), child_frame_id="camera_link", transform=transform)
    return "tf2_msgs/msg/TFMessage", types["tf2_msgs/msg/TFMessage"](transforms=[one, other])


def odometry(t, p, q):
    types = STORE.types
    zero = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    pose = types["geometry_msgs/msg/PoseWithCovariance"](
        pose=pose_of(p, q), covariance=np.zeros(36)
    )
    spin = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.8)
    twist = types["geometry_msgs/msg/TwistWithCovariance"](
        twist=types["geometry_msgs/msg/Twist"](linear=zero, angular=spin),
        covariance=np.zeros(36),
    )
    kind = "nav_msgs/msg/Odometry"
    message = STORE.types[kind](
        header=header(t, "odom"), child_frame_id="base_link", pose=pose, twist=twist
    )
    return kind, message


def write(folder: Path, make=pose_stamped, t=None, position=None, q=None, **options) -> Path:
    """A bag of one topic /body from times [s], positions and quaternions."""
    default = swing(**options)
    t = default[0] if t is None else t
    position = default[1] if position is None else position
    q = default[2] if q is None else q
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = None
        for k in range(len(t)):
            kind, message = make(t[k], position[k], q[k])
            if connection is None:
                connection = writer.add_connection("/body", kind, typestore=STORE)
            stamp = round((EPOCH + t[k]) * 1e9)
            writer.write(connection, stamp, bytes(STORE.serialize_cdr(message, kind)))
        if connection is None:
            writer.add_connection("/body", "geometry_msgs/msg/PoseStamped", typestore=STORE)
    return folder
