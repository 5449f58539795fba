# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Sinks of a running node: messages on topics, and the accuracy checks."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Collection, Sequence
from contextlib import ExitStack
from queue import Queue
from threading import Thread
from typing import TYPE_CHECKING, Any, NamedTuple

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSDurabilityPolicy
from rclpy.type_support import check_for_type_support

from rb_sim.accuracy.checks.check import Effort, effort_of
from rb_sim.accuracy.checks.check_list import CheckList
from rb_sim.io.messages.cdr import TF_MESSAGE
from rb_sim.io.messages.topic_names import CLOCK, CONTACT_EVENTS, TF
from rb_sim.io.messages.topics import SampleMessages, TopicTable
from rb_sim.mechanics.samples import block_of_rows, concatenate
from rb_sim.ros.build_interfaces import is_there
from rb_sim.ros.serving import message_class, offer, unusable
from rb_sim.ros.topics.presence import CLOCK_PERIOD

if TYPE_CHECKING:
    from rb_sim.base.errors import Finding
    from rb_sim.mechanics.samples import SampleBlock, SampleLayout, SampleRow
    from rb_sim.scene.schema import Scene
    from rb_sim.simulation.simulation import Simulation


EVENT_DEPTH = 10_000
"""Contact events kept for slow subscribers: enough for a cascade of impacts."""
ASK = 1000
"""Number of messages sent before a topic is checked again for subscribers."""

LOOK_PERIOD = 0.2
"""[s] of wall-clock time between checks for subscribers, each 1 to 2 us per topic."""

Send = Callable[[bytes], None]


class TopicSink:
    """Publishes each sample once.

    depth: messages kept for a slow subscriber (/clock: 1, events: at least EVENT_DEPTH). skip:
    topics to omit. prefix: of all frames.
    """

    def __init__(
        self, node: Node, depth: int, skip: Collection[str] = (), prefix: str = ""
    ) -> None:
        self._prefix = prefix
        self._skip = (*skip, *_unavailable(node))
        self._node = node
        self._depth = depth
        self._publishers: list[Publisher] = []
        self._send: list[Send] = []
        """send function of each topic of the table."""
        self._held = ExitStack()
        self._events: Publisher | None = None
        self._clock: tuple[Send, bytes] | None = None
        self._clock_sent = 0.0
        self._prepared: deque[tuple[SampleRow, SampleMessages]] = deque()
        self.latest = Latest()

    def wait_until_received(self, seconds: float) -> None:
        """Wait until reliable subscribers have all messages, at most `seconds` per topic."""
        for publisher in filter(None, (*self._publishers, self._events)):
            publisher.wait_for_all_acked(Duration(seconds=seconds))

    def repeat_clock(self) -> None:
        """Publish the last time again for new subscribers, twice a second."""
        now = time.monotonic()
        if self._clock is not None and now - self._clock_sent >= CLOCK_PERIOD:
            self._clock_sent = now
            send, data = self._clock
            send(data)

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Create the publishers. Raises RbSimError, SinkError."""
        self._table = TopicTable(scene, layout, skip=self._skip, prefix=self._prefix)
        topics = self._table.topics
        self._publishers = [self._publisher(topic.name, topic.ros_type) for topic in topics]
        self._send = [sender(publisher, self._held) for publisher in self._publishers]
        if self._table.event_topic is not None:
            self._events = self._publisher(*self._table.event_topic)
        self._table.warm(layout)
        self.latest.open(
            [
                publisher
                for publisher, topic in zip(self._publishers, topics, strict=True)
                if topic.name != CLOCK  # repeated by repeat_clock
            ]
        )

    def write(self, block: SampleBlock) -> None:
        """Publish every sample of the block, and the events before it."""
        for instant in self._table.messages(block):
            self._publish(instant)

    def prepare(self, rows: Sequence[SampleRow]) -> None:
        """Pack the messages of samples that will probably come next."""
        self._prepared = deque(zip(rows, self._table.messages_of_rows(rows), strict=True))

    def write_row(self, row: SampleRow) -> None:
        """Publish one sample given as a row: the same bytes as `write`, faster."""
        while self._prepared:
            one, instant = self._prepared.popleft()
            if one is row:
                self._publish(instant)
                return
        self._publish(self._table.messages_of_rows([row])[0])

    def _publish(self, instant: SampleMessages) -> None:
        for data in instant.events:
            self._events.publish(data)  # type: ignore[union-attr]  # set if there are contacts
        for send, data in zip(self._send, instant.messages, strict=True):
            send(data)
        self.latest.sent(instant.messages)
        if CLOCK not in self._skip:
            # the clock is last in the table
            self._clock = self._send[-1], instant.messages[-1]
            self._clock_sent = time.monotonic()

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Remove the publishers."""
        self.latest.close()
        self._held.close()
        for publisher in (*self._publishers, self._events):
            if publisher is not None:
                self._node.destroy_publisher(publisher)
        self._publishers, self._send, self._events, self._clock = [], [], None, None

    def _publisher(self, topic: str, ros_type: str) -> Publisher:
        name = topic if topic.startswith("/") else f"~/{topic}"
        depth = {CLOCK: 1, CONTACT_EVENTS: max(EVENT_DEPTH, self._depth)}.get(topic, self._depth)
        return offer(self._node, message_class(ros_type), name, depth)


class Latest:
    """Repeats the last message of each topic for new subscriptions while time stands.

    Most subscriptions are volatile (also those of tf), so that latching would not help them.
    Earlier subscribers receive that message twice.
    """

    def __init__(self) -> None:
        self._publishers: Sequence[Publisher] = []
        self._messages: Sequence[bytes] = []
        self._counts: list[int] = []
        """number of subscriptions of each topic at the last check."""
        self._new: set[int] = set()
        """topics with a subscription since their last message."""
        self._looked = 0.0

    def open(self, publishers: Sequence[Publisher]) -> None:
        """Set the topics."""
        self._publishers, self._counts = publishers, [0] * len(publishers)

    def sent(self, messages: Sequence[bytes]) -> None:
        """Store the published messages, one of each topic, in order."""
        self._messages = messages
        if self._new:
            self._new.clear()

    def tick(self, *, stands: bool) -> None:
        """Check for new subscriptions a few times a second; if no samples are due (`stands`), send
        them the last message."""
        if (now := time.monotonic()) - self._looked < LOOK_PERIOD:
            return
        self._looked = now
        for k, publisher in enumerate(self._publishers):
            count = publisher.get_subscription_count()
            if count > self._counts[k]:
                self._new.add(k)
            self._counts[k] = count
        if stands and self._messages:
            for k in self._new:
                self._publishers[k].publish(self._messages[k])
            self._new.clear()

    def close(self) -> None:
        """Forget the topics, whose publishers are removed."""
        self._publishers, self._messages = [], []
        self._new.clear()


def sender(publisher: Publisher, held: ExitStack) -> Send:
    """A function that sends serialized messages, in half the time of Publisher.publish; sends
    nothing without subscribers.

    Publisher.publish enters the handle and checks the type each time. Here `held` keeps the handle
    until it is closed, which must be before the publisher is destroyed.
    """
    handle = publisher.handle
    held.enter_context(handle)
    # these two are used by the publisher's own methods but not documented
    send = getattr(handle, "publish_raw", publisher.publish)
    listeners = getattr(handle, "get_subscription_count", publisher.get_subscription_count)
    if publisher.qos_profile.durability != QoSDurabilityPolicy.VOLATILE:
        return send  # late subscribers get messages sent before
    unasked = 0

    def send_to_listeners(data: bytes) -> None:
        nonlocal unasked
        if unasked:
            unasked -= 1
        elif listeners():
            unasked = ASK
        else:
            return
        send(data)

    return send_to_listeners


def _unavailable(node: Node) -> tuple[str, ...]:
    """/tf if tf2_msgs is not installed (it comes with ROS, but is not on PyPI), or cannot be
    loaded, which is logged."""
    package = TF_MESSAGE.partition("/")[0]
    if not is_there(package):
        return (TF,)
    try:
        check_for_type_support(message_class(TF_MESSAGE))
    except Exception as error:
        node.get_logger().warning(f"no topic {TF} (the bag has it): {unusable(package, error)}")
        return (TF,)
    return ()


# Accuracy checks of a running node, the same as in a run of the command line, in batches.


BATCH = 1000
"""Number of samples per batch: about 3 ms of work; single samples would cost far more."""
MOST = 8
"""Maximum number of queued batches; beyond it the loop waits."""
PART = 125
"""Number of samples that the thread concatenates at once."""
WAY = 1e-3
"""[s] that the thread sleeps between parts while no batch is queued: it may have a real-time
priority, and subscribers have none."""


class Batch(NamedTuple):
    """Samples, the checks for them, and the effort up to their end."""

    check_list: CheckList
    samples: list[SampleRow]
    effort: Effort


class CheckSink:
    """Collects samples and passes them to the checks in batches.

    simulation: its steps and rejections count as effort, including prefetched samples. From `open`
    to `close` a thread runs the checks, so that samples are not delayed.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._waiting: list[SampleRow] = []
        self._check_list = self._new()
        self._batches: Queue[Batch | None] = Queue(MOST)
        self._thread: Thread | None = None
        self._error: BaseException | None = None

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Start the thread."""
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def write_row(self, row: SampleRow) -> None:
        """Collect the sample; a full batch is checked."""
        self._waiting.append(row)
        if len(self._waiting) >= BATCH:
            self._pass_on()

    def look(self) -> tuple[Finding, ...]:
        """Findings since the start or the last reset, as far as the thread has come; also submits
        the collected samples."""
        self._pass_on()
        if self._error is not None:
            raise self._error
        return self._check_list.findings

    def reset(self) -> None:
        """Discard samples and findings: after a reset they belong to another run."""
        self._waiting = []
        self._check_list = self._new()

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Finish all checks and end the thread."""
        if self._thread is not None:
            self._batches.put(None)
            self._thread.join()
            self._thread = None

    def _new(self) -> CheckList:
        of = self._simulation
        return CheckList(of.scene, of.layout, of.compiled)

    def _pass_on(self) -> None:
        """Check the collected samples in the thread, or at once without a thread."""
        if not self._waiting:
            return
        rows, self._waiting = self._waiting, []
        batch = Batch(self._check_list, rows, effort_of(self._simulation))
        if self._thread is None:
            self._add(batch)
        else:
            self._batches.put(batch)

    def _add(self, batch: Batch) -> None:
        batch.check_list.add(self._block(batch.samples), batch.effort)
        self._give_way()

    def _block(self, rows: list[SampleRow]) -> SampleBlock:
        """The rows as one block."""
        parts = []
        for first in range(0, len(rows), PART):
            parts.append(block_of_rows(rows[first : first + PART], self._simulation.layout))
            self._give_way()
        return parts[0] if len(parts) == 1 else concatenate(parts, self._simulation.layout)

    def _give_way(self) -> None:
        if self._thread is not None and self._batches.empty():
            time.sleep(WAY)

    def _run(self) -> None:
        while (batch := self._batches.get()) is not None:
            if self._error is None:
                try:
                    self._add(batch)
                except BaseException as error:  # raised by the next `look`
                    self._error = error
