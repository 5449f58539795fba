"""The table of runs: a Parquet dataset, one file a batch, written whole or not at all.

pandas.read_parquet(DIR/runs), polars.scan_parquet, DuckDB and Dask read it in one line each.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rb_sim import __version__
from rb_sim.errors import MissingExtraError, RbSimError
from rb_sim.sweeps.plan import LoadedPlan
from rb_sim.sweeps.samples import final_units

if TYPE_CHECKING:
    import pyarrow

RUNS, TRAJECTORIES = "runs", "trajectories"
"""Folders of a sweep: the table, and all samples of a few runs."""


def arrow() -> Any:
    """The module pyarrow; raises MissingExtraError where it is not installed."""
    try:
        import pyarrow
        import pyarrow.dataset
        import pyarrow.parquet  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("pyarrow", "sweep", "a sweep's table") from error
    return pyarrow


def table_schema(loaded: LoadedPlan, bodies: tuple[str, ...]) -> pyarrow.Schema:
    """Columns of the table with their units; plan, scene and versions in the schema's metadata."""
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
    """Where the rows of a batch are kept."""
    return folder / RUNS / f"batch={batch:06d}" / "part.parquet"


def write_rows(path: Path, rows: list[dict[str, Any]], schema: pyarrow.Schema) -> None:
    """Write the rows as one Parquet file that is there whole or not at all."""
    pa = arrow()
    write_table(path, pa.Table.from_pylist(rows, schema=schema))


def write_table(path: Path, table: pyarrow.Table) -> None:
    """Write a table as one Parquet file that is there whole or not at all."""
    pa = arrow()
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.parent / f".{path.name}.{os.getpid()}"
    pa.parquet.write_table(table, unfinished, compression="zstd")
    os.replace(unfinished, path)


def finished(folder: Path) -> tuple[set[str], int]:
    """(hashes of the runs that the folder's table holds, number of the next batch)."""
    done: set[str] = set()
    batches = [-1]
    for path in sorted((folder / RUNS).glob("batch=*/part.parquet")):
        batches.append(int(path.parent.name.removeprefix("batch=")))
        table = arrow().parquet.read_table(path, columns=["scene_hash"], partitioning=None)
        done.update(table.column("scene_hash").to_pylist())
    return done, max(batches) + 1


def open_dataset(folder: Path) -> Any:
    """The dataset of a sweep, nothing of it read yet. Raises RbSimError where there is none."""
    pa = arrow()
    if not any((folder / RUNS).glob("batch=*/part.parquet")):
        raise RbSimError(
            f"{folder}: is no folder of a sweep (it has no {RUNS}/batch=*/part.parquet)"
        )
    return pa.dataset.dataset(folder / RUNS, format="parquet", partitioning=None)


def open_table(folder: Path) -> pyarrow.Table:
    """All rows of a sweep, ordered by run. Raises RbSimError where the folder holds none."""
    dataset = open_dataset(folder)
    table = dataset.to_table().sort_by("run")
    return table.replace_schema_metadata(dataset.schema.metadata)
