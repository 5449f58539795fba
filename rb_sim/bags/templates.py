"""ROS 2 messages of anybody as numbers, many at a time.

Messages of one topic mostly differ in stamps and numbers only: strings and lengths are read once,
and the numbers of all messages with the same ones are taken as columns. Alignment counts from after
the four bytes of the encapsulation header (OMG XTypes, encoding version 1, little endian).
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from rb_sim.sinks.bag_messages import Messages

NANO = 1_000_000_000
_ENCAPSULATION = 4
_ZSTD = b"\x28\xb5\x2f\xfd"
"""A frame of zstd begins so (RFC 8878)."""
_MOST = 10_000
"""Transforms in one message; more are taken for damage."""

LAYOUTS: dict[str, str] = {
    "geometry_msgs/msg/PoseStamped": "T S 7",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "T S 7 _36",
    "geometry_msgs/msg/Pose": "7",
    "geometry_msgs/msg/TwistStamped": "T S 6",
    "geometry_msgs/msg/TwistWithCovarianceStamped": "T S 6 _36",
    "geometry_msgs/msg/WrenchStamped": "T S 6",
    "geometry_msgs/msg/AccelStamped": "T S 6",
    "geometry_msgs/msg/TransformStamped": "T S S 7",
    "nav_msgs/msg/Odometry": "T S S 7 _36 6 _36",
    "sensor_msgs/msg/Imu": "T S 4 _9 3 _9 3 _9",
    "std_msgs/msg/Float64": "1",
    "tf2_msgs/msg/TFMessage": "(T S S 7)",
}
"""What each type consists of: T stamp, S string, n doubles, _n doubles to pass over, () many. Of
other schemas (`schemas.layout_of`) also, to pass over: s string, -n a number of n bytes, [n a
sequence of such numbers."""


class Group(NamedTuple):
    """n readings with the same strings."""

    which: np.ndarray
    """index of the message of each, shape (n,)."""
    names: tuple[str, ...]
    """frame_id, and child_frame_id where the type has one."""
    stamp: np.ndarray | None
    """[ns], shape (n,); None for a type without one."""
    values: np.ndarray
    """shape (n, m)."""


class _Field(NamedTuple):
    names: tuple[str, ...]
    stamp: int | None
    runs: tuple[tuple[int, int], ...]
    """(offset, how many doubles)."""


def decode(ros_type: str, messages: Messages, wrong: Counter[str], layout: str) -> Iterator[Group]:
    """The readings in the messages of one topic; counts those that are not of that type, by why."""
    rest = np.arange(len(messages.start))
    while len(rest):
        first = messages.data(int(rest[0]))
        try:
            fields, fixed = _parse(layout, first, ros_type)
        except ValueError as error:
            wrong[str(error)] += 1
            rest = rest[1:]
            continue
        same = rest[messages.size[rest] == len(first)]
        rows = messages.take(same).rows(len(first))
        alike = (rows[:, fixed] == np.frombuffer(first, np.uint8)[fixed]).all(axis=1)
        rows, same = rows[alike], same[alike]
        for field in fields:
            stamp = None if field.stamp is None else _stamps(rows, field.stamp)
            values = [_doubles(rows, offset, count) for offset, count in field.runs]
            yield Group(same, field.names, stamp, np.concatenate(values, axis=1))
        rest = np.setdiff1d(rest, same, assume_unique=True)


def _stamps(rows: np.ndarray, offset: int) -> np.ndarray:
    part = np.ascontiguousarray(rows[:, offset : offset + 8])
    seconds = part[:, :4].copy().view("<i4")[:, 0].astype(np.int64)
    return seconds * NANO + part[:, 4:].copy().view("<u4")[:, 0]


def _doubles(rows: np.ndarray, offset: int, count: int) -> np.ndarray:
    return np.ascontiguousarray(rows[:, offset : offset + 8 * count]).view("<f8")


def _parse(layout: str, data: bytes, ros_type: str) -> tuple[list[_Field], np.ndarray]:
    """Where the fields of a message are, and which bytes are the same in all like it."""
    if len(data) < _ENCAPSULATION:
        raise ValueError(f"a message of {len(data)} bytes is no {ros_type}")
    if data[:4] == _ZSTD:
        raise ValueError(
            "its messages are compressed one by one by rosbag2 (zstd): convert the bag with "
            "rosbags-convert"
        )
    if data[:2] != b"\x00\x01":
        raise ValueError(f"its encoding {data[:2].hex()} is not CDR, little endian (0001)")
    cursor = _Cursor(data, ros_type)
    if not layout.startswith("("):
        return [cursor.field(layout.split())], cursor.fixed
    count = cursor.count()
    if count > _MOST:
        raise ValueError(f"a message with {count} parts is no {ros_type}")
    return [cursor.field(layout[1:-1].split()) for _ in range(count)], cursor.fixed


class _Cursor:
    """Walks over a message."""

    def __init__(self, data: bytes, ros_type: str) -> None:
        self._data, self._type, self._at = data, ros_type, _ENCAPSULATION
        self.fixed = np.ones(len(data), bool)
        """bytes that are the same in all messages of this layout."""

    def field(self, parts: list[str]) -> _Field:
        names: list[str] = []
        runs: list[tuple[int, int]] = []
        stamp = None
        for part in parts:
            if part == "T":
                stamp = self._take(4, 8)
                self.fixed[stamp : stamp + 8] = False
            elif part == "S":
                names.append(self._text())
            elif part == "s":
                self._text()
            elif part[0] in "-[":
                self._pass_over(int(part[1:]), 1 if part[0] == "-" else self.count())
            else:
                count = int(part.lstrip("_"))
                at = self._take(8, 8 * count)
                self.fixed[at : at + 8 * count] = False
                if not part.startswith("_"):
                    runs.append((at, count))
        return _Field(tuple(names), stamp, tuple(runs))

    def _pass_over(self, size: int, count: int) -> None:
        """Numbers of this size that are not read; a sequence has one length in all alike."""
        if count:
            at = self._take(size, size * count)
            self.fixed[at : at + size * count] = False

    def count(self) -> int:
        return struct.unpack_from("<I", self._data, self._take(4, 4))[0]

    def _text(self) -> str:
        length = self.count()
        at = self._take(1, length)
        return self._data[at : at + max(0, length - 1)].decode("utf-8", "replace")

    def _take(self, alignment: int, size: int) -> int:
        before = self._at
        self._at += -(self._at - _ENCAPSULATION) % alignment
        self.fixed[before : self._at] = False  # padding is whatever it is
        start, self._at = self._at, self._at + size
        if self._at > len(self._data):
            raise ValueError(f"a message of {len(self._data)} bytes is no {self._type}")
        return start
