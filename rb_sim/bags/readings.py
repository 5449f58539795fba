# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Readings of any ROS 2 bag: poses, twists, wrenches, accelerations and scalars, by source."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.bags.transforms import (
    COLUMNS,
    IMU,
    JOINT,
    POSE,
    SCALAR,
    TRANSFORMS,
    TWIST,
    WRENCH,
    Composed,
    FixedFrames,
    Piece,
    Sources,
    chains,
    is_static,
)
from rb_sim.base.errors import SinkError
from rb_sim.base.names import one_of
from rb_sim.io.bag.batches import Batch, Messages, unpacked
from rb_sim.io.bag.folder import Scan, bag_paths, scan_of, unlisted
from rb_sim.io.messages.cdr import HEADER, JOINT_STATE, Codec, Cursor, schema_text

if TYPE_CHECKING:
    from mcap.records import Channel


# Messages of any ROS 2 bag as arrays, decoded by the schema in the file.


# Fields of a message, by the schema in the file that holds it.
#
# A type may differ from the one of that name known here (other release, private copy). Fields that
# are not needed are skipped, and the others taken in the order known here, whatever that in the
# file; a needed field that is missing or not a double is an error. The format
# is concatenated ROS 2 .msg files (MCAP "ros2msg"): the type itself, then each type used in it,
# after a line of = and "MSG: ...". Without a schema the type is the one known here.


class _Read(NamedTuple):
    """How a message type is read."""

    kind: str
    needed: tuple[str, ...]
    """fields that are read completely: stamps, strings and doubles."""


READ = {
    "geometry_msgs/msg/PoseStamped": _Read(POSE, ("header", "pose")),
    "geometry_msgs/msg/PoseWithCovarianceStamped": _Read(POSE, ("header", "pose.pose")),
    "geometry_msgs/msg/Pose": _Read(POSE, ("position", "orientation")),
    "geometry_msgs/msg/TransformStamped": _Read(POSE, ("header", "child_frame_id", "transform")),
    "tf2_msgs/msg/TFMessage": _Read(POSE, ("transforms",)),
    "nav_msgs/msg/Odometry": _Read(POSE, ("header", "child_frame_id", "pose.pose", "twist.twist")),
    "geometry_msgs/msg/TwistStamped": _Read(TWIST, ("header", "twist")),
    "geometry_msgs/msg/TwistWithCovarianceStamped": _Read(TWIST, ("header", "twist.twist")),
    "geometry_msgs/msg/WrenchStamped": _Read(WRENCH, ("header", "wrench")),
    "geometry_msgs/msg/Wrench": _Read(WRENCH, ("force", "torque")),
    "sensor_msgs/msg/Imu": _Read(
        IMU, ("header", "orientation", "angular_velocity", "linear_acceleration")
    ),
    "std_msgs/msg/Float64": _Read(SCALAR, ("data",)),
    JOINT_STATE: _Read(JOINT, ("header", "name", "position")),
}
INNER = {"tf2_msgs/msg/TFMessage": "geometry_msgs/msg/TransformStamped"}
"""Types that consist of a sequence of another type."""
SIZES = {
    "bool": 1, "byte": 1, "char": 1, "int8": 1, "uint8": 1, "int16": 2, "uint16": 2, "int32": 4,
    "uint32": 4, "float32": 4, "int64": 8, "uint64": 8, "float64": 8,
}  # fmt: skip
TIMES = ("builtin_interfaces/Time", "builtin_interfaces/msg/Time", "time")
_FIELD = re.compile(r"([\w/]+)(?:<=\d+)?(\[(?:<=)?(\d*)\])?\s+(\w+)")
_PART = re.compile(r"^=+\s*$", re.MULTILINE)
DEEPEST = 16
"""Maximum nesting depth of types."""


class Field(NamedTuple):
    """Values of one kind in a message; doubles that belong together are one field."""

    kind: str
    """a primitive type, "string" or "time"."""
    count: int
    """of values; -1 for a sequence."""
    place: int
    """of the first value among those that are needed; -1: not needed."""


@cache
def fields_of(ros_type: str, text: str) -> tuple[Field, ...]:
    """Fields of a message type in order, or of each part of a type of INNER, from its schema.

    Raises ValueError if the schema lacks a needed field or cannot be decoded.
    """
    types, inner = _types(text), INNER.get(ros_type)
    name = ""
    if inner is not None:
        parts, part = types[""], READ[ros_type].needed[0]
        if len(parts) != 1 or parts[0][1:] != (-1, part):
            raise ValueError(f"its schema of {ros_type} is not a sequence {part} alone")
        name = parts[0][0]
    several = READ[ros_type].kind == JOINT
    places = _places(inner or ros_type)
    found: list[Field] = []
    for path, kind, count in _leaves("", name, types, 0):
        place = places.pop(path, -1)
        taken = place >= 0
        if kind == "wstring":
            raise ValueError(f"{path} in its schema is a wstring that is not read over")
        if taken and (kind not in ("time", "string", "float64") or not (count > 0 or several)):
            sequence = "[]" * (count < 0)
            raise ValueError(f"{path} in its schema is {kind}{sequence}, not float64")
        last = found[-1] if found else Field("", 0, 0)
        follows = place == last.place + last.count if taken else True
        joins = kind == last.kind == "float64" and min(count, last.count) > 0
        if joins and follows and taken == (last.place >= 0):
            found[-1] = Field(kind, last.count + count, last.place)
        else:
            found.append(Field(kind, count, place))
    if places:
        needed = READ[inner or ros_type].needed
        lacks = [p for p in needed if any(f"{path}.".startswith(f"{p}.") for path in places)]
        raise ValueError(f"its schema of {inner or ros_type} lacks {', '.join(lacks)}")
    return tuple(found)


def _places(ros_type: str) -> dict[str, int]:
    """Place of each needed primitive field among them, in the type known here."""
    needed = READ[ros_type].needed
    leaves = _leaves("", "", _types(schema_text(ros_type)), 0)
    taken = [path for path, _, _ in leaves if f"{path}.".startswith(tuple(f"{p}." for p in needed))]
    return {path: k for k, path in enumerate(taken)}


def _types(text: str) -> dict[str, list[tuple[str, int, str]]]:
    """Fields (type, count, name) of each type by short name; "": the main type."""
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


def _leaves(path: str, name: str, types: dict, depth: int) -> Iterator[tuple[str, str, int]]:
    """(path, kind, count) of the primitive fields of a type, in order."""
    fields = types.get(_short(name))
    if fields is None:  # within a package names may stand without it
        fields = next((v for k, v in types.items() if k.rpartition("/")[2] == name), None)
    if fields is None or depth > DEEPEST:
        raise ValueError(f"its schema does not define {name}")
    for kind, count, field in fields:
        where = f"{path}.{field}" if path else field
        if kind in TIMES:
            yield where, "time", count
        elif kind in SIZES or kind in ("string", "wstring"):
            yield where, kind, count
        elif count == 1:
            yield from _leaves(where, kind, types, depth + 1)
        else:
            raise ValueError(f"its schema has several {kind} in {where}, which are not passed over")


# Decoding of many messages at once.
#
# Messages of one topic mostly differ only in stamps and numbers: strings and lengths are read once,
# and the numbers of all messages that share them are read as columns. Alignment is counted from the
# end of the 4-byte encapsulation header (OMG XTypes, encoding version 1, little endian).


_MOST = 10_000
"""Maximum number of transforms in one message; more is taken as damage."""


class Group(NamedTuple):
    """n readings whose messages have the same strings."""

    which: np.ndarray
    """index of each reading's message, shape (n,)."""
    names: tuple[str, ...]
    """frame_id, and child_frame_id if the type has one, or names of joints."""
    stamp: np.ndarray | None
    """[ns], shape (n,); None for a type without a stamp."""
    values: np.ndarray
    """shape (n, m)."""


def decode(
    ros_type: str, messages: Messages, wrong: Counter[str], fields: tuple[Field, ...]
) -> Iterator[Group]:
    """Readings in the messages of one topic; undecodable messages are counted in `wrong`."""
    rest = np.arange(len(messages.start))
    while len(rest):
        first = messages.data(int(rest[0]))
        try:
            parts, fixed = _parse(fields, first, ros_type)
        except ValueError as error:
            wrong[str(error)] += 1
            rest = rest[1:]
            continue
        same = rest[messages.size[rest] == len(first)]
        rows = messages.take(same).rows(len(first))
        alike = (rows[:, fixed] == np.frombuffer(first, np.uint8)[fixed]).all(axis=1)
        rows, same = rows[alike], same[alike]
        for names, codec in parts:
            stamp = codec.unpack_stamps(rows) if codec.stamps else None
            yield Group(same, names, stamp, codec.unpack_rows(rows))
        rest = np.setdiff1d(rest, same, assume_unique=True)


def _parse(
    fields: tuple[Field, ...], data: bytes, ros_type: str
) -> tuple[list[tuple[tuple[str, ...], Codec]], np.ndarray]:
    """(strings, codec) of each reading in a message, and a mask of the constant bytes."""
    if len(data) < len(HEADER):
        raise ValueError(f"a message of {len(data)} bytes is not a {ros_type}")
    if data[:2] != HEADER[:2]:
        raise ValueError(f"its encoding {data[:2].hex()} is not CDR, little endian (0001)")
    cursor = Cursor(data, ros_type)
    count = cursor.count() if ros_type in INNER else 1
    if count > _MOST:
        raise ValueError(f"a message with {count} parts is not a {ros_type}")
    return [_reading(cursor, data, fields) for _ in range(count)], cursor.fixed


def _reading(
    cursor: Cursor, data: bytes, fields: tuple[Field, ...]
) -> tuple[tuple[str, ...], Codec]:
    """Strings of the next reading, and the codec for its stamp and numbers."""
    names: list[tuple[int, list[str]]] = []
    stamps: list[int] = []
    runs: list[tuple[int, tuple[int, str, int]]] = []
    for kind, length, place in fields:  # messages of one group have sequences of equal length
        count = cursor.count() if length < 0 else length
        if kind == "string":
            texts = [cursor.text("replace") for _ in range(count)]
            names.append((place, texts))
        elif kind == "time":
            offsets = [cursor.take(4, 8, numbers=True) for _ in range(count)]
            stamps += offsets if place >= 0 else []
        elif count:
            at = cursor.take(SIZES[kind], SIZES[kind] * count, numbers=True)
            runs += [(place, (at, "d", count))] if place >= 0 else []
    texts = [text for place, some in sorted(names) if place >= 0 for text in some]
    return tuple(texts), Codec(data, stamps, [run for _, run in sorted(runs)])


# Check that the header stamps of all sources come from one clock, by comparison with log times.


APART = 0.5
"""[s]: larger differences of the delay between stamp and log time indicate different clocks."""
FIRST = 8
"""Number of readings of a source that are used."""


class Clocks:
    """Difference between log time and stamp of each source."""

    def __init__(self) -> None:
        self._ahead: dict[str, float] = {}

    def add(self, piece: Piece) -> None:
        """Append readings; only the first ones of a source are used."""
        if piece.source not in self._ahead and not is_static(piece.source):
            ahead = piece.log[:FIRST] - piece.t[:FIRST]
            self._ahead[piece.source] = float(np.median(ahead))

    @property
    def note(self) -> str:
        """A line with the two most different sources if the clocks differ; else ""."""
        if not self._ahead:
            return ""
        first = min(self._ahead, key=lambda source: self._ahead[source])
        last = max(self._ahead, key=lambda source: self._ahead[source])
        least, most = self._ahead[first], self._ahead[last]
        if most - least <= APART:
            return ""
        return (
            f"stamps of different clocks: those of {last} lie {most:.6g} s before the time of the "
            f"log, those of {first} {least:.6g} s: the topics are not synchronised"
        )


# Detect stamps whose `nanosec` holds microseconds or milliseconds, by comparison with log times,
# and stamps that nobody has set.
#
# Within each second the former advance 1000 or 1e6 times more slowly than the log times; the latter
# are all zero.


NANO = 1_000_000_000
UNITS = {1_000: "microseconds", 1_000_000: "milliseconds"}
"""Nanoseconds per unit that `nanosec` may hold."""
UNSET = 0
"""In place of a unit: the stamps are not set."""
LEAST = 8
"""Minimum number of readings of a source for a decision."""
NEAR = 4.0
"""Maximum ratio between steps of the log times and of the rescaled stamps, either way."""


class Fractions:
    """Rescales stamps to nanoseconds, and replaces stamps that are all zero by the log times;
    `notes` names the sources concerned."""

    def __init__(self) -> None:
        self._factor: dict[str, int] = {}
        self.notes: list[str] = []

    def learn(self, pieces: list[Piece]) -> None:
        """Determine the unit of each source from its first readings."""
        known: dict[str, list[Piece]] = {}
        for piece in pieces:
            if piece.source not in self._factor:
                known.setdefault(piece.source, []).append(piece)
        for source, parts in known.items():
            stamp, log = (np.concatenate([getattr(p, name) for p in parts])
                          for name in ("stamp", "log"))  # fmt: skip
            if len(stamp) < LEAST or is_static(source):
                continue
            self._factor[source] = factor = _factor(stamp, log)
            if parts[0].kind == JOINT:  # all joints of a message have its stamp
                source = source.partition(":")[0]
            what = "its stamps are zero: times of the log are taken"
            if factor in UNITS:
                unit = UNITS[factor]
                what = f"nanosec of its stamps holds {unit}, by the times of the log: taken as such"
            if factor != 1 and f"{source}: {what}" not in self.notes:
                self.notes.append(f"{source}: {what}")

    def mended(self, piece: Piece) -> Piece:
        """The readings with stamps in nanoseconds."""
        self.learn([piece])
        factor = self._factor.get(piece.source, 1)
        if factor == 1:
            return piece
        if factor == UNSET:
            return piece._replace(stamp=np.round(piece.log * NANO).astype(np.int64), t=piece.log)
        whole, part = np.divmod(piece.stamp, NANO)
        stamp = whole * NANO + part * factor
        return piece._replace(stamp=stamp, t=stamp * 1e-9)


def _factor(stamp: np.ndarray, log: np.ndarray) -> int:
    """Nanoseconds per unit of `nanosec`: 1, a key of UNITS, or UNSET if all stamps are zero."""
    if not stamp.any():
        return UNSET
    steps, logged = np.diff(stamp), np.diff(log)
    if not ((steps > 0).any() and (logged > 0).any()):
        return 1
    ratio = float(np.median(logged[logged > 0]) * NANO / np.median(steps[steps > 0]))
    most = int((stamp % NANO).max())
    for factor in UNITS:
        if most * factor < NANO and factor / NEAR < ratio < factor * NEAR:
            return factor
    return 1


UNIT = 1e-3
"""Deviation from unit length above which a quaternion is reported."""
HUGE = 1e100
"""Larger values count as damage, like non-finite ones: their squares would overflow."""
AHEAD = 1 << 23
"""Bytes of readings read ahead to find the transforms."""
MOST_WRONG = 10_000
"""Number of undecodable messages of a topic above which the rest is skipped."""


class Readings:
    """All readings of a bag; iterate over `pieces` once, afterwards `notes` lists problems.

    topics: only these; None: all of a known type. frames: frames whose poses are wanted in the root
    of their tree of transforms even if they are fixed to their parent (others are composed if they
    move). joints: also the positions of joints, each as a source. Raises SinkError if the file is
    not a bag.
    """

    def __init__(
        self,
        bag: Path,
        topics: frozenset[str] | None = None,
        frames: frozenset[str] = frozenset(),
        *,
        joints: bool = False,
    ) -> None:
        self.paths = bag_paths(Path(bag))
        self._unlisted = unlisted(Path(bag))
        self.composed: dict[str, str] = {}
        """name of the composed source (in the tree's root) by original source."""
        self.inner: set[str] = set()
        """reference frames of those original poses, which are not the root."""
        self.fixed = FixedFrames()
        """the static transforms; known with the first piece."""
        self._frames, self._joints = frames, joints
        self._tree: Composed | None = None
        self.bytes = 0
        self.messages = 0
        self._topics = topics
        self._others: set[str] = set()
        self._sources = Sources()
        self._clocks = Clocks()
        self._fractions = Fractions()
        self._refused: dict[str, str] = {}
        self._wrong: dict[str, Counter[str]] = {}
        self._read: set[str] = set()
        self._counts: dict[str, Counter[str]] = {}
        self._damage: list[str] = []
        self.other_topics: dict[str, str] = {}
        """topics without readings, with their types."""

    def pieces(self) -> Iterator[Piece]:
        """Yield the readings, chunk by chunk, each chunk followed by the poses composed from it."""
        batches = self._batches()
        first = _ahead(batches)
        self._fractions.learn([piece for batch in first for piece in batch])
        mended = self._fractions.mended
        first = [[mended(piece) for piece in batch] for batch in first]
        known = [piece for batch in first for piece in batch]
        made = chains(known, self._frames)
        self.fixed = FixedFrames(known)
        tree = self._tree = Composed(made, self.fixed)
        frames = {piece.source: piece.frame for piece in known}
        self.inner |= {frames[way.replaced] for way in made}
        self.composed |= {way.replaced: way.name for way in made}
        del known
        later = ([mended(piece) for piece in batch] for batch in batches)
        for batch in chain(_handed_over(first), later):
            for piece in batch:
                self._clocks.add(piece)
                yield piece
                tree.add(piece)
            yield from tree.ready()
        yield from tree.ready(last=True)

    def _batches(self) -> Iterator[list[Piece]]:
        for path in self.paths:
            scan = scan_of(path)
            for batch in scan.batches():
                yield list(self._batch(scan, batch))
            self._damage += scan.missing.lines()
            self.bytes += scan.bytes
            self.messages += scan.messages
        if self._topics is not None:
            missing = self._topics - set(self._counts) - set(self._refused)
            if missing:
                topics = one_of(min(missing), self._others | self._counts.keys())
                names = ", ".join(sorted(missing))
                raise SinkError(f"{self.paths[0]}: no readable topic {names}; must be {topics}")

    @property
    def notes(self) -> list[str]:
        """One line for each problem in the bag."""
        lines = [*self._unlisted, *self._damage, *self._sources.notes]
        lines += [] if self._tree is None else self._tree.notes
        lines += self._fractions.notes
        lines += [self._clocks.note] if self._clocks.note else []
        for topic, wrong in self._wrong.items():
            for text, count in wrong.most_common(3):
                some = f"{count} message{'s' * (count > 1)} skipped" if topic in self._read else ""
                lines.append(f"{topic}: {some or 'skipped'}: {text}")
        for topic, why in self._refused.items():
            some = "the rest is skipped" if topic in self._read else "skipped"
            lines.append(f"{topic}: {some}: {why}")
        for source, counts in self._counts.items():
            lines += [f"{source}: {count} {what}" for what, count in counts.items() if what]
        return lines

    def _batch(self, scan: Scan, batch: Batch) -> Iterator[Piece]:
        """Readings of a batch, in the order of the file for each source (which may have several
        channels, or messages of other sources in between)."""
        parts: dict[str, list[tuple[np.ndarray, Piece]]] = {}
        for number, messages in batch.items():
            for which, piece in self._channel(scan, number, messages):
                parts.setdefault(piece.source, []).append((messages.start[which], piece))
        for pieces in parts.values():
            yield from self._finite(_in_order(pieces))

    def _channel(
        self, scan: Scan, number: int, messages: Messages
    ) -> Iterator[tuple[np.ndarray, Piece]]:
        """Readings of a channel, and the index of each one's message."""
        channel = scan.channels[number]
        topic = channel.topic
        schema = scan.schemas.get(channel.schema_id)
        ros_type = schema.name if schema else ""
        readable = ros_type in READ and (self._joints or ros_type != JOINT_STATE)
        if topic in self._refused:
            return
        if self._topics is not None and topic not in self._topics:
            if readable:
                self._others.add(topic)
            return
        if not readable:
            self.other_topics[topic] = ros_type or "no type"
            return
        if channel.message_encoding != "cdr":
            self._refused[topic] = f"its messages are {channel.message_encoding!r}, not cdr"
            return
        self._counts.setdefault(topic, Counter())
        try:
            text = schema_text(ros_type)
            if schema is not None and schema.encoding == "ros2msg" and schema.data.strip():
                text = schema.data.decode("utf-8", "replace")
            wrong = self._wrong.setdefault(topic, Counter())
            fields = fields_of(ros_type, text)
            for group in decode(ros_type, unpacked(messages), wrong, fields):
                for piece in self._named(channel, ros_type, messages, group):
                    yield group.which, piece
            if wrong.total() > MOST_WRONG:
                raise ValueError("too many of its messages are not of its type")
        except ValueError as error:
            self._refused[topic] = str(error)

    def _named(
        self, channel: Channel, ros_type: str, messages: Messages, group: Group
    ) -> Iterator[Piece]:
        log = messages.log_time[group.which] * 1e-9
        stamp = messages.log_time[group.which] if group.stamp is None else group.stamp
        t = stamp * 1e-9
        values, kind = group.values, READ[ros_type].kind
        self._read.add(channel.topic)
        none = np.empty((len(t), 0))
        if kind == JOINT:
            frame, *joints = group.names
            for name, column in zip(joints, values.T, strict=False):
                source = self._sources.name(channel.topic, ros_type, frame, name, channel.id)
                yield Piece(source, kind, frame, name, t, log, column[:, None], stamp, none)
            return
        frame, child, *_ = [*group.names, "", ""]
        source, twist = self._sources.name(channel.topic, ros_type, frame, child, channel.id), none
        if ros_type == "nav_msgs/msg/Odometry":
            values, twist = np.split(values, [7], axis=1)
            yield Piece(f"{source}:twist", TWIST, child, child, t, log, twist, stamp, none)
            known = (np.abs(twist) <= HUGE).all(axis=1, keepdims=True)
            twist = np.where(known, twist, np.nan)
        is_transform = ros_type in TRANSFORMS
        yield Piece(source, kind, frame, child, t, log, values, stamp, twist, is_transform)

    def _finite(self, piece: Piece) -> Iterator[Piece]:
        """The reading without rows that are not finite, huge, or have a zero quaternion."""
        counts = self._counts.setdefault(piece.source, Counter())
        size = np.abs(piece.values).max(axis=1)
        known, good = np.isfinite(size), size <= HUGE
        found = {
            "readings with NaN or infinity skipped": ~known,
            f"readings beyond {HUGE:g} skipped": known & ~good,
        }
        if piece.kind == POSE:
            length = np.linalg.norm(np.where(good[:, None], piece.values[:, 3:7], 0.5), axis=1)
            zero = length < UNIT
            good &= ~zero
            far = good & (np.abs(length - 1) > UNIT)
            found["readings with a quaternion of length 0 skipped"] = zero
            found["quaternions are not of unit length (taken as a rotation)"] = far
        counts.update({what: int(which.sum()) for what, which in found.items() if which.any()})
        if good.any():
            yield piece.take(good)


def _ahead(batches: Iterator[list[Piece]]) -> list[list[Piece]]:
    """The first batches, up to AHEAD bytes."""
    first, size = [], 0
    for batch in batches:
        first.append(batch)
        size += sum(piece.values.nbytes for piece in batch)
        if size > AHEAD:
            break
    return first


def _handed_over(batches: list[list[Piece]]) -> Iterator[list[Piece]]:
    """Yield and release each batch."""
    while batches:
        yield batches.pop(0)


def _in_order(parts: list[tuple[np.ndarray, Piece]]) -> Piece:
    """Readings of one source merged into one piece, in the order of the file."""
    if len(parts) == 1:
        return parts[0][1]
    order = np.argsort(np.concatenate([start for start, _ in parts]), kind="stable")
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(piece, name) for _, piece in parts])[order]
        for name in COLUMNS
    }
    return parts[0][1]._replace(**joined)
