# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What a user of the node does: subscribe, command, call services, set parameters."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool, Trigger

NAME = "/rb_sim"
TIMEOUT = 60.0
"""[s]: of three groups of tests side by side on two cores each process gets little."""


class Client:
    """A node of the test process."""

    def __init__(self, context: Context) -> None:
        self.node = Node(f"client_{time.monotonic_ns()}", context=context)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self.node)
        self._publishers: dict[str, Any] = {}
        self._clients: dict[tuple[type, str], Any] = {}

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()

    def until(self, condition: Callable[[], Any], what: str, timeout: float = TIMEOUT) -> None:
        """Spin until the condition holds."""
        end = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < end, f"no {what} within {timeout:g} s"
            self._executor.spin_once(timeout_sec=0.05)

    def spin_once(self) -> None:
        """Receive what is there, if anything."""
        self._executor.spin_once(timeout_sec=0.001)

    def spin(self, seconds: float) -> None:
        """Receive for so long."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.02)

    def listen(self, kind: type, topic: str, *, raw: bool = False, depth: int = 1000) -> list[Any]:
        """A list that fills with the messages; returns when the publisher is matched."""
        messages: list[Any] = []
        name = topic if topic.startswith("/") else f"{NAME}/{topic}"
        self.node.create_subscription(
            kind, name, lambda message: messages.append(message), depth, raw=raw
        )
        self.until(lambda: self.node.count_publishers(name), f"publisher of {name}")
        return messages

    def send(
        self,
        force: Sequence[float] = (0.0, 0.0, 0.0),
        torque: Sequence[float] = (0.0, 0.0, 0.0),
        frame: str = "world",
        body: str = "ball",
    ) -> None:
        """Command a wrench; returns when the node has it."""
        publisher = self.commander(body)
        message = WrenchStamped()
        message.header.frame_id = frame
        for vector, numbers in ((message.wrench.force, force), (message.wrench.torque, torque)):
            vector.x, vector.y, vector.z = map(float, numbers)
        publisher.publish(message)
        assert publisher.wait_for_all_acked(Duration(seconds=TIMEOUT))

    def commander(self, body: str = "ball", depth: int = 100) -> Any:
        """The matched publisher of a body's commands. depth: of those that the node has not yet."""
        topic = f"{NAME}/{body}/wrench"
        if topic not in self._publishers:
            self._publishers[topic] = self.node.create_publisher(WrenchStamped, topic, depth)
        publisher = self._publishers[topic]
        self.until(publisher.get_subscription_count, f"subscription of {topic}")
        return publisher

    def call(self, kind: type, name: str, **fields: Any) -> Any:
        """Call a service of the node; the answer."""
        future = self.ask(kind, name, **fields)
        self.until(future.done, f"answer of {name}")
        return future.result()

    def ask(self, kind: type, name: str, **fields: Any) -> Any:
        """Call a service of the node; the future of its answer."""
        if (kind, name) not in self._clients:
            self._clients[kind, name] = self.service(kind, name)
        return self._clients[kind, name].call_async(kind.Request(**fields))

    def service(self, kind: type, name: str, depth: int = 10) -> Any:
        """A new client of a service of the node, which the node knows. depth: of its queues."""
        service = self.node.create_client(
            kind, f"{NAME}/{name}", qos_profile=QoSProfile(depth=depth)
        )
        self.until(service.service_is_ready, name)
        self._until_known()
        return service

    def _until_known(self) -> None:
        """Wait until the node knows all clients made so far.

        ROS drops an answer if the service does not discover its client within 0.1 s of the call, as
        on a busy machine. Clients are announced in the order in which they were made: when a later
        one gets an answer, the node knows the earlier ones. Its own call may be repeated.
        A node in the middle of a long request answers after it.
        """
        later = self.node.create_client(GetParameters, f"{NAME}/get_parameters")
        self.until(later.service_is_ready, "get_parameters")
        futures: dict[int, Any] = {}

        def answered() -> bool:
            second = int(time.monotonic())
            if second not in futures:
                futures[second] = later.call_async(GetParameters.Request())
            return any(future.done() for future in futures.values())

        self.until(answered, "answer of get_parameters")
        self.node.destroy_client(later)

    def trigger(self, name: str) -> Trigger.Response:
        """Call ~/reset or ~/step."""
        return self.call(Trigger, name)

    def until_it_stands(self, clocks: list[Clock]) -> float:
        """Receive until the last time comes again: the node stands, and this is where [s].

        An answer may be here before samples that were sent before it.
        """
        reported = len(clocks)
        self.until(
            lambda: len(clocks) >= reported + 2 and clocks[-1] == clocks[-2], "a clock that stands"
        )
        return seconds(clocks[-1].clock)

    def step_for(self, count: int, *lists: list[Any]) -> None:
        """Step until each list has so many messages, and the last of each is of one instant.

        What a paused node sends once more, for a new subscription, is taken out of the lists.
        """

        def shortest() -> int:
            for messages in lists:
                stamps = [None, *map(stamp_of, messages)]
                messages[:] = [
                    message
                    for message, before, stamp in zip(messages, stamps, stamps[1:], strict=False)
                    if stamp != before
                ]
            return min(map(len, lists))

        self.step_until(lambda: shortest() >= count)
        self.until(
            lambda: shortest() and len({stamp_of(messages[-1]) for messages in lists}) == 1,
            "the last",
        )

    def step_until(self, condition: Callable[[], Any], limit: int = 500) -> None:
        """Step until it holds (a subscription that is still being matched gets nothing)."""
        for _ in range(limit):
            assert self.trigger("step").success
            self.spin(0.02)
            if condition():
                return
        raise AssertionError(f"not within {limit} steps")

    def pause(self, paused: bool = True) -> SetBool.Response:
        """Call ~/pause."""
        return self.call(SetBool, "pause", data=paused)

    def set(self, name: str, value: Any) -> Any:
        """Set a parameter; the result with .successful and .reason."""
        parameter = Parameter(name, value=value).to_parameter_msg()
        return self.call(SetParameters, "set_parameters", parameters=[parameter]).results[0]

    def describe(self, name: str) -> Any:
        """Descriptor of a parameter."""
        return self.call(DescribeParameters, "describe_parameters", names=[name]).descriptors[0]

    def diagnostics(self, condition: Callable[[dict[str, str]], Any], what: str) -> dict[str, str]:
        """The first report whose values satisfy the condition; level and message included."""
        found: list[dict[str, str]] = []

        def note(array: DiagnosticArray) -> None:
            for status in array.status:
                values = {pair.key: pair.value for pair in status.values}
                values |= {"level": str(ord(status.level)), "message": status.message}
                if status.name.startswith(NAME.lstrip("/")) and condition(values):
                    found.append(values)

        subscription = self.node.create_subscription(DiagnosticArray, "/diagnostics", note, 10)
        self.until(lambda: found, what)
        self.node.destroy_subscription(subscription)
        return found[0]


def stamp_of(message: Any) -> float:
    """Of the message's header, or of the first one in it [s]."""
    stamped = message if hasattr(message, "header") else message.transforms[0]
    return seconds(stamped.header.stamp)


def seconds(stamp: Any) -> float:
    """A stamp as a number."""
    return stamp.sec + stamp.nanosec * 1e-9


def vector(of: Any) -> tuple[float, float, float]:
    """The components of a Vector3 or Point."""
    return (of.x, of.y, of.z)
