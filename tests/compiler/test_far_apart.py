# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Loops run wherever the system lays their code and their constants."""

from __future__ import annotations

import subprocess
import sys

PROGRAM = """
import mmap
kept = []
def map_more():
    kept.extend(mmap.mmap(-1, 1 << 30) for _ in range(3))  # never touched: no memory is used
map_more()
from rb_sim import Simulation, load_scene
for options in ({}, {"method": "time_stepping", "step": 1e-3}, {"method": "rk4", "step": 1e-3}):
    Simulation(load_scene("dropped_box", duration=0.05, **options)).run(watched=False)
    map_more()
print("ran")
"""


def test_gigabytes_between_code_and_constants_do_no_harm():
    """A code model that takes both to be within 2 GB ended the process in LLVM."""
    command = [sys.executable, "-c", PROGRAM]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0 and "ran" in done.stdout, done.stderr[-500:]
