"""The run of a bag once more: scene, settings, commands and resets come out of the bag."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rb_sim.accelerations import accelerating
from rb_sim.engine.samples import Input, SampleBlock, concatenate
from rb_sim.errors import SinkError
from rb_sim.finding import Finding
from rb_sim.given import give
from rb_sim.scene.schema import Scene
from rb_sim.simulation import Simulation
from rb_sim.sinks.bag import BagSink
from rb_sim.sinks.bag_reader import BagReader
from rb_sim.sinks.cdr import NANO
from rb_sim.watches.watched import Watched

BATCH = 256
"""Samples that are written at once."""

Inputs = dict[int, list[Input]]
"""By the number of the sample that they come before."""


def resimulate(reader: BagReader, scene: Scene, folder: Path) -> tuple[Finding, ...]:
    """Simulate `scene` as the bag's run went, and record it in `folder`; what watches saw.

    The steps are those of the program that recorded it: a node advances from sample to sample, a
    run samples its steps.
    Raises RbSimError where the scene takes no such command, SimulationError, SinkError.
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
    )
    sink.open(scene, simulation.layout)
    ended: dict[str, Any] | None = None
    try:
        node = settings.get("by") == "node"
        watched = Watched(simulation, blocks(simulation, inputs, count, node=node))
        for block in watched:
            sink.write(block)
        ended = {"outcome": "simulated again", "samples": count}
    finally:
        sink.close(ended)
    return watched.findings


def inputs_of(reader: BagReader) -> tuple[Inputs, int]:
    """Commands and resets of a bag, and how many samples its run had.

    Raises SinkError where a node's log lacks samples, and what was commanded at them.
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
    """Samples that found the queue of the logs full have no number: the next one has it."""
    lacking = np.round(t * rate).astype(np.int64) - number
    if lacking.any():
        first = int(np.argmax(lacking != 0))
        dropped = (reader.summary or {}).get("samples_dropped") or int(lacking[-1])
        raise SinkError(
            f"{reader.path}: {dropped} samples are lacking, the first of them before"
            f" t = {t[first]:.9g} s (the queue of the logs was full), and so is what was commanded"
            " at them: the run cannot be simulated again; record with a larger log_queue"
        )


def blocks(
    simulation: Simulation, inputs: Inputs, count: int, *, node: bool
) -> Iterator[SampleBlock]:
    """The first `count` samples, with the inputs before them."""
    if node:
        yield from _batches(_as_node(simulation, inputs, count), simulation)
    else:
        yield from _as_run(simulation, inputs, count)


def _as_node(simulation: Simulation, inputs: Inputs, count: int) -> Iterator[SampleBlock]:
    """From sample to sample, as rb_sim.ros.stepper goes."""
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
    """In one go, or in as many as there are commands in between (Simulation.run in turns)."""
    options = simulation.scene.simulation
    stops = sorted({k for k in inputs if 0 < k < count})
    done = 0
    for stop in [*stops, count]:
        give(simulation, inputs.get(done, []))
        whole = stop == count and not stops
        duration = options.duration if whole else (stop - done - 1) / options.rate
        for block in simulation.blocks(duration, options.rate):
            part = block if done + len(block) <= stop else _first(block, stop - done)
            done += len(part)
            yield part
            if done == stop:
                break


def _first(block: SampleBlock, n: int) -> SampleBlock:
    from rb_sim.engine.samples import ARRAYS

    return replace(block, **{name: getattr(block, name)[:n] for name in ARRAYS})


def _batches(samples: Iterator[SampleBlock], simulation: Simulation) -> Iterator[SampleBlock]:
    waiting: list[SampleBlock] = []
    for sample in samples:
        waiting.append(sample)
        if len(waiting) == BATCH:
            yield concatenate(waiting, simulation.layout)
            waiting = []
    if waiting:
        yield concatenate(waiting, simulation.layout)
