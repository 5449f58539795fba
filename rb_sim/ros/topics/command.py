# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Commanded wrenches: geometry_msgs/WrenchStamped on ~/BODY/wrench.

A command acts on the body at the body's origin O. Its numbers are in the axes of header.frame_id:
the world frame, or the frame named like the body (then the wrench turns with the body). It is
taken at a sample instant t_k, acts from t_k on, and is held until the next one or until
wrench_timeout simulated seconds have passed. The stamp is not used: what arrives late acts late,
and the bag says when (BODY/wrench_applied).

The loop polls the subscriptions itself and takes messages as bytes, in a ninth of the time that an
object of rclpy takes (2 us of 18): a controller may send far more commands than there are samples.
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
"""[s] of wall time between two lines on refusals of one kind."""
MOST_KINDS = 100
"""Reasons of refusals that are counted one by one; beyond, by kind: who sends a new
frame each time fills neither memory nor screen, and is reported all the same."""
LONGEST = 100
"""Characters of a wrong frame that are repeated."""
NUMBERS = Struct("<6d")
"""Force and torque."""
PLAIN, STAMP = b"\x00\x01\x00\x00", 8
"""First bytes of a message in CDR, little-endian, and the size of the stamp behind them."""


class Command(NamedTuple):
    """A wrench that may be applied."""

    frame: str
    """"world" or "body": the axes of force and torque."""
    force: Vector
    """[N]."""
    torque: Vector
    """about the body origin [N m]."""


class TakesWrench(Protocol):
    """The part of Simulation that commands act on."""

    def apply_wrench(
        self, body: str, force: Sequence[float], torque: Sequence[float], frame: str = "world"
    ) -> None:
        """Let a force [N] and a torque about the body origin [N m] act from now on."""
        ...


class Limits(NamedTuple):
    """The strongest wrench that is taken; 0: any."""

    force: float = 0.0
    """[N]."""
    torque: float = 0.0
    """[N m]."""


class Refusal(NamedTuple):
    """Why a message has no effect: the reason it is counted under, and what is wrong in words."""

    reason: str
    words: str


class Reader:
    """Reads the messages for `body`. prefix: of the node's frames."""

    def __init__(self, body: str, prefix: str = "") -> None:
        self._body, self._prefix = body, prefix
        self._frames = {prefix + WORLD: "world", prefix + body_frame(body): "body"}
        self._layouts = [_layout(frame_id, axes) for frame_id, axes in self._frames.items()]

    def read(self, data: bytes) -> Command | Refusal:
        """The command in a serialized WrenchStamped, or why it is refused."""
        for front, at, axes in self._layouts:
            if data.startswith(PLAIN) and data.startswith(front, len(PLAIN) + STAMP):
                if len(data) < at + NUMBERS.size:
                    break
                numbers = NUMBERS.unpack_from(data, at)
                return checked(axes, numbers[:3], numbers[3:])
        return self._read_any(data)

    def _read_any(self, data: bytes) -> Command | Refusal:
        """As `read`, in nine times the time: of other frames and other encodings."""
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
    """Of a message in this frame: what follows the stamp, where its numbers begin, the axes."""
    text = frame_id.encode() + b"\0"
    front = len(text).to_bytes(4, "little") + text
    end = STAMP + len(front)
    return front, len(PLAIN) + end + -end % 8, axes


def checked(frame: str, force: Vector, torque: Vector) -> Command | Refusal:
    """A command in "world" or "body" axes, if its numbers are finite and none is beyond all use."""
    numbers = (*force, *torque)
    if not all(map(math.isfinite, numbers)):
        return Refusal(NOT_FINITE, "a component is not a finite number")
    if max(map(abs, numbers)) > STRONGEST:
        return Refusal(TOO_STRONG, f"a component is beyond {STRONGEST:g}")
    return Command(frame, force, torque)


def wrong_frame(frame_id: str, body: str, prefix: str) -> Refusal:
    """What is wrong with a frame that is neither the world's nor the body's."""
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
    """Why the command is stronger than what is taken; None: it is not."""
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
    """Takes commands for the commanded bodies and applies them at sample instants."""

    def __init__(self, node: Node, bodies: Sequence[str], prefix: str = "") -> None:
        group = Polled()
        self._node = node
        self._warn = node.get_logger().warning
        self._inboxes = {
            body: Inbox(node, f"~/{body_topic(body, 'wrench')}", group) for body in bodies
        }
        self._readers = {body: Reader(body, prefix) for body in bodies}
        self._newest: dict[str, Command] = {}
        """what has come for a body since the last sample."""
        self.prefix = prefix
        self._since: dict[str, float] = {}
        self._warned: dict[tuple[str, str], float] = {}
        self.limits = Limits()
        self.held: dict[str, tuple[Command, float]] = {}
        """the command that acts on each body and when it began to [s]."""
        self.received = 0
        """messages that have come."""
        self.applied = 0
        self.refused: Counter[str] = Counter()
        """number of messages without effect, by reason."""

    def apply(self, simulation: TakesWrench, t: float, timeout: float) -> None:
        """Give the newest command of each body to the simulation, and end those that are too old.

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
        """Take what has come: the newest of each body will act, the others are counted.

        To be called between samples, too, where they are rare: the middleware keeps inbox.DEPTH.
        """
        for body, inbox in self._inboxes.items():
            for data in inbox.take():
                self.received += 1
                self._note(body, self._readers[body].read(data))

    def _note(self, body: str, command: Command | Refusal) -> None:
        """Keep a command for the next sample, or count why it has no effect."""
        if isinstance(command, Command):
            command = beyond(command, self.limits) or command
        if isinstance(command, Refusal):
            self._count(body, command, f"{body}/wrench refused: {command.words}")
            return
        if body in self._newest:
            self.refused[OVERTAKEN] += 1
        self._newest[body] = command

    def overtake(self, bodies: Iterable[str]) -> None:
        """Drop what has come for these bodies and has not acted: what takes its place is newer."""
        self.collect()
        for body in bodies:
            if self._newest.pop(body, None) is not None:
                self.refused[OVERTAKEN] += 1

    def give(self, simulation: TakesWrench, body: str, command: Command, t: float) -> None:
        """Let a command act from simulated time t [s] on. RbSimError: the body takes none."""
        simulation.apply_wrench(body, command.force, command.torque, command.frame)
        self._since[body] = t
        self.held[body] = command, t
        self.applied += 1

    def forget(self) -> None:
        """Drop what has arrived and what is held (after a reset)."""
        self.overtake(self._inboxes)
        self._since.clear()
        self.held.clear()

    def close(self) -> None:
        """Take no more."""
        for inbox in self._inboxes.values():
            self._node.destroy_subscription(inbox.subscription)
        self._inboxes = {}

    def in_force(self) -> str:
        """The commands that act now, in words."""
        acting = [
            f"{body} force {_text(command.force)} N, torque {_text(command.torque)} N m"
            f" in {command.frame} axes since t = {since:.9g} s"
            for body, (command, since) in self.held.items()
        ]
        return "; ".join(acting) or "none"

    def _is_over(self, body: str, t: float, timeout: float) -> bool:
        since = self._since.get(body)
        # half a nanosecond: sample instants are stamped to the nanosecond
        return since is not None and timeout > 0 and t - since >= timeout - 0.5e-9

    def _count(self, body: str, refusal: Refusal, line: str) -> None:
        """Count; say the first of each kind, then one every REMINDER with the number so far."""
        self.refused[refusal.reason] += 1
        count, now = self.refused[refusal.reason], time.monotonic()
        # the words of a wrong frame name it; those of a limit change with every message
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
