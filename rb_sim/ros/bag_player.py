# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Player of a recorded bag: publishes its topics over DDS under the name of the recording node.

Trace of one sample: `Player.run` -> `Pacer.wait` -> `TopicSink.write`; ~/pause is served in
between.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown
from std_srvs.srv import SetBool

from rb_sim.base.errors import RbSimError
from rb_sim.ros.pacing import SLICE, Pacer
from rb_sim.ros.parameters import DISCOVERY
from rb_sim.ros.topics.presence import is_alone
from rb_sim.ros.topics.topic_sink import TopicSink
from rb_sim.simulation.signals import Interruption

if TYPE_CHECKING:
    from rb_sim.io.bag.reader import BagReader
    from rb_sim.mechanics.samples import SampleBlock

SERVE_PERIOD = 0.02
"""[s] of wall-clock time between checks for service requests while samples are due."""
LAST = 0.5
"""[s] of wall-clock time allowed for subscribers to receive the last messages of a topic."""
DEPTH = 10
"""Messages kept per topic for slow subscribers."""


@dataclass(frozen=True)
class Playing:
    """Playback: simulated seconds per wall-clock second (0: no pacing), repeat, start [s]."""

    rate: float = 1.0
    loop: bool = False
    start: float = 0.0


def publish(reader: BagReader, playing: Playing) -> int:
    """Play the bag until its end or a signal; returns 0.

    Raises RbSimError if a node of this name is running, or nothing is recorded after
    `playing.start`.
    """
    with Interruption() as stop:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        space, _, name = reader.namespace.rpartition("/")
        node = Node(name, namespace=space or "/")
        try:
            looked = f"looks {DISCOVERY:g} s for another node of this name, then plays"
            node.get_logger().info(looked)
            if not is_alone(node, time.monotonic(), DISCOVERY):
                raise RbSimError(
                    f"a node called {reader.namespace} runs already: end it, or use another "
                    "ROS_DOMAIN_ID"
                )
            stop.logging = True
            Player(node, reader, playing, stop).run()
            stop.status = 0
        finally:
            node.destroy_node()
            try_shutdown()
    return 0


class Player:
    """Publishes the samples of a bag when they are due; ~/pause (std_srvs/SetBool) pauses it."""

    def __init__(self, node: Node, reader: BagReader, playing: Playing, stop: Interruption) -> None:
        self.paused = False
        self._node, self._reader, self._playing, self._stop = node, reader, playing, stop
        self._pacer = Pacer(playing.rate)
        self._topics = TopicSink(node, DEPTH)
        self._topics.open(reader.scene, reader.layout)  # type: ignore[arg-type]  # all that it reads
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(node)
        self._served = 0.0
        self._t = playing.start
        node.create_service(SetBool, "~/pause", self._pause)

    def run(self) -> None:
        """Play the bag, once or until a signal. Raises RbSimError if there is nothing to play."""
        say = self._node.get_logger().info
        rate = self._playing.rate
        pace = f"{rate:g} x real time" if rate else "no pacing"
        say(f"plays {self._reader.path}: {self._reader.scene.name}, {pace}; ~/pause holds it")
        again = True
        while again and not self._stop.cause:
            if not self._once():
                at = f"at or after t = {self._playing.start:g} s"
                raise RbSimError(f"{self._reader.path}: nothing is recorded {at}")
            again = self._playing.loop
        if not self._stop.cause:
            self._topics.wait_until_received(LAST)
        self._topics.close()
        self._executor.shutdown()
        cause = self._stop.cause.name if self._stop.cause else "end of the bag"
        say(f"stopped at t = {self._t:.9g} s ({cause})")

    def _once(self) -> bool:
        """Play from the start to the end; False if there was no sample."""
        period, before, any_yet = 0.0, None, False
        for sample in self._samples():
            t = float(sample.t[0])
            if before is None or t <= before:  # the first sample, or the run was reset
                self._pacer.restart(t, self._playing.rate)
            else:
                period = t - before
            if not self._due(t, period):
                return True
            self._topics.write(sample)
            self._t, before, any_yet = t, t, True
        return any_yet

    def _samples(self) -> Iterator[SampleBlock]:
        """Yield the samples one by one, from the first at or after the start."""
        waiting = True
        for block in self._reader.blocks(1):
            waiting = waiting and not (len(block) and block.t[0] >= self._playing.start - 1e-9)
            if not waiting and len(block):
                yield block

    def _due(self, t: float, period: float) -> bool:
        """Wait until a sample is due. False after a signal."""
        while not self._stop.cause:
            self._serve(0.0)
            if self.paused:
                self._serve(SLICE)
                self._topics.repeat_clock()
            elif self._pacer.wait(t, period, self._between):
                return True
        return False

    def _between(self) -> bool:
        self._serve(0.0)
        return not (self.paused or self._stop.cause)

    def _serve(self, timeout: float) -> None:
        self._topics.latest.tick(stands=self.paused)
        now = time.monotonic()
        if timeout or now - self._served >= SERVE_PERIOD:
            self._served = now
            self._executor.spin_once(timeout_sec=timeout)

    def _pause(self, request: SetBool.Request, answer: SetBool.Response) -> SetBool.Response:
        self.paused = bool(request.data)
        self._pacer.restart(self._t, self._playing.rate)
        answer.success = True
        answer.message = f"{'paused' if self.paused else 'running'} at t = {self._t:.9g} s"
        return answer
