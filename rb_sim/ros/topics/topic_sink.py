# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The sinks of a running node: messages on topics, and the accuracy checks."""

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

from rb_sim.checks.check import Effort, effort_of
from rb_sim.checks.check_list import CheckList
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
"""Events of contacts that are kept for a slow subscriber: a cascade of impacts is not cut short."""
ASK = 1000
"""Messages that somebody listened to, after which a topic is asked again whether anybody does."""

LOOK_PERIOD = 0.2
"""[s] of wall time between looks at who listens: a look takes a microsecond or two a topic."""

Send = Callable[[bytes], None]


class TopicSink:
    """Publishes each sample once.

    depth: messages kept for a slow subscriber (/clock: 1, events: EVENT_DEPTH at least).
    skip: topics that are not wanted. prefix: of all frames.
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
        """for each topic of the table."""
        self._held = ExitStack()
        self._events: Publisher | None = None
        self._clock: tuple[Send, bytes] | None = None
        self._clock_sent = 0.0
        self._prepared: deque[tuple[SampleRow, SampleMessages]] = deque()
        self.latest = Latest()

    def wait_until_received(self, seconds: float) -> None:
        """Until the reliable subscribers have all that was sent, but at most so long for each."""
        for publisher in filter(None, (*self._publishers, self._events)):
            publisher.wait_for_all_acked(Duration(seconds=seconds))

    def repeat_clock(self) -> None:
        """Publish the last time again, for who has come since, twice a second."""
        now = time.monotonic()
        if self._clock is not None and now - self._clock_sent >= CLOCK_PERIOD:
            self._clock_sent = now
            send, data = self._clock
            send(data)

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Create the publishers."""
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
                if topic.name != CLOCK  # it is repeated for all
            ]
        )

    def write(self, block: SampleBlock) -> None:
        """Publish every sample of the block, and the events before it."""
        for instant in self._table.messages(block):
            self._publish(instant)

    def prepare(self, rows: Sequence[SampleRow]) -> None:
        """Pack the messages of samples that may come next, together."""
        self._prepared = deque(zip(rows, self._table.messages_of_rows(rows), strict=True))

    def write_row(self, row: SampleRow) -> None:
        """Publish one sample: the same bytes, without arrays by name in between."""
        while self._prepared:
            one, instant = self._prepared.popleft()
            if one is row:
                self._publish(instant)
                return
        self._publish(self._table.messages_of_rows([row])[0])

    def _publish(self, instant: SampleMessages) -> None:
        for data in instant.events:
            self._events.publish(data)  # type: ignore[union-attr]  # events are of contacts
        for send, data in zip(self._send, instant.messages, strict=True):
            send(data)
        self.latest.sent(instant.messages)
        if CLOCK not in self._skip:
            # the table ends with the clock
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
    """The last message of each topic, once more where a subscription begins while none comes.

    Most subscriptions are volatile, those of tf among them: a latched topic would not help them.
    Who was there before gets that message a second time.
    """

    def __init__(self) -> None:
        self._publishers: Sequence[Publisher] = []
        self._messages: Sequence[bytes] = []
        self._counts: list[int] = []
        """of subscriptions, of each topic at the last look."""
        self._new: set[int] = set()
        """topics with a subscription that has come since their last message, as far as seen."""
        self._looked = 0.0

    def open(self, publishers: Sequence[Publisher]) -> None:
        """Take charge of these topics."""
        self._publishers, self._counts = publishers, [0] * len(publishers)

    def sent(self, messages: Sequence[bytes]) -> None:
        """Remember what was published, one message of each topic in their order."""
        self._messages = messages
        if self._new:
            self._new.clear()

    def tick(self, *, stands: bool) -> None:
        """See who has come, a few times a second; where no sample is due they get the last one."""
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
        """Forget the topics: their publishers are removed."""
        self._publishers, self._messages = [], []
        self._new.clear()


def sender(publisher: Publisher, held: ExitStack) -> Send:
    """Sends serialized messages, in half the time of Publisher.publish; nothing to nobody.

    That takes hold of the publisher's handle and looks at the message's type each time. Here `held`
    keeps the handle until it is closed, which must be before the publisher is destroyed.
    """
    handle = publisher.handle
    held.enter_context(handle)
    # these two are what the publisher's own methods call, but not documented
    send = getattr(handle, "publish_raw", publisher.publish)
    listeners = getattr(handle, "get_subscription_count", publisher.get_subscription_count)
    if publisher.qos_profile.durability != QoSDurabilityPolicy.VOLATILE:
        return send  # who comes late gets what was sent to nobody
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
    """/tf where tf2_msgs is not installed (it is with ROS, but not on PyPI), or cannot be loaded,
    which is said."""
    package = TF_MESSAGE.partition("/")[0]
    if not is_there(package):
        return (TF,)
    try:
        check_for_type_support(message_class(TF_MESSAGE))
    except Exception as error:
        node.get_logger().warning(f"no topic {TF} (the bag has it): {unusable(package, error)}")
        return (TF,)
    return ()


# What a running node is watched for: the same as a run of the command line, batch by batch.


BATCH = 1000
"""Samples that wait at most to be looked at: some 3 ms of work; one by one would cost far more."""
MOST = 8
"""Batches that wait at most; the loop waits then."""
PART = 125
"""Samples that the thread puts together in one go."""
WAY = 1e-3
"""[s] that the thread sleeps between two goes while no batch waits: it may have a real-time
priority, and who listens to the node has none."""


class Batch(NamedTuple):
    """Samples, who is to look at them, and what they cost up to their end."""

    check_list: CheckList
    samples: list[SampleRow] | SampleBlock
    effort: Effort


class CheckSink:
    """Keeps samples for a while and hands them to the checks together.

    simulation: whose steps and rejections count as effort, samples computed ahead included.
    From `open` to `close` a thread looks at them, since a sample is not to wait for that.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._waiting: list[SampleRow] = []
        self._check_list = self._new()
        self._batches: Queue[Batch | None] = Queue(MOST)
        self._thread: Thread | None = None
        self._error: BaseException | None = None

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Begin to look, in a thread."""
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def write(self, block: SampleBlock) -> None:
        """Look at the block, and at what waits."""
        self._pass_on()
        self._hand_over(block)

    def write_row(self, row: SampleRow) -> None:
        """Keep the sample; have what waits looked at once it is enough."""
        self._waiting.append(row)
        if len(self._waiting) >= BATCH:
            self._pass_on()

    def look(self) -> tuple[Finding, ...]:
        """Have looked at what waits; what has passed its bound since the start or the last reset,
        as far as the thread has come, if there is one."""
        self._pass_on()
        if self._error is not None:
            raise self._error
        return self._check_list.findings

    def reset(self) -> None:
        """Begin anew: from the initial state on balances and findings are another run's."""
        self._waiting = []
        self._check_list = self._new()

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """End the thread, when it has looked at everything."""
        if self._thread is not None:
            self._batches.put(None)
            self._thread.join()
            self._thread = None

    def _new(self) -> CheckList:
        of = self._simulation
        return CheckList(of.scene, of.layout, of.compiled)

    def _pass_on(self) -> None:
        """Have looked at what waits."""
        if self._waiting:
            rows, self._waiting = self._waiting, []
            self._hand_over(rows)

    def _hand_over(self, samples: list[SampleRow] | SampleBlock) -> None:
        """Have the samples looked at: by the thread, or at once."""
        batch = Batch(self._check_list, samples, effort_of(self._simulation))
        if self._thread is None:
            self._add(batch)
        else:
            self._batches.put(batch)

    def _add(self, batch: Batch) -> None:
        samples = batch.samples
        if isinstance(samples, list):
            samples = self._block(samples)
        batch.check_list.add(samples, batch.effort)
        self._give_way()

    def _block(self, rows: list[SampleRow]) -> SampleBlock:
        """One block from the samples."""
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
                except BaseException as error:  # raised where somebody looks next
                    self._error = error
