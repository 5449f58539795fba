# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`python -m benchmarks.auto_search`: what the search of `method: auto` costs, and what it keeps.

Random scenes of six families that nobody tuned for; one row each: counted time of the search, the
CPU time that it takes once more when all is compiled, runs at the chosen setting that it is worth
(allowed: 5, or 1 s), and the true error beside the target, where two sharper runs of different
methods know it.
"""

from __future__ import annotations

import argparse
import random
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.fuzz import random_scenes
from benchmarks.fuzz.random_scenes import Mapping, magnitude, unit, vector
from rb_sim import load_scene
from rb_sim.accuracy import auto
from rb_sim.accuracy.checked import checked_run, local_tolerance, pilot, pose_within, sharpest
from rb_sim.accuracy.runs import Runner, pose_difference, sample_times
from rb_sim.base.errors import RbSimError
from rb_sim.scene.compile import compile_scene

RUNS, SECOND = 5.0, 1.0
"""Runs at the chosen setting, or counted seconds, that a search may cost."""


def chain(rng: random.Random) -> Mapping:
    """Two to five rods, each hung on the one before: chaotic from three on."""
    bodies: Mapping = {}
    joints: Mapping = {}
    top = 0.0
    for i in range(rng.randint(2, 5)):
        name, length = f"rod{i}", rng.uniform(0.2, 1.0)
        size = {"type": "box", "size": [0.05, 0.04, length]}
        bodies[name] = {"mass": magnitude(rng, 0.1, 10.0), "shape": size}
        bodies[name] |= {"position": [0, 0, top - length / 2], "angular_velocity": vector(rng, 5.0)}
        top -= length
        joints[f"joint{i}"] = {"type": "fixed_point", "body": name, "point_B": [0, 0, length / 2]}
        if i:
            joints[f"joint{i}"] |= {"parent": f"rod{i - 1}", "point_A": [0, 0, -length / 2]}
    return {"bodies": bodies, "constraints": joints, "effects": weight()}


def stiff(rng: random.Random) -> Mapping:
    """A body between strong springs and dampers."""
    spring = {
        "type": "spring", "body": "b", "point_A": vector(rng), "point_B": vector(rng, 0.2),
        "stiffness": magnitude(rng, 1e3, 1e9), "damping": magnitude(rng, 1.0, 1e6),
        "rest_length": rng.uniform(0.1, 1.0),
    }  # fmt: skip
    drag = {"type": "linear_drag", "body": "b", "coefficient": magnitude(rng, 1e-2, 1e6)}
    bodies = {"b": random_scenes.body(rng, vector(rng, 0.5), None)}
    return {"bodies": bodies, "effects": weight() | {"spring": spring, "drag": drag}}


def contact(rng: random.Random) -> Mapping:
    """One or two bodies thrown onto the floor."""
    bodies: Mapping = {}
    contacts: Mapping = {}
    for i in range(rng.randint(1, 2)):
        name = f"b{i}"
        bodies[name] = random_scenes.body(rng, vector(rng, 0.3), random_scenes.shape(rng))
        bodies[name]["position"][2] = 0.5 + 2.0 * i
        contacts[f"c{i}"] = random_scenes.contact(rng, name)
    return {"bodies": bodies, "constraints": contacts, "effects": weight()}


def resting(rng: random.Random) -> Mapping:
    """One to three boxes that rest on their faces, or slide."""
    bodies: Mapping = {}
    contacts: Mapping = {}
    for i in range(rng.randint(1, 3)):
        size = [rng.uniform(0.1, 0.5) for _ in range(3)]
        bodies[f"b{i}"] = {
            "mass": magnitude(rng, 0.1, 10.0),
            "shape": {"type": "box", "size": size},
        }
        bodies[f"b{i}"] |= {"position": [2.0 * i, 0.0, 0.5 * size[2]]}
        bodies[f"b{i}"] |= {"linear_velocity": [0.0, rng.choice((0.0, rng.uniform(0.0, 3.0))), 0.0]}
        friction = {"type": "coulomb", "static": 0.5, "kinetic": 0.4}
        contacts[f"c{i}"] = {"type": "contact", "body": f"b{i}", "friction": friction}
    return {"bodies": bodies, "constraints": contacts, "effects": weight()}


def guide(rng: random.Random) -> Mapping:
    """A body led along a line or a curve, on a spring."""
    led: Mapping = {"type": "translation", "body": "b"}
    led["guide"] = rng.choice(
        (
            {"type": "line", "direction": unit(rng)},
            {"type": "circle", "center": [1.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0], "radius": 1.0},
        )
    )
    spring = random_scenes.effect(rng, ["b"])
    bodies = {"b": random_scenes.body(rng, [0.0, 0.0, 0.0], None)}
    bodies["b"].pop("center_of_mass", None)
    return {
        "bodies": bodies, "constraints": {"led": led}, "effects": weight() | {"spring": spring}
    }  # fmt: skip


def anything(rng: random.Random) -> Mapping:
    """A scene as the fuzzer has it."""
    return random_scenes.scene(rng)


def weight() -> Mapping:
    return {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}}


FAMILIES: dict[str, Callable[[random.Random], Mapping]] = {
    "chain": chain, "stiff": stiff, "contact": contact, "resting": resting,
    "guide": guide, "anything": anything,
}  # fmt: skip


def drawn(family: str, number: int) -> Mapping:
    """The scene of that number, which asks `auto` for an error between 1e-9 and 1e-2."""
    rng = random.Random(f"{family} {number}")
    scene = FAMILIES[family](rng)
    scene["simulation"] = {
        "duration": magnitude(rng, 0.3, 30.0), "rate": 100.0, "project_initial": True,
        "method": "auto", "tolerance": magnitude(rng, 1e-9, 1e-2),
    }  # fmt: skip
    return scene


def searched(mapping: Mapping, beyond: float) -> tuple[str, bool]:
    """(the row, whether all that was promised holds). beyond: counted time for the truth [s]."""
    scene = load_scene(mapping)
    options, compiled = scene.simulation, compile_scene(scene)
    runners: list[Runner] = []

    def made(*arguments: Any) -> Runner:
        runners.append(Runner(*arguments))
        return runners[-1]

    auto.__dict__["Runner"] = made
    try:
        choice = auto.choose(compiled, options)
    finally:
        auto.__dict__["Runner"] = Runner
    began = time.process_time()
    auto.choose(compiled, options)
    cpu = time.process_time() - began
    spent, one = runners[0].spent, choice.cost * options.duration
    cheap = spent <= max(SECOND, RUNS * one)
    row = (
        f"{spent:7.3f} s {cpu:7.3f} s {spent / one if one else np.nan:9.3g} runs "
        f"{options.tolerance:8.1e} {choice.predicted_error:8.1e}"
    )
    truth = Runner(compiled, options.duration, sample_times(options))
    target = 0.01 * min(float(options.tolerance or 0.0), 0.1)
    tolerance = local_tolerance(target)
    first = pilot(truth, tolerance, beyond) or sharpest(truth, tolerance)
    truth.limit = beyond
    true = checked_run(truth, first, pose_within(target), beyond)
    rows, _ = truth.sampled(choice.setting)
    error = float(pose_difference(rows, true.rows, compiled.layout).max())
    known = true.agreement < 0.3 * float(options.tolerance or 0.0)
    kept = not known or not choice.reached or error <= float(options.tolerance or 0.0)
    verdict = ("" if cheap else " DEAR") + ("" if kept else " WRONG")
    row += f" {error:8.1e}{' ' if known else '?'} {choice.setting!s:32}"
    return f"{row}{verdict}{'' if choice.reached else ' | ' + choice.reason}", cheap and kept


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--count", type=int, default=6, help="scenes of each family")
    options.add_argument("--first", type=int, default=0, help="number of the first")
    options.add_argument("--family", choices=list(FAMILIES), action="append")
    options.add_argument("--beyond", type=float, default=5.0, help="counted time for the truth [s]")
    given = options.parse_args()
    print("scene         counted       CPU        worth    target predicted     true  setting")
    broken = 0
    for family in given.family or list(FAMILIES):
        for number in range(given.first, given.first + given.count):
            try:
                row, holds = searched(drawn(family, number), given.beyond)
            except RbSimError as error:
                row, holds = f"refused: {error}", True
            broken += not holds
            print(f"{family:8} {number:3} {row}", flush=True)
    print(f"{broken} broken")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
