"""Messages of any ROS 2 bag as arrays of numbers, by the schema in the file."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from itertools import groupby
from typing import NamedTuple

import numpy as np

from rb_sim.io.bag.batches import Messages
from rb_sim.io.messages.cdr import HEADER, Codec, Cursor

# Where the fields of a message lie, by the schema in the file that holds it.
#
# A type may have other fields than the one of that name that this program knows: an older or newer
# release, somebody's own copy. Fields that are not needed are passed over; a needed one that is
# missing, or no double, is an error. The form is that of ROS 2's .msg files, concatenated (MCAP,
# "ros2msg"): the type itself first, then each that it uses behind a line of = and "MSG: ...".


NEEDED: dict[str, tuple[str, ...]] = {
    "geometry_msgs/msg/PoseStamped": ("header", "pose"),
    "geometry_msgs/msg/PoseWithCovarianceStamped": ("header", "pose.pose"),
    "geometry_msgs/msg/Pose": ("position", "orientation"),
    "geometry_msgs/msg/TwistStamped": ("header", "twist"),
    "geometry_msgs/msg/TwistWithCovarianceStamped": ("header", "twist.twist"),
    "geometry_msgs/msg/WrenchStamped": ("header", "wrench"),
    "geometry_msgs/msg/AccelStamped": ("header", "accel"),
    "geometry_msgs/msg/TransformStamped": ("header", "child_frame_id", "transform"),
    "nav_msgs/msg/Odometry": ("header", "child_frame_id", "pose.pose", "twist.twist"),
    "sensor_msgs/msg/Imu": ("header", "orientation", "angular_velocity", "linear_acceleration"),
    "std_msgs/msg/Float64": ("data",),
    "tf2_msgs/msg/TFMessage": ("transforms",),
}
"""Fields of each type that are read, all that is in them; they come in this order."""
INNER = {"tf2_msgs/msg/TFMessage": "geometry_msgs/msg/TransformStamped"}
"""Types that are a sequence of another one."""
SIZES = {
    "bool": 1, "byte": 1, "char": 1, "int8": 1, "uint8": 1, "int16": 2, "uint16": 2, "int32": 4,
    "uint32": 4, "float32": 4, "int64": 8, "uint64": 8, "float64": 8,
}  # fmt: skip
TIMES = ("builtin_interfaces/Time", "builtin_interfaces/msg/Time", "time")
_FIELD = re.compile(r"([\w/]+)(?:<=\d+)?(\[(?:<=)?(\d*)\])?\s+(\w+)")
_PART = re.compile(r"^=+\s*$", re.MULTILINE)
DEEPEST = 16
"""Types within types."""


class _Leaf(NamedTuple):
    path: str
    kind: str
    """a primitive, "string" or "time"."""
    count: int
    """1, of a fixed array its length; -1 of a sequence."""


@cache
def layout_of(ros_type: str, text: str) -> str:
    """The layout of messages of a type by its schema, as `templates.LAYOUTS` has it.

    Raises ValueError in one line for a schema that lacks what is needed.
    """
    types = _types(text)
    inner = INNER.get(ros_type)
    if inner is None:
        return " ".join(_tokens(ros_type, list(_leaves("", "", types, 0))))
    fields = types[""]
    if len(fields) != 1 or fields[0][1] != -1 or fields[0][2] != NEEDED[ros_type][0]:
        raise ValueError(f"its schema of {ros_type} is not a sequence {NEEDED[ros_type][0]} alone")
    return f"({' '.join(_tokens(inner, list(_leaves('', fields[0][0], types, 0))))})"


def _types(text: str) -> dict[str, list[tuple[str, int, str]]]:
    """Fields (type, count as of a leaf, name) of each type by its short name; "" is the first."""
    found: dict[str, list[tuple[str, int, str]]] = {}
    for part in _PART.split(text):
        lines = [line.split("#")[0].strip() for line in part.splitlines()]
        name = next((line[4:].strip() for line in lines if line.startswith("MSG:")), "")
        fields = []
        for line in lines:
            match = _FIELD.match(line)
            if match is None or line.startswith("MSG:") or re.match(r"\S+\s+\w+\s*=", line):
                continue  # blank, or a constant
            count = 1 if match[2] is None else int(match[3]) if match[3] else -1
            if "<=" in (match[2] or ""):
                count = -1
            fields.append((match[1], count, match[4]))
        found.setdefault(_short(name), fields)
    return found


def _short(name: str) -> str:
    return name.replace("/msg/", "/")


def _leaves(path: str, name: str, types: dict, depth: int) -> Iterator[_Leaf]:
    """The primitives of a type in their order."""
    fields = types.get(_short(name))
    if fields is None:  # within a package names may stand without it
        fields = next((v for k, v in types.items() if k.rpartition("/")[2] == name), None)
    if fields is None or depth > DEEPEST:
        raise ValueError(f"its schema does not define {name}")
    for kind, count, field in fields:
        where = f"{path}.{field}" if path else field
        if kind in TIMES:
            yield _Leaf(where, "time", count)
        elif kind in SIZES or kind in ("string", "wstring"):
            yield _Leaf(where, kind, count)
        elif count == 1:
            yield from _leaves(where, kind, types, depth + 1)
        else:
            raise ValueError(f"its schema has several {kind} in {where}, which are not passed over")


def _tokens(ros_type: str, leaves: list[_Leaf]) -> Iterator[str]:
    """What the cursor of `templates` is to do, field by field."""
    order = {path: k for k, path in enumerate(NEEDED[ros_type])}
    seen: list[int] = []
    parts: list[tuple[str, int]] = []
    for leaf in leaves:
        needed = next((p for p in order if leaf.path == p or leaf.path.startswith(p + ".")), None)
        if needed is not None:
            seen.append(order[needed])
            if leaf.kind == "time" and leaf.count == 1:
                parts.append(("T", 1))
            elif leaf.kind == "string" and leaf.count == 1:
                parts.append(("S", 1))
            elif leaf.kind == "float64" and leaf.count > 0:
                parts.append(("", leaf.count))
            elif leaf.path.endswith(".seq"):  # of headers of ROS 1
                parts.append((f"-{SIZES[leaf.kind]}", 1))
            else:
                raise ValueError(f"{leaf.path} in its schema is {leaf.kind}, not float64")
        elif leaf.kind in ("string", "wstring") or leaf.count < 0:
            if leaf.kind == "wstring" or (leaf.kind == "string" and leaf.count != 1):
                raise ValueError(
                    f"{leaf.path} in its schema is a {leaf.kind} that is not read over"
                )
            size = SIZES.get(leaf.kind, 8)
            parts.append(("s" if leaf.kind == "string" else f"[{size}", 1))
        elif leaf.kind == "float64":
            parts.append(("_", leaf.count))
        elif leaf.kind == "time":
            parts.append(("-4", 2 * leaf.count))
        else:
            parts.append((f"-{SIZES[leaf.kind]}", leaf.count))
    lacks = [path for path, k in order.items() if k not in seen]
    if lacks or seen != sorted(seen):
        what = f"lacks {', '.join(lacks)}" if lacks else "has its fields in another order"
        raise ValueError(f"its schema of {ros_type} {what}")
    for kind, group in groupby(parts, key=lambda part: part[0]):
        counts = [count for _, count in group]
        if kind in ("T", "S", "s") or kind.startswith(("-", "[")):
            for count in counts:
                yield from [kind] * count
        else:
            yield f"{kind}{sum(counts)}"


# ROS 2 messages of anybody as numbers, many at a time.
#
# Messages of one topic mostly differ in stamps and numbers only: strings and lengths are read once,
# and the numbers of all messages with the same ones are taken as columns. Alignment counts from
# after the four bytes of the encapsulation header (OMG XTypes, encoding version 1, little endian).


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
        for names, codec in fields:
            stamp = codec.unpack_stamps(rows) if codec.stamps else None
            yield Group(same, names, stamp, codec.unpack_rows(rows))
        rest = np.setdiff1d(rest, same, assume_unique=True)


def _parse(
    layout: str, data: bytes, ros_type: str
) -> tuple[list[tuple[tuple[str, ...], Codec]], np.ndarray]:
    """Strings and numbers of each reading in a message, and which bytes are the same in all like
    it."""
    if len(data) < len(HEADER):
        raise ValueError(f"a message of {len(data)} bytes is not a {ros_type}")
    if data[:2] != HEADER[:2]:
        raise ValueError(f"its encoding {data[:2].hex()} is not CDR, little endian (0001)")
    cursor = Cursor(data, ros_type)
    if not layout.startswith("("):
        return [_reading(cursor, data, layout.split())], cursor.fixed
    count = cursor.count()
    if count > _MOST:
        raise ValueError(f"a message with {count} parts is not a {ros_type}")
    return [_reading(cursor, data, layout[1:-1].split()) for _ in range(count)], cursor.fixed


def _reading(cursor: Cursor, data: bytes, parts: list[str]) -> tuple[tuple[str, ...], Codec]:
    """The strings of the next reading, and where its stamp and numbers are."""
    names: list[str] = []
    stamps: list[int] = []
    runs: list[tuple[int, str, int]] = []
    for part in parts:
        if part == "T":
            stamps.append(cursor.take(4, 8, numbers=True))
        elif part in ("S", "s"):
            text = cursor.text("replace")
            names += [text] if part == "S" else []
        elif part[0] in "-[":  # a sequence has one length in all alike
            size, count = int(part[1:]), 1 if part[0] == "-" else cursor.count()
            if count:
                cursor.take(size, size * count, numbers=True)
        else:
            count = int(part.lstrip("_"))
            at = cursor.take(8, 8 * count, numbers=True)
            runs += [] if part.startswith("_") else [(at, "d", count)]
    return tuple(names), Codec(data, stamps, runs)
