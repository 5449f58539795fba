# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Where commands arrive: subscriptions that the loop polls itself, as bytes.

A message as bytes takes a ninth of the time that an object of rclpy does (2 us of 18): a controller
may send far more commands than there are samples.
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
"""Messages kept until they are taken, the newest ones, and taken at once."""


class Polled(CallbackGroup):
    """A group that no executor runs: its subscriptions are polled by handle instead.

    Idle, an executor's spin_once costs some 100 us and take_message under 2 us, so a loop can
    afford the latter at every sample; and the two can never race for a message.
    """

    def can_execute(self, entity) -> bool:
        """False: no executor takes from this group."""
        return False

    def beginning_execution(self, entity) -> bool:
        """False: no executor takes from this group."""
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
    """The messages of one subscription, serialized, in order of arrival."""

    def __init__(self, node: Node, topic: str, group: Polled) -> None:
        self._arrived: deque[bytes] = deque()
        # take_message is what rclpy's executors call, but not documented: without it the
        # subscription joins the default group and the node's own spinning fills the queue.
        self._by_handle = _can_take()

        def note(message: bytes) -> None:  # rclpy inspects the signature
            self._arrived.append(message)

        own_group = group if self._by_handle else None
        self.subscription = accept(node, WrenchStamped, topic, note, DEPTH, own_group)

    def take(self) -> list[bytes]:
        """What has arrived since the last call."""
        if self._by_handle:
            handle = self.subscription.handle
            with handle:
                for _ in range(DEPTH):
                    taken = handle.take_message(WrenchStamped, True)
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
