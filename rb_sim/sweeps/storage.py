# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The table of runs on disk (Parquet), and reuse of the runs that it contains."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.base import __version__
from rb_sim.base.errors import MissingExtraError, RbSimError, SinkError
from rb_sim.sweeps.expressions import final_units
from rb_sim.sweeps.one_run import FAILED, GIVEN_UP
from rb_sim.sweeps.plan import LoadedPlan, Plan

if TYPE_CHECKING:
    import pyarrow


# The table of runs: a Parquet dataset, one file per batch, written atomically.
#
# Readable by pandas.read_parquet(DIR/runs), polars.scan_parquet, DuckDB and Dask.


RUNS, TRAJECTORIES = "runs", "trajectories"
"""Folders of a sweep: the table, and the samples of some runs."""


def arrow() -> Any:
    """The module pyarrow. Raises MissingExtraError if it is not installed."""
    try:
        import pyarrow
        import pyarrow.dataset
        import pyarrow.parquet  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("pyarrow", "sweep", "a sweep's table") from error
    return pyarrow


def table_schema(loaded: LoadedPlan, bodies: tuple[str, ...]) -> pyarrow.Schema:
    """Columns of the table with units; plan, scene and versions as metadata of the schema."""
    pa, plan = arrow(), loaded.plan

    def column(name: str, unit: str) -> Any:
        return pa.field(name, pa.float64(), metadata={"unit": unit})

    fields = [
        pa.field("run", pa.int64()),
        pa.field("scene_hash", pa.string()),
        pa.field("status", pa.string()),
        pa.field("reason", pa.string()),
        pa.field("steps", pa.int64()),
    ]
    fields += [column(name, vary.unit) for name, vary in plan.vary.items()]
    fields += [column(name, output.unit) for name, output in plan.outputs.items()]
    if plan.final_state:
        fields += [column(name, unit) for name, unit in final_units(bodies).items()]
    about = {"rb_sim": __version__, "plan": json.dumps(loaded.as_dict())}
    return pa.schema(fields, metadata=about)


def batch_file(folder: Path, batch: int) -> Path:
    """Path of the rows of a batch."""
    return folder / RUNS / f"batch={batch:06d}" / "part.parquet"


def write_rows(path: Path, rows: list[dict[str, Any]], schema: pyarrow.Schema) -> None:
    """Write the rows as one Parquet file, atomically. Raises SinkError."""
    pa = arrow()
    write_table(path, pa.Table.from_pylist(rows, schema=schema))


def write_table(path: Path, table: pyarrow.Table) -> None:
    """Write a table as one Parquet file, atomically. Raises SinkError if it cannot be written."""
    pa = arrow()
    unfinished = path.parent / f".{path.name}.{os.getpid()}"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        pa.parquet.write_table(table, unfinished, compression="zstd")
        os.replace(unfinished, path)
    except OSError as error:
        unfinished.unlink(missing_ok=True)
        why = os.strerror(error.errno) if error.errno else error
        raise SinkError(
            f"{path}: cannot be written: {why}; finished runs are kept; repeat the command "
            "to continue"
        ) from None


def batch_files(folder: Path) -> list[Path]:
    """Files of the table, ordered by batch number."""
    return sorted((folder / RUNS).glob("batch=*/part.parquet"))


def batch_number(path: Path) -> int:
    """Number of the batch in that file. Raises RbSimError if it has none."""
    try:
        return int(path.parent.name.removeprefix("batch="))
    except ValueError:
        raise RbSimError(f"{path}: not the table of a sweep") from None


def trajectory_file(folder: Path, run: int) -> Path:
    """Path of the samples of a run."""
    return folder / TRAJECTORIES / f"run={run:08d}" / "part.parquet"


def read(path: Path, columns: list[str] | None = None) -> pyarrow.Table:
    """These columns of a file of the table (all if None).

    Raises RbSimError if it is not the table of a sweep.
    """
    pa = arrow()
    try:
        return pa.parquet.ParquetFile(path).read(columns=columns, use_threads=False)
    except (pa.ArrowException, OSError) as error:
        why = str(error).splitlines()[0]
        raise RbSimError(f"{path}: cannot be read as a table of a sweep: {why}") from None


def plan_of(schema: pyarrow.Schema) -> LoadedPlan:
    """The plan of a table. Raises RbSimError if it contains none."""
    try:
        return LoadedPlan.from_dict(json.loads(schema.metadata[b"plan"]))
    except (TypeError, KeyError, ValueError):
        raise RbSimError("the table was not written by a sweep: it names no plan") from None


def start_file(folder: Path) -> Path:
    """File with the identifier of the sweep that writes in the folder and locks the file."""
    return folder / ".start"


def is_overtaken(folder: Path, start: str) -> bool:
    """Whether another sweep is writing in the folder now, and will do the remaining runs.

    A worker of a cluster completes its batch even if its sweep was killed.
    """
    try:
        return start_file(folder).read_text() != start
    except OSError:
        return False


@contextmanager
def alone(folder: Path) -> Iterator[str]:
    """Lock the folder for this sweep, creating it if needed; yields the identifier of this start.

    Raises RbSimError if another sweep holds the lock, or the folder cannot be written.
    """
    try:
        (folder / RUNS).mkdir(parents=True, exist_ok=True)
        lock = start_file(folder).open("a+")
    except OSError as error:
        raise RbSimError(f"{folder}: cannot be written: {error.strerror}") from None
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # released when this process ends
        except OSError:
            raise RbSimError(
                f"{folder}: another sweep is writing there; must be another folder, or wait"
            ) from None
        start = uuid.uuid4().hex
        lock.truncate(0)
        lock.write(start)
        lock.flush()
        yield start


def open_dataset(folder: Path) -> Any:
    """The dataset of a sweep, not yet read. Raises RbSimError if there is none."""
    pa = arrow()
    if not batch_files(folder):
        raise RbSimError(
            f"{folder}: not the folder of a sweep (it has no {RUNS}/batch=*/part.parquet)"
        )
    try:
        return pa.dataset.dataset(folder / RUNS, format="parquet", partitioning=None)
    except (pa.ArrowException, OSError) as error:
        raise RbSimError(f"{folder}: {str(error).splitlines()[0]}") from None


def open_table(folder: Path) -> pyarrow.Table:
    """All rows of a sweep, ordered by run. Raises RbSimError if the folder has none."""
    dataset = open_dataset(folder)
    table = dataset.to_table().sort_by("run")
    return table.replace_schema_metadata(dataset.schema.metadata)


# Reuse of the runs of a plan that a folder already contains.
#
# A row belongs to a plan if the plan has a run with the same hash (see `PlanRunner.scene_hash`). A
# plan that grew, by draws or grid points, numbers its runs differently; rows are renumbered.


NONE = -1
"""Run number of a row that belongs to no run of the plan."""


def take_over(
    folder: Path, plan: Plan, hashes: np.ndarray, schema: pyarrow.Schema
) -> tuple[np.ndarray, int]:
    """(mask of the plan's runs that the folder contains, shape (runs,); number of the next batch).

    hashes: of the plan's runs, as bytes, shape (runs,). schema: of a table of this plan. The rows
    get this plan's run numbers and metadata. Rows are deleted if their run must be repeated: it
    exceeded a shorter time limit, or its samples are missing. Raises RbSimError if a row belongs to
    no run of the plan.
    """
    files = batch_files(folder)
    columns = [_runs_and_hashes(path) for path in files]
    sizes = np.cumsum([len(runs) for runs, _ in columns])
    before = np.concatenate([np.empty(0, int), *(runs for runs, _ in columns)])
    names = np.concatenate([np.empty(0, "S24"), *(name for _, name in columns)])
    now = _numbered(before, names, hashes)
    if foreign := int((now == NONE).sum()):
        raise RbSimError(
            f"{folder}: holds {foreign} rows that are no runs of this plan (another scene, other "
            "values, outputs or settings, or another version of rb_sim); must be another folder"
        )
    for run in before[before != now].tolist():  # samples are stored under the old run number
        shutil.rmtree(trajectory_file(folder, run).parent, ignore_errors=True)
    held = np.zeros(len(hashes), dtype=bool)
    for path, old, new in zip(files, np.split(before, sizes), np.split(now, sizes), strict=False):
        table = read(path)
        kept = _kept(folder, table, new, plan)
        same = kept.all() and (old == new).all()
        if not same or not table.schema.equals(schema, check_metadata=True):
            _rewrite(path, table, new, kept, schema)
        held[new[kept]] = True
    return held, max((batch_number(path) + 1 for path in files), default=0)


def _numbered(before: np.ndarray, names: np.ndarray, hashes: np.ndarray) -> np.ndarray:
    """The plan's run number for each row, NONE if there is none.

    before: numbers so far, names: hashes of the rows. Runs of equal values are matched in order:
    the k-th row to the k-th run.
    """
    order = np.argsort(hashes, kind="stable")
    wanted = hashes[order]
    rows = np.lexsort((before, names))
    names = names[rows]
    place = np.searchsorted(wanted, names) + np.arange(len(names)) - np.searchsorted(names, names)
    found = place < len(wanted)
    found[found] = wanted[place[found]] == names[found]
    now = np.full(len(names), NONE)
    now[rows[found]] = order[place[found]]
    return now


def _runs_and_hashes(path: Path) -> tuple[np.ndarray, np.ndarray]:
    table = read(path, ["run", "scene_hash"])
    names = np.array(table.column("scene_hash").to_pylist(), dtype="S24")
    return table.column("run").to_numpy(), names


def _kept(folder: Path, table: pyarrow.Table, runs: np.ndarray, plan: Plan) -> np.ndarray:
    """Mask of the rows whose runs need not be repeated. runs: their present numbers."""
    status = np.array(table.column("status").to_pylist(), dtype=object)
    limit = plan_of(table.schema).plan.seconds_per_run
    kept = (status != GIVEN_UP) | (limit >= plan.seconds_per_run)
    for row in np.flatnonzero(kept & (runs < plan.trajectories) & (status != FAILED)):
        kept[row] = trajectory_file(folder, int(runs[row])).exists()
    return kept


def _rewrite(
    path: Path, table: pyarrow.Table, runs: np.ndarray, kept: np.ndarray, schema: pyarrow.Schema
) -> None:
    """Replace the file by the kept rows with their new numbers; delete it if there are none."""
    pa: Any = arrow()
    columns = [pa.array(runs) if name == "run" else table.column(name) for name in schema.names]
    renewed = pa.Table.from_arrays(columns, schema=schema).filter(pa.array(kept))
    if len(renewed):
        write_table(path, renewed)
    else:
        shutil.rmtree(path.parent)
