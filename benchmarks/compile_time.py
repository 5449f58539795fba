# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""CPU time of compiling the loops, once per machine and version, and of `rb_sim accuracy` cold.

    python -m benchmarks.compile_time [--part WORD]
    python -m benchmarks.compile_time --accuracy SCENE [SCENE ...]
    python -m benchmarks.compile_time --draft SCENE [SCENE ...]

Each part compiles into the folder that the parts before it left, empty at first (RB_SIM_CACHE), and
once more when only its laws are new: the difference are its loops. --part takes one part alone.
--accuracy gives whole `rb_sim accuracy` commands with nothing on disk, and with the loops there.
--draft gives what RB_SIM_DRAFT=1 makes of compiling the laws of a scene and of a run of it, over
what they take without it.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import yaml

from benchmarks import machine
from benchmarks.many_body_scenes import chain
from benchmarks.start_time import COMMAND, Taken, timed

WARM = """
import sys
from rb_sim.simulation.simulation import compiled
from rb_sim.scene.load import load_scene
for scene, method in zip(sys.argv[1::2], sys.argv[2::2]):
    compiled(load_scene(scene, method=method or None), lambda line: None)
"""
"""Compiles scenes, each under a method ("": its own)."""

METHODS = ("euler", "rk4", "dopri853", "gauss6", "radau5", "taylor")


def parts(folder: Path) -> dict[str, list[str]]:
    """Scenes and methods of each part, in turn."""
    links = folder / "chain.yaml"
    links.write_text(yaml.safe_dump(chain(2)), encoding="utf-8")
    methods = [word for method in METHODS for word in ("heavy_top", method)]
    return {
        "one body": methods,
        "several bodies": [str(links), ""],
        "contact events": ["dropped_box", "", "ball_on_block", ""],
        "time stepping": ["dropped_box", "time_stepping"],
    }


def forget(folder: Path, laws: bool) -> None:
    """Remove the laws from the cache, or all of it."""
    for path in folder.glob("laws-*" if laws else "*"):
        shutil.rmtree(path, ignore_errors=True)


def loops(only: str | None) -> None:
    """Print what each part's loops take."""
    with tempfile.TemporaryDirectory() as scenes, tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "RB_SIM_CACHE": cache}
        total = 0.0
        for name, words in parts(Path(scenes)).items():
            if only is not None and only not in name:
                continue
            forget(Path(cache), laws=True)
            cold = timed([sys.executable, "-c", WARM, *words], environment)
            forget(Path(cache), laws=True)
            warm = timed([sys.executable, "-c", WARM, *words], environment)
            total += cold.cpu - warm.cpu
            print(
                f"{name:16s} {cold.cpu - warm.cpu:6.2f} s of CPU for its loops "
                f"({cold.wall - warm.wall:.2f} s of wall), {warm.cpu:.2f} s with these on disk",
                flush=True,
            )
        print(f"{'in all':16s} {total:6.2f} s of CPU")


def accuracy(scenes: list[str]) -> None:
    """Print what whole accuracy commands take."""
    for scene in scenes:
        with tempfile.TemporaryDirectory() as cache:
            environment = {**os.environ, "RB_SIM_CACHE": cache}
            command = [sys.executable, "-c", COMMAND, "accuracy", scene]
            cold = timed(command, environment)
            forget(Path(cache), laws=True)
            print(f"{scene:16s} {said(cold)}; loops on disk: {said(timed(command, environment))}")


DRAFT = """
import sys, time
from rb_sim import Simulation, load_scene
scene = load_scene(sys.argv[1], method="rk4", step=2e-6)
began = time.process_time()
simulation = Simulation(scene, announce=None)
simulation.warm()
taken = [time.process_time() - began]
for _ in range(4):
    simulation.reset()
    began = time.process_time()
    simulation.run(0.2, checks=False)
    taken.append(time.process_time() - began)
print(taken[0], min(taken[1:]))
"""
"""Prints the CPU time [s] of compiling a scene's laws and of 100,000 steps."""


def draft(scenes: list[str]) -> None:
    """Print the ratios of a draft to optimised code."""
    for scene in scenes:
        compiled, stepped = drafted_or_not(scene, "0")
        drafted, slower = drafted_or_not(scene, "1")
        print(
            f"{scene:24} laws {compiled:.2f} s, as a draft {drafted / compiled:.2f} times; "
            f"steps {stepped:.3f} s, as a draft {slower / stepped:.2f} times",
            flush=True,
        )


def drafted_or_not(scene: str, draft: str) -> list[float]:
    """CPU times [s] of compiling the laws and of the steps, the loops on disk."""
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "RB_SIM_CACHE": cache, "RB_SIM_DRAFT": draft}
        for _ in range(2):
            forget(Path(cache), laws=True)
            command = [sys.executable, "-c", DRAFT, scene]
            out = subprocess.run(
                command, env=environment, check=True, capture_output=True, text=True
            )
        return [float(word) for word in out.stdout.split()]


def said(taken: Taken) -> str:
    """Both clocks in words."""
    return f"{taken.cpu:.1f} s of CPU, {taken.wall:.1f} s of wall"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.compile_time")
    parser.add_argument("--part", help="a word of the part's name")
    parser.add_argument("--accuracy", nargs="+", metavar="SCENE")
    parser.add_argument("--draft", nargs="+", metavar="SCENE")
    options = parser.parse_args()
    with machine.alone():
        print(machine.line(machine.describe()), flush=True)
        if options.accuracy:
            accuracy(options.accuracy)
        elif options.draft:
            draft(options.draft)
        else:
            loops(options.part)


if __name__ == "__main__":
    main()
