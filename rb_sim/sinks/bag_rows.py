"""From the messages of a bag to whole samples: what belongs to one instant is put together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from mcap.records import Channel

from rb_sim.engine.samples import ContactEvent, Input
from rb_sim.sinks.bag_batches import BagScan
from rb_sim.sinks.bag_damage import Missing
from rb_sim.sinks.bag_messages import Batch, Messages
from rb_sim.sinks.event_messages import read_event
from rb_sim.sinks.input_messages import InputTable
from rb_sim.sinks.topics import TopicTable

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleLayout


class Rows(NamedTuple):
    """n whole samples as the bytes of their messages."""

    number: np.ndarray
    """of each sample, increasing, shape (n,)."""
    data: dict[str, np.ndarray]
    """by topic as in TopicTable: uint8, shape (n, length)."""
    events: list[tuple[int, bytes]]
    """number of the sample that an event comes before, and its message."""
    inputs: list[tuple[int, Input]]
    """likewise, read; Input.index counts among these samples."""

    def read_events(self) -> tuple[ContactEvent, ...]:
        """The events. Raises ValueError for a message that is none."""
        return tuple(ContactEvent(*read_event(data)) for _, data in self.events)  # type: ignore[arg-type]


class RowReader:
    """Puts the messages of one sample together; they have the sample's number in common."""

    def __init__(self, table: TopicTable, namespace: str, layout: SampleLayout) -> None:
        self._topics = table.topics
        self._index = {topic.full_name(namespace): i for i, topic in enumerate(table.topics)}
        event = table.event_topic
        self._event_topic = "" if event is None else f"{namespace}/{event[0]}"
        self._waiting: list[list[tuple[np.ndarray, np.ndarray]]] = [[] for _ in table.topics]
        self._events: list[tuple[int, bytes]] = []
        self._inputs: list[tuple[int, Input]] = []
        self._input_table = InputTable(layout)
        topics = self._input_table.topics
        self._input_topics = {f"{namespace}/{name}": i for i, (name, _) in enumerate(topics)}

    def read(self, paths: list[Path], missing: list[Missing]) -> Iterator[Rows]:
        """The samples of the files; what could not be read comes into `missing`.

        Raises ValueError for a message that is not as recorded, SinkError as BagScan does.
        """
        for path in paths:
            scan = BagScan(path)
            for batch in scan.batches():
                rows = self._add(batch, scan.channels)
                if rows is not None:
                    yield rows
            if scan.missing.damages:
                missing.append(scan.missing)

    def _add(self, batch: Batch, channels: Mapping[int, Channel]) -> Rows | None:
        inputs: list[tuple[int, int, Input]] = []
        for number, messages in batch.items():
            topic = channels[number].topic
            if topic in self._index:
                i = self._index[topic]
                rows = messages.rows(self._topics[i].codec.length)
                self._waiting[i].append((messages.sequence, rows))
            elif topic == self._event_topic:
                numbers = messages.sequence.tolist()
                self._events += [(k, messages.data(i)) for i, k in enumerate(numbers)]
            elif topic in self._input_topics:
                inputs += self._read_inputs(self._input_topics[topic], messages)
        # a reset and commands at one instant stand in the file in their order
        self._inputs += [(k, given) for _, k, given in sorted(inputs, key=lambda entry: entry[0])]
        return self._whole()

    def _read_inputs(self, topic: int, messages: Messages) -> Iterator[tuple[int, int, Input]]:
        for i, (start, k) in enumerate(
            zip(messages.start.tolist(), messages.sequence.tolist(), strict=True)
        ):
            yield start, k, self._input_table.read(topic, messages.data(i), 0)

    def _whole(self) -> Rows | None:
        """The samples of which every message is there; the rest waits."""
        if not all(self._waiting):
            return None
        joined = [
            (np.concatenate([s for s, _ in parts]), np.concatenate([r for _, r in parts]))
            for parts in self._waiting
        ]
        if (common := _alike([number for number, _ in joined])) is not None:
            return self._cut(common, {
                topic.name: rows[: len(common)]
                for topic, (_, rows) in zip(self._topics, joined, strict=True)
            }, joined)  # fmt: skip
        common = reduce(np.intersect1d, [number for number, _ in joined])
        if not len(common):
            return None
        data = {}
        for topic, (number, rows) in zip(self._topics, joined, strict=True):
            number, first = np.unique(number, return_index=True)
            data[topic.name] = rows[first[np.isin(number, common, assume_unique=True)]]
        return self._cut(common, data, joined)

    def _cut(
        self,
        common: np.ndarray,
        data: dict[str, np.ndarray],
        joined: list[tuple[np.ndarray, np.ndarray]],
    ) -> Rows:
        """The samples `common`, and what came before them; what is later waits."""
        last = int(common[-1])
        self._waiting = [
            [(number[later], rows[later])] if (later := number > last).any() else []
            for number, rows in joined
        ]
        events = [(k, event) for k, event in self._events if k <= last]
        self._events = [(k, event) for k, event in self._events if k > last]
        inputs = [
            (k, given._replace(index=int(np.searchsorted(common, k))))
            for k, given in self._inputs
            if k <= last
        ]
        self._inputs = [(k, given) for k, given in self._inputs if k > last]
        return Rows(common, data, events, inputs)


def _alike(numbers: list[np.ndarray]) -> np.ndarray | None:
    """The numbers up to the least of the last ones, where all have the same and in order."""
    last = min(int(number[-1]) for number in numbers)
    first = numbers[0]
    count = int(np.count_nonzero(first <= last))
    if not count or not (first[1:] > first[:-1]).all():
        return None
    common = first[:count]
    same = all(
        np.array_equal(number[:count], common) and (number[count:] > last).all()
        for number in numbers
    )
    return common if same else None
