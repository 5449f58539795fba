"""How many wrong runs end without a word, and how many right ones are warned about.

    python -m benchmarks.silent_runs [--scenes N] [--seconds S] [--seed K]

Random scenes (benchmarks.fuzz), springs and tops run long, near-singular pendulums and narrow
pulses; each scene runs at random settings.  The truth is a run with dopri853 at a tolerance of
1e-12, used where one at 1e-11 agrees to 1e-4 of the motion.  The error of a run is the largest
pose error at its samples, over the largest way of a body or turn times radius of gyration (and rad
as they are); right is below 1e-3, wrong above 1e-2, grossly wrong above 0.1.
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

from benchmarks.fuzz.random_scenes import scene as random_scene
from rb_sim import Simulation, Trajectory
from rb_sim.base.errors import RbSimError
from rb_sim.checks.second_run import apart

RIGHT, WRONG, GROSS, SAME = 1e-3, 1e-2, 0.1, 1e-4

SLOWEST, LONGEST = 5.0, 60
"""Processor time [s]: a scene whose tight run takes longer is left out, and a run is broken off."""


def own_scene(rng: random.Random) -> dict[str, Any]:
    """A scene whose errors are hard to see: in a long run, under narrow pulses, near an unstable
    equilibrium."""
    kind = rng.choice(("spring", "pulse", "upright", "top"))
    body: dict[str, Any] = {"mass": 1.0, "inertia": [0.05, 0.08, 0.11], "position": [0, 0, 0]}
    gravity = {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}
    duration = rng.choice((5.0, 20.0, 100.0))
    scene: dict[str, Any] = {"bodies": {"p": body}}
    if kind == "spring":
        body["position"] = [rng.uniform(0.1, 2.0), 0.0, 0.0]
        stiffness = 10.0 ** rng.uniform(0.0, 4.0)
        scene["effects"] = {"s": {"type": "spring", "body": "p", "stiffness": stiffness}}
    elif kind == "pulse":
        duration = 2.0
        force = [rng.gauss(0.0, 2e3) for _ in range(3)]
        frequency = 10.0 ** rng.uniform(1.0, 3.7)
        body["angular_velocity"] = [rng.gauss(0.0, 1.0) for _ in range(3)]
        load = {"type": "wrench", "body": "p", "sine_force": force, "frame": "body"}
        scene["effects"] = {"w": load | {"angular_frequency": frequency}}
    else:
        tilt = 10.0 ** rng.uniform(-4.0, 0.0)
        body |= {"position": [math.sin(tilt), 0.0, math.cos(tilt)]}
        body["orientation"] = {"axis": [0, 1, 0], "angle": tilt}
        if kind == "top":
            body["angular_velocity"] = [0.0, 0.0, rng.uniform(20.0, 100.0)]
        duration = rng.choice((2.0, 10.0))
        joint = {"type": "fixed_point", "body": "p", "point_B": [0.0, 0.0, -1.0]}
        scene |= {"constraints": {"j": joint}, "effects": {"w": gravity}}
    scene["simulation"] = {"duration": duration, "rate": 200.0 / duration}
    return scene


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


def difference(run: Trajectory, truth: Trajectory, simulation: Any) -> float:
    """Largest pose error over the motion of the truth."""
    poses = [np.concatenate([r.block.position, r.block.orientation], axis=2) for r in (run, truth)]
    if poses[0].shape != poses[1].shape:
        return math.inf
    return apart(truth.t, poses[0], poses[1], simulation).relative


def judged(scene: dict[str, Any], rng: random.Random, counts: Counter[str]) -> None:
    """Count the runs of one scene by their true error and by whether anything is reported."""
    began = time.process_time()
    tight = {"method": "dopri853", "tolerance": 1e-12}
    try:
        truth, simulation = ran(scene, tight, watched=False)
        other, _ = ran(scene, tight | {"tolerance": 1e-11}, watched=False)
    except (RbSimError, ArithmeticError):
        counts["scenes without a tight run"] += 1
        return
    if time.process_time() - began > SLOWEST or difference(other, truth, simulation) > SAME:
        counts["scenes without a known truth"] += 1
        return
    counts["scenes"] += 1
    contacts = bool(simulation.layout.contacts)
    for setting in settings(rng, scene["simulation"]["duration"], contacts):
        try:
            run, _ = ran(scene, setting)
        except (RbSimError, ArithmeticError):
            counts["ended with an error"] += 1
            continue
        error = difference(run, truth, simulation)
        silent = not run.findings
        names = ["right"] if error < RIGHT else []
        names += ["wrong"] if error > WRONG else []
        names += ["gross"] if error > GROSS else []
        for name in names:
            counts[name] += 1
            counts[f"{name}, {'silent' if silent else 'reported'}"] += 1
        if silent and error > WRONG:
            print(f"silent: error {error:.2g}, {setting}, {run.global_error}", flush=True)
        if not silent and error < RIGHT:
            found = [str(finding) for finding in run.findings]
            print(f"false: error {error:.2g}, {setting}: {found}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description="wrong runs without a word")
    parser.add_argument("--scenes", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=math.inf)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    signal.signal(signal.SIGVTALRM, break_off)
    np.seterr(all="ignore")
    counts: Counter[str] = Counter()
    began = time.perf_counter()
    for k in range(options.scenes):
        if time.perf_counter() - began > options.seconds:
            break
        rng = random.Random(f"{options.seed} {k}")
        scene = own_scene(rng) if k % 3 == 0 else random_scene(rng, contacts=k % 3 == 1)
        own = {key: scene["simulation"][key] for key in ("duration", "rate")}
        judged(scene | {"simulation": own | {"project_initial": True}}, rng, counts)
    for name, count in sorted(counts.items()):
        print(f"{count:6d} {name}")
    for name, other in (("wrong", "silent"), ("gross", "silent"), ("right", "reported")):
        share = counts[f"{name}, {other}"] / max(1, counts[name])
        print(f"{100.0 * share:5.1f} % of the {name} runs {other}")


if __name__ == "__main__":
    main()
