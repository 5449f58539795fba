"""Commanded wrenches: geometry_msgs/WrenchStamped on ~/BODY/wrench.

A command acts on the body at the body's origin O. Its numbers are in the axes of header.frame_id:
the world frame, or the frame named like the body (then the wrench turns with the body). It is
taken at a sample instant t_k, acts from t_k on, and is held until the next one or until
wrench_timeout simulated seconds have passed. The stamp is not used: what arrives late acts late,
and the bag says when (BODY/wrench_applied).
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Sequence
from typing import NamedTuple, Protocol

from geometry_msgs.msg import WrenchStamped
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy

from rb_sim.sinks.topics import WORLD

Vector = tuple[float, float, float]
UNKNOWN_FRAME = "unknown frame"
NOT_FINITE = "not finite"
OVERTAKEN = "overtaken"
EXPIRED = "expired"
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


def read(message: WrenchStamped, body: str) -> Command | str:
    """The command in a message, or the reason why it is refused."""
    frames = {WORLD: "world", body: "body"}
    frame = frames.get(message.header.frame_id)
    if frame is None:
        return UNKNOWN_FRAME
    force, torque = message.wrench.force, message.wrench.torque
    numbers = (force.x, force.y, force.z, torque.x, torque.y, torque.z)
    if not all(map(math.isfinite, numbers)):
        return NOT_FINITE
    return Command(frame, numbers[:3], numbers[3:])


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
        while self._by_handle and (message := self._take_one()) is not None:
            self._arrived.append(message)
        messages = list(self._arrived)
        self._arrived.clear()
        return messages

    def _take_one(self) -> WrenchStamped | None:
        handle = self.subscription.handle
        with handle:
            taken = handle.take_message(WrenchStamped, False)
        return taken[0] if taken else None


def _can_take() -> bool:
    from rclpy.impl.implementation_singleton import rclpy_implementation

    return hasattr(rclpy_implementation.Subscription, "take_message")


class Commands:
    """Takes commands for the commanded bodies and applies them at sample instants."""

    def __init__(self, node: Node, bodies: Sequence[str]) -> None:
        group = Polled()
        self._warn = node.get_logger().warning
        self._inboxes = {body: Inbox(node, f"~/{body}/wrench", group) for body in bodies}
        self._since: dict[str, float] = {}
        self.applied = 0
        self.refused: Counter[str] = Counter()
        """number of messages without effect, by reason."""

    def apply(self, simulation: TakesWrench, t: float, timeout: float) -> None:
        """Give the newest command of each body to the simulation, and end those that are too old.

        t: simulated time from which it acts [s]. timeout: see wrench_timeout [s].
        """
        for body, inbox in self._inboxes.items():
            command = self._newest(body, inbox.take())
            if command is not None:
                simulation.apply_wrench(body, command.force, command.torque, command.frame)
                self._since[body] = t
                self.applied += 1
            elif self._is_over(body, t, timeout):
                simulation.apply_wrench(body, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
                del self._since[body]
                self._count(
                    EXPIRED, f"{body}: no command for {timeout:g} s: the wrench is now zero"
                )

    def forget(self) -> None:
        """Drop what has arrived and what is held (after a reset)."""
        for inbox in self._inboxes.values():
            inbox.take()
        self._since.clear()

    def _is_over(self, body: str, t: float, timeout: float) -> bool:
        since = self._since.get(body)
        # half a nanosecond: sample instants are stamped to the nanosecond
        return since is not None and timeout > 0 and t - since >= timeout - 0.5e-9

    def _newest(self, body: str, messages: list[WrenchStamped]) -> Command | None:
        newest = None
        for message in messages:
            command = read(message, body)
            if isinstance(command, str):
                self._count(command, self._refusal(command, body, message))
                continue
            if newest is not None:
                self.refused[OVERTAKEN] += 1
            newest = command
        return newest

    def _refusal(self, reason: str, body: str, message: WrenchStamped) -> str:
        if reason == UNKNOWN_FRAME:
            return (
                f"{body}/wrench refused: frame_id {message.header.frame_id!r} is neither"
                f" {WORLD!r} nor {body!r}"
            )
        return f"{body}/wrench refused: a component is not a finite number"

    def _count(self, reason: str, line: str) -> None:
        """Count, and say so at the 1st, 10th, 100th ... time."""
        self.refused[reason] += 1
        count = self.refused[reason]
        if count == 10 ** (len(str(count)) - 1):
            self._warn(f"{line} ({count} so far)" if count > 1 else line)
