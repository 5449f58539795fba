"""`python -m benchmarks.watches`: CPU time of the watches of a run beside that of the run itself.

Both are taken in one run, block by block, so that load on the machine touches both alike; the
median of several runs. The first block is left out of neither: what a watch makes once is its cost.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time

import numpy as np

from rb_sim import Simulation, load_scene
from rb_sim.watches.bounds import effort_of
from rb_sim.watches.watch_list import WatchList

RUNS = 5

CASES = (
    ("free_tumble", {}, 60.0),
    ("heavy_top", {}, 20.0),
    ("heavy_top", {"method": "rk4", "step": 1e-4}, 20.0),
    ("rolling_disk", {}, 20.0),
    ("hard_cases/door_on_three_hinges", {}, 20.0),
    ("bouncing_ball", {}, 5.0),
)
"""(scene, settings, duration [s])."""


def measured(simulation: Simulation, duration: float, rate: float) -> tuple[float, float]:
    """CPU time [s] of the run and of its watches."""
    simulation.reset()
    watches = WatchList(simulation.scene, simulation.layout)
    watching, began = 0.0, time.process_time()
    with np.errstate(all="ignore"):
        for block in simulation.blocks(duration, rate):
            entered = time.process_time()
            watches.add(block, effort_of(simulation))
            watching += time.process_time() - entered
    return time.process_time() - began - watching, watching


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--runs", type=int, default=RUNS)
    given = options.parse_args()
    print(f"{'scene':34} {'method':9} {'run [ms]':>9} {'watches [ms]':>12} {'share':>7}")
    for name, settings, duration in CASES:
        simulation = Simulation(load_scene(scene_of(name), **settings), announce=None)
        simulation.warm()
        rate = simulation.scene.simulation.rate
        pairs = [measured(simulation, duration, rate) for _ in range(given.runs)]
        run, watches = (statistics.median(column) for column in zip(*pairs, strict=True))
        share = statistics.median(w / r for r, w in pairs)
        method = simulation.scene.simulation.method
        print(f"{name:34} {method:9} {1e3 * run:9.2f} {1e3 * watches:12.2f} {share:7.1%}")
    return 0


def scene_of(name: str):
    """A shipped scene, or that of a hard case."""
    if "/" not in name:
        return name
    from rb_sim.cli.hard_cases import shipped
    from rb_sim.hard_cases.case import load_cases

    return load_cases(shipped(), [name.split("/")[1]])[0].scene


if __name__ == "__main__":
    sys.exit(main())
