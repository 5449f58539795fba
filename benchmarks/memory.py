# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Memory does not grow with steps.

    python -m benchmarks.memory

Exit code 1 if the resident memory grows by more than GROWTH over a hundred times more steps. That
no step takes memory, a test sees in the machine code (tests/test_architecture.py).
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from benchmarks.peers import scenes
from rb_sim import Simulation, load_scene

STEP = 1e-4
FEW, MANY = 1_000, 100_000
GROWTH = 256 * 1024
"""Tolerated growth [bytes]: pages that the allocator keeps."""


def resident() -> int:
    """Resident memory of this process [bytes]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def growth_of(simulation: Simulation, steps: int) -> int:
    """By how much the resident memory grows in one block of steps [bytes]."""
    simulation.reset()
    before = resident()
    simulation.advance(steps * STEP)
    return resident() - before


def main() -> int:
    """Measure every scene with every method."""
    failed = False
    for name in scenes.NAMES:
        for method in ("euler", "rk4", "dopri853", "gauss6"):
            scene = load_scene(scenes.CONFIG / f"{name}.yaml", method=method, step=STEP)
            simulation = Simulation(scene)
            growth_of(simulation, FEW)
            growth = growth_of(simulation, MANY)
            failed |= growth > GROWTH
            reported = f"{growth / 1024:+.0f} KiB{'  GROWS' if growth > GROWTH else ''}"
            print(f"{name:15s} {method:9s} memory {reported} over {MANY} steps")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
