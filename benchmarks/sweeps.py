# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Many runs: lanes beside one at a time, Dask beside multiprocessing and MuJoCo's rollout, memory.

    python -m benchmarks.sweeps lanes                 # steps of RK4 on one core
    python -m benchmarks.sweeps throughput            # whole sweeps of the heavy top
    python -m benchmarks.sweeps tops --runs 100000     # one sweep, start included
    python -m benchmarks.sweeps memory --runs 1000000 # peak of every process, report included

CPU time is what is compared: wall time says as much only where nothing else runs.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import machine
from rb_sim import Simulation
from rb_sim.mechanics.lane_motions import Lanes
from rb_sim.mechanics.laws import ReducedLaws
from rb_sim.sweeps.batch import BatchRunner
from rb_sim.sweeps.one_run import PlanRunner
from rb_sim.sweeps.plan import load_plan, points
from rb_sim.sweeps.sweep import _looks, _row, sweep

BODIES = {"free_tumble": "angular_velocity[0]", "heavy_top": "mass", "pendulum": "mass"}
RUNS, STEPS, REPEATS = 64, 2000, 5

TOP: dict[str, Any] = {
    "scene": "heavy_top",
    "simulation": {"duration": 2.0, "tolerance": 1e-6},
    "vary": {
        "spin": {"path": "bodies.top.angular_velocity[1]", "uniform": [100.0, 150.0]},
        "mass": {"path": "bodies.top.mass", "uniform": [10.0, 20.0]},
    },
    "outputs": {"load": "max(norm(reaction.tip.force))", "height": "last(position.top.z)"},
}
AXES = [
    f"{q}.stone.{c}" for q in ("position", "linear_velocity", "angular_velocity") for c in "xyz"
]
STONE: dict[str, Any] = {
    "vary": {
        "speed": {"path": "bodies.stone.linear_velocity[2]", "normal": {"mean": 3.0, "std": 0.5}},
        "start": {"path": "bodies.stone.position[2]", "uniform": [0.0, 1.0]},
    },
    "outputs": {
        f"{which}_{i}": f"{which}({axis})"
        for which in ("last", "first")
        for i, axis in enumerate(AXES)
    }
    | {"energy": "last(energy)", "w": "last(orientation.stone.w)"},
}
STONE_SCENE = """\
bodies:
  stone: {mass: 2.0, inertia: [0.1, 0.1, 0.1]}
effects:
  weight: {type: gravity, acceleration: [0.0, 0.0, -9.81]}
simulation: {duration: 0.1, rate: 10, method: rk4, step: 0.05}
"""
"""A run of two steps, so that a million of them can be waited for."""


def prepared(plan: dict[str, Any], draws: int) -> tuple[PlanRunner, list[dict[str, float]]]:
    """The runner of a plan and the values of its runs."""
    loaded = load_plan({**plan, "draws": draws})
    values = points(loaded.plan)
    runner = PlanRunner(loaded, _looks(values))
    return runner, [_row(values, run) for run in range(draws)]


def lanes() -> None:
    """CPU time of a step of RK4, one run at a time and in lanes, best of REPEATS."""
    print("scene          one at a time   in lanes   times")
    for scene, number in BODIES.items():
        body = next(iter(load_plan({"scene": scene, **_any_plan()}).scene["bodies"]))
        vary = {"x": {"path": f"bodies.{body}.{number}", "uniform": [1.0, 2.0]}}
        simulation = {"method": "rk4", "step": 1e-3, "duration": 1e-3 * STEPS, "rate": 0.5}
        plan = {"scene": scene, "vary": vary, "simulation": simulation, "final_state": True}
        runner, rows = prepared(plan, RUNS)
        runs = [Simulation(runner.scene(x), family=runner.family, announce=None) for x in rows]
        laws = runs[0].compiled.laws
        assert isinstance(laws, ReducedLaws)
        together = Lanes(laws, runs[0].method)
        assert together.possible
        starts = np.array([run.compiled.y for run in runs])
        given = np.array([laws.inputs.values(run.compiled.system, 0.0) for run in runs])
        times = np.array([0.0, 1e-3 * STEPS])
        best = [float("inf")] * 2
        for _ in range(REPEATS):
            began = time.process_time()
            for run in runs:
                run.reset()
                run.advance(times[-1])
            middle = time.process_time()
            together.run(starts, given.reshape(RUNS, -1), times)
            ended = time.process_time()
            best = [min(best[0], middle - began), min(best[1], ended - middle)]
        alone, shared = (1e9 * x / (RUNS * STEPS) for x in best)
        print(f"{scene:14} {alone:10.1f} ns {shared:10.1f} ns {alone / shared:7.1f}")


def _any_plan() -> dict[str, Any]:
    return {"vary": {"x": {"list": [1.0]}}, "final_state": True}


def throughput(runs: int, workers: int) -> None:
    """Runs per second of CPU and of wall time: alone, in lanes, on Dask, in a pool, in MuJoCo.

    Of Dask also, from the first batch that ended to the last one: how busy the workers' cores were,
    and what the scheduler, which is in this process, took of a core.
    """
    print(f"{runs} runs of heavy_top, 2 s each at 1e-6, 1001 samples; {workers} processes")
    print(
        "way                                    CPU per run   runs/s of wall   share of the cores"
    )
    runner, rows = prepared(TOP, runs)
    for name, use in (("one at a time, one process", False), ("lanes, one process", True)):
        batch = BatchRunner(runner, use)
        list(batch.rows(range(16), rows[:16]))
        some = rows[: min(runs, 2000)]
        began, wall = time.process_time(), time.perf_counter()
        list(batch.rows(range(len(some)), some))
        cpu, wall = time.process_time() - began, time.perf_counter() - wall
        _printed(name, len(some), cpu, wall, 1)
    for name, use in (("Dask, no lanes", False), ("Dask, lanes", True)):
        with tempfile.TemporaryDirectory() as folder:
            busy = _Busy(workers)
            with _Used() as used:
                sweep({**TOP, "draws": runs}, folder, workers=workers, lanes=use, progress=busy)
        _printed(f"{name}, start included", runs, used.cpu, used.wall, workers)
        busy.tell()
    with _Used() as used, multiprocessing.get_context("spawn").Pool(workers) as pool:
        list(pool.imap_unordered(_pooled, _chunks(runs, 1000)))
        pool.close()
        pool.join()
    _printed("multiprocessing, lanes, start incl.", runs, used.cpu, used.wall, workers)
    _mujoco(runs, workers)
    print(f"the machine's load: {os.getloadavg()[0]:.1f}")


class _Busy:
    """Told of each batch: what workers and scheduler did between the first one and the last one.

    Of each worker the thread that does the runs counts, the busiest one. Where the machine has
    other work, too, that thread waits for a core: what it computed and waited together is what it
    would have computed on cores of its own.
    """

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self._marks: list[tuple[int, float, float]] = []
        self._threads: list[dict[tuple[int, str], tuple[float, float]]] = []

    def __call__(self, done: int, runs: int, failed: int) -> None:
        if not self._marks or done == runs:
            self._threads.append(_threads_of_children())
            self._marks.append((done, time.perf_counter(), time.process_time()))

    def tell(self) -> None:
        if len(self._marks) < 2:
            print("    too few batches to say what the workers did between them")
            return
        done, wall, own = (b - a for a, b in zip(*self._marks, strict=True))
        used = [
            (ran - before[0], waited - before[1], process)
            for (process, thread), (ran, waited) in self._threads[1].items()
            if (before := self._threads[0].get((process, thread)))
        ]
        every = sum(ran for ran, _, _ in used)
        busiest = [max(u for u in used if u[2] == pid) for pid in {pid for _, _, pid in used}]
        busiest = sorted(busiest, reverse=True)[: self._workers]  # the others keep watch
        cores = wall * self._workers
        ran, waited = (sum(u[i] for u in busiest) for i in range(2))
        print(
            f"    between batches: of their cores' time the runs computed {100 * ran / cores:.0f} "
            f"% and waited for a core {100 * waited / cores:.0f} %, idle "
            f"{100 - 100 * (ran + waited) / cores:.1f} %;\n"
            f"    {1e3 * every / done:.3f} ms of CPU a run; the scheduler "
            f"{1e3 * own / done:.4f} ms a run, {100 * own / wall:.1f} % of a core",
            flush=True,
        )


def _threads_of_children() -> dict[tuple[int, str], tuple[float, float]]:
    """CPU time of each thread of this process's children, and time that it was ready but had no
    core [s], by (process, thread)."""
    import psutil

    found = {}
    for child in psutil.Process().children(recursive=True):
        for task in Path(f"/proc/{child.pid}/task").glob("*/schedstat"):
            ran, waited, _ = task.read_text(encoding="ascii").split()
            found[child.pid, task.parent.name] = 1e-9 * int(ran), 1e-9 * int(waited)
    return found


def tops(runs: int, workers: int) -> None:
    """One sweep of heavy tops from its start to its table, and nothing beside it."""
    with tempfile.TemporaryDirectory() as folder, _Used() as used:
        sweep({**TOP, "draws": runs}, folder, workers=workers)
    print(f"{runs} runs of heavy_top, 2 s each at 1e-6, 1001 samples; start included")
    _printed(f"Dask, lanes, {workers} workers", runs, used.cpu, used.wall, workers)


def _chunks(runs: int, size: int) -> list[tuple[int, int, int]]:
    return [(runs, first, min(size, runs - first)) for first in range(0, runs, size)]


_KEPT: dict[int, Any] = {}


def _pooled(chunk: tuple[int, int, int]) -> list[float]:
    """A chunk of runs in a worker of multiprocessing, without a table on disk."""
    runs, first, count = chunk
    if runs not in _KEPT:
        runner, rows = prepared(TOP, runs)
        _KEPT[runs] = BatchRunner(runner), rows
    batch, rows = _KEPT[runs]
    return [row["load"] for row, _ in batch.rows(range(count), rows[first : first + count])]


def _mujoco(runs: int, workers: int) -> None:
    """The same motions by MuJoCo's RK4 at the step that keeps 1e-6, all states kept, no forces."""
    try:
        import mujoco
        from mujoco import rollout
    except ImportError:
        print("MuJoCo is not installed")
        return
    from benchmarks.peers.engine_mujoco import _model
    from benchmarks.peers.scenes import load

    step = 1e-3
    model = mujoco.MjModel.from_xml_string(_model(load("heavy_top"), "RK4", step))
    few, count = min(runs, 2000), round(2.0 / step)
    states = np.zeros((few, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    states[:, 1] = 1.0
    spins = np.random.default_rng(0).uniform(100.0, 150.0, few)
    states[:, 5:8] = np.stack([0.0 * spins, spins, 0.0 * spins - 4.61538], axis=1)
    data = [mujoco.MjData(model) for _ in range(workers)]
    with _Used() as used:
        for first in range(0, few, 100):
            rollout.rollout(model, data, states[first : first + 100], nstep=count)
    _printed(f"MuJoCo rollout, RK4 {step:g} s", few, used.cpu, used.wall, workers)


class _Used:
    """CPU time of this process and of children that have ended, and wall time [s]."""

    cpu = wall = 0.0

    def __enter__(self) -> _Used:
        self._cpu, self._wall = self._now(), time.perf_counter()
        return self

    def __exit__(self, *_: Any) -> None:
        self.cpu, self.wall = self._now() - self._cpu, time.perf_counter() - self._wall

    @staticmethod
    def _now() -> float:
        kinds = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
        return sum(u.ru_utime + u.ru_stime for u in map(resource.getrusage, kinds))


def _printed(name: str, runs: int, cpu: float, wall: float, cores: int) -> None:
    share = 100.0 * cpu / (wall * cores)
    print(f"{name:36} {1e3 * cpu / runs:7.3f} ms {runs / wall:12.0f} {share:14.0f} %", flush=True)


def memory(runs: int, workers: int) -> None:
    """Peak resident memory of every process of a sweep of `runs` runs of 20 outputs, and report."""
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "stone.yaml"
        scene.write_text(STONE_SCENE)
        out = Path(folder) / "out"
        peaks = _Peaks()
        began = time.perf_counter()
        sweep({**STONE, "scene": str(scene), "draws": runs}, out, workers=workers)
        took = time.perf_counter() - began
        peaks.stop()
        size = sum(path.stat().st_size for path in out.rglob("*.parquet"))
        own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f"{runs} runs, {len(STONE['outputs'])} outputs in {took:.0f} s, {size / 1e6:.0f} MB")
        print(f"peak: this process {own:.0f} MB, largest worker {peaks.largest / 2**20:.0f} MB")
        code = (
            "import resource, sys; from rb_sim.sweeps.sweep_page import report; "
            "report(sys.argv[1]); print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)"
        )
        command = [sys.executable, "-c", code, str(out)]
        reported = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        page = (out / "report.html").stat().st_size
        print(f"report: peak {float(reported):.0f} MB, page {page / 1e6:.1f} MB")


class _Peaks:
    """Watches the resident memory of all children of this process."""

    def __init__(self) -> None:
        import psutil

        self._process, self._over = psutil.Process(), threading.Event()
        self._gone: Any = psutil.Error
        self.largest = 0
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def _watch(self) -> None:
        while not self._over.wait(0.2):
            for child in self._process.children(recursive=True):
                try:
                    self.largest = max(self.largest, child.memory_info().rss)
                except self._gone:
                    continue

    def stop(self) -> None:
        self._over.set()
        self._thread.join()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("lanes", "throughput", "tops", "memory"))
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    print(machine.line(machine.describe()))
    if given.what == "memory":  # which others do not disturb
        memory(given.runs, given.workers)
        return 0
    with machine.alone():
        if given.what == "lanes":
            lanes()
        elif given.what == "tops":
            tops(given.runs, given.workers)
        else:
            throughput(given.runs, given.workers)
    return 0


if __name__ == "__main__":
    sys.exit(main())
