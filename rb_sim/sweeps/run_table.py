"""The table of a sweep, read a column at a time: a report of a million runs stays small."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.sweeps import storage
from rb_sim.sweeps.one_run import OK
from rb_sim.sweeps.plan import LoadedPlan

if TYPE_CHECKING:
    import pyarrow


class RunTable:
    """The rows of a sweep ordered by run; only the column that is asked for is in memory.

    Raises RbSimError where the folder holds no sweep.
    """

    def __init__(self, folder: Path) -> None:
        dataset = storage.open_dataset(folder)
        self.schema: pyarrow.Schema = dataset.schema
        self._files: list[str] = dataset.files
        runs = self._read("run", lambda values: values.to_numpy())
        in_order = bool((np.diff(runs) > 0).all())
        self._order = slice(None) if in_order else np.argsort(runs, kind="stable")
        self.runs = runs[self._order]
        """numbers of all runs, shape (rows,)."""
        self.ok = self._read("status", _is_ok)[self._order]
        """which runs came to their end, shape (rows,)."""

    def __len__(self) -> int:
        return len(self.runs)

    @property
    def good_runs(self) -> np.ndarray:
        """Numbers of the runs that came to their end, shape (good,)."""
        return self.runs[self.ok]

    def plan(self) -> LoadedPlan:
        """The plan that the table was made by. Raises RbSimError where it names none."""
        return storage.plan_of(self.schema)

    def label(self, name: str) -> str:
        """The name of a column with its unit."""
        about: Mapping[bytes, bytes] = self.schema.field(name).metadata or {}
        unit = about.get(b"unit", b"").decode()
        return f"{name} [{unit}]" if unit not in ("", "1") else name

    def column(self, name: str) -> np.ndarray:
        """A column of all runs as floats, shape (rows,)."""
        return self._read(name, lambda values: values.to_numpy().astype(float))[self._order]

    def good(self, name: str) -> np.ndarray:
        """A column of the runs that came to their end, shape (good,)."""
        values = self.column(name)
        return values if self.ok.all() else values[self.ok]

    def failures(self) -> dict[str, int]:
        """How many runs did not come to their end, by "status: reason"."""
        counts: Counter[str] = Counter()
        if not self.ok.all():
            for table in self._tables(["status", "reason"]):
                rows = zip(*(column.to_pylist() for column in table.columns), strict=True)
                counts.update(f"{status}: {why}" for status, why in rows if status != OK)
        return dict(counts)

    def _read(self, name: str, convert: Callable[[Any], np.ndarray]) -> np.ndarray:
        """A column of all files one after the other, each made an array by `convert`."""
        return np.concatenate([convert(table.column(0)) for table in self._tables([name])])

    def _tables(self, names: list[str]) -> Iterator[pyarrow.Table]:
        """These columns of one file after the other: to read ahead would outweigh them."""
        for file in self._files:
            yield storage.read(Path(file), names)


def _is_ok(status: Any) -> np.ndarray:
    compute: Any = import_module("pyarrow.compute")
    return compute.equal(status, OK).to_numpy().astype(bool)
