"""What a running node is watched for: the same as a run of the command line, batch by batch."""

from __future__ import annotations

import time
from queue import Queue
from threading import Thread
from typing import TYPE_CHECKING, Any, NamedTuple

from rb_sim.checks.check import Effort, effort_of
from rb_sim.checks.check_list import WatchList
from rb_sim.mechanics.samples import block_of_rows, concatenate

if TYPE_CHECKING:
    from rb_sim.base.diagnostic import Finding
    from rb_sim.mechanics.samples import SampleBlock, SampleLayout, SampleRow
    from rb_sim.scene.schema import Scene
    from rb_sim.simulation.simulation import Simulation

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

    watches: WatchList
    samples: list[SampleRow] | SampleBlock
    effort: Effort


class WatchSink:
    """Keeps samples for a while and hands them to the watches together.

    simulation: whose steps and rejections count as effort, samples computed ahead included.
    From `open` to `close` a thread looks at them, since a sample is not to wait for that.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._waiting: list[SampleRow] = []
        self._watches = self._new()
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
        return self._watches.findings

    def reset(self) -> None:
        """Begin anew: from the initial state on balances and findings are another run's."""
        self._waiting = []
        self._watches = self._new()

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """End the thread, when it has looked at everything."""
        if self._thread is not None:
            self._batches.put(None)
            self._thread.join()
            self._thread = None

    def _new(self) -> WatchList:
        of = self._simulation
        return WatchList(of.scene, of.layout, of.compiled)

    def _pass_on(self) -> None:
        """Have looked at what waits."""
        if self._waiting:
            rows, self._waiting = self._waiting, []
            self._hand_over(rows)

    def _hand_over(self, samples: list[SampleRow] | SampleBlock) -> None:
        """Have the samples looked at: by the thread, or at once."""
        effort = effort_of(self._simulation)._replace(ahead=None)  # a thread looks at it
        batch = Batch(self._watches, samples, effort)
        if self._thread is None:
            self._add(batch)
        else:
            self._batches.put(batch)

    def _add(self, batch: Batch) -> None:
        samples = batch.samples
        if isinstance(samples, list):
            samples = self._block(samples)
        batch.watches.add(samples, batch.effort)
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
