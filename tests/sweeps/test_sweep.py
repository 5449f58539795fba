"""Whole sweeps on real workers: every run once, right, resumed, and the same however it is cut."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pyarrow")
pytest.importorskip("distributed")

import duckdb
import pandas as pd
import polars as pl
from dask import dataframe as dd
from distributed import Client

from rb_sim.errors import RbSimError
from rb_sim.sweeps import sweep
from rb_sim.sweeps.one_run import GIVEN_UP, PlanRunner
from rb_sim.sweeps.plan import LoadedPlan, load_plan
from tests.sweeps.plans import height, plan

PATIENCE = 240.0


class Cluster:
    """A scheduler and two workers, each a process that a test can kill."""

    def __init__(self, folder: Path) -> None:
        self.file = folder / "scheduler.json"
        self.processes = [self._start("scheduler", "--no-dashboard", "--port", "0")]
        worker = ("worker", "--nthreads", "1", "--no-nanny", "--no-dashboard")
        self.processes += [self._start(*worker) for _ in range(2)]
        end = time.monotonic() + PATIENCE
        while not self.file.exists() and time.monotonic() < end:
            time.sleep(0.05)
        self.address = json.loads(self.file.read_text())["address"]
        with Client(self.address, timeout=PATIENCE) as client:
            client.wait_for_workers(2, timeout=PATIENCE)
            pids = client.run(os.getpid)
        self.worker_pids = list(pids.values())

    def _start(self, *arguments: str) -> subprocess.Popen:
        root = str(Path(__file__).resolve().parents[2])
        environment = {**os.environ, "PYTHONPATH": root}
        command = [sys.executable, "-m", "distributed.cli.dask_" + arguments[0], *arguments[1:]]
        return subprocess.Popen(
            [*command, "--scheduler-file", str(self.file)],
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def close(self) -> None:
        for process in reversed(self.processes):
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    started = Cluster(tmp_path_factory.mktemp("cluster"))
    yield started
    started.close()


def columns(result: Any) -> dict[str, np.ndarray]:
    table = result.table()
    return {name: table.column(name).to_numpy(zero_copy_only=False) for name in table.column_names}


def test_a_killed_worker_costs_nothing_but_time(cluster: Cluster, tmp_path: Path) -> None:
    victims = list(cluster.worker_pids[:1])

    def kill(done: int, total: int, failed: int) -> None:
        if victims:
            os.kill(victims.pop(), signal.SIGKILL)

    description = plan(tmp_path, draws=200)
    result = sweep(description, tmp_path / "out", scheduler=cluster.address, batch=7, progress=kill)
    assert not victims
    found = columns(result)
    assert found["run"].tolist() == list(range(200))
    assert set(found["status"]) == {"ok"}
    assert found["height"] == pytest.approx(height(found["speed"], found["start"]), abs=1e-13)
    # the mean of a linear function of the draws is that function of their means, to the bit of sums
    assert found["height"].mean() == pytest.approx(
        height(found["speed"].mean(), found["start"].mean()), abs=1e-13
    )


def test_one_and_two_workers_a_cut_and_a_resumed_sweep_agree_to_the_bit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, workers = sys.modules["rb_sim.sweeps.sweep"], []
    run_batches = module.run_batches

    def counting(connected: Any, *rest: Any) -> None:
        workers.append(len(connected.scheduler_info()["workers"]))
        run_batches(connected, *rest)

    monkeypatch.setattr(module, "run_batches", counting)
    description = plan(tmp_path)
    two = columns(sweep(description, tmp_path / "two", workers=2, batch=7))
    cut = tmp_path / "cut"
    sweep({**description, "draws": 10}, cut, workers=1)
    resumed = sweep(description, cut, workers=1, batch=11)
    assert resumed.reused == 10
    one = columns(resumed)
    for name in two:
        assert (one[name] == two[name]).all(), name
    assert sweep(description, cut, workers=1).reused == 40
    assert workers == [2, 1, 1]  # the last one had nothing to do
    readable_by_everybody(cut, two)


def readable_by_everybody(folder: Path, expected: dict[str, np.ndarray]) -> None:
    """One line each, as docs/sweeps.md says."""
    runs = folder / "runs"
    total = expected["height"].sum()
    assert pd.read_parquet(runs)["height"].sum() == pytest.approx(total)
    assert pl.scan_parquet(runs / "**/*.parquet").collect()["height"].sum() == pytest.approx(total)
    query = f"select sum(height) from read_parquet('{runs}/*/*.parquet')"
    assert duckdb.sql(query).fetchall()[0][0] == pytest.approx(total)
    assert dd.read_parquet(runs)["height"].sum().compute() == pytest.approx(total)


def test_units_plan_and_scene_are_in_the_schema(tmp_path: Path) -> None:
    description = plan(tmp_path, draws=3, final_state=True, trajectories=1)
    result = sweep(description, tmp_path / "out", workers=1)
    table = result.table()
    assert table.schema.field("height").metadata[b"unit"] == b"m"
    assert table.schema.field("linear_velocity.stone.z").metadata[b"unit"] == b"m/s"
    again = LoadedPlan.from_dict(json.loads(table.schema.metadata[b"plan"]))
    assert again.plan.vary.keys() == description["vary"].keys()
    assert "stone" in again.scene["bodies"]
    kept = pd.read_parquet(tmp_path / "out" / "trajectories")
    assert kept["position.stone.z"].iloc[-1] == table.column("height")[0].as_py()


def test_the_order_of_what_varies_survives_the_way_to_a_worker(tmp_path: Path) -> None:
    """It says which Sobol index belongs to which name."""
    loaded = load_plan(plan(tmp_path))
    assert list(loaded.plan.vary) == ["speed", "start"]
    swapped = {"vary": dict(reversed(list(plan(tmp_path)["vary"].items())))}
    other = load_plan(plan(tmp_path, **swapped))
    assert list(LoadedPlan.from_dict(other.as_dict()).plan.vary) == ["start", "speed"]


def test_a_run_that_fails_is_a_row_with_its_reason(tmp_path: Path) -> None:
    vary = {"mass": {"path": "bodies.stone.mass", "list": [-1.0, 1.0]}}
    description = {k: v for k, v in plan(tmp_path, vary=vary).items() if k != "draws"}
    runner = PlanRunner(load_plan(description))
    row, run = runner.run({"mass": -1.0})
    assert row["status"] == "failed" and run is None
    assert "bodies.stone.mass: got -1.0; must be a number > 0" in row["reason"]
    assert np.isnan(row["height"])
    assert runner.run({"mass": 1.0})[0]["status"] == "ok"


def test_a_run_that_takes_too_long_is_given_up_and_says_so(tmp_path: Path) -> None:
    slow = plan(tmp_path, seconds_per_run=1e-9, simulation={"duration": 1e4, "rate": 1.0})
    row, _ = PlanRunner(load_plan(slow)).run({"speed": 1.0, "start": 0.0})
    assert row["status"] == GIVEN_UP and "1e-09 s" in row["reason"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"outputs": {"z": "position.stone.z"}}, "outputs.z: gives"),
        ({"outputs": {"z": "max(position.stein.z)"}}, "did you mean stone"),
        ({"derived": {"bodies.stone.position[0]": "sped"}}, "did you mean speed"),
        ({"vary": {"m": {"path": "bodies.stone.mas", "list": [1.0]}}}, "did you mean mass"),
        ({"vary": {"t": {"path": "bodies.stone.mass", "list": [1.0]}}}, "another name"),
    ],
)
def test_what_is_wrong_with_every_run_is_said_before_the_first(
    tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    description = plan(tmp_path, **changes)
    if "vary" in changes:
        del description["draws"]
    with pytest.raises(RbSimError) as caught:
        sweep(description, tmp_path / "out", workers=1)
    assert message in str(caught.value) and "\n" not in str(caught.value)


def test_no_scheduler_is_said_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(RbSimError, match="scheduler: .* does not answer"):
        sweep(plan(tmp_path), tmp_path / "out", scheduler="nonsense://nowhere")
