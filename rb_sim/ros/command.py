"""Commanded wrenches: geometry_msgs/WrenchStamped on ~/BODY/wrench.

A command acts on the body at the body's origin O. Its numbers are in the axes of header.frame_id:
the world frame, or the frame named like the body (then the wrench turns with the body). It is
taken at a sample instant t_k, acts from t_k on, and is held until the next one or until
wrench_timeout simulated seconds have passed. The stamp is not used: what arrives late acts late,
and the bag says when (BODY/wrench_applied).
"""

from __future__ import annotations

import math
import time
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from typing import NamedTuple, Protocol

from geometry_msgs.msg import WrenchStamped
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy
from rclpy.subscription import Subscription

from rb_sim.sinks.topics import WORLD

Vector = tuple[float, float, float]
UNKNOWN_FRAME = "unknown frame"
NO_FRAME = "no frame"
OWN_FRAME = "frame of the node"
NOT_FINITE = "not finite"
TOO_STRONG = "beyond the limit"
OVERTAKEN = "overtaken"
EXPIRED = "expired"
REMINDER = 10.0
"""[s] of wall time between two lines on refusals of one kind."""
MOST_AT_ONCE = 1000
"""Messages taken at one sample; the middleware keeps the newest of the rest."""
MOST_KINDS = 100
"""Kinds of refusals that are told apart: who sends a new frame each time fills no memory."""
QOS = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST, depth=10, reliability=QoSReliabilityPolicy.RELIABLE
)


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
    ) -> None: ...


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


def read(message: WrenchStamped, body: str, prefix: str = "") -> Command | Refusal:
    """The command in a message for `body`, or why it is refused. prefix: of the node's frames."""
    frame_id = message.header.frame_id
    frame = {prefix + WORLD: "world", prefix + body: "body"}.get(frame_id)
    if frame is None:
        return wrong_frame(frame_id, body, prefix)
    force, torque = message.wrench.force, message.wrench.torque
    return checked(frame, (force.x, force.y, force.z), (torque.x, torque.y, torque.z))


def checked(frame: str, force: Vector, torque: Vector) -> Command | Refusal:
    """A command in "world" or "body" axes, if its numbers are finite."""
    if not all(map(math.isfinite, (*force, *torque))):
        return Refusal(NOT_FINITE, "a component is not a finite number")
    return Command(frame, force, torque)


def wrong_frame(frame_id: str, body: str, prefix: str) -> Refusal:
    """What is wrong with a frame that is neither the world's nor the body's."""
    world, own = repr(prefix + WORLD), repr(prefix + body)
    if not frame_id:
        return Refusal(NO_FRAME, f"frame_id is empty; must be {world} or {own}")
    if frame_id.endswith(("/origin", "/anchor")):
        words = f"frame_id {frame_id!r} is a frame that the node publishes; its axes are the"
        return Refusal(OWN_FRAME, f"{words} world's, so say {world}")
    return Refusal(UNKNOWN_FRAME, f"frame_id {frame_id!r} is neither {world} nor {own}")


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


class Polled(CallbackGroup):
    """A group that no executor runs: its subscriptions are polled by handle instead.

    Idle, an executor's spin_once costs some 100 us and take_message under 2 us, so a loop can
    afford the latter at every sample; and the two can never race for a message.
    """

    def can_execute(self, entity) -> bool:
        return False

    def beginning_execution(self, entity) -> bool:
        return False

    def ending_execution(self, entity) -> None:
        """Never begun."""


class HidesPolled:
    """A node whose executor is not shown the subscriptions that are polled.

    rclpy's events executor does not ask their group: it would take commands as well, and an older
    one could come behind a newer one.
    """

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """All others."""
        for subscription in super().subscriptions:  # type: ignore[misc]  # of rclpy's node
            if not isinstance(subscription.callback_group, Polled):
                yield subscription


class PollingNode(HidesPolled, Node):
    """A node as rclpy has it, but for that."""


class Inbox:
    """The messages of one subscription, in order of arrival."""

    def __init__(self, node: Node, topic: str, group: Polled) -> None:
        self._arrived: deque[WrenchStamped] = deque()
        # take_message is what rclpy's executors call, but not documented: without it the
        # subscription joins the default group and the node's own spinning fills the queue.
        self._by_handle = _can_take()

        def note(message: WrenchStamped) -> None:  # rclpy inspects the signature
            self._arrived.append(message)

        self.subscription = node.create_subscription(
            WrenchStamped,
            topic,
            note,
            QOS,
            callback_group=group if self._by_handle else None,
        )

    def take(self) -> list[WrenchStamped]:
        """What has arrived since the last call."""
        if self._by_handle:
            handle = self.subscription.handle
            with handle:
                for _ in range(MOST_AT_ONCE):
                    taken = handle.take_message(WrenchStamped, False)
                    if not taken:
                        break
                    self._arrived.append(taken[0])
        if not self._arrived:  # as it is at nearly every sample
            return []
        messages = list(self._arrived)
        self._arrived.clear()
        return messages


def _can_take() -> bool:
    from rclpy.impl.implementation_singleton import rclpy_implementation

    return hasattr(rclpy_implementation.Subscription, "take_message")


class Commands:
    """Takes commands for the commanded bodies and applies them at sample instants."""

    def __init__(self, node: Node, bodies: Sequence[str], prefix: str = "") -> None:
        group = Polled()
        self._node = node
        self._warn = node.get_logger().warning
        self._inboxes = {body: Inbox(node, f"~/{body}/wrench", group) for body in bodies}
        self.prefix = prefix
        self._since: dict[str, float] = {}
        self._told: dict[tuple[str, str], float] = {}
        self.limits = Limits()
        self.held: dict[str, tuple[Command, float]] = {}
        """the command that acts on each body and when it began to [s]."""
        self.applied = 0
        self.refused: Counter[str] = Counter()
        """number of messages without effect, by reason."""

    def apply(self, simulation: TakesWrench, t: float, timeout: float) -> None:
        """Give the newest command of each body to the simulation, and end those that are too old.

        t: simulated time from which it acts [s]. timeout: see wrench_timeout [s].
        """
        for body, inbox in self._inboxes.items():
            messages = inbox.take()
            command = self._newest(body, messages) if messages else None
            if command is not None:
                self.give(simulation, body, command, t)
            elif self._is_over(body, t, timeout):
                simulation.apply_wrench(body, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
                del self._since[body], self.held[body]
                words = f"no command for {timeout:g} s: the wrench is now zero"
                self._count(body, Refusal(EXPIRED, words), f"{body}: {words}")

    def give(self, simulation: TakesWrench, body: str, command: Command, t: float) -> None:
        """Let a command act from simulated time t [s] on. RbSimError: the body takes none."""
        simulation.apply_wrench(body, command.force, command.torque, command.frame)
        self._since[body] = t
        self.held[body] = command, t
        self.applied += 1

    def forget(self) -> None:
        """Drop what has arrived and what is held (after a reset)."""
        for inbox in self._inboxes.values():
            inbox.take()
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

    def _newest(self, body: str, messages: list[WrenchStamped]) -> Command | None:
        newest = None
        for message in messages:
            command = read(message, body, self.prefix)
            if isinstance(command, Command):
                command = beyond(command, self.limits) or command
            if isinstance(command, Refusal):
                self._count(body, command, f"{body}/wrench refused: {command.words}")
                continue
            if newest is not None:
                self.refused[OVERTAKEN] += 1
            newest = command
        return newest

    def _count(self, body: str, refusal: Refusal, line: str) -> None:
        """Count; say the first of each kind, then one every REMINDER with the number so far."""
        self.refused[refusal.reason] += 1
        count, now = self.refused[refusal.reason], time.monotonic()
        # the words of a wrong frame name it; those of a limit change with every message
        kind = refusal.words if refusal.reason in (UNKNOWN_FRAME, OWN_FRAME) else refusal.reason
        last = self._told.get((body, kind))
        if last is None and len(self._told) < MOST_KINDS:
            self._warn(line)
        elif last is not None and now - last >= REMINDER:
            self._warn(f"{line} ({count} {refusal.reason} so far)")
        else:
            return
        self._told[body, kind] = now


def _text(vector: Vector) -> str:
    return "(" + ", ".join(f"{value:g}" for value in vector) + ")"
