"""What a folder holds of a plan already: the runs that do not have to be done again.

A row belongs to a plan where the plan has a run of the same hash (see `PlanRunner.scene_hash`).  A
plan that grows, by draws or by points of a grid, numbers its runs anew, and so are the rows.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.errors import RbSimError
from rb_sim.sweeps.one_run import FAILED, GIVEN_UP
from rb_sim.sweeps.plan import Plan
from rb_sim.sweeps.storage import (
    arrow,
    batch_files,
    batch_number,
    plan_of,
    read,
    trajectory_file,
    write_table,
)

if TYPE_CHECKING:
    import pyarrow

NONE = -1
"""Instead of the number of a run: the plan has none such."""


def take_over(
    folder: Path, plan: Plan, hashes: np.ndarray, schema: pyarrow.Schema
) -> tuple[np.ndarray, int]:
    """(which runs of the plan the folder holds, shape (runs,); number of the next batch).

    hashes: of the plan's runs, as bytes, shape (runs,). schema: of a table by this plan.
    The rows get the numbers that this plan gives their runs, and its metadata. Rows that are to be
    done again are taken out: given up after less time than the plan allows, or without the samples
    that it keeps. Raises RbSimError where a row belongs to no run of the plan.
    """
    files = batch_files(folder)
    numbers = _numbered(folder, files, hashes)
    for before, now in numbers.values():  # samples are known by the number of their run
        for run in before[before != now].tolist():
            shutil.rmtree(trajectory_file(folder, run).parent, ignore_errors=True)
    held = np.zeros(len(hashes), dtype=bool)
    for path, (before, now) in numbers.items():
        table = read(path)
        kept = _kept(folder, table, now, plan)
        same = kept.all() and (before == now).all()
        if not same or not table.schema.equals(schema, check_metadata=True):
            _rewrite(path, table, now, kept, schema)
        held[now[kept]] = True
    return held, max((batch_number(path) + 1 for path in files), default=0)


def _numbered(
    folder: Path, files: list[Path], hashes: np.ndarray
) -> dict[Path, tuple[np.ndarray, np.ndarray]]:
    """The number of the run of each row, by file: (as it stands there, the plan's).

    Raises RbSimError where the plan has no run for a row.
    """
    order = np.argsort(hashes, kind="stable")
    free = np.ones(len(hashes), dtype=bool)
    found = {}
    for path in files:  # rows that have their number already, first
        runs, names = _runs_and_hashes(path)
        own = (runs >= 0) & (runs < len(hashes))
        own[own] = hashes[runs[own]] == names[own]
        own[own] = _first_of_each(runs[own]) & free[runs[own]]
        free[runs[own]] = False
        found[path] = (runs, np.where(own, runs, NONE))
    waiting: dict[bytes, Iterator[int]] = {}
    for path, (_, now) in found.items():
        rows = np.flatnonzero(now == NONE)
        if len(rows):
            for row, name in zip(rows, _runs_and_hashes(path)[1][rows], strict=True):
                numbers = waiting.setdefault(name, _same(hashes, order, free, name))
                now[row] = next(numbers, NONE)
    foreign = sum(int((now == NONE).sum()) for _, now in found.values())
    if foreign:
        raise RbSimError(
            f"{folder}: holds {foreign} rows that are no runs of this plan (another scene, other "
            "values, outputs or settings, or another version of rb_sim); must be another folder"
        )
    return found


def _first_of_each(numbers: np.ndarray) -> np.ndarray:
    """True where a number stands for the first time."""
    first = np.zeros(len(numbers), dtype=bool)
    first[np.unique(numbers, return_index=True)[1]] = True
    return first


def _same(hashes: np.ndarray, order: np.ndarray, free: np.ndarray, name: bytes) -> Iterator[int]:
    """Runs of that hash that no row had from the start."""
    for place in range(int(np.searchsorted(hashes, name, sorter=order)), len(order)):
        number = int(order[place])
        if hashes[number] != name:
            return
        if free[number]:
            yield number


def _runs_and_hashes(path: Path) -> tuple[np.ndarray, np.ndarray]:
    table = read(path, ["run", "scene_hash"])
    names = np.array(table.column("scene_hash").to_pylist(), dtype="S24")
    return table.column("run").to_numpy().copy(), names


def _kept(folder: Path, table: pyarrow.Table, runs: np.ndarray, plan: Plan) -> np.ndarray:
    """Which rows need not be done again. runs: the numbers that they have now."""
    status = np.array(table.column("status").to_pylist(), dtype=object)
    limit = plan_of(table.schema).plan.seconds_per_run
    kept = (status != GIVEN_UP) | (limit >= plan.seconds_per_run)
    for row in np.flatnonzero(kept & (runs < plan.trajectories) & (status != FAILED)):
        kept[row] = trajectory_file(folder, int(runs[row])).exists()
    return kept


def _rewrite(
    path: Path, table: pyarrow.Table, runs: np.ndarray, kept: np.ndarray, schema: pyarrow.Schema
) -> None:
    """Write the rows that are kept, with their numbers, in place of the file."""
    pa: Any = arrow()
    columns = [pa.array(runs) if name == "run" else table.column(name) for name in schema.names]
    renewed = pa.Table.from_arrays(columns, schema=schema).filter(pa.array(kept))
    if len(renewed):
        write_table(path, renewed)
    else:
        shutil.rmtree(path.parent)
