# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A folder that holds runs already: none twice, none lost, none of another plan."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from rb_sim.base.errors import RbSimError, SinkError
from rb_sim.sweeps import storage
from rb_sim.sweeps.batch import Batch, described, do_batch
from rb_sim.sweeps.one_run import GIVEN_UP, PlanRunner
from rb_sim.sweeps.plan import LoadedPlan, load_plan, points
from rb_sim.sweeps.storage import take_over
from rb_sim.sweeps.sweep import sweep
from rb_sim.sweeps.sweep_page import RunTable
from tests.sweeps.plans import plan

pytest.importorskip("pyarrow")


SPEED = "bodies.stone.linear_velocity[2]"


def listed(folder: Path, *speeds: float, **more: Any) -> LoadedPlan:
    """A plan over these speeds."""
    vary = {"speed": {"path": SPEED, "list": list(speeds)}}
    outputs = {"top": "max(position.stone.z)"}
    made = plan(folder, vary=vary, outputs=outputs, **more)
    return load_plan({key: value for key, value in made.items() if key != "draws"})


def do(folder: Path, loaded: LoadedPlan, runs: list[int], number: int = 0, start: str = "") -> None:
    """Those runs of the plan as one batch of it."""
    values = {name: column[runs] for name, column in points(loaded.plan).items()}
    do_batch(
        described(loaded, []), str(folder), Batch(number, np.array(runs), values, ("stone",), start)
    )


def taken(folder: Path, loaded: LoadedPlan) -> list[bool]:
    """Which runs of the plan need not be done."""
    runner, speeds = PlanRunner(loaded), points(loaded.plan)["speed"]
    hashes = np.array([runner.scene_hash({"speed": float(x)}) for x in speeds], dtype="S24")
    held, following = take_over(
        folder, loaded.plan, hashes, storage.table_schema(loaded, ("stone",))
    )
    assert following == len(storage.batch_files(folder)) or not held.all()
    return held.tolist()


def rows(folder: Path) -> list[tuple[int, float]]:
    """(run, speed) of the table."""
    table = storage.open_table(folder)
    return list(zip(table["run"].to_pylist(), table["speed"].to_pylist(), strict=True))


def test_runs_of_equal_values_are_counted_each(tmp_path: Path) -> None:
    loaded = listed(tmp_path, 1.0, 2.0, 1.0, 1.0)
    do(tmp_path, loaded, [0, 2])
    assert taken(tmp_path, loaded) == [True, False, True, False]


def test_a_plan_that_grows_gives_the_rows_its_own_numbers(tmp_path: Path) -> None:
    """The report fills a map by the number of the run, and reads the plan from the first file."""
    do(tmp_path, listed(tmp_path, 1.0, 3.0), [0])
    do(tmp_path, listed(tmp_path, 1.0, 3.0), [1], number=1)
    grown = listed(tmp_path, 0.0, 1.0, 2.0, 3.0)
    assert taken(tmp_path, grown) == [False, True, False, True]
    assert rows(tmp_path) == [(1, 1.0), (3, 3.0)]
    assert RunTable(tmp_path).plan().plan.runs == 4


def test_rows_of_another_plan_are_refused_and_stay(tmp_path: Path) -> None:
    do(tmp_path, listed(tmp_path, 1.0, 3.0), [0, 1])
    with pytest.raises(RbSimError, match="holds 1 rows that are no runs of this plan") as caught:
        taken(tmp_path, listed(tmp_path, 1.0, 2.0))
    assert "\n" not in str(caught.value)
    assert rows(tmp_path) == [(0, 1.0), (1, 3.0)]


def test_what_was_given_up_is_done_again_where_it_gets_more_time(tmp_path: Path) -> None:
    short = listed(tmp_path, 1.0, 2.0, seconds_per_run=1.0)
    do(tmp_path, short, [0, 1])
    path = storage.batch_file(tmp_path, 0)
    table = storage.read(path)
    status = pa.array([GIVEN_UP, "ok"])
    storage.write_table(
        path, table.set_column(table.column_names.index("status"), "status", status)
    )
    assert taken(tmp_path, short) == [True, True]
    assert taken(tmp_path, listed(tmp_path, 1.0, 2.0, seconds_per_run=2.0)) == [False, True]
    assert rows(tmp_path) == [(1, 2.0)]


def test_runs_whose_samples_are_asked_for_later_are_done_again(tmp_path: Path) -> None:
    do(tmp_path, listed(tmp_path, 1.0, 2.0), [0, 1])
    more = listed(tmp_path, 1.0, 2.0, trajectories=1)
    assert taken(tmp_path, more) == [False, True]
    do(tmp_path, more, [0], number=1)
    assert taken(tmp_path, more) == [True, True]
    moved = listed(tmp_path, 0.0, 1.0, 2.0, trajectories=1)  # samples are known by the number
    assert taken(tmp_path, moved) == [False, True, True]
    assert not storage.trajectory_file(tmp_path, 0).exists()


def test_a_file_that_is_no_table_is_named(tmp_path: Path) -> None:
    path = storage.batch_file(tmp_path, 0)
    path.parent.mkdir(parents=True)
    path.write_text("no parquet")
    for act in (lambda: taken(tmp_path, listed(tmp_path, 1.0)), lambda: RunTable(tmp_path)):
        with pytest.raises(RbSimError) as caught:
            act()
        assert "\n" not in str(caught.value) and str(tmp_path) in str(caught.value)


def test_two_sweeps_do_not_write_into_one_folder(tmp_path: Path) -> None:
    with storage.alone(tmp_path), pytest.raises(RbSimError, match="another sweep is writing"):
        sweep(listed(tmp_path, 1.0), tmp_path)
    with storage.alone(tmp_path):  # it is let go at the end
        pass


def test_a_worker_of_a_killed_sweep_leaves_the_folder_to_the_next(tmp_path: Path) -> None:
    """It goes on with its batch on a cluster; its number is another batch's by then."""
    loaded = listed(tmp_path, 1.0, 2.0)
    with storage.alone(tmp_path) as killed:
        pass
    do(tmp_path, loaded, [0], start=killed)
    assert rows(tmp_path) == [(0, 1.0)]
    with storage.alone(tmp_path) as start:
        do(tmp_path, loaded, [1], number=0, start=killed)
        do(tmp_path, loaded, [1], number=1, start=start)
    assert rows(tmp_path) == [(0, 1.0), (1, 2.0)]


def test_a_full_disk_is_said_in_one_line_and_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: Any, path: Path, **__: Any) -> None:
        path.write_text("half")
        raise OSError(28, "Error writing bytes to file. Detail: [errno 28] No space left on device")

    monkeypatch.setattr(storage.arrow().parquet, "write_table", full)
    with pytest.raises(SinkError) as caught:
        do(tmp_path, listed(tmp_path, 1.0), [0])
    path = storage.batch_file(tmp_path, 0)
    assert str(caught.value).startswith(f"{path}: cannot be written: No space left on device;")
    assert list(path.parent.iterdir()) == []
    assert "\n" not in str(caught.value)


# The table of a report: rows by run, failures by reason, one column in memory at a time.


pytest.importorskip("pyarrow")


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
