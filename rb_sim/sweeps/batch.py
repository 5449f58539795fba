# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A batch: the runs of one task of the scheduler, simulated and written by a worker."""

from __future__ import annotations

import functools
import json
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rb_sim.base.errors import RbSimError
from rb_sim.integrate.layout import FINE
from rb_sim.mechanics.lane_motions import Lanes
from rb_sim.mechanics.laws import ReducedLaws
from rb_sim.mechanics.samples import SampleLayout, block_of, row_width
from rb_sim.motion.motion import instants_at_rate, samples_at_rate
from rb_sim.scene.compile import compile_method, compile_scene
from rb_sim.scene.place import at_its_size
from rb_sim.simulation.trajectory import XYZ, Trajectory
from rb_sim.sweeps.expressions import COMPONENTS
from rb_sim.sweeps.one_run import OK, PlanRunner, ended
from rb_sim.sweeps.plan import LoadedPlan
from rb_sim.sweeps.storage import (
    arrow,
    batch_file,
    is_overtaken,
    table_schema,
    trajectory_file,
    write_rows,
    write_table,
)

# Simulation of many runs at once in the processor's vector lanes (SIMD).
#
# Runs that do not support it (contacts, several bodies, tables over time, implicit methods, `auto`)
# or exceed the time limit are left to `PlanRunner.run`, one at a time.


MOST_NUMBERS = 1 << 21
"""Maximum number of sample values in memory for the runs simulated together: 16 MB."""

FEWEST = 8
"""Minimum number of runs that share the lanes; if memory allows fewer, each is simulated alone."""


FIELDS = {
    "reaction": ("reaction_force", "reaction_torque", "anchor"),
    "energy": ("kinetic_energy", "potential_energy"),
}
"""Fields of a block for a name in an expression, if they have other names."""


class Placed(NamedTuple):
    """A run that is ready to start."""

    index: int
    """index in the batch."""
    start: tuple[float, ...]
    given: list[float]
    """values of the laws' inputs."""


class Alike(NamedTuple):
    """Settings that runs in the same lanes must share: method, duration, rate."""

    kind: type
    method: Any
    duration: float
    rate: float


class LaneRunner:
    """Simulates many points of one plan in lanes, which are compiled once."""

    def __init__(self, runner: PlanRunner) -> None:
        self._runner = runner
        self._lanes: dict[Alike, Lanes] = {}
        self._layout: SampleLayout | None = None

    def rows(self, points: Sequence[Mapping[str, float]]) -> dict[int, dict[str, Any]]:
        """Table rows of the runs simulated in lanes, by index; the others must be run singly."""
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
        """Runs that can use lanes, by their common settings."""
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
            except RbSimError:  # reported in the row of that run
                continue
            if compiled.laws is not family.laws or compiled.breakpoints or instants > MOST_NUMBERS:
                continue
            if compiled.absolute:  # lanes do not support tolerances of single bodies
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
        """Table rows of these runs, without those that failed or took too long."""
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
            with suppress(RbSimError):  # reported in the row of that run
                outputs = self._runner.outputs(points[run.index], trajectory)
                found[run.index] = ended(int(runs.steps[k]), outputs)
        return found


def columns_of(layout: SampleLayout, quantities: Iterable[str]) -> list[int]:
    """Columns of a sample row that these names of expressions need."""
    numbers = np.arange(float(row_width(layout)))[None]
    block = block_of(np.zeros(1), numbers, layout, np.zeros((1, len(layout.commanded), 6)))
    fields = [field for name in quantities if name != "t" for field in FIELDS.get(name, (name,))]
    found = [getattr(block, field).ravel().astype(int).tolist() for field in fields]
    return sorted({column for columns in found for column in columns})


class Batch(NamedTuple):
    """The runs of one task."""

    number: int
    runs: np.ndarray
    """numbers of the runs, shape (n,)."""
    values: dict[str, np.ndarray]
    """values of the varied names, shape (n,) each."""
    bodies: tuple[str, ...]
    start: str = ""
    """identifier of the sweep's start (see `storage.alone`)."""


class Done(NamedTuple):
    """Result of a batch for the scheduler; the rows themselves are in the worker's file."""

    number: int
    runs: int
    failed: int


class BatchRunner:
    """Runs points of a plan: in lanes if possible, else singly. lanes: False disables lanes."""

    def __init__(self, runner: PlanRunner, lanes: bool = True) -> None:
        self.runner = runner
        self._lanes = LaneRunner(runner) if lanes else None

    def rows(
        self, runs: Sequence[int], points: Sequence[Mapping[str, float]]
    ) -> Iterator[tuple[dict[str, Any], Trajectory | None]]:
        """Yield (status, reason, steps and outputs; samples to be kept or None) of each run."""
        kept = self.runner.loaded.plan.trajectories
        together = [i for i, run in enumerate(runs) if run >= kept]
        found: dict[int, dict[str, Any]] = {}
        if self._lanes is not None:
            rows = self._lanes.rows([points[i] for i in together])
            found = {together[k]: row for k, row in rows.items()}
        for i, run in enumerate(runs):
            if i in found:
                yield found[i], None
            else:
                row, trajectory = self.runner.run(points[i])
                yield row, trajectory if run < kept else None


@functools.lru_cache(maxsize=2)
def _runner(plan: str) -> BatchRunner:
    """The runner of a plan, created once per worker."""
    data = json.loads(plan)
    runner = PlanRunner(LoadedPlan.from_dict(data["plan"]), data["looks"])
    return BatchRunner(runner, data["lanes"])


def described(
    loaded: LoadedPlan,
    looks: Sequence[Mapping[str, float]],
    lanes: bool = True,
) -> str:
    """The plan for a worker, as JSON. looks: values of a few runs (see PlanRunner)."""
    description = {"plan": loaded.as_dict(), "looks": list(looks), "lanes": lanes}
    return json.dumps(description)


def do_batch(plan: str, folder: str, batch: Batch) -> Done:
    """Simulate the runs of a batch and write their rows to `folder`. plan: from `described`."""
    several = _runner(plan)
    runner = several.runner
    schema = table_schema(runner.loaded, batch.bodies)
    runs = batch.runs.tolist()
    columns = {name: column.tolist() for name, column in batch.values.items()}
    points = [
        dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)
    ]
    rows: list[dict[str, Any]] = []
    for run, values, (row, trajectory) in zip(
        runs, points, several.rows(runs, points), strict=True
    ):
        rows.append({"run": run, "scene_hash": runner.scene_hash(values), **values, **row})
        if trajectory is not None:
            write_trajectory(Path(folder), run, trajectory)
    if not is_overtaken(Path(folder), batch.start):
        write_rows(batch_file(Path(folder), batch.number), rows, schema)
    return Done(batch.number, len(rows), sum(row["status"] != OK for row in rows))


def write_trajectory(folder: Path, run: int, trajectory: Trajectory) -> None:
    """Write all samples of one run as Parquet, one column for each component."""
    columns: dict[str, np.ndarray] = {"t": trajectory.t, "energy": trajectory.energy}
    for quantity, (components, _) in COMPONENTS.items():
        for body, values in getattr(trajectory, quantity).items():
            for i, component in enumerate(components):
                columns[f"{quantity}.{body}.{component}"] = values[:, i]
    for name, reaction in trajectory.reaction.items():
        for part in ("force", "torque"):
            for i, component in enumerate(XYZ):
                columns[f"reaction.{name}.{part}.{component}"] = getattr(reaction, part)[:, i]
    write_table(trajectory_file(folder, run), arrow().table(columns))
