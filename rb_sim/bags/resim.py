# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Re-simulation of a recorded run, and byte-for-byte comparison of two bags."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rb_sim.accuracy.checks.check_list import CheckedSamples
from rb_sim.base.errors import Finding, SinkError
from rb_sim.io.bag.bag_sink import BagSink
from rb_sim.io.bag.reader import BagReader, Rows
from rb_sim.io.messages.cdr import NANO
from rb_sim.io.sink import split_at
from rb_sim.mechanics.samples import Input, SampleBlock, concatenate
from rb_sim.scene.schema import Scene
from rb_sim.simulation.record import accelerating
from rb_sim.simulation.simulation import Simulation, give

# Byte-for-byte comparison of two bags of one scene: first difference and its size.


class FirstDifference(NamedTuple):
    """The first sample that differs."""

    number: int
    t: float
    """[s]."""
    topic: str
    size: float
    """largest difference of a value in that message; 0.0 if only bytes differ."""


class Identity(NamedTuple):
    """Result of the comparison of the payloads of two bags."""

    samples: int
    """number of samples in both."""
    only_in: tuple[int, int]
    """number of samples in only one of them."""
    identical: int
    sha256: tuple[str, str]
    """of the payloads of the common samples, topic by topic."""
    first: FirstDifference | None
    largest: dict[str, float]
    """largest difference of a value over the run, by topic, if there is any."""

    @property
    def same(self) -> bool:
        """True if both bags have the same samples, bit for bit."""
        return self.sha256[0] == self.sha256[1] and self.only_in == (0, 0)

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        first = None if self.first is None else self.first._asdict()
        return self._asdict() | {"first": first, "same": self.same}


def identity(a: BagReader, b: BagReader) -> Identity:
    """Compare two bags of the same topics, sample by sample.

    Raises SinkError if their bodies, reactions or contacts differ."""
    if a.layout != b.layout:
        raise SinkError(f"{b.path}: its bodies, reactions or contacts are not those of {a.path}")
    codecs = {topic.name: topic.codec for topic in a.topics}
    clock = a.topics[-1]
    digests = {name: (hashlib.sha256(), hashlib.sha256()) for name in codecs}
    largest: dict[str, float] = {}
    first: FirstDifference | None = None
    samples = identical = 0
    counts = [0, 0]
    for number, one, other in _aligned(a.rows(), b.rows(), counts):
        samples += len(number)
        differs = np.zeros(len(number), bool)
        for name, codec in codecs.items():
            for digest, data in zip(digests[name], (one[name], other[name]), strict=True):
                digest.update(data.tobytes())
            wrong = (one[name] != other[name]).any(axis=1)
            if wrong.any():
                size = np.abs(codec.unpack_rows(one[name]) - codec.unpack_rows(other[name]))
                k = int(np.argmax(wrong))
                if first is None or number[k] < first.number:
                    t = clock.codec.unpack_stamps(one[clock.name][k : k + 1])[0] / NANO
                    first = FirstDifference(
                        int(number[k]), float(t), name, float(size[k].max(initial=0))
                    )
                largest[name] = max(largest.get(name, 0.0), float(size.max(initial=0.0)))
            differs |= wrong
        identical += int((~differs).sum())
    sums = [hashlib.sha256(), hashlib.sha256()]
    for pair in digests.values():
        for total, digest in zip(sums, pair, strict=True):
            total.update(digest.digest())
    rest = (counts[0] - samples, counts[1] - samples)
    return Identity(
        samples, rest, identical, (sums[0].hexdigest(), sums[1].hexdigest()), first, largest
    )


Part = tuple[np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray]]


def _aligned(a: Iterator[Rows], b: Iterator[Rows], counts: list[int]) -> Iterator[Part]:
    """Yield samples with equal numbers: (numbers, data of a, data of b).

    counts: number of samples of a and of b, updated."""
    waiting: Rows | None = None
    for one in a:
        counts[0] += len(one.number)
        while waiting is None or waiting.number[-1] < one.number[-1]:
            more = next(b, None)
            if more is None:
                break
            counts[1] += len(more.number)
            waiting = more if waiting is None else _joined(waiting, more)
        if waiting is None:
            continue
        number, i, j = np.intersect1d(one.number, waiting.number, return_indices=True)
        yield (
            number,
            {name: data[i] for name, data in one.data.items()},
            {name: data[j] for name, data in waiting.data.items()},
        )
        later = waiting.number > one.number[-1]
        left = {name: data[later] for name, data in waiting.data.items()}
        waiting = Rows(waiting.number[later], left, [], []) if later.any() else None
    counts[1] += sum(len(more.number) for more in b)


def _joined(a: Rows, b: Rows) -> Rows:
    data = {name: np.concatenate([a.data[name], b.data[name]]) for name in a.data}
    return Rows(np.concatenate([a.number, b.number]), data, [], [])


# Re-simulation: scene, settings, commands and resets come from the bag.


BATCH = 256
"""Samples written at once."""

Inputs = dict[int, list[Input]]
"""Inputs by the number of the sample that they precede."""


def resimulate(reader: BagReader, scene: Scene, folder: Path) -> tuple[Finding, ...]:
    """Repeat the recorded run with `scene`, recorded in `folder`; returns the checks' findings.

    The steps are those of the recording program: a node advances from sample to sample, `run`
    samples within steps. Raises RbSimError if the scene does not accept a recorded command;
    SimulationError, SinkError.
    """
    inputs, count = inputs_of(reader)
    if not count:
        raise SinkError(f"{reader.path}: no whole sample in it")
    simulation = Simulation(scene)
    settings = reader.settings
    sink = BagSink(
        folder,
        start_ns=reader.start,
        namespace=reader.namespace,
        run=settings,
        accelerations=accelerating if settings.get("accelerations") else None,
        odometry=bool(settings.get("odometry")),
    )
    sink.open(scene, simulation.layout)
    ended: dict[str, Any] | None = None
    try:
        node = settings.get("by") == "node"
        checked = CheckedSamples(simulation, blocks(simulation, inputs, count, node=node))
        for block in checked:
            sink.write(block)
        ended = {"outcome": "simulated again", "samples": count}
    finally:
        sink.close(ended)
    return checked.findings


def inputs_of(reader: BagReader) -> tuple[Inputs, int]:
    """Commands and resets of a bag, and its number of samples.

    Raises SinkError if a node's log lacks samples, since their commands are lost too.
    """
    inputs: Inputs = defaultdict(list)
    count = 0
    clock = reader.clock
    rate = reader.scene.simulation.rate
    by_node = reader.settings.get("by") == "node"
    for rows in reader.rows():
        count = max(count, int(rows.number[-1]) + 1)
        if by_node:
            t = clock.codec.unpack_stamps(rows.data[clock.name]) / NANO
            _refuse_dropped(reader, rows.number, t, rate)
        for number, given in rows.inputs:
            inputs[number].append(given)
    return dict(inputs), count


def _refuse_dropped(reader: BagReader, number: np.ndarray, t: np.ndarray, rate: float) -> None:
    """Raise SinkError if the log queue overflowed: dropped samples have no number, so times run
    ahead of numbers."""
    lacking = np.round(t * rate).astype(np.int64) - number
    if lacking.any():
        first = int(np.argmax(lacking != 0))
        dropped = (reader.summary or {}).get("samples_dropped") or int(lacking[-1])
        raise SinkError(
            f"{reader.path}: {dropped} samples are lacking, the first of them before"
            f" t = {t[first]:.9g} s (the queue of the logs was full), with their commands: the run"
            " cannot be simulated again; record with a larger log_queue"
        )


def blocks(
    simulation: Simulation, inputs: Inputs, count: int, *, node: bool
) -> Iterator[SampleBlock]:
    """The first `count` samples, simulated with their inputs."""
    if node:
        yield from _batches(_as_node(simulation, inputs, count), simulation)
    else:
        yield from _as_run(simulation, inputs, count)


def _as_node(simulation: Simulation, inputs: Inputs, count: int) -> Iterator[SampleBlock]:
    """Sample to sample, as in rb_sim.ros.stepper."""
    rate = simulation.scene.simulation.rate
    started = 0  # sample at which the simulation's own time was zero
    for k in range(count):
        before = inputs.get(k, [])
        for given in before:
            if not given.body:
                started = round(given.t * rate)
        started += sum(given.state != () for given in before[-1:])
        give(simulation, before)
        if k and not any(given.state for given in before):
            own_time = (k - started) / rate
            simulation.advance(own_time - simulation.time)
        sample, events = simulation.sample().block, simulation.take_events()
        shift = started / rate
        yield replace(
            sample,
            t=sample.t + shift if started else sample.t,
            events=tuple(replace(event, t=event.t + shift) for event in events),
            inputs=tuple(g._replace(t=g.t + shift) for g in simulation.take_inputs()),
        )


def _as_run(simulation: Simulation, inputs: Inputs, count: int) -> Iterator[SampleBlock]:
    """In one call of Simulation.blocks, or one for each interval between commands."""
    options = simulation.scene.simulation
    stops = sorted({k for k in inputs if 0 < k < count})
    done = 0
    for stop in [*stops, count]:
        give(simulation, inputs.get(done, []))
        whole = stop == count and not stops
        duration = options.duration if whole else (stop - done - 1) / options.rate
        for block in simulation.blocks(duration, options.rate):
            part = block if done + len(block) <= stop else split_at(block, stop - done)[0]
            done += len(part)
            yield part
            if done == stop:
                break


def _batches(samples: Iterator[SampleBlock], simulation: Simulation) -> Iterator[SampleBlock]:
    waiting: list[SampleBlock] = []
    for sample in samples:
        waiting.append(sample)
        if len(waiting) == BATCH:
            yield concatenate(waiting, simulation.layout)
            waiting = []
    if waiting:
        yield concatenate(waiting, simulation.layout)
