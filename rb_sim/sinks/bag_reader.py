"""Reads a bag that rb_sim recorded back into samples.

What the topics give for the body origin is turned back to the centre of mass; momenta follow from
the state. All numbers are those recorded, to round-off; times to half a nanosecond.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from mcap.reader import make_reader

from rb_sim.engine.samples import Array, ContactEvent, SampleBlock, SampleLayout
from rb_sim.errors import SinkError
from rb_sim.sinks.bag import FORMAT, RECORD, SUMMARY_RECORD
from rb_sim.sinks.bag_records import Channel, Message, Metadata, bag_path, is_complete, read_records
from rb_sim.sinks.cdr import NANO
from rb_sim.sinks.frames import centers_of_mass, conjugate, rotate
from rb_sim.sinks.topics import (
    CONTACT_EVENTS,
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

    bag: directory or .mcap file.
    Raises SinkError with one clear line: missing, no MCAP, unfinished, not recorded by rb_sim.
    """

    def __init__(self, bag: Path) -> None:
        self.path = bag_path(Path(bag))
        record = _first_record(self.path)
        if record is None:
            raise SinkError(f"{self.path}: not recorded by rb_sim")
        if record["format"] != FORMAT:
            raise SinkError(
                f"{self.path}: its records have format {record['format']}; "
                f"this version of rb_sim reads format {FORMAT}"
            )
        if not is_complete(self.path):
            raise SinkError(f"{self.path}: unfinished; first run: rb_sim recover {bag}")
        layout = {key: tuple(names) for key, names in json.loads(record["layout"]).items()}
        self.layout = SampleLayout(**layout)
        self.scene = _scene(record)
        self.namespace = record["namespace"]
        self.start = int(record["start"])

    @property
    def summary(self) -> dict[str, Any] | None:
        """Summary of the run, if it had come to one."""
        with self.path.open("rb") as file:
            for record in make_reader(file).iter_metadata():
                if record.name == SUMMARY_RECORD:
                    return json.loads(record.metadata["summary"])
        return None

    def blocks(self, size: int = BLOCK) -> Iterator[SampleBlock]:
        """The samples in time order, at most `size` at a time."""
        table = TopicTable(self.scene, self.layout)  # type: ignore[arg-type]  # has what it reads
        names = [topic.full_name(self.namespace) for topic in table.topics]
        center_of_mass = centers_of_mass(self.scene.bodies, self.layout.bodies)
        rows: list[list[bytes]] = []
        events: list[ContactEvent] = []

        def block() -> SampleBlock:
            columns = {
                topic.name: np.array([topic.codec.unpack(row[i]) for row in rows])
                for i, topic in enumerate(table.topics)
            }
            stamp = table.topics[-1].codec.unpack_stamp
            t = np.array([stamp(row[-1]) for row in rows]) / NANO
            found = _block(t, columns, self.scene, self.layout, center_of_mass)
            return replace(found, events=tuple(events))

        try:
            for row, before in self._rows(names):
                rows.append(row)
                events += [ContactEvent(*read_event(data)) for data in before]  # type: ignore[arg-type]
                if len(rows) == size:
                    yield block()
                    rows.clear()
                    events.clear()
            if rows:
                yield block()
        except ValueError as error:
            raise SinkError(f"{self.path}: a message is not as recorded: {error}") from None

    def _rows(self, names: list[str]) -> Iterator[tuple[list[bytes], list[bytes]]]:
        """The messages of each whole sample, in the order of `names`, and the events before it."""
        event_topic = f"{self.namespace}/{CONTACT_EVENTS}"
        event_channels: set[int] = set()
        events: list[bytes] = []
        index = {name: i for i, name in enumerate(names)}
        channels: dict[int, int] = {}
        row: dict[int, bytes] = {}
        sample = 0
        for record in read_records(self.path):
            if isinstance(record, Channel) and record.topic in index:
                channels[record.id] = index[record.topic]
            elif isinstance(record, Channel) and self.layout.contacts:
                event_channels |= {record.id} if record.topic == event_topic else set()
            elif isinstance(record, Message) and record.channel_id in event_channels:
                events.append(record.data)
            elif isinstance(record, Message) and record.channel_id in channels:
                if record.sequence != sample:
                    row, sample = {}, record.sequence
                row[channels[record.channel_id]] = record.data
                if len(row) == len(names):
                    yield [row[i] for i in range(len(names))], events
                    events = []


def _first_record(path: Path) -> dict[str, str] | None:
    """What rb_sim writes before the first message; None in a bag of somebody else."""
    for record in read_records(path):
        if isinstance(record, Metadata) and record.name == RECORD:
            return record.metadata
        if isinstance(record, Message):
            return None
    return None


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
