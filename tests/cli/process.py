# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Runs the real command, in processes of its own or in this one."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from click.testing import Result
from typer.testing import CliRunner

from rb_sim.cli.main import app

TUMBLE = """\
description: a free body, for as long as one likes
bodies:
  nut: {mass: 1.0, inertia: [1.0, 2.0, 3.0], angular_velocity: [0.1, 2.0, 0.1]}
simulation: {duration: 2.0, rate: 100, method: rk4, step: 0.001}
"""

COMMAND = (sys.executable, "-m", "rb_sim.cli.main")
PATIENCE = 240.0
"""[s], for a machine that compiles and is busy."""


def environment(**more: str) -> dict[str, str]:
    root = str(Path(__file__).parents[2])
    path = os.pathsep.join(part for part in (more.pop("path", ""), root) if part)
    return {**os.environ, "PYTHONPATH": path, "COLUMNS": "100", **more}


def rb_sim(*arguments: object, env: dict[str, str] | None = None, **options: object):
    """The command, run to its end."""
    return subprocess.run(
        [*COMMAND, *map(str, arguments)],
        env=env or environment(),
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
        **options,  # type: ignore[call-overload]
    )


def invoke(*arguments: object) -> Result:
    """The command in this process, which takes a second less."""
    return CliRunner().invoke(app, [*map(str, arguments)], env={"COLUMNS": "100"})


def start(*arguments: object) -> subprocess.Popen[str]:
    """The command, running."""
    return subprocess.Popen(
        [*COMMAND, *map(str, arguments)],
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def wait_until(condition: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    """Wait for it; fail if the process ends first."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.02)


def lines(text: str) -> Sequence[str]:
    return text.strip().splitlines()
