# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A scheduler and two workers of Dask as processes of their own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

from distributed import Client

PATIENCE = 240.0
"""[s], for a machine that is busy."""


class Cluster:
    """A scheduler and two workers, each a process that a test can kill."""

    def __init__(self, folder: Path) -> None:
        self.file = folder / "scheduler.json"
        self.processes = [self._start("scheduler", "--no-dashboard", "--port", "0")]
        worker = ("worker", "--nthreads", "1", "--no-nanny", "--no-dashboard")
        self.processes += [self._start(*worker) for _ in range(2)]

    def __enter__(self) -> Cluster:
        try:
            self._connect()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _connect(self) -> None:
        end = time.monotonic() + PATIENCE
        while not self._written() and time.monotonic() < end:
            time.sleep(0.05)
        self.address = json.loads(self.file.read_text())["address"]
        with Client(self.address, timeout=PATIENCE) as client:
            client.wait_for_workers(2, timeout=PATIENCE)
            pids = client.run(os.getpid)
        self.worker_pids = list(pids.values())

    def _written(self) -> bool:
        """True once the scheduler has made its file and also filled it."""
        return self.file.exists() and self.file.read_text().rstrip().endswith("}")

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
