# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

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
