"""Where the fields of a message lie, by the schema in the file that holds it.

A type may have other fields than the one of that name that this program knows: an older or newer
release, somebody's own copy. Fields that are not needed are passed over; a needed one that is
missing, or no double, is an error. The form is that of ROS 2's .msg files, concatenated (MCAP,
"ros2msg"): the type itself first, then each that it uses behind a line of = and "MSG: ...".
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from itertools import groupby
from typing import NamedTuple

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
        raise ValueError(f"its schema does not say what {name} is")
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
