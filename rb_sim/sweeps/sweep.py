# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`sweep`: simulates all runs of a plan, on all cores or a cluster, into a table on disk."""

from __future__ import annotations

import ast
import inspect
import math
import signal
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import islice
from multiprocessing import resource_tracker
from numbers import Integral
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

import numpy as np

from rb_sim.accuracy.checks.check_list import CheckedSamples
from rb_sim.base.errors import (
    AccuracyWarning,
    Finding,
    MissingExtraError,
    RbSimError,
    SimulationError,
)
from rb_sim.simulation.simulation import Simulation
from rb_sim.sweeps import storage
from rb_sim.sweeps.batch import Batch, BatchRunner, Done, described, do_batch
from rb_sim.sweeps.one_run import PlanRunner
from rb_sim.sweeps.plan import LoadedPlan, load_plan, points
from rb_sim.sweeps.storage import take_over

# The scheduler: batches are distributed to workers of dask.distributed, local or on a cluster.
#
# Only a few batches per worker are submitted at once, so that the scheduler's memory and time do
# not grow with the number of runs. If a worker dies, dask repeats its batch elsewhere.


# Check that the calling script can be imported by workers.
#
# Spawned processes import the script that started them and execute all of it outside of
# `if __name__ == "__main__":`, including sweeps.


def check_guarded() -> None:
    """Raise RbSimError if a script calls this from a line that its workers would execute too."""
    frame = _of_the_script()
    if frame is None:
        return
    script = Path(frame.f_code.co_filename)
    try:
        tree = ast.parse(script.read_text(encoding="utf-8"))
    except (OSError, ValueError, SyntaxError):  # interactive or a notebook: never imported
        return
    if not any(_guards(node, frame.f_lineno) for node in tree.body):
        raise RbSimError(
            f"{script}:{frame.f_lineno}: starts workers, which import this file and would come to "
            'this line themselves; must be below `if __name__ == "__main__":`'
        )


def _of_the_script() -> FrameType | None:
    """Frame of the started script that contains the call; None if there is none."""
    if getattr(sys.modules.get("__main__"), "__file__", None) is None:
        return None
    frame = inspect.currentframe()
    while frame is not None:
        if frame.f_code.co_name == "<module>" and frame.f_globals.get("__name__") == "__main__":
            return frame
        frame = frame.f_back
    return None


def _guards(node: ast.stmt, line: int) -> bool:
    """Whether the statement prevents the execution of that line on import."""
    if not isinstance(node, ast.If) or not node.lineno <= line <= (node.end_lineno or line):
        return False
    return any(isinstance(x, ast.Name) and x.id == "__name__" for x in ast.walk(node.test))


IN_FLIGHT = 3
"""Number of batches per worker submitted ahead."""

CONNECT = 20.0
"""Timeout for the connection to a scheduler [s]."""


START = 120.0
"""Timeout for the start of local workers, which is slow on a busy machine [s]."""


@contextmanager
def client(workers: int | None, scheduler: str | None) -> Iterator[Any]:
    """A dask client: of the scheduler at that address, or of local workers.

    workers: number of single-threaded processes; None: one per core. Raises RbSimError if the
    scheduler does not answer.
    """
    try:
        from dask import config
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise MissingExtraError("distributed", "sweep", "a sweep") from error
    if scheduler is not None:
        try:
            reached = Client(scheduler, timeout=CONNECT)
        except (OSError, ValueError) as error:
            raise RbSimError(f"scheduler: {scheduler} does not answer ({error})") from None
        with reached as connected:
            yield connected
        return
    quiet = {"distributed.worker.daemon": False, "distributed.logging.distributed": "error"}
    quiet["distributed.worker.profile.enabled"] = False  # it would sample 100 times a second
    with config.set({**quiet, "distributed.comm.timeouts.connect": f"{START:g}s"}):
        settings: dict[str, Any] = {"dashboard_address": ":0", "silence_logs": 50}
        settings |= {"threads_per_worker": 1, "processes": True}
        with _deaf_to_interrupts():
            started = LocalCluster(n_workers=workers, **settings)
        with started as cluster:
            with Client(cluster) as connected:
                yield connected


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Processes started inside the block ignore Ctrl-C, which a terminal sends to the whole group.

    This process then ends them, instead of each ending with its own traceback. An interrupt of this
    process is delivered at the end of the block.
    """
    resource_tracker.ensure_running()  # its start unblocks SIGINT, so start it before
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def run_batches(
    connected: Any,
    plan: str,
    folder: str,
    batches: Iterable[Batch],
    report: Callable[[Done], None],
) -> None:
    """Execute all batches; `report` is called with each result.

    Raises SimulationError if a batch killed every worker that tried it.
    """
    from distributed import as_completed

    waiting = iter(batches)
    ahead = IN_FLIGHT * max(1, len(connected.scheduler_info()["workers"]))

    def submit(batch: Batch) -> Any:
        return connected.submit(do_batch, plan, folder, batch, pure=False)

    first = [submit(batch) for batch in islice(waiting, ahead)]
    running = as_completed(first)
    for future in running:
        try:
            done = future.result()
        except Exception as error:
            if type(error).__name__ != "KilledWorker":
                raise
            raise SimulationError(
                "a batch killed every worker that tried it; run it alone to see why: "
                f"{error}".splitlines()[0]
            ) from None
        report(done)
        future.release()
        following = next(waiting, None)
        if following is not None:
            running.add(submit(following))


# Repetition of some runs with all checks, since runs in lanes have none.


FEW, MOST, ONE_IN = 2, 8, 50
"""Number of repeated runs: one in fifty within these limits, as costly as checking all runs."""


class Lost(NamedTuple):
    """A failed accuracy check of a run of a sweep."""

    run: int
    """its run number in the plan."""
    finding: Finding

    def __str__(self) -> str:
        return f"run {self.run}: {self.finding}"


def to_look_at(runs: np.ndarray) -> list[int]:
    """Some of these runs, evenly spread, including the first and the last."""
    count = min(len(runs), max(FEW, min(MOST, len(runs) // ONE_IN)))
    return sorted({int(runs[i]) for i in np.linspace(0, len(runs) - 1, count).round().astype(int)})


def look_over(
    runner: PlanRunner, values: Mapping[str, np.ndarray], runs: Sequence[int]
) -> tuple[Lost, ...]:
    """Findings of the accuracy checks in these runs of the plan.

    A run that fails or exceeds its time limit is checked up to that point; its row has the reason.
    """
    found: list[Lost] = []
    for run in runs:
        row = {name: float(column[run]) for name, column in values.items()}
        found += [Lost(run, finding) for finding in findings(runner, row)]
    return tuple(found)


def findings(runner: PlanRunner, values: Mapping[str, float]) -> tuple[Finding, ...]:
    """Findings of the accuracy checks in the run with these values, simulated singly."""
    try:
        simulation = Simulation(runner.scene(values), family=runner.family, announce=None)
        simulation.warm()
    except RbSimError:  # reported in its row
        return ()
    options = simulation.scene.simulation
    end = time.perf_counter() + runner.loaded.plan.seconds_per_run
    blocks = simulation.blocks(options.duration, options.rate, lambda t: time.perf_counter() < end)
    checked = CheckedSamples(simulation, blocks)
    try:
        for _ in checked:
            pass
    except RbSimError:
        pass
    return checked.findings


BATCH_TIME = 1.0
"""Approximate CPU time of a batch [s]: large against the scheduler's overhead of milliseconds, but
little is lost if a worker dies or the sweep is ended."""

LOOKS, MANY_LOOKS, CHEAP = 3, 64, 0.01
"""Number of runs timed to choose the batch size; MANY_LOOKS if a run costs less than CHEAP [s]."""

MANY_CHECKS = 64
"""Number of runs tried at the start; if none starts, the plan is wrong."""

LARGEST_BATCH = 2000
"""Maximum number of runs per batch; a worker keeps the rows of one batch in memory."""

Progress = Callable[[int, int, int], None]
"""Called with (completed runs, all runs, failed runs)."""


class SweepResult(NamedTuple):
    """Result of a sweep: where its table is, and how many runs it made."""

    folder: Path
    """Folder of the results; `folder / "runs"` is the Parquet dataset."""
    runs: int
    """Runs in the plan."""
    reused: int
    """Runs that the folder had already."""
    failed: int
    """Runs of this call that failed; their rows have the reason."""
    looked_at: int = 0
    """Runs of this call that were repeated with all accuracy checks."""
    lost: tuple[Lost, ...] = ()
    """Accuracy checks that failed in the repeated runs."""

    def table(self) -> Any:
        """All rows as a pyarrow table, ordered by run."""
        return storage.open_table(self.folder)


def sweep(
    plan: str | Path | dict[str, Any] | LoadedPlan,
    out: str | Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    batch: int | None = None,
    lanes: bool = True,
    progress: Progress | None = None,
) -> SweepResult:
    """Run a scene many times with varied numbers; runs already in `out` are not repeated.

    At the end 2 % of the runs (2 to 8) are repeated with all accuracy checks; failed checks are
    issued as AccuracyWarnings and listed in the result's `lost`. A failed run has the reason in its
    row.

    Args:
        plan: Plan file (YAML), name of a shipped plan, or mapping.
        out: Folder of the results.
        workers: Processes on this machine; None: one for each core.
        scheduler: Address of a dask scheduler to use instead.
        batch: Runs per task; None: as many as take about a second.
        lanes: Let runs share the vector lanes of the processor; their numbers then differ from
            those of single runs by rounding.
        progress: Called after each batch.

    Raises:
        RbSimError: The plan is not valid, or `out` cannot be used.
    """
    _check_arguments(out, workers, batch)
    if scheduler is None:
        check_guarded()
    loaded = plan if isinstance(plan, LoadedPlan) else load_plan(plan)
    storage.arrow()
    folder = Path(out)
    values = points(loaded.plan)
    looks = _looks(values)
    runner = PlanRunner(loaded, looks)
    simulation = _checked(runner, values)
    bodies, runs = simulation.layout.bodies, loaded.plan.runs
    with storage.alone(folder) as start:
        todo, next_batch = _missing(runner, values, folder, bodies)
        counts = {"done": runs - len(todo), "failed": 0}
        reused = counts["done"]
        if len(todo):
            several = BatchRunner(runner, lanes)
            size = batch or _batch_size(several, values, todo, workers or 2)

            def report(finished: Done) -> None:
                counts["done"] += finished.runs
                counts["failed"] += finished.failed
                if progress is not None:
                    progress(counts["done"], runs, counts["failed"])

            batches = _batches(values, todo, size, Batch(next_batch, todo, {}, bodies, start))
            with client(workers, scheduler) as connected:
                description = described(loaded, looks, lanes)
                run_batches(connected, description, str(folder.resolve()), batches, report)
    looked_at = to_look_at(todo) if len(todo) else []
    lost = look_over(runner, values, looked_at)
    for each in lost:
        warnings.warn(str(each), AccuracyWarning, stacklevel=2)
    return SweepResult(folder, runs, reused, counts["failed"], len(looked_at), lost)


def _check_arguments(out: Any, workers: int | None, batch: int | None) -> None:
    """Raise RbSimError for invalid numbers or folder."""
    for name, value in (("workers", workers), ("batch", batch)):
        if value is not None and not (isinstance(value, Integral) and value >= 1):
            raise RbSimError(f"{name}: got {value!r}; must be a whole number >= 1")
    if not isinstance(out, (str, Path)):
        raise RbSimError(f"out: got {out!r}; must be a folder")


def _row(values: dict[str, np.ndarray], run: int) -> dict[str, float]:
    return {name: float(column[run]) for name, column in values.items()}


def _looks(values: dict[str, np.ndarray]) -> list[dict[str, float]]:
    """A few runs that together vary everything: those at both ends of each number."""
    ends = {0, len(next(iter(values.values()))) // 2}
    for column in values.values():
        ends |= {int(column.argmin()), int(column.argmax())}
    return [_row(values, run) for run in sorted(ends)]


def _checked(runner: PlanRunner, values: dict[str, np.ndarray]) -> Simulation:
    """The simulation of the first run that starts, among some spread over all.

    Raises the RbSimError of the first one if none starts.
    """
    count = len(next(iter(values.values())))
    first: RbSimError | None = None
    for run in range(0, count, max(1, count // MANY_CHECKS)):
        try:
            return runner.check(_row(values, run))
        except RbSimError as error:
            first = first or error
    assert first is not None
    raise first


def _missing(
    runner: PlanRunner, values: dict[str, np.ndarray], folder: Path, bodies: tuple[str, ...]
) -> tuple[np.ndarray, int]:
    """(numbers of the runs still to be done, number of the next batch)."""
    count = len(next(iter(values.values())))
    if not storage.batch_files(folder):
        return np.arange(count), 0
    hashes = (runner.scene_hash(_row(values, run)).encode() for run in range(count))
    loaded = runner.loaded
    held, following = take_over(
        folder,
        loaded.plan,
        np.fromiter(hashes, dtype="S24", count=count),
        storage.table_schema(loaded, bodies),
    )
    return np.flatnonzero(~held), following


def _batch_size(
    runner: BatchRunner, values: dict[str, np.ndarray], todo: np.ndarray, workers: int
) -> int:
    """Runs per batch, from the measured cost of a few; every worker gets several batches."""

    def cost(runs: list[int]) -> float:
        """Wall-clock time per run [s]."""
        began = time.perf_counter()
        for _ in runner.rows(runs, [_row(values, run) for run in runs]):
            pass
        return max(1e-5, (time.perf_counter() - began) / len(runs))

    cost(todo[:1].tolist())  # compiles the laws shared by all runs
    each = cost(todo[:: max(1, len(todo) // LOOKS)][:LOOKS].tolist())
    if each < CHEAP:  # runs in lanes cost less
        many = todo[:: max(1, len(todo) // MANY_LOOKS)][:MANY_LOOKS].tolist()
        each = min(each, cost(many))
    fair = math.ceil(len(todo) / (4 * workers))
    return max(1, min(LARGEST_BATCH, fair, round(BATCH_TIME / each)))


def _batches(
    values: dict[str, np.ndarray], todo: np.ndarray, size: int, first: Batch
) -> Iterator[Batch]:
    """The runs to be done in batches; `first` gives the first number and the common fields."""
    for i in range(0, len(todo), size):
        runs = todo[i : i + size]
        chosen = {name: column[runs] for name, column in values.items()}
        yield first._replace(number=first.number + i // size, runs=runs, values=chosen)
