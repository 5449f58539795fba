"""The scheduler: batches go to the workers of dask.distributed, here or on a cluster.

Only a few batches per worker are in flight, so that neither the scheduler's memory nor its time
grows with the number of runs.  A worker that dies costs its batch, which dask runs again elsewhere.
"""

from __future__ import annotations

import ast
import inspect
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import islice
from multiprocessing import resource_tracker
from pathlib import Path
from types import FrameType
from typing import Any

from rb_sim.base.errors import MissingExtraError, RbSimError, SimulationError
from rb_sim.sweeps.batch import Batch, Done, do_batch

# Whether the script that asks for workers may be imported by them.
#
# Processes that are spawned import the script that started them: what it does outside of
# `if __name__ == "__main__":` is done in each of them again, sweeps included.


def check_guarded() -> None:
    """Raise RbSimError where a script calls this from a line that its workers would run, too."""
    frame = _of_the_script()
    if frame is None:
        return
    script = Path(frame.f_code.co_filename)
    try:
        tree = ast.parse(script.read_text(encoding="utf-8"))
    except (OSError, ValueError, SyntaxError):  # typed in, or of a notebook: nobody imports it
        return
    if not any(_guards(node, frame.f_lineno) for node in tree.body):
        raise RbSimError(
            f"{script}:{frame.f_lineno}: starts workers, which import this file and would come to "
            'this line themselves; must be below `if __name__ == "__main__":`'
        )


def _of_the_script() -> FrameType | None:
    """The frame of the script that was started, in which the call is; None where it is in none."""
    if getattr(sys.modules.get("__main__"), "__file__", None) is None:
        return None
    frame = inspect.currentframe()
    while frame is not None:
        if frame.f_code.co_name == "<module>" and frame.f_globals.get("__name__") == "__main__":
            return frame
        frame = frame.f_back
    return None


def _guards(node: ast.stmt, line: int) -> bool:
    """Whether the statement keeps that line from those who import the file."""
    if not isinstance(node, ast.If) or not node.lineno <= line <= (node.end_lineno or line):
        return False
    return any(isinstance(x, ast.Name) and x.id == "__name__" for x in ast.walk(node.test))


IN_FLIGHT = 3
"""Batches per worker that are submitted ahead."""

CONNECT = 20.0
"""How long to wait for a scheduler [s]."""


START = 120.0
"""How long workers on this machine may take to answer; a busy machine starts them slowly [s]."""


@contextmanager
def client(workers: int | None, scheduler: str | None) -> Iterator[Any]:
    """A dask client: of the scheduler at that address, or of workers on this machine.

    workers: processes of one thread each; one a core if None.
    Raises RbSimError where the scheduler does not answer.
    """
    try:
        from dask import config
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise MissingExtraError("distributed", "sweep", "a sweep") from error
    if scheduler is not None:
        try:
            reached = Client(scheduler, timeout=CONNECT)
        except (OSError, TimeoutError, ValueError) as error:
            raise RbSimError(f"scheduler: {scheduler} does not answer ({error})") from None
        with reached as connected:
            yield connected
        return
    quiet = {"distributed.worker.daemon": False, "distributed.logging.distributed": "error"}
    quiet["distributed.worker.profile.enabled"] = False  # 100 looks a second at what the runs do
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
    """Processes that begin inside do not hear Ctrl-C, which a terminal sends to all at once.

    They are ended by this process then, instead of each by itself with a traceback. It hears of an
    interrupt itself at the end of the block.
    """
    resource_tracker.ensure_running()  # which lets SIGINT through again once it has started
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
    """Do all batches; `report` gets each as it ends.

    Raises SimulationError where a batch killed every worker that tried it.
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
