"""Some runs of a sweep once more, under all watches: those that share lanes nobody watches."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from rb_sim.errors import RbSimError
from rb_sim.finding import Finding
from rb_sim.simulation import Simulation
from rb_sim.sweeps.one_run import PlanRunner
from rb_sim.watches.watched import Watched

FEW, MOST, ONE_IN = 2, 8, 50
"""Runs that are looked at: one in fifty, which costs as much as watching all of them would."""


class Lost(NamedTuple):
    """Accuracy that was lost in a run of a sweep."""

    run: int
    """its number in the plan."""
    finding: Finding

    def __str__(self) -> str:
        return f"run {self.run}: {self.finding}"


def to_look_at(runs: np.ndarray) -> list[int]:
    """Some of these runs, spread over all, the first and the last among them."""
    count = min(len(runs), max(FEW, min(MOST, len(runs) // ONE_IN)))
    return sorted({int(runs[i]) for i in np.linspace(0, len(runs) - 1, count).round().astype(int)})


def look_over(
    runner: PlanRunner, values: Mapping[str, np.ndarray], runs: Sequence[int]
) -> tuple[Lost, ...]:
    """What watches see of lost accuracy in these runs of the plan.

    A run that fails, or takes longer than the plan lets it, is told of as far as it went; why it
    ended is in its row.
    """
    found: list[Lost] = []
    for run in runs:
        row = {name: float(column[run]) for name, column in values.items()}
        found += [Lost(run, finding) for finding in findings(runner, row)]
    return tuple(found)


def findings(runner: PlanRunner, values: Mapping[str, float]) -> tuple[Finding, ...]:
    """What watches see in the run with these values, simulated by itself."""
    try:
        simulation = Simulation(runner.scene(values), family=runner.family, announce=None)
        simulation.warm()
    except RbSimError:  # as its row says
        return ()
    options = simulation.scene.simulation
    end = time.perf_counter() + runner.loaded.plan.seconds_per_run
    blocks = simulation.blocks(options.duration, options.rate, lambda t: time.perf_counter() < end)
    watched = Watched(simulation, blocks)
    try:
        for _ in watched:
            pass
    except RbSimError:
        pass
    return watched.findings
