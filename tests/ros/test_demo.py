# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`make run`: what it says is there is there, the second time, too."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def demonstrated(out: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "rb_sim.ros.demo", "--out", str(out)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def test_it_replaces_what_it_left_and_shows_plots_that_are_drawn(tmp_path: Path) -> None:
    (tmp_path / "node.log").write_text("of an earlier one")
    plots = tmp_path / "plots.png"
    plots.write_text("old")
    os.utime(plots, (1e9, 1e9))
    done = demonstrated(tmp_path)
    assert done.returncode == 0, done.stderr
    assert str(plots) in done.stdout.replace("\n", "")
    assert plots.read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "bag/metadata.yaml").is_file()


def test_logs_of_somebody_else_stay(tmp_path: Path) -> None:
    (tmp_path / "plots.png").write_text("mine")
    done = demonstrated(tmp_path)
    assert done.returncode == 1 and "has plots.png already" in done.stderr
    assert (tmp_path / "plots.png").read_text() == "mine"
