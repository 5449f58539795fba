"""Memory does not grow with steps, and a step allocates nothing.

    python -m benchmarks.memory

Exit code 1 if the resident memory grows by more than GROWTH over a hundred times more steps, or if
numba's runtime counts allocations that follow the number of steps.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from numba.core.runtime import _nrt_python, rtsys

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


def allocations(simulation: Simulation, steps: int) -> int:
    """Allocations that numba's runtime made during one block of steps."""
    simulation.reset()
    before = rtsys.get_allocation_stats().alloc
    simulation.advance(steps * STEP)
    return rtsys.get_allocation_stats().alloc - before


def main() -> int:
    """Measure every scene with every method."""
    _nrt_python.memsys_enable_stats()
    failed = False
    for name in scenes.NAMES:
        for method in ("euler", "rk4", "dopri853", "gauss6"):
            scene = load_scene(scenes.CONFIG / f"{name}.yaml", method=method, step=STEP)
            simulation = Simulation(scene)
            few = allocations(simulation, FEW)
            few = allocations(simulation, FEW)
            before = resident()
            many = allocations(simulation, MANY)
            growth = resident() - before
            bad = growth > GROWTH or many > few
            failed |= bad
            print(
                f"{name:15s} {method:9s} allocations {few} for {FEW} steps, {many} for {MANY}; "
                f"memory {growth / 1024:+.0f} KiB{'  GROWS' if bad else ''}"
            )
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
