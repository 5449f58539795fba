# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Sources of readings in a bag: their names, and the pieces in which readings come."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rb_sim.base.names import first_few

# What a bag gives at once of one source: times and numbers, by what they are of.


POSE, TWIST, WRENCH, IMU, SCALAR = "pose", "twist", "wrench", "imu", "scalar"


class Piece(NamedTuple):
    """Readings of one source, in the order of the file."""

    source: str
    """the topic; of transforms TOPIC:CHILD; of the twist of an Odometry TOPIC:twist; others under
    that name as `Sources` has it."""
    kind: str
    """POSE [position, quaternion], TWIST [v, w], WRENCH [force, torque], IMU [q, w, a], SCALAR."""
    frame: str
    child: str
    t: np.ndarray
    """header stamp, or log time where the type has none [s], shape (n,)."""
    log: np.ndarray
    """log time [s], shape (n,)."""
    values: np.ndarray
    """shape (n, size of the kind)."""
    stamp: np.ndarray
    """t as integers [ns], exact since the epoch, too, shape (n,)."""
    transform: bool = False
    """whether it is of a tree of transforms."""


# Names of what readings are of: two frames or two types under one topic are two sources.
#
# A topic may carry poses of one body in several frames, transforms from several parents to one
# child, or messages of several types. Joined to one curve they would be a motion that nothing made.


MOST = 16
"""Sources of one name; more are taken for a name that changes with every message."""
MOST_OF_TOPIC = 1000
WORLD = ("", "world", "map", "odom")
"""Frames that are the world's, besides that of the poses."""
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "geometry_msgs/msg/TransformStamped")


class Origin(NamedTuple):
    """What tells readings under one name apart."""

    ros_type: str
    frame: str
    child: str


class Sources:
    """Gives each origin a name: the topic (of transforms TOPIC:CHILD) to the first one, and the
    same with what is different in brackets to others."""

    def __init__(self) -> None:
        self._named: dict[str, dict[Origin, str]] = {}
        self._of_topic: dict[str, int] = {}
        self._channels: dict[str, set[int]] = {}

    @property
    def notes(self) -> list[str]:
        """A line for each name that is not of one thing."""
        lines = []
        for base, named in self._named.items():
            others = list(named.values())[1:]
            if others:
                named_others = first_few(others)
                lines.append(f"{base}: not all of one type and frame: {named_others} for itself")
        return lines + [
            f"{source}: comes in {len(channels)} channels, which are taken as one source"
            for source, channels in self._channels.items()
            if len(channels) > 1
        ]

    def name(self, topic: str, ros_type: str, frame: str, child: str, channel: int = 0) -> str:
        """The source of readings. ValueError where a topic has too many."""
        origin = Origin(ros_type, frame.removeprefix("/"), child.removeprefix("/"))
        base = f"{topic}:{child}" if ros_type in TRANSFORMS else topic
        named = self._named.setdefault(base, {})
        if origin not in named:
            count = self._of_topic[topic] = self._of_topic.get(topic, 0) + 1
            if len(named) >= MOST:
                raise ValueError(f"it has more than {MOST} frames")
            if count > MOST_OF_TOPIC:
                raise ValueError(f"it has more than {MOST_OF_TOPIC} children")
            named[origin] = base if not named else self._other(base, origin, next(iter(named)))
        self._channels.setdefault(named[origin], set()).add(channel)
        return named[origin]

    def _other(self, base: str, origin: Origin, first: Origin) -> str:
        parts = []
        if origin.ros_type != first.ros_type:
            parts.append(origin.ros_type.rpartition("/")[2])
        if origin.child != first.child:
            parts.append(f"of {origin.child or 'no child'}")
        if origin.frame != first.frame:
            parts.append(f"in {origin.frame or 'no frame'}")
        return f"{base} ({', '.join(parts)})"


def words(source: str) -> set[str]:
    """The parts of a source's name that may be the name of a body."""
    plain = topic_of(source)
    return {source, plain, *plain.replace(":", "/").split("/")}


def topic_of(source: str) -> str:
    """The name of a source without what tells it from others of the same topic."""
    return source.partition(" (")[0]
