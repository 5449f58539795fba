# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bags as an independent reader (rosbags) sees them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore


class Series(NamedTuple):
    """One topic of a bag."""

    raw: list[bytes]
    messages: list[Any]

    @property
    def t(self) -> np.ndarray:
        """Header stamps [s]."""
        stamps = [message.header.stamp for message in self.messages]
        return np.array([stamp.sec + stamp.nanosec * 1e-9 for stamp in stamps])

    @property
    def wrench(self) -> np.ndarray:
        """[force, torque], shape (n, 6)."""
        return np.array([_vector(m.wrench.force) + _vector(m.wrench.torque) for m in self.messages])

    @property
    def twist(self) -> np.ndarray:
        """[linear, angular], shape (n, 6)."""
        return np.array([_vector(m.twist.linear) + _vector(m.twist.angular) for m in self.messages])

    @property
    def position(self) -> np.ndarray:
        """Shape (n, 3)."""
        return np.array([_vector(m.pose.position) for m in self.messages])


def read(folder: Path) -> dict[str, Series]:
    """Every topic of a bag directory; raises unless the bag is whole."""
    series: dict[str, Series] = {}
    with AnyReader([folder], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, _, data in reader.messages():
            of_topic = series.setdefault(connection.topic, Series([], []))
            of_topic.raw.append(bytes(data))
            of_topic.messages.append(reader.deserialize(data, connection.msgtype))
    return series


def count(folder: Path, topic: str) -> int:
    """How many messages of the topic a bag has, by its index: for more than is worth reading."""
    with AnyReader([folder], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        return reader.topics[topic].msgcount


def _vector(of: Any) -> tuple[float, float, float]:
    return (of.x, of.y, of.z)
