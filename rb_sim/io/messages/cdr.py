"""ROS 2 messages as bytes: little-endian CDR (OMG XTypes, encoding version 1), zero padding.

The bytes are those of rclpy's serialize_message, but for its padding, which is arbitrary there and
zero here: equal samples give equal bytes. The same bytes go to DDS and into a bag.

A message whose strings are fixed has a fixed layout, so it is a template with a stamp and numbers
to fill in. Alignment counts from after the four bytes of the encapsulation header.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

HEADER = b"\x00\x01\x00\x00"
"""CDR, little endian, no options."""

NANO = 1_000_000_000
_STAMP = struct.Struct("<iI")
_COUNT = struct.Struct("<I")


def stamp_of(t: float) -> int:
    """Simulated time [s] as a stamp [ns]."""
    return round(t * NANO)


class Layout:
    """A message under construction: bytes so far, and where stamps and numbers go."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._stamps: list[int] = []
        self._numbers: list[tuple[int, str, int]] = []

    def _align(self, size: int) -> None:
        self._bytes += bytes(-len(self._bytes) % size)

    def stamp(self) -> Layout:
        """A builtin_interfaces/Time, filled with the message's stamp."""
        self._align(4)
        self._stamps.append(len(HEADER) + len(self._bytes))
        self._bytes += bytes(8)
        return self

    def count(self, length: int) -> Layout:
        """The length of a sequence."""
        self._align(4)
        self._bytes += struct.pack("<I", length)
        return self

    def text(self, value: str) -> Layout:
        """A string that stays as it is."""
        data = value.encode() + b"\0"
        self.count(len(data))
        self._bytes += data
        return self

    def doubles(self, length: int) -> Layout:
        """`length` float64 fields in a row, filled with the next values."""
        if length:
            self._align(8)
            self._numbers.append((len(HEADER) + len(self._bytes), "d", length))
            self._bytes += bytes(8 * length)
        return self

    def fixed(self, kind: str, *values: float) -> Layout:
        """Numbers that stay as they are. kind: of each, as `struct` has it."""
        self._align(struct.calcsize(kind))
        self._bytes += struct.pack(f"<{len(values)}{kind}", *values)
        return self

    def octet(self) -> Layout:
        """A uint8 field, filled with the next value."""
        self._numbers.append((len(HEADER) + len(self._bytes), "B", 1))
        self._bytes += bytes(1)
        return self

    def codec(self) -> Codec:
        """The finished layout."""
        return Codec(HEADER + bytes(self._bytes), self._stamps, self._numbers)


class Codec:
    """Packs and unpacks the messages of one topic.

    size: how many numbers a message carries.
    """

    def __init__(
        self, template: bytes, stamps: Sequence[int], numbers: Sequence[tuple[int, str, int]]
    ) -> None:
        self.template = template
        """the message with every stamp and number zero."""
        self.stamps = tuple(stamps)
        """where stamps are in it."""
        self.numbers = tuple(numbers)
        """(where, "d" or "B", how many) of each run of numbers in it."""
        runs, start = [], 0
        for offset, kind, length in numbers:
            runs.append((struct.Struct(f"<{length}{kind}"), offset, start, start + length))
            start += length
        self._runs = tuple(runs)
        self.size = start

    def pack(self, stamp: int, values: Sequence[float]) -> bytes:
        """The message.

        stamp: [ns], >= 0; ignored where the type has none. values: `size` numbers in wire order.
        """
        data = bytearray(self.template)
        if self.stamps:
            time = divmod(stamp, NANO)
            for offset in self.stamps:
                _STAMP.pack_into(data, offset, *time)
        for run, offset, start, end in self._runs:
            run.pack_into(data, offset, *values[start:end])
        return bytes(data)

    def unpack(self, data: bytes) -> list[float]:
        """The numbers of a message that was packed with this layout.

        Raises ValueError where the length is another one.
        """
        if len(data) != len(self.template):
            raise ValueError(f"{len(data)} bytes instead of {len(self.template)}")
        values: list[float] = []
        for run, offset, _, _ in self._runs:
            values += run.unpack_from(data, offset)
        return values

    def unpack_rows(self, rows: NDArray[np.uint8]) -> NDArray[np.float64]:
        """The numbers of n messages, shape (n, size), from their bytes, shape (n, length)."""
        values = np.empty((len(rows), self.size))
        for run, offset, start, end in self._runs:
            part = np.ascontiguousarray(rows[:, offset : offset + run.size])
            values[:, start:end] = part.view("<f8" if run.format.endswith("d") else "u1")
        return values

    def pack_rows(
        self, stamps: NDArray[np.int64], values: NDArray[np.float64]
    ) -> NDArray[np.uint8]:
        """The bytes, shape (n, length), of n messages whose numbers are all doubles.

        stamps: [ns], shape (n,); values: shape (n, size).
        """
        rows = np.tile(np.frombuffer(self.template, np.uint8), (len(values), 1))
        times = np.stack([stamps // NANO, stamps % NANO], axis=1).astype("<u4").view(np.uint8)
        for offset in self.stamps:
            rows[:, offset : offset + _STAMP.size] = times
        for run, offset, start, end in self._runs:
            part = np.ascontiguousarray(values[:, start:end], "<f8")
            rows[:, offset : offset + run.size] = part.view(np.uint8)
        return rows

    def unpack_stamps(self, rows: NDArray[np.uint8]) -> NDArray[np.int64]:
        """The stamps [ns] of n messages of a type that has one, shape (n,)."""
        offset = self.stamps[0]
        part = np.ascontiguousarray(rows[:, offset : offset + _STAMP.size])
        seconds, nanoseconds = part[:, :4].copy().view("<i4"), part[:, 4:].copy().view("<u4")
        return (seconds.astype(np.int64) * NANO + nanoseconds)[:, 0]

    def frames(self, data: bytes) -> bool:
        """True if `data` is as long as a message of this layout and has the same fixed parts."""
        if len(data) != len(self.template):
            return False
        blank = bytearray(data)
        for offset in self.stamps:
            blank[offset : offset + _STAMP.size] = bytes(_STAMP.size)
        for run, offset, _, _ in self._runs:
            blank[offset : offset + run.size] = bytes(run.size)
        return bytes(blank) == self.template

    @property
    def length(self) -> int:
        """Of a message [bytes]."""
        return len(self.template)


def pose_stamped(frame_id: str) -> Codec:
    """geometry_msgs/PoseStamped: position [x, y, z], orientation [x, y, z, w]."""
    return Layout().stamp().text(frame_id).doubles(7).codec()


def twist_stamped(frame_id: str) -> Codec:
    """geometry_msgs/TwistStamped: linear [x, y, z], angular [x, y, z]."""
    return Layout().stamp().text(frame_id).doubles(6).codec()


def accel_stamped(frame_id: str) -> Codec:
    """geometry_msgs/AccelStamped: linear acceleration (3), angular acceleration (3)."""
    return Layout().stamp().text(frame_id).doubles(6).codec()


def wrench_stamped(frame_id: str) -> Codec:
    """geometry_msgs/WrenchStamped: force [x, y, z], torque [x, y, z]."""
    return Layout().stamp().text(frame_id).doubles(6).codec()


def float64() -> Codec:
    """std_msgs/Float64: one number."""
    return Layout().doubles(1).codec()


def uint8() -> Codec:
    """std_msgs/UInt8: one whole number."""
    return Layout().octet().codec()


COVARIANCE_6X6 = 36
"""Numbers of a 6 x 6 covariance; all zero, since the state is known."""


def odometry(frame_id: str, child_frame_id: str) -> Codec:
    """nav_msgs/Odometry: pose (7), its covariance (36), twist (6), its covariance (36)."""
    layout = Layout().stamp().text(frame_id).text(child_frame_id)
    return layout.doubles(7 + COVARIANCE_6X6 + 6 + COVARIANCE_6X6).codec()


def clock() -> Codec:
    """rosgraph_msgs/Clock: the stamp alone."""
    return Layout().stamp().codec()


def tf_message(frames: Sequence[tuple[str, str]]) -> Codec:
    """tf2_msgs/TFMessage: for each (parent, child) translation [x, y, z], rotation [x, y, z, w]."""
    layout = Layout().count(len(frames))
    for parent, child in frames:
        layout.stamp().text(parent).text(child).doubles(7)
    return layout.codec()


def joint_state(frame_id: str, names: Sequence[str], efforts: bool = True) -> Codec:
    """sensor_msgs/JointState: positions, then velocities, then efforts, which may be left out."""
    layout = Layout().stamp().text(frame_id).count(len(names))
    for name in names:
        layout.text(name)
    for _ in range(3 if efforts else 2):
        layout.count(len(names)).doubles(len(names))
    return (layout if efforts else layout.count(0)).codec()


def string(text: str) -> bytes:
    """std_msgs/String."""
    return Layout().text(text).codec().pack(0, ())


def diagnostic(stamp: int, name: str, message: str, values: Mapping[str, str]) -> bytes:
    """diagnostic_msgs/DiagnosticArray with one status of level OK. stamp: [ns]."""
    layout = Layout().stamp().text("").count(1)
    layout.fixed("B", 0).text(name).text(message).text("").count(len(values))
    for key, value in values.items():
        layout.text(key).text(value)
    return layout.codec().pack(stamp, ())


def read_string(data: bytes) -> str:
    """The text of a std_msgs/String. Raises ValueError for any other message."""
    return Cursor(data, "std_msgs/msg/String").text()


def read_joint_state(data: bytes) -> tuple[int, list[str], tuple[float, ...]]:
    """Stamp [ns], names and positions of a sensor_msgs/JointState. Raises ValueError otherwise."""
    if data[: len(HEADER)] != HEADER:
        raise ValueError("not CDR, little endian")
    cursor = Cursor(data, "sensor_msgs/msg/JointState")
    stamp = cursor.stamp()
    cursor.text()
    names = [cursor.text() for _ in range(cursor.count())]
    return stamp, names, cursor.doubles()


def read_diagnostic(data: bytes) -> tuple[int, str, str, dict[str, str]]:
    """The arguments of `diagnostic`. Raises ValueError for any other message."""
    cursor = Cursor(data, "diagnostic_msgs/msg/DiagnosticArray")
    stamp = cursor.stamp()
    cursor.text()
    if cursor.count() != 1:
        raise ValueError("not one status")
    cursor.take(1, 1)
    name, message, _ = cursor.text(), cursor.text(), cursor.text()
    values = {cursor.text(): cursor.text() for _ in range(cursor.count())}
    return stamp, name, message, values


class Cursor:
    """Walks over the fields of a message; ValueError where it ends too early."""

    def __init__(self, data: bytes, ros_type: str) -> None:
        self._data, self._type, self._at = data, ros_type, len(HEADER)
        self.fixed = np.ones(len(data), bool)
        """bytes that are the same in all messages of this layout: all but padding, and what is
        taken as a number."""

    def take(self, alignment: int, size: int, *, numbers: bool = False) -> int:
        """Where the next `size` bytes begin."""
        before = self._at
        self._at += -(self._at - len(HEADER)) % alignment
        start, self._at = self._at, self._at + size
        if self._at > len(self._data):
            raise ValueError(f"a message of {len(self._data)} bytes is not a {self._type}")
        self.fixed[before : self._at if numbers else start] = False
        return start

    def stamp(self) -> int:
        """[ns]."""
        seconds, nanoseconds = _STAMP.unpack_from(self._data, self.take(4, _STAMP.size))
        return seconds * NANO + nanoseconds

    def count(self) -> int:
        """The length of a sequence."""
        return _COUNT.unpack_from(self._data, self.take(4, 4))[0]

    def doubles(self) -> tuple[float, ...]:
        """A sequence of them."""
        length = self.count()
        at = self.take(8 if length else 1, 8 * length)
        return struct.unpack_from(f"<{length}d", self._data, at)

    def text(self, errors: str = "strict") -> str:
        """A string; errors: as of bytes.decode."""
        length = self.count()
        at = self.take(1, length)
        return self._data[at : at + max(0, length - 1)].decode("utf-8", errors)
