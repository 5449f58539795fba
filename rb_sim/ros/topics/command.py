# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Commanded wrenches: geometry_msgs/WrenchStamped on ~/BODY/wrench.

A command acts on the body at the body's origin O. Its components are in the axes of
header.frame_id: the world frame, or the body frame (then the wrench turns with the body). It is
taken at a sample instant t_k, acts from t_k on, and is held until the next one or until
wrench_timeout simulated seconds have passed. The stamp is not used: a late command acts late, as
recorded in BODY/wrench_applied.

The loop polls the subscriptions itself and takes messages as bytes, in a ninth of the time of an
rclpy object (2 us instead of 18): a controller may send far more commands than there are samples.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from struct import Struct
from typing import NamedTuple, Protocol

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from rb_sim.catalogue.spec import STRONGEST
from rb_sim.io.messages.topic_names import WORLD, body_frame, body_topic
from rb_sim.ros.topics.inbox import Inbox, Polled

Vector = tuple[float, float, float]
UNKNOWN_FRAME = "unknown frame"
NO_FRAME = "no frame"
OWN_FRAME = "frame of the node"
NOT_FINITE = "not finite"
TOO_STRONG = "beyond the limit"
UNREADABLE = "not a wrench"
OVERTAKEN = "overtaken"
EXPIRED = "expired"
REMINDER = 10.0
"""[s] of wall-clock time between two log lines on refusals of one kind."""
MOST_KINDS = 100
"""Maximum number of reasons counted individually; further ones are counted by kind, so that a
sender of ever new frames fills neither memory nor log."""
LONGEST = 100
"""Maximum number of characters of a wrong frame that are quoted."""
NUMBERS = Struct("<6d")
"""Force and torque, six doubles."""
PLAIN, STAMP = b"\x00\x01\x00\x00", 8
"""First bytes of a CDR message, little-endian, and size of the stamp that follows."""


class Command(NamedTuple):
    """A valid commanded wrench."""

    frame: str
    """"world" or "body": the axes of force and torque."""
    force: Vector
    """[N]."""
    torque: Vector
    """about the body origin [N m]."""


class TakesWrench(Protocol):
    """The interface of Simulation that commands use."""

    def apply_wrench(
        self, body: str, force: Sequence[float], torque: Sequence[float], frame: str = "world"
    ) -> None:
        """Apply a force [N] and a torque about the body origin [N m] from now on."""
        ...


class Limits(NamedTuple):
    """Largest accepted force and torque; 0: unlimited."""

    force: float = 0.0
    """[N]."""
    torque: float = 0.0
    """[N m]."""


class Refusal(NamedTuple):
    """Why a message has no effect: the reason under which it is counted, and an explanation."""

    reason: str
    words: str


class Reader:
    """Reads the messages for `body`. prefix: of the node's frame names."""

    def __init__(self, body: str, prefix: str = "") -> None:
        self._body, self._prefix = body, prefix
        self._frames = {prefix + WORLD: "world", prefix + body_frame(body): "body"}
        self._layouts = [_layout(frame_id, axes) for frame_id, axes in self._frames.items()]

    def read(self, data: bytes) -> Command | Refusal:
        """The command in a serialized WrenchStamped, or the reason of refusal."""
        for front, at, axes in self._layouts:
            if data.startswith(PLAIN) and data.startswith(front, len(PLAIN) + STAMP):
                if len(data) < at + NUMBERS.size:
                    break
                numbers = NUMBERS.unpack_from(data, at)
                return checked(axes, numbers[:3], numbers[3:])
        return self._read_any(data)

    def _read_any(self, data: bytes) -> Command | Refusal:
        """As `read`, nine times slower, for other frames and other encodings."""
        try:
            message: WrenchStamped = deserialize_message(data, WrenchStamped)
        except Exception as error:  # rclpy's own error types share no base class
            return Refusal(UNREADABLE, f"unreadable: {' '.join(str(error).split())}")
        frame_id, wrench = message.header.frame_id, message.wrench
        if frame_id not in self._frames:
            return wrong_frame(frame_id, self._body, self._prefix)
        force, torque = wrench.force, wrench.torque
        numbers = (force.x, force.y, force.z), (torque.x, torque.y, torque.z)
        return checked(self._frames[frame_id], *numbers)


def _layout(frame_id: str, axes: str) -> tuple[bytes, int, str]:
    """For a message in this frame: bytes after the stamp, offset of its numbers, axes."""
    text = frame_id.encode() + b"\0"
    front = len(text).to_bytes(4, "little") + text
    end = STAMP + len(front)
    return front, len(PLAIN) + end + -end % 8, axes


def checked(frame: str, force: Vector, torque: Vector) -> Command | Refusal:
    """A command in "world" or "body" axes; a Refusal if a number is not finite or huge."""
    numbers = (*force, *torque)
    if not all(map(math.isfinite, numbers)):
        return Refusal(NOT_FINITE, "a component is not a finite number")
    if max(map(abs, numbers)) > STRONGEST:
        return Refusal(TOO_STRONG, f"a component is beyond {STRONGEST:g}")
    return Command(frame, force, torque)


def wrong_frame(frame_id: str, body: str, prefix: str) -> Refusal:
    """The refusal of a frame that is neither the world nor the body."""
    world, own, given = repr(prefix + WORLD), repr(prefix + body_frame(body)), repr(frame_id)
    if len(given) > LONGEST:
        given = f"{given[:LONGEST]}... ({len(frame_id)} characters)"
    if not frame_id:
        return Refusal(NO_FRAME, f"frame_id is empty; must be {world} or {own}")
    if frame_id.endswith(("/origin", "/anchor")):
        words = f"frame_id {given} is a frame that the node publishes; its axes are the"
        return Refusal(OWN_FRAME, f"{words} world's, so say {world}")
    return Refusal(UNKNOWN_FRAME, f"frame_id {given} is neither {world} nor {own}")


def beyond(command: Command, limits: Limits) -> Refusal | None:
    """The refusal of a command above the limits; None if it is within them."""
    for name, unit, vector, limit in (
        ("force", "N", command.force, limits.force),
        ("torque", "N m", command.torque, limits.torque),
    ):
        size = math.hypot(*vector)
        if limit > 0.0 and not size <= limit:
            words = f"its {name} of {size:g} {unit} is beyond max_{name} = {limit:g} {unit}"
            return Refusal(TOO_STRONG, words)
    return None


class Commands:
    """Receives commands for the commanded bodies and applies them at sample instants."""

    def __init__(self, node: Node, bodies: Sequence[str], prefix: str = "") -> None:
        group = Polled()
        self._node = node
        self._warn = node.get_logger().warning
        self._inboxes = {
            body: Inbox(node, f"~/{body_topic(body, 'wrench')}", group) for body in bodies
        }
        self._readers = {body: Reader(body, prefix) for body in bodies}
        self._newest: dict[str, Command] = {}
        """newest command for each body since the last sample."""
        self.prefix = prefix
        self._since: dict[str, float] = {}
        self._warned: dict[tuple[str, str], float] = {}
        self.limits = Limits()
        self.held: dict[str, tuple[Command, float]] = {}
        """the command that acts on each body, and when it started [s]."""
        self.received = 0
        """number of messages received."""
        self.applied = 0
        self.refused: Counter[str] = Counter()
        """number of messages without effect, by reason."""

    def apply(self, simulation: TakesWrench, t: float, timeout: float) -> None:
        """Apply the newest command of each body to the simulation, and end those that timed out.

        t: simulated time from which it acts [s]. timeout: see wrench_timeout [s].
        """
        self.collect()
        for body in self._inboxes:
            command = self._newest.pop(body, None)
            if command is not None:
                self.give(simulation, body, command, t)
            elif self._is_over(body, t, timeout):
                simulation.apply_wrench(body, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
                del self._since[body], self.held[body]
                words = f"no command for {timeout:g} s: the wrench is now zero"
                self._count(body, Refusal(EXPIRED, words), f"{body}: {words}")

    def collect(self) -> None:
        """Read the received messages: the newest of each body will act, the others are counted.

        If samples are rare, also call it between samples: the middleware keeps only inbox.DEPTH
        messages.
        """
        for body, inbox in self._inboxes.items():
            for data in inbox.take():
                self.received += 1
                self._note(body, self._readers[body].read(data))

    def _note(self, body: str, command: Command | Refusal) -> None:
        """Keep a command for the next sample, or count the reason of refusal."""
        if isinstance(command, Command):
            command = beyond(command, self.limits) or command
        if isinstance(command, Refusal):
            self._count(body, command, f"{body}/wrench refused: {command.words}")
            return
        if body in self._newest:
            self.refused[OVERTAKEN] += 1
        self._newest[body] = command

    def overtake(self, bodies: Iterable[str]) -> None:
        """Drop pending commands for these bodies, in favour of newer ones."""
        self.collect()
        for body in bodies:
            if self._newest.pop(body, None) is not None:
                self.refused[OVERTAKEN] += 1

    def give(self, simulation: TakesWrench, body: str, command: Command, t: float) -> None:
        """Let a command act from time t [s] on. Raises RbSimError if the body takes none."""
        simulation.apply_wrench(body, command.force, command.torque, command.frame)
        self._since[body] = t
        self.held[body] = command, t
        self.applied += 1

    def forget(self) -> None:
        """Drop pending and acting commands (after a reset)."""
        self.overtake(self._inboxes)
        self._since.clear()
        self.held.clear()

    def close(self) -> None:
        """Remove the subscriptions."""
        for inbox in self._inboxes.values():
            self._node.destroy_subscription(inbox.subscription)
        self._inboxes = {}

    def in_force(self) -> str:
        """Text with the commands that act now."""
        acting = [
            f"{body} force {_text(command.force)} N, torque {_text(command.torque)} N m"
            f" in {command.frame} axes since t = {since:.9g} s"
            for body, (command, since) in self.held.items()
        ]
        return "; ".join(acting) or "none"

    def _is_over(self, body: str, t: float, timeout: float) -> bool:
        since = self._since.get(body)
        # half a nanosecond, since sample instants are stamped in nanoseconds
        return since is not None and timeout > 0 and t - since >= timeout - 0.5e-9

    def _count(self, body: str, refusal: Refusal, line: str) -> None:
        """Count a refusal; log the first of each kind, then one per REMINDER with the count."""
        self.refused[refusal.reason] += 1
        count, now = self.refused[refusal.reason], time.monotonic()
        # the text for a wrong frame is specific; that for a limit changes with every message
        kind = refusal.words if refusal.reason in (UNKNOWN_FRAME, OWN_FRAME) else refusal.reason
        if (body, kind) not in self._warned and len(self._warned) >= MOST_KINDS:
            kind = refusal.reason
        last = self._warned.get((body, kind))
        if last is not None and now - last < REMINDER:
            return
        self._warn(line if last is None else f"{line} ({count} {refusal.reason} so far)")
        self._warned[body, kind] = now


def _text(vector: Vector) -> str:
    return "(" + ", ".join(f"{value:g}" for value in vector) + ")"
