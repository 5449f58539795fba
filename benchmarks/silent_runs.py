# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""How many wrong runs end without a word, and how many right ones are warned about.

    python -m benchmarks.silent_runs [--scenes N] [--seconds S] [--seed K] [--kind KIND]
        [--no-check]

Random scenes (benchmarks.fuzz) and such whose errors are hard to see (benchmarks.hard_to_see);
each scene runs at random settings; with --no-check without a second run.  The truth is a closed
form (benchmarks.known_motions) where there is one, else a run with dopri853 at a tolerance of
1e-12, used where one at 1e-11 agrees to 1e-4 of the motion.  The error
of a run is the largest pose error at its samples, over the largest way of a body or turn times
radius of gyration (and rad as they are); right is below 1e-3, wrong above 1e-2, grossly wrong above
0.1.  Where stated errors are compared with true ones, either counts as 1e-4 if it is smaller.
"""

from __future__ import annotations

import argparse
import math
import random
import signal
import time
import warnings
from collections import Counter
from typing import Any

import numpy as np

from benchmarks import hard_to_see
from benchmarks.fuzz.random_scenes import scene as random_scene
from benchmarks.known_motions import known_poses
from rb_sim import Simulation, Trajectory
from rb_sim.accuracy.checks.second_run import apart
from rb_sim.accuracy.runs import poses_of
from rb_sim.base.errors import RbSimError

RIGHT, WRONG, GROSS, SAME = 1e-3, 1e-2, 0.1, 1e-4

SLOWEST, LONGEST = 5.0, 60
"""Processor time [s]: a scene whose tight run takes longer is left out, and a run is broken off."""


def settings(rng: random.Random, duration: float, contacts: bool) -> list[dict[str, Any]]:
    """The default, and some that nobody would swear by."""
    found: list[dict[str, Any]] = [{}]
    for _ in range(4):
        method = rng.choice(("dopri853", "radau5", "taylor"))
        tolerance = 10.0 ** rng.uniform(-8.0, -2.0)
        found.append({"method": method, "tolerance": tolerance})
    for _ in range(6):
        method = rng.choice(("euler", "rk4", "gauss6", "radau5", "dopri853"))
        found.append({"method": method, "step": duration / 10.0 ** rng.uniform(0.7, 3.7)})
    if contacts:
        for _ in range(3):
            step = duration / 10.0 ** rng.uniform(1.5, 3.5)
            found.append({"method": "time_stepping", "step": step})
    return found


def ran(scene: dict[str, Any], setting: dict[str, Any], **how: Any) -> tuple[Trajectory, Any]:
    """The run of the scene with the setting, and its simulation.

    Raises RbSimError, also of a run that takes too long.
    """
    simulation = Simulation(scene | {"simulation": scene["simulation"] | setting}, announce=None)
    signal.setitimer(signal.ITIMER_VIRTUAL, LONGEST)
    try:
        return simulation.run(**how), simulation
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)


def break_off(*_: Any) -> None:
    raise RbSimError(f"broken off after {LONGEST} s")


def difference(run: Trajectory, truth: np.ndarray, simulation: Any) -> float:
    """Largest pose error over the motion of the truth, poses (n, bodies, 7)."""
    poses = poses_of(run.block)
    if poses.shape != truth.shape:
        return math.inf
    return apart(run.t, poses, truth, simulation).relative


def truth_of(
    kind: str, scene: dict[str, Any], counts: Counter[str]
) -> tuple[np.ndarray, Any] | None:
    """The poses of the motion and a simulation of it, or None where nobody knows it."""
    began = time.process_time()
    tight = {"method": "dopri853", "tolerance": 1e-12}
    try:
        run, simulation = ran(scene, tight, checks=False)
    except (RbSimError, ArithmeticError):
        counts["scenes without a tight run"] += 1
        return None
    known = known_poses(kind, scene, run.t)
    if known is not None:
        counts["scenes with a closed form"] += 1
        error = difference(run, known, simulation)
        if error > SAME:
            print(f"tight: {kind}, error {error:.2g}", flush=True)
        return known, simulation
    try:
        other, _ = ran(scene, tight | {"tolerance": 1e-11}, checks=False)
        slow = time.process_time() - began > SLOWEST
        if not slow and difference(other, poses_of(run.block), simulation) <= SAME:
            return poses_of(run.block), simulation
    except (RbSimError, ArithmeticError):
        pass
    counts["scenes without a known truth"] += 1
    return None


def judged(
    kind: str,
    scene: dict[str, Any],
    rng: random.Random,
    counts: Counter[str],
    ratios: list[float],
    check: bool | None,
) -> None:
    """Count the runs of one scene by their true error and by whether anything is reported, and add
    the ratios of true to stated error, of which neither counts as less than SAME."""
    found = truth_of(kind.split()[0], scene, counts)
    if found is None:
        return
    truth, simulation = found
    counts["scenes"] += 1
    contacts = bool(simulation.layout.contacts)
    for setting in settings(rng, scene["simulation"]["duration"], contacts):
        try:
            run, _ = ran(scene, setting, check=check)
        except (RbSimError, ArithmeticError):
            counts["ended with an error"] += 1
            continue
        error = difference(run, truth, simulation)
        silent = not run.findings
        stated = run.global_error
        if (
            stated is not None
            and stated.known
            and math.isfinite(stated.relative)
            and stated.upto is None
        ):
            ratios.append(max(error, SAME) / max(stated.relative, SAME))
            if ratios[-1] > 3.0 and stated.relative < 1.0:
                print(f"ratio: {kind}, {error:.2g}, {setting}, {stated}", flush=True)
        names = ["right"] if error < RIGHT else []
        names += ["wrong"] if error > WRONG else []
        names += ["gross"] if error > GROSS else []
        for name in names:
            counts[name] += 1
            counts[f"{name}, {'silent' if silent else 'reported'}"] += 1
            for watch in {finding.check for finding in run.findings}:
                counts[f"{name}, reported by {watch}"] += 1
                counts[f"{name}, reported by {watch} alone"] += len(run.findings) == 1
        if silent and error > WRONG:
            print(f"silent: {kind}, error {error:.2g}, {setting}, {run.global_error}", flush=True)
        if not silent and error < RIGHT:
            found = [str(finding) for finding in run.findings]
            print(f"false: {kind}, error {error:.2g}, {setting}: {found}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description="wrong runs without a word")
    parser.add_argument("--scenes", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=math.inf)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", choices=hard_to_see.KINDS, help="scenes of this kind only")
    parser.add_argument("--no-check", dest="check", action="store_const", const=False)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    signal.signal(signal.SIGVTALRM, break_off)
    np.seterr(all="ignore")
    counts: Counter[str] = Counter()
    ratios: list[float] = []
    began = time.perf_counter()
    for k in range(options.scenes):
        if time.perf_counter() - began > options.seconds:
            break
        rng = random.Random(f"{options.seed} {k}")
        if k % 3 == 0 or options.kind:
            kind, scene = hard_to_see.scene(rng, options.kind)
        else:
            kind, scene = "random", random_scene(rng, contacts=k % 3 == 1)
        own = {key: scene["simulation"][key] for key in ("duration", "rate")}
        scene |= {"simulation": own | {"project_initial": True}}
        judged(f"{kind} {k}", scene, rng, counts, ratios, options.check)
    for name, count in sorted(counts.items()):
        print(f"{count:6d} {name}")
    for name, other in (("wrong", "silent"), ("gross", "silent"), ("right", "reported")):
        share = counts[f"{name}, {other}"] / max(1, counts[name])
        print(f"{100.0 * share:5.1f} % of the {name} runs {other}")
    ratio = np.array(ratios)
    for share, words in (
        ((ratio <= 1.0 / 3.0).mean(), "less than a third of"),
        ((ratio <= 3.0).mean(), "at most 3 times"),
        ((ratio < 0.01).mean(), "less than 1/100 of"),
    ):
        print(f"{100.0 * share:5.1f} % of {len(ratio)} true errors {words} the stated one")


if __name__ == "__main__":
    main()
