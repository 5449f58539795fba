# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Reader of bags recorded by rb_sim: samples, and the scene as run or with changed values.

Poses and twists of the body origin are converted to the centre of mass; momenta are computed from
the state. Numbers agree with the recorded run to rounding, times to half a nanosecond.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from mcap.records import Channel

from rb_sim.base.errors import SceneError, SinkError
from rb_sim.io.bag.bag_sink import READABLE, RECORD, REQUIRED, SUMMARY_RECORD, checksum, summary_in
from rb_sim.io.bag.batches import Batch, Messages, unpacked
from rb_sim.io.bag.checked_records import Missing
from rb_sim.io.bag.folder import (
    Scan,
    bag_paths,
    is_complete,
    metadata_of,
    scan_of,
    unlisted,
)
from rb_sim.io.messages.cdr import NANO
from rb_sim.io.messages.topic_names import (
    CONTACT_WORK,
    DESCRIPTION,
    TF,
    body_topic,
    reaction_topic,
    state_topic,
)
from rb_sim.io.messages.topics import InputTable, Topic, TopicTable, read_event, record_in
from rb_sim.io.sink import split_at
from rb_sim.mechanics.samples import (
    Array,
    ContactEvent,
    Input,
    SampleBlock,
    SampleLayout,
    centers_of_mass,
    concatenate,
)
from rb_sim.numerics.rotations import conjugate, cross, rotate
from rb_sim.scene import yaml_reader
from rb_sim.scene.load import scene_from_mapping
from rb_sim.scene.schema import Scene
from rb_sim.scene.shapes import SHAPES
from rb_sim.scene.values import with_values

# Assembly of the messages of each sample.


class Rows(NamedTuple):
    """n complete samples as the bytes of their messages."""

    number: np.ndarray
    """number of each sample, increasing, shape (n,)."""
    data: dict[str, np.ndarray]
    """uint8, shape (n, length), by topic of the TopicTable."""
    events: list[tuple[int, bytes]]
    """number of the sample that an event precedes, and its message."""
    inputs: list[tuple[int, Input]]
    """number of the sample that an input precedes, and the input; Input.index counts here."""

    def read_events(self) -> tuple[ContactEvent, ...]:
        """The events. Raises ValueError if a message is not an event."""
        return tuple(ContactEvent(*read_event(data)) for _, data in self.events)  # type: ignore[arg-type]


class RowReader:
    """Assembles the messages of each sample, which share its number as sequence number.

    converted: the bag was rewritten by a program that keeps only messages, in order. Then the k-th
    message of each topic belongs to sample k, and an event or input to the sample that follows it.
    """

    def __init__(
        self, table: TopicTable, namespace: str, layout: SampleLayout, *, converted: bool = False
    ) -> None:
        self._converted = converted
        self._counts: Counter[str] = Counter()
        """number of messages of each topic so far, for a converted bag."""
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
        """Yield the samples of the files; unreadable parts are appended to `missing`.

        Raises ValueError for a message that is not as recorded, SinkError as `scan_of` does.
        """
        for path in paths:
            scan = scan_of(path)
            for batch in scan.batches():
                if self._converted:
                    batch = self._numbered(batch, scan)
                rows = self._add(batch, scan.channels)
                if rows is not None:
                    yield rows
            if scan.missing.damages:
                missing.append(scan.missing)

    def _numbered(self, batch: Batch, scan: Scan) -> Batch:
        """The messages with the numbers of their samples as sequence numbers."""
        topics = {number: scan.channels[number].topic for number in batch}
        clock = next(name for name, i in self._index.items() if i == len(self._topics) - 1)
        ends = [messages.start for number, messages in batch.items() if topics[number] == clock]
        ticks = np.sort(np.concatenate(ends)) if ends else np.empty(0, dtype=np.int64)
        before = self._counts[clock]
        numbered: Batch = {}
        for number, messages in batch.items():
            topic, n = topics[number], len(messages.start)
            of = np.searchsorted(ticks, messages.start) + before
            if topic in self._index:
                of = self._counts[topic] + np.arange(n)
                self._counts[topic] += n
            numbered[number] = messages._replace(sequence=of)
        return numbered

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
        # a reset and commands at the same instant keep the order of the file
        self._inputs += [(k, given) for _, k, given in sorted(inputs, key=lambda entry: entry[0])]
        return self._whole()

    def _read_inputs(self, topic: int, messages: Messages) -> Iterator[tuple[int, int, Input]]:
        for i, (start, k) in enumerate(
            zip(messages.start.tolist(), messages.sequence.tolist(), strict=True)
        ):
            yield start, k, self._input_table.read(topic, messages.data(i), 0)

    def _whole(self) -> Rows | None:
        """The samples whose messages are all there; messages of later ones stay buffered."""
        if not all(self._waiting):
            return None
        joined = [
            _increasing(*map(np.concatenate, zip(*parts, strict=True))) for parts in self._waiting
        ]
        last = min(int(number[-1]) for number, _ in joined)
        heads = [number[: np.searchsorted(number, last, "right")] for number, _ in joined]
        common = heads[0]
        alike = all(np.array_equal(head, common) for head in heads)
        if not alike:
            common = reduce(np.intersect1d, heads)
        if not len(common):
            return None
        last = int(common[-1])
        data = {}
        for i, (number, rows) in enumerate(joined):
            place = slice(len(common)) if alike else np.searchsorted(number, common)
            data[self._topics[i].name] = rows[place]
            later = number > last
            self._waiting[i] = [(number[later], rows[later])] if later.any() else []
        events = [(k, event) for k, event in self._events if k <= last]
        self._events = [(k, event) for k, event in self._events if k > last]
        inputs = [
            (k, given._replace(index=int(np.searchsorted(common, k))))
            for k, given in self._inputs
            if k <= last
        ]
        self._inputs = [(k, given) for k, given in self._inputs if k > last]
        return Rows(common, data, events, inputs)


def _increasing(number: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Messages in the order of their samples, the first of each sample."""
    if (number[1:] > number[:-1]).all():
        return number, rows
    number, first = np.unique(number, return_index=True)
    return number, rows[first]


UNREADABLE = "damaged: the record of the simulation cannot be read"
BLOCK = 4096
"""Samples per block."""


class RecordedBody(NamedTuple):
    """A body as recorded in a bag; units and frames as in a scene file."""

    mass: float
    inertia: Array
    center_of_mass: Array
    shape: Any | None


@dataclass(frozen=True)
class RecordedScene:
    """A scene as recorded in a bag: enough for every sink."""

    name: str
    description: str
    text: str
    bodies: dict[str, RecordedBody]
    constraints: dict[str, Any]
    """contacts only: type, body, parent, surface."""
    simulation: Any


class ForeignBagError(SinkError):
    """A bag not recorded by rb_sim."""


class BagReader:
    """A bag recorded by rb_sim: `scene`, `layout`, `namespace`, `start` [ns], sample blocks.

    bag: directory or .mcap file. unfinished: also accept an unfinished bag. missing: after
    `blocks`, the unreadable parts of each damaged file. Raises SinkError with one line: missing,
    not a bag, unfinished; ForeignBagError.
    """

    def __init__(self, bag: Path, *, unfinished: bool = False) -> None:
        self.paths = bag_paths(Path(bag))
        self.path = self.paths[0]
        self.unlisted = unlisted(Path(bag))
        """lines on files of the directory that are not read."""
        self.missing: list[Missing] = []
        self._broken_summary: list[str] = []
        record = _first_record(self.path)
        self.converted = record is None
        """whether another program converted the bag and kept only its messages."""
        record = described_in(self.path) if record is None else record
        if record is None:
            raise ForeignBagError(f"{self.path}: not recorded by rb_sim")
        if record["format"] not in READABLE:
            raise SinkError(
                f"{self.path}: its records have format {record['format']}; "
                f"this version of rb_sim reads format {' and '.join(READABLE)}"
            )
        if not unfinished and not all(is_complete(path) for path in self.paths):
            raise SinkError(f"{self.path}: unfinished; first run: rb_sim recover {bag}")
        self.record = record
        self.scene, self.layout = _described(record, self.path)
        self._table = TopicTable(self.scene, self.layout)  # type: ignore[arg-type]  # has what it reads
        self.namespace = record["namespace"]
        self.start = int(record["start"])

    @property
    def summary(self) -> dict[str, Any] | None:
        """Summary of the run; None if there is none, or it is broken (see `damage`)."""
        try:
            return summary_in(metadata_of(self.paths[-1], SUMMARY_RECORD)[0])
        except ValueError as error:
            self._broken_summary = [f"{self.paths[-1]}: {error}"]
            return None

    @property
    def topics(self) -> tuple[Topic, ...]:
        """Topics of a sample; the last one is the clock."""
        return self._table.topics

    @property
    def settings(self) -> dict[str, Any]:
        """How the simulation was run: `by` and the program's settings; {} if not recorded."""
        return json.loads(self.record.get("run", "{}"))

    @property
    def damage(self) -> list[str]:
        """Lines on parts missing in the samples that `blocks` has read."""
        lines = [line for missing in self.missing for line in missing.lines()]
        return lines + self._broken_summary

    @property
    def left_out(self) -> list[str]:
        """Lines on all that `blocks` has not read: other files of the directory, and `damage`."""
        return self.unlisted + self.damage

    def blocks(self, size: int = BLOCK) -> Iterator[SampleBlock]:
        """Yield the complete samples in order of time, `size` at a time."""
        waiting: list[SampleBlock] = []
        count = 0
        for block in self._parts():
            waiting.append(block)
            count += len(block)
            while count >= size:
                joined = concatenate(waiting, self.layout)
                whole, rest = split_at(joined, size)
                waiting, count = [rest], len(rest)
                yield whole
        if count or any(block.events for block in waiting):
            yield concatenate(waiting, self.layout)

    @property
    def clock(self) -> Topic:
        """The topic whose stamps are those of the samples [ns]."""
        return self._table.topics[-1]

    def rows(self) -> Iterator[Rows]:
        """Yield the complete samples as the bytes of their messages."""
        reader = RowReader(self._table, self.namespace, self.layout, converted=self.converted)
        self.missing = []
        try:
            yield from reader.read(self.paths, self.missing)
        except ValueError as error:
            raise SinkError(f"{self.path}: a message is not as recorded: {error}") from None

    def _parts(self) -> Iterator[SampleBlock]:
        """Yield the samples in blocks of the file's chunks."""
        center_of_mass = centers_of_mass(self.scene.bodies, self.layout.bodies)
        clock = self.clock
        for rows in self.rows():
            columns = {t.name: t.codec.unpack_rows(rows.data[t.name]) for t in self._table.topics}
            t = clock.codec.unpack_stamps(rows.data[clock.name]) / NANO
            try:
                events = rows.read_events()
            except ValueError as error:
                raise SinkError(f"{self.path}: a message is not as recorded: {error}") from None
            block = _block(t, columns, self.scene, self.layout, center_of_mass)
            yield replace(block, events=events, inputs=tuple(given for _, given in rows.inputs))


def reader_of(bag: Path, *, unfinished: bool = False) -> BagReader | None:
    """The reader of a bag recorded by rb_sim; None for a foreign bag.

    Raises SinkError if it is not a bag, and as BagReader does.
    """
    try:
        return BagReader(bag, unfinished=unfinished)
    except ForeignBagError:
        return None


def _first_record(path: Path) -> dict[str, str] | None:
    """Metadata record of an rb_sim bag; None for a foreign bag. Raises SinkError if broken."""
    found, named = metadata_of(path, RECORD)
    if found is None:
        if named:
            raise SinkError(f"{path}: {UNREADABLE}")
        return None
    if not _is_whole(found):
        raise SinkError(f"{path}: damaged: the record of the simulation has changed")
    return found


def _is_whole(record: Mapping[str, str]) -> bool:
    known = all(key in record for key in REQUIRED)
    return known and record.get("sha256", "") in ("", checksum(record))


def described_in(path: Path) -> dict[str, str] | None:
    """The record from the topic `description` of an rb_sim bag that another program converted; None
    for a foreign bag. Raises SinkError as `scan_of` does."""
    scan, ending = scan_of(path), f"/{DESCRIPTION}"
    for batch in scan.batches():
        describing = [n for n, channel in scan.channels.items() if channel.topic.endswith(ending)]
        if not describing:  # it is among the first messages
            return None
        for number in batch.keys() & describing:
            record = record_in(unpacked(batch[number]).data(0))
            if record is not None and _is_whole(record):
                return record
    return None


def _described(record: dict[str, str], path: Path) -> tuple[RecordedScene, SampleLayout]:
    try:
        names = json.loads(record["layout"]).items()
        return _scene(record), SampleLayout(**{key: tuple(value) for key, value in names})
    except (ValueError, KeyError, TypeError, AttributeError):
        raise SinkError(f"{path}: {UNREADABLE}") from None


def _scene(record: dict[str, str]) -> RecordedScene:
    bodies = {
        name: RecordedBody(
            mass=body["mass"],
            inertia=np.array(body["inertia"]),
            center_of_mass=np.array(body["center_of_mass"]),
            shape=(shape := body["shape"]) and SHAPES[shape["type"]].model_validate(shape),
        )
        for name, body in json.loads(record["bodies"]).items()
    }
    return RecordedScene(
        name=record["name"],
        description=record["description"],
        text=record["scene"],
        bodies=bodies,
        constraints={
            name: SimpleNamespace(
                type="contact", **{**spec, "surface": SimpleNamespace(**spec["surface"])}
            )
            for name, spec in json.loads(record.get("contacts", "{}")).items()
        },
        simulation=SimpleNamespace(**json.loads(record["simulation"])),
    )


def _block(
    t: Array,
    columns: dict[str, Array],
    scene: RecordedScene,
    layout: SampleLayout,
    center_of_mass: Array,
) -> SampleBlock:
    """Samples from the values of each topic, shape (n, size)."""
    n, bodies, reactions = len(t), len(layout.bodies), len(layout.reactions)
    pose = _stack([columns[body_topic(name, "pose")] for name in layout.bodies], n, 7)
    twist = _stack([columns[body_topic(name, "twist")] for name in layout.bodies], n, 6)
    wrench = _stack([columns[reaction_topic(name)] for name in layout.reactions], n, 6)
    q, spin_W = pose[..., 3:], twist[..., 3:]
    r_OC_W = rotate(q, center_of_mass)
    position, velocity = pose[..., :3] + r_OC_W, twist[..., :3] + cross(spin_W, r_OC_W)
    spin_B = rotate(conjugate(q), spin_W)
    momentum, angular_momentum = _momenta(scene, layout, position, velocity, q, spin_B)
    frames = columns[TF].reshape(n, -1, 7)
    states = _stack([columns[state_topic(name)] for name in layout.contacts], n, 1)[..., 0]
    return SampleBlock(
        t=t,
        position=position,
        orientation=q,
        linear_velocity=velocity,
        angular_velocity=spin_B,
        reaction_force=wrench[..., :3],
        reaction_torque=wrench[..., 3:],
        anchor=frames[:, bodies : bodies + reactions, :3],
        command=_stack(
            [columns[body_topic(name, "wrench_applied")] for name in layout.commanded], n, 6
        ),
        kinetic_energy=columns["energy/kinetic"][:, 0],
        potential_energy=columns["energy/potential"][:, 0],
        power=columns["power"][:, 0],
        momentum=momentum,
        angular_momentum=angular_momentum,
        residual=columns["residual"][:, 0],
        contact_work=columns[CONTACT_WORK][:, 0] if layout.contacts else np.zeros(n),
        contact_state=states.astype(float),
    )


def _stack(parts: list[Array], n: int, size: int) -> Array:
    """Array of shape (n, number of parts, size), also without parts."""
    return np.stack(parts, axis=1) if parts else np.empty((n, 0, size))


def _momenta(
    scene: RecordedScene, layout: SampleLayout, p: Array, v: Array, q: Array, w_B: Array
) -> tuple[Array, Array]:
    """P = sum m v,  L = sum p x m v + R I w, world axes, shape (n, 3) each."""
    mass = np.array([scene.bodies[name].mass for name in layout.bodies])[:, None]
    inertia = np.array([scene.bodies[name].inertia for name in layout.bodies])
    spin = rotate(q, np.einsum("bij,nbj->nbi", inertia, w_B))
    return (mass * v).sum(axis=1), (cross(p, mass * v) + spin).sum(axis=1)


OPTIONS = ("duration", "rate", "method", "step", "tolerance", "project_initial", "impacts")


def scene_as_run(
    reader: BagReader, changes: Sequence[str] = (), overrides: Mapping[str, Any] | None = None
) -> Scene:
    """The scene with the options of the recorded run; `method: auto` is replaced by its choice.

    changes: texts KEY=VALUE that replace values of the scene; overrides: as in load_scene. Raises
    SceneError, RbSimError.
    """
    recorded = reader.scene
    data = yaml_reader.parse(recorded.text, recorded.name)
    options = {k: v for k, v in vars(recorded.simulation).items() if k in OPTIONS and v is not None}
    given = {key: value for key, value in (overrides or {}).items() if value is not None}
    summary = reader.summary
    choice = (summary or {}).get("choice")
    if choice and options.get("method") == "auto":
        options |= {"method": choice["method"], "step": None, "tolerance": None}
        options |= {k: choice[k] for k in ("step", "tolerance") if choice.get(k)}
        options = {key: value for key, value in options.items() if value is not None}
    data = with_values({**data, "simulation": options}, changes)
    with SceneError.after(changes):
        return scene_from_mapping(data, name=recorded.name, file=str(reader.path), **given)
