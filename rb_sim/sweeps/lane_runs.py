"""The runs of a batch that go through the machine together, in its vector lanes.

What cannot go together (contacts, several bodies, tables over time, implicit methods, `auto`) or
does not come to its end in time is left to `PlanRunner.run`, one at a time.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from rb_sim.base.errors import RbSimError
from rb_sim.integrate.layout import FINE
from rb_sim.mechanics.lane_motions import Lanes
from rb_sim.mechanics.laws import ReducedLaws
from rb_sim.mechanics.samples import SampleLayout, block_of, row_width
from rb_sim.motion.instants import instants_at_rate, samples_at_rate
from rb_sim.scene.compile import compile_method, compile_scene
from rb_sim.scene.scales import at_its_size
from rb_sim.sweeps.one_run import PlanRunner, ended
from rb_sim.trajectory.trajectory import Trajectory

MOST_NUMBERS = 1 << 21
"""Samples of the runs that are together in memory, in numbers: 16 MB."""

FEWEST = 8
"""Runs that share the lanes: where the samples of fewer fill the memory, each goes alone."""


FIELDS = {
    "reaction": ("reaction_force", "reaction_torque", "anchor"),
    "energy": ("kinetic_energy", "potential_energy"),
}
"""Fields of a block behind a name in an expression, where they are not called the same."""


class Placed(NamedTuple):
    """A run, ready to start."""

    index: int
    """in the batch."""
    start: tuple[float, ...]
    given: list[float]
    """inputs of the laws."""


class Alike(NamedTuple):
    """What runs have in common that share lanes: the method with its settings, the instants."""

    kind: type
    method: Any
    duration: float
    rate: float


class LaneRunner:
    """Runs many points of one plan; its lanes are compiled once."""

    def __init__(self, runner: PlanRunner) -> None:
        self._runner = runner
        self._lanes: dict[Alike, Lanes] = {}
        self._layout: SampleLayout | None = None

    def rows(self, points: Sequence[Mapping[str, float]]) -> dict[int, dict[str, Any]]:
        """Rows of the runs that went through the lanes, by index; others are to be run alone."""
        found: dict[int, dict[str, Any]] = {}
        for alike, placed in self._placed(points).items():
            times = instants_at_rate(0.0, alike.duration, alike.rate)
            if self._runner.of_ends:
                times = times[:: max(1, len(times) - 1)]
            lanes = self._lanes_for(alike)
            size = MOST_NUMBERS // (len(times) * (lanes.n + lanes.laws.width))
            if not lanes.possible or size < FEWEST:
                continue
            for first in range(0, len(placed), size):
                found |= self._together(lanes, placed[first : first + size], times, points)
        return found

    def _placed(self, points: Sequence[Mapping[str, float]]) -> dict[Alike, list[Placed]]:
        """The runs that can share lanes, by what they have to have in common."""
        family = self._runner.family
        groups: dict[Alike, list[Placed]] = {}
        if family is None or not isinstance(family.laws, ReducedLaws):
            return groups
        for index, values in enumerate(points):
            try:
                scene = self._runner.scene(values)
                if scene.simulation.method == "auto":
                    continue
                compiled = compile_scene(scene).sharing(family)
                options = at_its_size(scene).simulation
                method = compile_method(options, options.duration)
                instants = samples_at_rate(options.duration, options.rate)
            except RbSimError:  # said in the row of that run
                continue
            if compiled.laws is not family.laws or compiled.breakpoints or instants > MOST_NUMBERS:
                continue
            if compiled.absolute:  # lanes have one tolerance for all
                continue
            self._layout = compiled.layout
            given = family.laws.inputs.values(compiled.system, 0.0)
            alike = Alike(type(method), method, options.duration, options.rate)
            groups.setdefault(alike, []).append(Placed(index, compiled.y, given))
        return groups

    def _lanes_for(self, alike: Alike) -> Lanes:
        if alike not in self._lanes:
            family, layout = self._runner.family, self._layout
            assert family is not None and layout is not None
            columns = columns_of(layout, self._runner.quantities)
            self._lanes[alike] = Lanes(family.laws, alike.method, columns)
        return self._lanes[alike]

    def _together(
        self,
        lanes: Lanes,
        placed: Sequence[Placed],
        times: np.ndarray,
        points: Sequence[Mapping[str, float]],
    ) -> dict[int, dict[str, Any]]:
        """Rows of these runs; those that failed or took too long are left out."""
        end = time.perf_counter() + self._runner.loaded.plan.seconds_per_run
        starts = np.array([run.start for run in placed])
        given = np.array([run.given for run in placed]).reshape(len(placed), -1)
        runs = lanes.run(starts, given, times, lambda: time.perf_counter() < end)
        layout = self._layout
        assert layout is not None
        found = {}
        values = np.zeros((len(times), row_width(layout)))
        command = np.zeros((len(times), len(layout.commanded), 6))
        for k, run in enumerate(placed):
            if runs.statuses[k] != FINE:
                continue
            values[:, lanes.columns] = runs.samples[k]
            trajectory = Trajectory(block_of(times, values, layout, command), layout)
            with suppress(RbSimError):  # said in the row of that run
                outputs = self._runner.outputs(points[run.index], trajectory)
                found[run.index] = ended(int(runs.steps[k]), outputs)
        return found


def columns_of(layout: SampleLayout, quantities: Iterable[str]) -> list[int]:
    """The columns of a row of samples behind these names of expressions."""
    numbers = np.arange(float(row_width(layout)))[None]
    block = block_of(np.zeros(1), numbers, layout, np.zeros((1, len(layout.commanded), 6)))
    fields = [field for name in quantities if name != "t" for field in FIELDS.get(name, (name,))]
    found = [getattr(block, field).ravel().astype(int).tolist() for field in fields]
    return sorted({column for columns in found for column in columns})
