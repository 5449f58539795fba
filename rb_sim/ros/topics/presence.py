# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Latched state and description of the node, and the clock during start.

`~/state` is a std_msgs/String: compiling, paused, running, error. `~/description` is one with JSON:
scene, bodies, constraints, effects, rate, version. Both exist from the start, also during
compilation, when parameters are answered and /clock is zero.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from rb_sim.io.messages.topic_names import CLOCK
from rb_sim.io.messages.topics import description
from rb_sim.ros.serving import offer

if TYPE_CHECKING:
    from rb_sim.scene.schema import Scene

CLOCK_PERIOD = 0.5
"""[s] of wall-clock time between messages of a stopped clock."""
STARTING = 0.1
"""[s] between clock messages during start, when subscribers have not yet found the node."""


class Presence:
    """Publishes state and description of the node."""

    def __init__(self, node: Node, *, publish_clock: bool) -> None:
        self._node, self._publish_clock = node, publish_clock
        self._state_topic = offer(node, String, "~/state", 1, latched=True)
        self._description_topic = offer(node, String, "~/description", 1, latched=True)
        self._state = ""

    def tell(self, state: str) -> None:
        """Publish the state if it changed."""
        if state != self._state:
            self._state = state
            self._state_topic.publish(String(data=state))

    def describe(self, scene: Scene) -> None:
        """Publish the description of the scene."""
        self._description_topic.publish(String(data=description(scene)))

    @contextmanager
    def telling_time(
        self, do: Callable[[Callable[[], object]], object] = lambda act: act()
    ) -> Iterator[None]:
        """Publish a clock at zero from a thread inside the block, while this thread prepares a run.

        do: executes the function that destroys the publisher.
        """
        if not self._publish_clock:
            yield
            return
        clock, over = offer(self._node, Clock, CLOCK, 1), threading.Event()

        def show_clock() -> None:
            clock.publish(Clock())
            while not over.wait(STARTING):
                clock.publish(Clock())

        telling = threading.Thread(target=show_clock, daemon=True)
        telling.start()
        try:
            yield
        finally:
            over.set()
            telling.join()
            do(lambda: self._node.destroy_publisher(clock))


def twins(node: Node) -> int:
    """Number of other nodes with this node's full name."""
    own = (node.get_name(), node.get_namespace())
    return max(0, node.get_node_names_and_namespaces().count(own) - 1)


def is_alone(
    node: Node, since: float, discovery: float, over: Callable[[], bool] = lambda: False
) -> bool:
    """Whether no other node of this name is seen up to `discovery` seconds after `since`
    (time.monotonic), or until `over` returns True.
    """
    while twins(node) == 0:
        if over() or time.monotonic() >= since + discovery:
            return True
        time.sleep(0.05)
    return False
