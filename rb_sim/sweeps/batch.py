"""A batch: the runs that one task of the scheduler does, written by the worker that does them."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rb_sim.sweeps.one_run import OK, PlanRunner
from rb_sim.sweeps.plan import LoadedPlan
from rb_sim.sweeps.storage import (
    TRAJECTORIES,
    arrow,
    batch_file,
    table_schema,
    write_rows,
    write_table,
)
from rb_sim.trajectory import Trajectory


class Batch(NamedTuple):
    """The work of one task."""

    number: int
    runs: np.ndarray
    """numbers of the runs, shape (n,)."""
    values: dict[str, np.ndarray]
    """of the varied names, shape (n,) each."""
    bodies: tuple[str, ...]


class Done(NamedTuple):
    """What the scheduler is told of a batch; the rows themselves stay with the worker's file."""

    number: int
    runs: int
    failed: int


@functools.lru_cache(maxsize=2)
def _runner(plan: str) -> PlanRunner:
    """The runner of a plan, made once per worker."""
    data = json.loads(plan)
    return PlanRunner(LoadedPlan.from_dict(data["plan"]), data["looks"])


def described(loaded: LoadedPlan, looks: Sequence[Mapping[str, float]]) -> str:
    """What a worker has to know of a plan, as JSON.

    looks: values of a few runs (see PlanRunner).
    """
    return json.dumps({"plan": loaded.as_dict(), "looks": list(looks)})


def do_batch(plan: str, folder: str, batch: Batch) -> Done:
    """Simulate the runs of a batch and write their rows below `folder`.

    plan: as `described` gives it.
    """
    runner = _runner(plan)
    schema = table_schema(runner.loaded, batch.bodies)
    rows: list[dict[str, Any]] = []
    for i, run in enumerate(batch.runs.tolist()):
        values = {name: float(column[i]) for name, column in batch.values.items()}
        row, trajectory = runner.run(values)
        rows.append({"run": run, "scene_hash": runner.scene_hash(values), **values, **row})
        if trajectory is not None and run < runner.loaded.plan.trajectories:
            write_trajectory(Path(folder), run, trajectory)
    write_rows(batch_file(Path(folder), batch.number), rows, schema)
    return Done(batch.number, len(rows), sum(row["status"] != OK for row in rows))


def write_trajectory(folder: Path, run: int, trajectory: Trajectory) -> None:
    """Write all samples of one run as Parquet, a column a component."""
    columns: dict[str, np.ndarray] = {"t": trajectory.t, "energy": trajectory.energy}
    for quantity in ("position", "orientation", "linear_velocity", "angular_velocity"):
        for body, values in getattr(trajectory, quantity).items():
            for i in range(values.shape[1]):
                columns[f"{quantity}.{body}.{'xyzw'[i]}"] = values[:, i]
    for name, reaction in trajectory.reaction.items():
        for part in ("force", "torque"):
            for i in range(3):
                columns[f"reaction.{name}.{part}.{'xyz'[i]}"] = getattr(reaction, part)[:, i]
    path = folder / TRAJECTORIES / f"run={run:08d}" / "part.parquet"
    write_table(path, arrow().table(columns))
