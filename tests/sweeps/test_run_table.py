# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The table of a report: rows by run, failures by reason, one column in memory at a time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pyarrow")

from rb_sim.sweeps import storage
from rb_sim.sweeps.plan import load_plan
from rb_sim.sweeps.report import RunTable
from tests.sweeps.plans import plan


def _written(folder: Path, batches: list[list[int]], outputs: int) -> None:
    """A table of made-up runs: output k of run i is i + k / 100; every seventh run failed."""
    names = [f"o{k}" for k in range(outputs)]
    loaded = load_plan(plan(folder, outputs={name: "last(energy)" for name in names}))
    schema = storage.table_schema(loaded, ("stone",))
    for number, runs in enumerate(batches):
        rows = [
            {"run": run, "scene_hash": str(run), "steps": 1, "speed": 0.0, "start": 0.0}
            | {"status": "ok", "reason": ""}
            | ({"status": "failed", "reason": "why"} if run % 7 == 0 else {})
            | {name: run + k / 100 for k, name in enumerate(names)}
            for run in runs
        ]
        storage.write_rows(storage.batch_file(folder, number), rows, schema)


def test_columns_are_ordered_by_run_and_without_what_failed(tmp_path: Path) -> None:
    _written(tmp_path, [[8, 3], [7, 1], [14, 2]], outputs=2)
    table = RunTable(tmp_path)
    assert table.runs.tolist() == [1, 2, 3, 7, 8, 14]
    assert table.column("o1").tolist() == [run + 0.01 for run in (1, 2, 3, 7, 8, 14)]
    assert table.good_runs.tolist() == [1, 2, 3, 8]
    assert table.good("o0").tolist() == [1.0, 2.0, 3.0, 8.0]
    assert table.failures() == {"failed: why": 2}
    whole = storage.open_table(tmp_path)
    assert np.array_equal(whole.column("o1").to_numpy(), table.column("o1"))


def test_only_the_column_asked_for_is_in_memory(tmp_path: Path) -> None:
    runs = list(range(1, 6001))
    _written(tmp_path, [runs[:3000], runs[3000:]], outputs=10)
    import pyarrow as pa

    before = pa.total_allocated_bytes()
    table = RunTable(tmp_path)
    columns = [table.column(f"o{k}") for k in range(10)]
    assert len(columns[-1]) == 6000
    assert pa.total_allocated_bytes() - before < 2 * columns[0].nbytes
