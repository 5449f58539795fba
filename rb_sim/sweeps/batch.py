"""A batch: the runs that one task of the scheduler does, written by the worker that does them."""

from __future__ import annotations

import functools
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rb_sim.sweeps.expressions import COMPONENTS
from rb_sim.sweeps.lane_runs import LaneRunner
from rb_sim.sweeps.one_run import OK, PlanRunner
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
from rb_sim.trajectory.tables import XYZ
from rb_sim.trajectory.trajectory import Trajectory


class Batch(NamedTuple):
    """The work of one task."""

    number: int
    runs: np.ndarray
    """numbers of the runs, shape (n,)."""
    values: dict[str, np.ndarray]
    """of the varied names, shape (n,) each."""
    bodies: tuple[str, ...]
    start: str = ""
    """of the sweep (see `storage.alone`)."""


class Done(NamedTuple):
    """What the scheduler gets of a batch; the rows themselves stay with the worker's file."""

    number: int
    runs: int
    failed: int


class BatchRunner:
    """Runs many points of a plan: through the machine's lanes where they can, else one at a time.

    lanes: False keeps all to one at a time.
    """

    def __init__(self, runner: PlanRunner, lanes: bool = True) -> None:
        self.runner = runner
        self._lanes = LaneRunner(runner) if lanes else None

    def rows(
        self, runs: Sequence[int], points: Sequence[Mapping[str, float]]
    ) -> Iterator[tuple[dict[str, Any], Trajectory | None]]:
        """(status, reason, steps and outputs, samples where they are to be kept) of each run."""
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
    """The runner of a plan, made once per worker."""
    data = json.loads(plan)
    runner = PlanRunner(LoadedPlan.from_dict(data["plan"]), data["looks"])
    return BatchRunner(runner, data["lanes"])


def described(
    loaded: LoadedPlan,
    looks: Sequence[Mapping[str, float]],
    lanes: bool = True,
) -> str:
    """What a worker has to know of a plan, as JSON.

    looks: values of a few runs (see PlanRunner).
    """
    description = {"plan": loaded.as_dict(), "looks": list(looks), "lanes": lanes}
    return json.dumps(description)


def do_batch(plan: str, folder: str, batch: Batch) -> Done:
    """Simulate the runs of a batch and write their rows below `folder`.

    plan: as `described` gives it.
    """
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
    """Write all samples of one run as Parquet, a column a component."""
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
