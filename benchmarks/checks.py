# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`python -m benchmarks.checks`: CPU time of the checks of a run beside that of the run itself.

"command" is a whole `rb_sim run SCENE`, from the start of Python to its end, and "of that" what the
checks add to it; each in a process of its own, kernels and modules compiled before. Start and
imports are most of a short run, for whoever gives the command. Among them are the modules of the
checks themselves, which come with the program whatever it runs: "imports", not in "of that".

"bare" is stepping and sampling alone; bare and checked runs take turns, and "pairs" is the median
of how much more the checked ones take. "inside" is the share that the clock shows around the
checks' calls of the checked runs, which other programs on the machine disturb less. Of every scene
two runs at its own rate are shown: the one that it asks for, which is short and looked at closely
all over, and one that goes on for about `--seconds` of CPU time: most of a run's cost may come late
(a sphere that is pushed rolls ever faster), or early (a ball comes to rest).
"""

from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import many_body_scenes
from rb_sim import Simulation, load_scene, scenes
from rb_sim.accuracy.checks.check import effort_of
from rb_sim.accuracy.checks.check_list import CheckList
from rb_sim.scene.load import as_run_text

CASES: tuple[tuple[Any, dict[str, Any]], ...] = (
    ("free_tumble", {}),
    ("heavy_top", {}),
    ("heavy_top", {"method": "rk4", "step": 1e-4}),
    ("rolling_disk", {}),
    ("rolling_sphere", {}),
    ("hard_cases/door_on_three_hinges", {}),
    ("hard_cases/four_bar_in_space", {}),
    ("chain of 5", {}),
    ("chain of 20", {}),
    ("bouncing_ball", {}),
    ("thrown_ball", {}),
    ("stick_slip", {}),
    ("rattleback", {}),
)
"""(scene, settings)."""


MOST_GROWTH = 10.0
"""Of the duration from one trial to the next."""

MOST_TRIALS = 12
"""Of durations."""


def long_enough(simulation: Simulation, duration: float, seconds: float) -> float:
    """A duration [s] whose bare run takes about so much CPU time, at least half of it.

    The next trial may cost by the square of the duration, so it grows by the root of what lacks.
    """
    for _ in range(MOST_TRIALS):
        spent = bare(simulation, duration)
        if spent >= 0.5 * seconds:
            break
        duration *= min(MOST_GROWTH, math.sqrt(seconds / spent))
    return duration


def bare(simulation: Simulation, duration: float) -> float:
    """CPU time [s] of a run without checks."""
    simulation.reset()
    began = time.process_time()
    with np.errstate(all="ignore"):
        for _ in simulation.blocks(duration, simulation.scene.simulation.rate):
            pass
    return time.process_time() - began


def checked(simulation: Simulation, duration: float) -> tuple[float, float]:
    """CPU time [s] of a run with its checks, and the share of the checks as seen from inside.

    Inside it is the wall's clock, which costs a hundredth of the processor's: what else runs on the
    machine stops the checks as often as the steps, for the time that each takes.
    """
    simulation.reset()
    effort, clock, inside = partial(effort_of, simulation), time.perf_counter, 0.0
    began, start = clock(), time.process_time()
    with np.errstate(all="ignore"):
        check_list = CheckList(simulation.scene, simulation.layout, simulation.compiled)
        inside += clock() - began
        for block in simulation.blocks(duration, simulation.scene.simulation.rate):
            entered = clock()
            check_list.add(block, effort)
            inside += clock() - entered
    return time.process_time() - start, inside / (clock() - began - inside)


def figures(simulation: Simulation, duration: float, runs: int) -> tuple[float, float, float]:
    """Medians: bare [s], and the share of the checks by pairs and from inside."""
    bare(simulation, duration)
    both = [(bare(simulation, duration), *checked(simulation, duration)) for _ in range(runs)]
    return (
        statistics.median(run for run, _, _ in both),
        statistics.median(whole / run - 1.0 for run, whole, _ in both),
        statistics.median(inside for _, _, inside in both),
    )


def share_of_command(scene: Any, duration: float, runs: int) -> tuple[float, float, float]:
    """Medians of runs in processes of their own: CPU time [s], the share of the checks, and the
    time [s] of importing them."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.yaml"
        path.write_text(as_run_text(scene), encoding="utf-8")
        module = "benchmarks.checks_of_command"
        line = [sys.executable, "-m", module, str(path), str(duration)]
        compiles = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
        kept = compiles | {"PYTHONPYCACHEPREFIX": str(Path(folder) / "modules")}
        run = partial(subprocess.run, line, capture_output=True, text=True, check=True, env=kept)
        run()  # compiles the modules, as an installed package has them
        found = []
        for _ in range(runs):
            done = run()
            cost = json.loads(done.stdout)
            bare = cost["whole"] - cost["checks"]
            found.append((cost["whole"], cost["checks"] / bare, cost["imports"]))
    whole, share, imports = (statistics.median(column) for column in zip(*found, strict=True))
    return whole, share, imports


def shipped(runs: int) -> None:
    """Print what the runs of all shipped scenes take together, without checks and with them."""
    simulations = [Simulation(scene.name, announce=None) for scene in scenes()]
    ways: dict[str, dict[str, Any]] = {
        "run(checks=False)": {"checks": False}, "run(check=False)": {"check": False}, "run()": {},
    }  # fmt: skip
    for way, given in ways.items():
        taken = []
        for _ in range(runs + 1):  # the first compiles
            for simulation in simulations:
                simulation.reset()
            began = time.process_time()
            for simulation in simulations:
                simulation.run(**given)
            taken.append(time.process_time() - began)
        print(f"{len(simulations)} shipped scenes, {way:18} {min(taken[1:]):6.2f} s", flush=True)


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--runs", type=int, default=3, help="pairs of runs")
    options.add_argument("--seconds", type=float, default=1.0, help="CPU time of a long run")
    options.add_argument("--only", help="a word of the scene's name")
    options.add_argument("--shipped", action="store_true", help="all shipped scenes together")
    given = options.parse_args()
    if given.shipped:
        shipped(given.runs)
        return 0
    heads = ("simulated", "bare [ms]", "pairs", "inside", "command [ms]", "of that", "imports [ms]")
    print(f"{'scene':31} {'method':8} " + " ".join(f"{head:>12}" for head in heads))
    for name, settings in CASES:
        if given.only and given.only not in name:
            continue
        simulation = Simulation(load_scene(scene_of(name), **settings), announce=None)
        simulation.warm()
        asked = simulation.scene.simulation.duration
        for duration in (asked, long_enough(simulation, asked, given.seconds)):
            run, pairs, inside = figures(simulation, duration, given.runs)
            whole, share, imports = share_of_command(simulation.scene, duration, given.runs)
            print(
                f"{name:31} {simulation.scene.simulation.method:8} {duration:10.4g} s "
                f"{1e3 * run:12.2f} {pairs:12.1%} {inside:12.1%} {1e3 * whole:12.0f} {share:12.2%} "
                f"{1e3 * imports:12.1f}",
                flush=True,
            )
    return 0


def scene_of(name: str) -> Any:
    """A shipped scene, that of a hard case, or a chain."""
    if name.startswith("chain of "):
        return many_body_scenes.chain(int(name.rsplit(" ", 1)[1]))
    if "/" not in name:
        return name
    from rb_sim.cli.verbs.hard_cases import shipped
    from rb_sim.sweeps.hard_cases import load_cases

    return load_cases(shipped(), [name.split("/")[1]])[0].scene


if __name__ == "__main__":
    sys.exit(main())
