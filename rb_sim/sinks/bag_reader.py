"""Reads a bag that rb_sim recorded back into samples.

What the topics give for the body origin is turned back to the centre of mass; momenta follow from
the state. All numbers are those recorded, to round-off; times to half a nanosecond.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from mcap.records import Channel

from rb_sim.engine.samples import (
    ARRAYS,
    Array,
    ContactEvent,
    SampleBlock,
    SampleLayout,
    concatenate,
)
from rb_sim.errors import SinkError
from rb_sim.sinks.bag import READABLE, RECORD, REQUIRED, SUMMARY_RECORD, checksum
from rb_sim.sinks.bag_batches import BagScan, Batch
from rb_sim.sinks.bag_records import Missing, bag_paths, is_complete, read_metadata
from rb_sim.sinks.cdr import NANO
from rb_sim.sinks.frames import centers_of_mass, conjugate, rotate
from rb_sim.sinks.topics import (
    CONTACT_WORK,
    TF,
    TopicTable,
    reaction_topic,
    read_event,
    state_topic,
)

BLOCK = 4096
"""Samples that are read at a time."""


class RecordedBody(NamedTuple):
    """What a bag tells of a body. Units and frames as in a scene."""

    mass: float
    inertia: Array
    center_of_mass: Array
    shape: Any | None


@dataclass(frozen=True)
class RecordedScene:
    """What a bag tells of its scene: enough for every sink."""

    name: str
    description: str
    text: str
    bodies: dict[str, RecordedBody]
    constraints: dict[str, Any]
    """contacts only: type, body, parent, surface."""
    simulation: Any


class BagReader:
    """A recorded bag: `scene`, `layout`, `namespace`, `start` [ns], and its samples in blocks.

    bag: directory or .mcap file. unfinished: read also one that was never finished.
    missing: after `blocks`, what could not be read of each file that is not whole.
    Raises SinkError with one clear line: missing, no MCAP, unfinished, not recorded by rb_sim.
    """

    def __init__(self, bag: Path, *, unfinished: bool = False) -> None:
        self.paths = bag_paths(Path(bag))
        self.path = self.paths[0]
        self.missing: list[Missing] = []
        record = _first_record(self.path)
        if record is None:
            raise SinkError(f"{self.path}: not recorded by rb_sim")
        if record["format"] not in READABLE:
            raise SinkError(
                f"{self.path}: its records have format {record['format']}; "
                f"this version of rb_sim reads format {' and '.join(READABLE)}"
            )
        if not unfinished and not all(is_complete(path) for path in self.paths):
            raise SinkError(f"{self.path}: unfinished; first run: rb_sim recover {bag}")
        self.record = record
        self.scene, self.layout = _described(record, self.path)
        self.namespace = record["namespace"]
        self.start = int(record["start"])

    @property
    def summary(self) -> dict[str, Any] | None:
        """Summary of the run, if it had come to one."""
        found = metadata_of(self.paths[-1], SUMMARY_RECORD)
        return None if found is None else json.loads(found["summary"])

    @property
    def damage(self) -> list[str]:
        """Lines that say what was missing in what `blocks` has read."""
        return [line for missing in self.missing for line in missing.lines()]

    def blocks(self, size: int = BLOCK) -> Iterator[SampleBlock]:
        """The whole samples in time order, `size` at a time."""
        waiting: list[SampleBlock] = []
        count = 0
        for block in self._parts():
            waiting.append(block)
            count += len(block)
            while count >= size:
                joined = concatenate(waiting, self.layout)
                whole, rest = _split(joined, size)
                waiting, count = [rest], len(rest)
                yield whole
        if count or any(block.events for block in waiting):
            yield concatenate(waiting, self.layout)

    def _parts(self) -> Iterator[SampleBlock]:
        """The samples as they come out of the chunks."""
        table = TopicTable(self.scene, self.layout)  # type: ignore[arg-type]  # has what it reads
        center_of_mass = centers_of_mass(self.scene.bodies, self.layout.bodies)
        rows = SampleRows(table, self.namespace)
        self.missing = []
        try:
            for path in self.paths:
                scan = BagScan(path)
                for batch in scan.batches():
                    found = rows.add(batch, scan.channels)
                    if found is not None:
                        columns, t, events = found
                        block = _block(t, columns, self.scene, self.layout, center_of_mass)
                        yield replace(block, events=events)
                if scan.missing.damages:
                    self.missing.append(scan.missing)
        except ValueError as error:
            raise SinkError(f"{self.path}: a message is not as recorded: {error}") from None


class SampleRows:
    """Puts the messages of one sample together; they have the number of the sample in common."""

    def __init__(self, table: TopicTable, namespace: str) -> None:
        self._topics = table.topics
        self._index = {topic.full_name(namespace): i for i, topic in enumerate(table.topics)}
        event = table.event_topic
        self._event_topic = None if event is None else f"{namespace}/{event[0]}"
        self._waiting: list[list[tuple[Any, Any]]] = [[] for _ in table.topics]
        self._events: list[tuple[int, ContactEvent]] = []

    def add(
        self, batch: Batch, channels: Mapping[int, Channel]
    ) -> tuple[dict[str, Array], Array, tuple[ContactEvent, ...]] | None:
        """Numbers by topic, times [s], events of the samples that are whole now; None if none is.

        Raises ValueError for a message that is not as recorded.
        """
        for number, messages in batch.items():
            topic = channels[number].topic if number in channels else None
            if topic is not None and topic == self._event_topic:
                for k in range(len(messages.start)):
                    event = ContactEvent(*read_event(messages.data(k)))  # type: ignore[arg-type]
                    self._events.append((int(messages.sequence[k]), event))
            elif topic in self._index:
                i = self._index[topic]
                rows = messages.rows(self._topics[i].codec.length)
                self._waiting[i].append((messages.sequence, rows))
        return self._whole()

    def _whole(self) -> tuple[dict[str, Array], Array, tuple[ContactEvent, ...]] | None:
        if not all(self._waiting):
            return None
        joined = [
            (np.concatenate([s for s, _ in parts]), np.concatenate([r for _, r in parts]))
            for parts in self._waiting
        ]
        common = reduce(np.intersect1d, [sequence for sequence, _ in joined])
        if not len(common):
            return None
        last = common[-1]
        self._waiting = [
            [(sequence[later], rows[later])] if (later := sequence > last).any() else []
            for sequence, rows in joined
        ]
        columns, clock = {}, None
        for topic, (sequence, rows) in zip(self._topics, joined, strict=True):
            sequence, first = np.unique(sequence, return_index=True)
            clock = rows[first[np.isin(sequence, common, assume_unique=True)]]
            columns[topic.name] = topic.codec.unpack_rows(clock)
        assert clock is not None  # the last topic is the clock
        t = self._topics[-1].codec.unpack_stamps(clock) / NANO
        events = tuple(event for k, event in self._events if k <= last)
        self._events = [(k, event) for k, event in self._events if k > last]
        return columns, t, events


def _split(block: SampleBlock, size: int) -> tuple[SampleBlock, SampleBlock]:
    """The first `size` samples, and the rest; events go with the sample that they come before."""
    first = replace(block, **{name: getattr(block, name)[:size] for name in ARRAYS}, events=())
    rest = replace(block, **{name: getattr(block, name)[size:] for name in ARRAYS}, events=())
    if not block.events:
        return first, rest
    end = first.t[-1] if len(rest) else np.inf
    before = tuple(event for event in block.events if event.t <= end)
    return replace(first, events=before), replace(rest, events=block.events[len(before) :])


def metadata_of(path: Path, name: str) -> dict[str, str] | None:
    """The values of the metadata record called `name`, the last one; None if there is none."""
    found = None
    for record in read_metadata(path):
        if record.name == name:
            found = record.metadata
    return found


def _first_record(path: Path) -> dict[str, str] | None:
    """What rb_sim writes before the first message; None in a bag of somebody else.

    Raises SinkError if it is broken.
    """
    found = metadata_of(path, RECORD)
    if found is None:
        return None
    if any(key not in found for key in REQUIRED) or found.get("sha256", "") not in (
        "",
        checksum(found),
    ):
        raise SinkError(f"{path}: damaged: the record of what was simulated is not as written")
    return found


def _described(record: dict[str, str], path: Path) -> tuple[RecordedScene, SampleLayout]:
    try:
        names = json.loads(record["layout"]).items()
        return _scene(record), SampleLayout(**{key: tuple(value) for key, value in names})
    except (ValueError, KeyError, TypeError, AttributeError):
        raise SinkError(
            f"{path}: damaged: the record of what was simulated cannot be read"
        ) from None


def _scene(record: dict[str, str]) -> RecordedScene:
    bodies = {
        name: RecordedBody(
            mass=body["mass"],
            inertia=np.array(body["inertia"]),
            center_of_mass=np.array(body["center_of_mass"]),
            shape=None if body["shape"] is None else SimpleNamespace(**body["shape"]),
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
    """Samples from the numbers of each topic, shape (n, size)."""
    n, bodies, reactions = len(t), len(layout.bodies), len(layout.reactions)
    pose = _stack([columns[f"{name}/pose"] for name in layout.bodies], n, 7)
    twist = _stack([columns[f"{name}/twist"] for name in layout.bodies], n, 6)
    wrench = _stack([columns[reaction_topic(name)] for name in layout.reactions], n, 6)
    q, spin_W = pose[..., 3:], twist[..., 3:]
    r_OC_W = rotate(q, center_of_mass)
    position, velocity = pose[..., :3] + r_OC_W, twist[..., :3] + np.cross(spin_W, r_OC_W)
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
        command=_stack([columns[f"{name}/wrench_applied"] for name in layout.commanded], n, 6),
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
    """Shape (n, number of parts, size), for no parts too."""
    return np.stack(parts, axis=1) if parts else np.empty((n, 0, size))


def _momenta(
    scene: RecordedScene, layout: SampleLayout, p: Array, v: Array, q: Array, w_B: Array
) -> tuple[Array, Array]:
    """P = sum m v,  L = sum p x m v + R I w, world axes, shape (n, 3) each."""
    mass = np.array([scene.bodies[name].mass for name in layout.bodies])[:, None]
    inertia = np.array([scene.bodies[name].inertia for name in layout.bodies])
    spin = rotate(q, np.einsum("bij,nbj->nbi", inertia, w_B))
    return (mass * v).sum(axis=1), (np.cross(p, mass * v) + spin).sum(axis=1)
