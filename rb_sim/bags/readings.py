"""The readings in any ROS 2 bag: poses, twists, wrenches, accelerations, by what they are of."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rb_sim.bags.templates import LAYOUTS, Group, decode
from rb_sim.errors import SinkError
from rb_sim.sinks.bag_batches import BagScan, Messages
from rb_sim.sinks.bag_records import bag_paths

POSE, TWIST, WRENCH, IMU, SCALAR = "pose", "twist", "wrench", "imu", "scalar"
KINDS = {
    "geometry_msgs/msg/PoseStamped": POSE,
    "geometry_msgs/msg/PoseWithCovarianceStamped": POSE,
    "geometry_msgs/msg/Pose": POSE,
    "geometry_msgs/msg/TransformStamped": POSE,
    "tf2_msgs/msg/TFMessage": POSE,
    "nav_msgs/msg/Odometry": POSE,
    "geometry_msgs/msg/TwistStamped": TWIST,
    "geometry_msgs/msg/TwistWithCovarianceStamped": TWIST,
    "geometry_msgs/msg/WrenchStamped": WRENCH,
    "sensor_msgs/msg/Imu": IMU,
    "std_msgs/msg/Float64": SCALAR,
}
UNIT = 1e-3
"""Distance from unit length beyond which a quaternion is told."""


class Piece(NamedTuple):
    """Readings of one source, in the order of the file."""

    source: str
    """the topic; of transforms TOPIC:CHILD; of the twist of an Odometry TOPIC:twist."""
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


class Readings:
    """All readings of a bag; iterate over `pieces` once, then `notes` tells what is wrong in it.

    topics: only these; None: all of a known type. Raises SinkError for what is no bag.
    """

    def __init__(self, bag: Path, topics: frozenset[str] | None = None) -> None:
        self.paths = bag_paths(Path(bag))
        self.bytes = 0
        self.messages = 0
        self._topics = topics
        self._refused: dict[str, str] = {}
        self._counts: dict[str, Counter[str]] = {}
        self._damage: list[str] = []
        self._unknown: dict[str, str] = {}
        self._encodings: set[str] = set()

    def pieces(self) -> Iterator[Piece]:
        """The readings, chunk by chunk."""
        for path in self.paths:
            scan = BagScan(path)
            for batch in scan.batches():
                for number, messages in batch.items():
                    yield from self._channel(scan, number, messages)
            self._damage += scan.missing.lines()
            self.bytes += scan.bytes
            self.messages += scan.messages
        if self._topics is not None:
            missing = self._topics - set(self._counts) - set(self._refused)
            if missing:
                raise SinkError(f"{self.paths[0]}: no readable topic {', '.join(sorted(missing))}")

    @property
    def notes(self) -> list[str]:
        """One line for each thing that a reader of the numbers should know."""
        lines = list(self._damage)
        lines += [f"{topic}: left out: {why}" for topic, why in self._refused.items()]
        for source, counts in self._counts.items():
            lines += [f"{source}: {count} {what}" for what, count in counts.items() if what]
        return lines

    @property
    def other_topics(self) -> dict[str, str]:
        """Topics that hold no readings, with their types."""
        return dict(self._unknown)

    def _channel(self, scan: BagScan, number: int, messages: Messages) -> Iterator[Piece]:
        channel = scan.channels[number]
        topic = channel.topic
        schema = scan.schemas.get(channel.schema_id)
        ros_type = schema.name if schema else ""
        if topic in self._refused or (self._topics is not None and topic not in self._topics):
            return
        if ros_type not in KINDS:
            self._unknown[topic] = ros_type or "no type"
            return
        if channel.message_encoding != "cdr":
            self._refused[topic] = f"its messages are {channel.message_encoding!r}, not cdr"
            return
        self._counts.setdefault(topic, Counter())
        assert ros_type in LAYOUTS
        try:
            for group in decode(ros_type, messages):
                yield from self._clean(topic, ros_type, messages, group)
        except ValueError as error:
            self._refused[topic] = str(error)

    def _clean(
        self, topic: str, ros_type: str, messages: Messages, group: Group
    ) -> Iterator[Piece]:
        log = messages.log_time[group.which] * 1e-9
        stamp = messages.log_time[group.which] if group.stamp is None else group.stamp
        t = stamp * 1e-9
        values, kind = group.values, KINDS[ros_type]
        names = [*group.names, "", ""]
        source = topic
        if ros_type in ("tf2_msgs/msg/TFMessage", "geometry_msgs/msg/TransformStamped"):
            source = f"{topic}:{names[1]}"
        if ros_type == "nav_msgs/msg/Odometry":
            twist, values = values[:, 7:13], values[:, :7]
            yield from self._finite(
                Piece(f"{topic}:twist", TWIST, names[1], names[1], t, log, twist, stamp)
            )
        yield from self._finite(Piece(source, kind, names[0], names[1], t, log, values, stamp))

    def _finite(self, piece: Piece) -> Iterator[Piece]:
        """Without readings that are no numbers, whose quaternion is none; all counted."""
        counts = self._counts.setdefault(piece.source, Counter())
        good = np.isfinite(piece.values).all(axis=1)
        if not good.all():
            counts["readings with NaN or infinity are left out"] += int((~good).sum())
        if piece.kind == POSE:
            length = np.linalg.norm(piece.values[:, 3:7], axis=1)
            zero = good & (length < UNIT)
            if zero.any():
                counts["readings with a quaternion of length 0 are left out"] += int(zero.sum())
            good &= ~zero
            far = good & (np.abs(length - 1) > UNIT)
            if far.any():
                counts["quaternions are not of unit length (taken as a rotation)"] += int(far.sum())
        if good.any():
            columns = ("t", "log", "values", "stamp")
            yield piece._replace(**{name: getattr(piece, name)[good] for name in columns})
