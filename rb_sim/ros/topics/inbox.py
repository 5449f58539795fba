# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Subscriptions for commands that the loop polls itself, as bytes.

Taking a message as bytes takes a ninth of the time of an rclpy object (2 us instead of 18): a
controller may send far more commands than there are samples.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

from geometry_msgs.msg import WrenchStamped
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.subscription import Subscription

from rb_sim.ros.serving import accept

DEPTH = 1000
"""Number of newest messages kept until they are taken, and taken at once."""


class Polled(CallbackGroup):
    """A callback group that no executor runs: its subscriptions are polled by handle instead.

    Without messages an executor's spin_once costs some 100 us and take_message under 2 us, so that
    a loop can afford the latter at every sample; and the two cannot compete for a message.
    """

    def can_execute(self, entity) -> bool:
        """False: no executor takes from this group."""
        return False

    def beginning_execution(self, entity) -> bool:
        """False: no executor takes from this group."""
        return False

    def ending_execution(self, entity) -> None:
        """Never called."""


class HidesPolled:
    """A node that hides its polled subscriptions from its executor.

    rclpy's events executor ignores their callback group: it would take commands too, and could
    deliver an older one after a newer one.
    """

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """The subscriptions that are not polled."""
        for subscription in super().subscriptions:  # type: ignore[misc]  # of rclpy's node
            if not isinstance(subscription.callback_group, Polled):
                yield subscription


class PollingNode(HidesPolled, Node):
    """An rclpy node that hides polled subscriptions."""


class Inbox:
    """The messages of one subscription, serialized, in order of arrival."""

    def __init__(self, node: Node, topic: str, group: Polled) -> None:
        self._arrived: deque[bytes] = deque()
        # take_message is used by rclpy's executors but not documented: if it is missing, the
        # subscription joins the default group, and the node's executor fills the queue
        self._by_handle = _can_take()

        def note(message: bytes) -> None:  # rclpy inspects the signature
            self._arrived.append(message)

        own_group = group if self._by_handle else None
        self.subscription = accept(node, WrenchStamped, topic, note, DEPTH, own_group)

    def take(self) -> list[bytes]:
        """Messages since the last call."""
        if self._by_handle:
            handle = self.subscription.handle
            with handle:
                for _ in range(DEPTH):
                    taken = handle.take_message(WrenchStamped, True)
                    if not taken:
                        break
                    self._arrived.append(taken[0])
        if not self._arrived:  # the usual case
            return []
        messages = list(self._arrived)
        self._arrived.clear()
        return messages


def _can_take() -> bool:
    from rclpy.impl.implementation_singleton import rclpy_implementation

    return hasattr(rclpy_implementation.Subscription, "take_message")
