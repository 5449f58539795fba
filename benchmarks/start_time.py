"""Time from starting Python to the first step: the first start (compiles) and later ones (cached).

    python -m benchmarks.start_time [--scene NAME] [--repeats N]

A new empty cache folder (RB_SIM_CACHE) makes the first start a real first one. Times are on the
wall clock: this is what a user waits for, so it depends on what else the machine does.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time

from benchmarks import machine
from benchmarks.peers import scenes

FIRST_STEP = """
import sys
from rb_sim import Simulation, load_scene
simulation = Simulation(load_scene(sys.argv[1]))
simulation.advance(1e-3)
print("stepped")
"""

COMMAND = "import sys; from rb_sim.cli.main import main; sys.exit(main())"


def to_first_step(scene: str, environment: dict[str, str]) -> float:
    """Seconds from starting Python to the end of the first step, through the library."""
    begin = time.perf_counter()
    child = [sys.executable, "-c", FIRST_STEP, scene]
    subprocess.run(child, env=environment, check=True, capture_output=True)
    return time.perf_counter() - begin


def whole_run(scene: str, environment: dict[str, str], out: str) -> float:
    """Seconds of a whole `rb_sim run` of 10 ms simulated time, without bag and recording."""
    options = ["--duration", "0.01", "--no-bag", "--no-rerun", "--quiet", "--out", out]
    begin = time.perf_counter()
    child = [sys.executable, "-c", COMMAND, "run", scene, *options]
    subprocess.run(child, env=environment, check=True, capture_output=True)
    return time.perf_counter() - begin


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.start_time")
    parser.add_argument("--scene", choices=scenes.NAMES, default="rolling_sphere")
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    scene = str(scenes.CONFIG / f"{options.scene}.yaml")
    with machine.alone(), tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "RB_SIM_CACHE": folder}
        print(machine.line(machine.describe()))
        first = to_first_step(scene, environment)
        print(f"first start, compiles, to the first step: {first:.2f} s")
        later = [to_first_step(scene, environment) for _ in range(options.repeats)]
        print(f"later starts to the first step: {_summary(later)}")
        whole_run(scene, environment, folder)
        runs = [whole_run(scene, environment, folder) for _ in range(options.repeats)]
        print(f"whole `rb_sim run` of 10 ms, plots included: {_summary(runs)}")


def _summary(values: list[float]) -> str:
    return f"median {statistics.median(values):.2f} s, least {min(values):.2f} s"


if __name__ == "__main__":
    main()
