# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Time from starting Python to the first step: the first start (compiles) and later ones (cached).

    python -m benchmarks.start_time [--scene NAME] [--repeats N]
    python -m benchmarks.start_time --beside [--repeats N]
    python -m benchmarks.start_time --first [--repeats N]

A new empty cache folder (RB_SIM_CACHE) makes the first start a real first one. Given are the wall
clock, which is what a user waits for and depends on what else the machine does, and the CPU time.
--beside gives the least CPU times of new scenes, whose laws have to be compiled while the loops are
on disk, and what they are above that of a free body whose law is on disk, too.
--first gives what a machine that never ran rb_sim needs: each start has an empty cache folder, the
loops are those that come with the package, and what an empty Python takes is subtracted. It ends
where a start compiles a loop.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from benchmarks import machine
from benchmarks.many_body_scenes import chain, on_springs
from benchmarks.peers import scenes

FIRST_STEP = """
import sys
from rb_sim import Simulation, load_scene
simulation = Simulation(load_scene(sys.argv[1]))
simulation.advance(1e-3)
print("stepped")
"""

NEW: dict[str, dict[str, Any] | None] = {
    "heavy_top": None,
    "16 springs": on_springs(16),
    "dropped_box": None,
    "ball_on_block": None,
    "chain of 20": chain(20),
}
"""Scenes; None for a shipped one of this name."""

FIRST = ("dropped_box", "heavy_top", "gazebo_boxes")
"""Shipped scenes with a contact, without one, and with a stack of boxes."""

COMMAND = "import sys; from rb_sim.cli.main import main; sys.exit(main())"


class Taken(NamedTuple):
    """Time of one child process [s]."""

    wall: float
    cpu: float


def to_first_step(scene: str, environment: dict[str, str]) -> Taken:
    """From starting Python to the end of the first step, through the library."""
    return timed([sys.executable, "-c", FIRST_STEP, scene], environment)


def whole_run(scene: str, environment: dict[str, str], out: str) -> Taken:
    """A whole `rb_sim run` of 10 ms simulated time, without bag and recording."""
    options = ["--duration", "0.01", "--no-bag", "--no-rerun", "--quiet", "--out", out]
    options += ["--overwrite"]
    return timed([sys.executable, "-c", COMMAND, "run", scene, *options], environment)


def timed(command: list[str], environment: dict[str, str]) -> Taken:
    """What a child process takes; ends the measurement where it fails."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode != 0:
        raise SystemExit(f"the measured process failed: {done.stderr.strip()[-300:]}")
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Taken(wall, cpu)


def beside(folder: Path, repeats: int) -> dict[str, float]:
    """Least CPU time to the first step of new scenes, the free body's first [s]."""
    environment = {**os.environ, "RB_SIM_CACHE": str(folder)}
    paths = {}
    for name, scene in (("free body", on_springs(0)), *NEW.items()):
        paths[name] = str(scenes.CONFIG / f"{name}.yaml")
        if isinstance(scene, dict):
            paths[name] = str(folder / f"{name.replace(' ', '_')}.yaml")
            Path(paths[name]).write_text(yaml.safe_dump(scene), encoding="utf-8")
        to_first_step(paths[name], environment)
    taken: dict[str, list[float]] = {name: [] for name in paths}
    for _ in range(repeats):
        for name, path in paths.items():
            for laws in folder.glob("laws-*"):
                shutil.rmtree(laws)
            if name == "free body":
                to_first_step(path, environment)
            taken[name].append(to_first_step(path, environment).cpu)
    return {name: min(values) for name, values in taken.items()}


def print_beside(repeats: int) -> None:
    """Measure and print new scenes beside the free body."""
    with machine.alone(), tempfile.TemporaryDirectory() as folder:
        print(machine.line(machine.describe()))
        least = beside(Path(folder), repeats)
    for name, value in least.items():
        print(f"{name:14s} {value:.2f} s of CPU, {value - least['free body']:+.2f} s")


def print_first(repeats: int) -> None:
    """Measure and print starts with an empty cache, above those of an empty Python."""
    subprocess.run([sys.executable, "-m", "rb_sim.compiler.ship", os.uname().machine], check=True)
    with machine.alone():
        print(machine.line(machine.describe()))
        empty = [timed([sys.executable, "-c", "pass"], dict(os.environ)).cpu for _ in range(9)]
        python = statistics.median(empty)
        for name in FIRST:
            above = [never_started(name).cpu - python for _ in range(repeats)]
            print(
                f"{name:14s} first start to the first step, above Python's {python:.2f} s: "
                f"CPU median {statistics.median(above):.2f} s, least {min(above):.2f} s"
            )


def never_started(name: str) -> Taken:
    """A first start of a shipped scene; ends the measurement where it compiles a loop."""
    with tempfile.TemporaryDirectory() as folder:
        taken = to_first_step(
            str(scenes.CONFIG / f"{name}.yaml"), {**os.environ, "RB_SIM_CACHE": folder}
        )
        if compiled := sorted(Path(folder).glob("*/loop-*")):
            raise SystemExit(f"{name}: compiles {len(compiled)} loops, which are not shipped")
    return taken


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.start_time")
    parser.add_argument("--scene", choices=scenes.NAMES, default="rolling_sphere")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--beside", action="store_true", help="new scenes beside a free body")
    parser.add_argument("--first", action="store_true", help="with an empty cache, shipped loops")
    options = parser.parse_args()
    if options.first:
        print_first(options.repeats)
        return
    if options.beside:
        print_beside(options.repeats)
        return
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
