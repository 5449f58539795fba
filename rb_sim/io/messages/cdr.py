# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""ROS 2 message types (fields, hashes) and their bytes (CDR, OMG XTypes, encoding 1)."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

# Fields of the ROS 2 message types that rb_sim publishes, records or reads, and the type hashes of
# those that it records.
#
# They are stored here because bags contain them and are written without ROS. The definitions hold
# only the fields; the hashes (RIHS01, REP 2016) are those of ROS 2 Jazzy.


ACCEL_STAMPED = "geometry_msgs/msg/AccelStamped"
CLOCK = "rosgraph_msgs/msg/Clock"
DIAGNOSTIC_ARRAY = "diagnostic_msgs/msg/DiagnosticArray"
FLOAT64 = "std_msgs/msg/Float64"
JOINT_STATE = "sensor_msgs/msg/JointState"
MARKER_ARRAY = "visualization_msgs/msg/MarkerArray"
ODOMETRY = "nav_msgs/msg/Odometry"
POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
STRING = "std_msgs/msg/String"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
UINT8 = "std_msgs/msg/UInt8"
WRENCH_STAMPED = "geometry_msgs/msg/WrenchStamped"

FIELDS: dict[str, tuple[str, ...]] = {
    "builtin_interfaces/msg/Duration": ("int32 sec", "uint32 nanosec"),
    "builtin_interfaces/msg/Time": ("int32 sec", "uint32 nanosec"),
    "diagnostic_msgs/msg/DiagnosticStatus": (
        "byte level",
        "string name",
        "string message",
        "string hardware_id",
        "KeyValue[] values",
    ),
    "diagnostic_msgs/msg/KeyValue": ("string key", "string value"),
    "geometry_msgs/msg/Accel": ("Vector3 linear", "Vector3 angular"),
    "geometry_msgs/msg/Point": ("float64 x", "float64 y", "float64 z"),
    "geometry_msgs/msg/Pose": ("Point position", "Quaternion orientation"),
    "geometry_msgs/msg/PoseWithCovariance": ("Pose pose", "float64[36] covariance"),
    "geometry_msgs/msg/PoseWithCovarianceStamped": (
        "std_msgs/Header header",
        "PoseWithCovariance pose",
    ),
    "geometry_msgs/msg/Quaternion": ("float64 x 0", "float64 y 0", "float64 z 0", "float64 w 1"),
    "geometry_msgs/msg/Transform": ("Vector3 translation", "Quaternion rotation"),
    "geometry_msgs/msg/TransformStamped": (
        "std_msgs/Header header",
        "string child_frame_id",
        "Transform transform",
    ),
    "geometry_msgs/msg/Twist": ("Vector3 linear", "Vector3 angular"),
    "geometry_msgs/msg/TwistWithCovariance": ("Twist twist", "float64[36] covariance"),
    "geometry_msgs/msg/TwistWithCovarianceStamped": (
        "std_msgs/Header header",
        "TwistWithCovariance twist",
    ),
    "geometry_msgs/msg/Vector3": ("float64 x", "float64 y", "float64 z"),
    "geometry_msgs/msg/Wrench": ("Vector3 force", "Vector3 torque"),
    "sensor_msgs/msg/CompressedImage": (
        "std_msgs/Header header",
        "string format",
        "uint8[] data",
    ),
    "sensor_msgs/msg/Imu": (
        "std_msgs/Header header",
        "geometry_msgs/Quaternion orientation",
        "float64[9] orientation_covariance",
        "geometry_msgs/Vector3 angular_velocity",
        "float64[9] angular_velocity_covariance",
        "geometry_msgs/Vector3 linear_acceleration",
        "float64[9] linear_acceleration_covariance",
    ),
    "std_msgs/msg/ColorRGBA": ("float32 r", "float32 g", "float32 b", "float32 a"),
    "std_msgs/msg/Header": ("builtin_interfaces/Time stamp", "string frame_id"),
    "visualization_msgs/msg/Marker": (
        "std_msgs/Header header",
        "string ns",
        "int32 id",
        "int32 type",
        "int32 action",
        "geometry_msgs/Pose pose",
        "geometry_msgs/Vector3 scale",
        "std_msgs/ColorRGBA color",
        "builtin_interfaces/Duration lifetime",
        "bool frame_locked",
        "geometry_msgs/Point[] points",
        "std_msgs/ColorRGBA[] colors",
        "string texture_resource",
        "sensor_msgs/CompressedImage texture",
        "UVCoordinate[] uv_coordinates",
        "string text",
        "string mesh_resource",
        "MeshFile mesh_file",
        "bool mesh_use_embedded_materials",
    ),
    "visualization_msgs/msg/MeshFile": ("string filename", "uint8[] data"),
    "visualization_msgs/msg/UVCoordinate": ("float32 u", "float32 v"),
    ACCEL_STAMPED: ("std_msgs/Header header", "Accel accel"),
    CLOCK: ("builtin_interfaces/Time clock",),
    DIAGNOSTIC_ARRAY: ("std_msgs/Header header", "DiagnosticStatus[] status"),
    FLOAT64: ("float64 data",),
    JOINT_STATE: (
        "std_msgs/Header header",
        "string[] name",
        "float64[] position",
        "float64[] velocity",
        "float64[] effort",
    ),
    MARKER_ARRAY: ("Marker[] markers",),
    ODOMETRY: (
        "std_msgs/Header header",
        "string child_frame_id",
        "geometry_msgs/PoseWithCovariance pose",
        "geometry_msgs/TwistWithCovariance twist",
    ),
    POSE_STAMPED: ("std_msgs/Header header", "Pose pose"),
    STRING: ("string data",),
    TF_MESSAGE: ("geometry_msgs/TransformStamped[] transforms",),
    TWIST_STAMPED: ("std_msgs/Header header", "Twist twist"),
    UINT8: ("uint8 data",),
    WRENCH_STAMPED: ("std_msgs/Header header", "Wrench wrench"),
}
"""Fields of each type, in wire order."""

TYPE_HASHES: dict[str, str] = {
    ACCEL_STAMPED: "RIHS01_ef1df9eabae0a708cc049a061ebcddc4e2a5f745730100ba680e086a9698b165",
    CLOCK: "RIHS01_692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
    DIAGNOSTIC_ARRAY: "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    FLOAT64: "RIHS01_705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a",
    JOINT_STATE: "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    MARKER_ARRAY: "RIHS01_86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf",
    ODOMETRY: "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    POSE_STAMPED: "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
    STRING: "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    TF_MESSAGE: "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    TWIST_STAMPED: "RIHS01_5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64",
    UINT8: "RIHS01_6138bd83d8c3569cb80a667db03cfc1629f529fee79d944c39c34e352e72f010",
    WRENCH_STAMPED: "RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77",
}
"""Hash of each published type."""

_SEPARATOR = "=" * 80


def schema_text(ros_type: str) -> str:
    """Definition of `ros_type` and of all types in it, breadth first, in MCAP's ros2msg format."""
    used = [ros_type]
    for name in used:  # grows while it runs
        used += [part for part in _parts(name) if part not in used]
    head, *rest = used
    blocks = ["\n".join(FIELDS[head])]
    blocks += [f"MSG: {_short(name)}\n" + "\n".join(FIELDS[name]) for name in rest]
    return f"\n{_SEPARATOR}\n".join(blocks) + "\n"


def _parts(ros_type: str) -> list[str]:
    """Full names of the message types among the fields of `ros_type`."""
    kinds = [field.split()[0].removesuffix("[]") for field in FIELDS[ros_type]]
    parts = [_full_name(kind, ros_type) for kind in kinds]
    return list(dict.fromkeys(part for part in parts if part in FIELDS))


def _full_name(kind: str, inside: str) -> str:
    """pkg/msg/Type of the type of a field, which may lack the package of the type it is in."""
    own = kind if "/" in kind else f"{inside.partition('/')[0]}/{kind}"
    return own.replace("/", "/msg/", 1)


def _short(ros_type: str) -> str:
    """pkg/Type for pkg/msg/Type."""
    return ros_type.replace("/msg/", "/")


HEADER = b"\x00\x01\x00\x00"
"""CDR, little endian, no options."""

NANO = 1_000_000_000
_STAMP = struct.Struct("<iI")
_COUNT = struct.Struct("<I")


def stamp_of(t: float) -> int:
    """Simulated time [s] as a stamp [ns]."""
    return round(t * NANO)


class Layout:
    """Builder of a message layout: bytes so far, and positions of stamps and numbers."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._stamps: list[int] = []
        self._numbers: list[tuple[int, str, int]] = []

    def _align(self, size: int) -> None:
        self._bytes += bytes(-len(self._bytes) % size)

    def stamp(self) -> Layout:
        """Append a builtin_interfaces/Time, filled with the message's stamp."""
        self._align(4)
        self._stamps.append(len(HEADER) + len(self._bytes))
        self._bytes += bytes(8)
        return self

    def count(self, length: int) -> Layout:
        """Append the length of a sequence."""
        self._align(4)
        self._bytes += struct.pack("<I", length)
        return self

    def text(self, value: str) -> Layout:
        """Append a constant string."""
        data = value.encode() + b"\0"
        self.count(len(data))
        self._bytes += data
        return self

    def doubles(self, length: int) -> Layout:
        """Append `length` float64 fields, filled with the next values."""
        if length:
            self._align(8)
            start, before = len(HEADER) + len(self._bytes), 0
            if self._numbers and self._numbers[-1][0] + 8 * self._numbers[-1][2] == start:
                start, _, before = self._numbers.pop()  # one run with the doubles before it
            self._numbers.append((start, "d", before + length))
            self._bytes += bytes(8 * length)
        return self

    def fixed(self, kind: str, *values: float) -> Layout:
        """Append constant numbers. kind: format character of `struct`."""
        self._align(struct.calcsize(kind))
        self._bytes += struct.pack(f"<{len(values)}{kind}", *values)
        return self

    def octet(self) -> Layout:
        """Append a uint8 field, filled with the next value."""
        self._numbers.append((len(HEADER) + len(self._bytes), "B", 1))
        self._bytes += bytes(1)
        return self

    def codec(self) -> Codec:
        """The codec of the finished layout."""
        return Codec(HEADER + bytes(self._bytes), self._stamps, self._numbers)


class Codec:
    """Packs and unpacks messages of one topic. size: number of values in a message."""

    def __init__(
        self, template: bytes, stamps: Sequence[int], numbers: Sequence[tuple[int, str, int]]
    ) -> None:
        self.template = template
        """the message with all stamps and numbers zero."""
        self.stamps = tuple(stamps)
        """offsets of the stamps."""
        self.numbers = tuple(numbers)
        """(offset, "d" or "B", length) of each run of numbers."""
        runs, start = [], 0
        for offset, kind, length in numbers:
            runs.append((struct.Struct(f"<{length}{kind}"), offset, start, start + length))
            start += length
        self._runs = tuple(runs)
        self.size = start

    def pack(self, stamp: int, values: Sequence[float]) -> bytes:
        """The bytes of a message.

        stamp: [ns], >= 0; ignored if the type has none. values: `size` numbers in wire order.
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
        """The values of a message with this layout. Raises ValueError if its length differs."""
        if len(data) != len(self.template):
            raise ValueError(f"{len(data)} bytes instead of {len(self.template)}")
        values: list[float] = []
        for run, offset, _, _ in self._runs:
            values += run.unpack_from(data, offset)
        return values

    def unpack_rows(self, rows: NDArray[np.uint8]) -> NDArray[np.float64]:
        """The values of n messages, shape (n, size), from their bytes, shape (n, length)."""
        values = np.empty((len(rows), self.size))
        for run, offset, start, end in self._runs:
            part = np.ascontiguousarray(rows[:, offset : offset + run.size])
            values[:, start:end] = part.view("<f8" if run.format.endswith("d") else "u1")
        return values

    def pack_rows(
        self, stamps: NDArray[np.int64], values: NDArray[np.float64]
    ) -> NDArray[np.uint8]:
        """The bytes, shape (n, length), of n messages that contain only doubles.

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
        """The stamps [ns] of n messages of a type with a stamp, shape (n,)."""
        offset = self.stamps[0]
        part = np.ascontiguousarray(rows[:, offset : offset + _STAMP.size])
        seconds, nanoseconds = part[:, :4].copy().view("<i4"), part[:, 4:].copy().view("<u4")
        return (seconds.astype(np.int64) * NANO + nanoseconds)[:, 0]

    def frames(self, data: bytes) -> bool:
        """Whether `data` has the length and the constant parts of this layout."""
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
        """Length of a message [bytes]."""
        return len(self.template)


COVARIANCE_6X6 = 36
"""Elements of a 6 x 6 covariance; all zero, since the state is exact."""


def codec(ros_type: str, *texts: str, lengths: Sequence[int] = ()) -> Codec:
    """The codec of a type by its FIELDS.

    texts: its strings; lengths: those of its sequences; both in wire order.
    """
    layout = Layout()
    _append(layout, ros_type, iter(texts), iter(lengths))
    return layout.codec()


def _append(layout: Layout, ros_type: str, texts: Iterator[str], lengths: Iterator[int]) -> None:
    """Append the fields of a type."""
    for field in FIELDS[ros_type]:
        kind, bracket, size = field.split()[0].removesuffix("]").partition("[")
        count = int(size) if size else next(lengths) if bracket else 1
        if bracket and not size:
            layout.count(count)
        if kind == "float64":
            layout.doubles(count)
            continue
        for _ in range(count):
            if kind == "string":
                layout.text(next(texts))
            elif kind == "uint8":
                layout.octet()
            elif kind == "builtin_interfaces/Time":
                layout.stamp()
            else:
                _append(layout, _full_name(kind, ros_type), texts, lengths)


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
    """The text of a std_msgs/String. Raises ValueError for other messages."""
    return Cursor(data, "std_msgs/msg/String").text()


def read_diagnostic(data: bytes) -> tuple[int, str, str, dict[str, str]]:
    """The arguments of `diagnostic`. Raises ValueError for other messages."""
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
    """Sequential reader of a message's fields. Raises ValueError if it is too short."""

    def __init__(self, data: bytes, ros_type: str) -> None:
        self._data, self._type, self._at = data, ros_type, len(HEADER)
        self.fixed = np.ones(len(data), bool)
        """mask of the bytes equal in all messages of this layout: no padding, no values."""

    def take(self, alignment: int, size: int, *, numbers: bool = False) -> int:
        """Offset of the next `size` bytes. numbers: whether they are values, which vary."""
        before = self._at
        self._at += -(self._at - len(HEADER)) % alignment
        start, self._at = self._at, self._at + size
        if self._at > len(self._data):
            raise ValueError(f"a message of {len(self._data)} bytes is not a {self._type}")
        self.fixed[before : self._at if numbers else start] = False
        return start

    def stamp(self) -> int:
        """The next stamp [ns]."""
        seconds, nanoseconds = _STAMP.unpack_from(self._data, self.take(4, _STAMP.size))
        return seconds * NANO + nanoseconds

    def count(self) -> int:
        """The length of the next sequence."""
        return _COUNT.unpack_from(self._data, self.take(4, 4))[0]

    def text(self, errors: str = "strict") -> str:
        """The next string; errors: as in bytes.decode."""
        length = self.count()
        at = self.take(1, length)
        return self._data[at : at + max(0, length - 1)].decode("utf-8", errors)
