"""Time from starting Python to the first step: the first start (compiles) and later ones (cached).

    python -m benchmarks.start_time [--scene NAME] [--repeats N]

A new empty cache folder (RB_SIM_CACHE) makes the first start a real first one. Given are the wall
clock, which is what a user waits for and depends on what else the machine does, and the CPU time.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from typing import NamedTuple

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


class Taken(NamedTuple):
    """Time of one child process [s]."""

    wall: float
    cpu: float


def to_first_step(scene: str, environment: dict[str, str]) -> Taken:
    """From starting Python to the end of the first step, through the library."""
    return _timed([sys.executable, "-c", FIRST_STEP, scene], environment)


def whole_run(scene: str, environment: dict[str, str], out: str) -> Taken:
    """A whole `rb_sim run` of 10 ms simulated time, without bag and recording."""
    options = ["--duration", "0.01", "--no-bag", "--no-rerun", "--quiet", "--out", out]
    return _timed([sys.executable, "-c", COMMAND, "run", scene, *options], environment)


def _timed(command: list[str], environment: dict[str, str]) -> Taken:
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode != 0:
        raise SystemExit(f"the measured process failed: {done.stderr.strip()[-300:]}")
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Taken(wall, cpu)


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
        print(f"first start, compiles, to the first step: {_summary([first])}")
        later = [to_first_step(scene, environment) for _ in range(options.repeats)]
        print(f"later starts to the first step: {_summary(later)}")
        whole_run(scene, environment, folder)
        runs = [whole_run(scene, environment, folder) for _ in range(options.repeats)]
        print(f"whole `rb_sim run` of 10 ms, plots included: {_summary(runs)}")


def _summary(values: list[Taken]) -> str:
    wall, cpu = zip(*values, strict=True)
    return (
        f"wall clock median {statistics.median(wall):.2f} s, least {min(wall):.2f} s; "
        f"CPU median {statistics.median(cpu):.2f} s, least {min(cpu):.2f} s"
    )


if __name__ == "__main__":
    main()
