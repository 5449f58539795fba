"""A worker of Dask as a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from distributed import Client

PATIENCE = 240.0
"""[s], for a machine that is busy."""


@contextmanager
def one_more_worker(scheduler: str) -> Iterator[int]:
    """A second worker of the scheduler at that address; gives the number of its process."""
    root = str(Path(__file__).resolve().parents[2])
    command = [sys.executable, "-m", "distributed.cli.dask_worker", scheduler]
    with subprocess.Popen(
        [*command, "--nthreads", "1", "--no-nanny", "--no-dashboard"],
        env={**os.environ, "PYTHONPATH": root},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ) as process:
        try:
            with Client(scheduler, timeout=PATIENCE) as client:
                client.wait_for_workers(2, timeout=PATIENCE)
            yield process.pid
        finally:
            process.kill()
