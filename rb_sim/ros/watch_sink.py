"""What a running node is watched for: the same as a run of the command line, batch by batch."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rb_sim.engine.samples import block_of_rows
from rb_sim.watches.bounds import effort_of
from rb_sim.watches.watch_list import WatchList

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleBlock, SampleLayout, SampleRow
    from rb_sim.scene.schema import Scene
    from rb_sim.simulation import Simulation
    from rb_sim.watches.finding import Finding

BATCH = 1000
"""Samples that wait at most to be looked at: some 3 ms of work; one by one would cost far more."""


class WatchSink:
    """Keeps samples for a while and hands them to the watches together.

    simulation: whose steps and rejections count as effort.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._waiting: list[SampleRow] = []
        self._watches = WatchList(simulation.scene, simulation.layout)

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Nothing is to be opened."""

    def write(self, block: SampleBlock) -> None:
        """Look at the block, and at what waits."""
        self.look()
        self._watches.add(block, effort_of(self._simulation))

    def write_row(self, row: SampleRow) -> None:
        """Keep the sample; look at what waits once it is enough."""
        self._waiting.append(row)
        if len(self._waiting) >= BATCH:
            self.look()

    def look(self) -> tuple[Finding, ...]:
        """Look at what waits; what has passed its bound since the start or the last reset."""
        if self._waiting:
            batch = block_of_rows(self._waiting, self._simulation.layout)
            self._waiting = []
            self._watches.add(batch, effort_of(self._simulation))
        return self._watches.findings

    def reset(self) -> None:
        """Begin anew: from the initial state on balances and findings are another run's."""
        self._waiting = []
        self._watches = WatchList(self._simulation.scene, self._simulation.layout)

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Nothing is to be closed."""
