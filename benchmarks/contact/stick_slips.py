# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Random stick-slips against the closed form: `python -m benchmarks.contact.stick_slips`.

A block is pulled over the floor by a spring whose end moves at v.  It slips once the spring pulls
with mu_s m g, then moves as v t - (v/w) sin(w t) + d (1 - cos(w t)), d = (mu_s - mu_k) m g / k,
and sticks where that has no speed: after 2 (pi - atan(w d / v)) / w.  It rests for 2 d / v.  Where
w d is small beside v, the slip dips below zero by little and for a short time only.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from typing import Any, NamedTuple

import numpy as np

G = 9.81
CYCLES = 4
"""Slips of one run, which ends in the middle of the last stick."""
NEAR = 0.05
"""Part of a slip by which a stick may be early or late to be that of the closed form."""
MOST_STEPS = 50_000


class StickSlip(NamedTuple):
    """One random case."""

    mapping: dict[str, Any]
    sticks: list[float]
    """instants of the closed form [s]."""
    slip_time: float
    options: str
    """how it is integrated, in words."""


class Block(NamedTuple):
    """What is pulled, and how."""

    w: float
    """sqrt(k / m) [rad/s]."""
    d: float
    """by which the spring shortens, on the mean, in a slip [m]."""
    ratio: float
    """w d / v."""
    mass: float
    kinetic: float


def case(seed: int, number: int, fixed: bool) -> StickSlip:
    """A random block; fixed: steps of rk4, else a tolerance of dopri853."""
    rng = np.random.default_rng([seed, number])
    w, d = 10.0 ** rng.uniform(0.3, 1.7), 10.0 ** rng.uniform(-1.3, -0.3)
    ratio, mass = 10.0 ** rng.uniform(-1.0, 1.3), float(rng.uniform(0.3, 3.0))
    block = Block(w, d, ratio, mass, float(rng.uniform(0.1, 0.6)))
    options, text = how(rng, w, end_of(block, CYCLES), fixed)
    return pulled(block, CYCLES, options, text)


def end_of(block: Block, cycles: int) -> float:
    """The middle of the last stick [s]."""
    return sticks_of(block, cycles)[-1] + block.ratio / block.w


def slip_time(block: Block) -> float:
    return 2.0 * (math.pi - math.atan(block.ratio)) / block.w


def sticks_of(block: Block, cycles: int) -> list[float]:
    """Instants at which a slip ends [s]."""
    w, d, ratio, _, kinetic = block
    v, slip = w * d / ratio, slip_time(block)
    first = (kinetic * G + w * w * d) / (w * w * v)
    return [first + n * (slip + 2.0 * d / v) + slip for n in range(cycles)]


def pulled(block: Block, cycles: int, options: dict[str, Any], text: str) -> StickSlip:
    """The scene of a block, and its closed form."""
    w, d, ratio, mass, kinetic = block
    v, k, end = w * d / ratio, mass * w * w, end_of(block, cycles)
    static = kinetic + k * d / (mass * G)
    spring = {"type": "spring", "body": "b", "stiffness": k, "point_A": [0.0, 0.0, 0.0]}
    pull = {"type": "wrench_table", "body": "b", "times": [0.0, 2.0 * end]}
    friction = {"type": "coulomb", "static": static, "kinetic": kinetic}
    floor = {"type": "contact", "body": "b", "points": [[0.0, 0.0, 0.0]], "friction": friction}
    mapping = {
        "bodies": {"b": {"mass": mass, "inertia": [0.01, 0.01, 0.01]}},
        "constraints": {"upright": {"type": "translation", "body": "b"}, "floor": floor},
        "effects": {
            "weight": {"type": "gravity", "acceleration": [0.0, 0.0, -G]},
            "spring": spring,
            "pull": pull | {"forces": [[0.0, 0.0, 0.0], [2.0 * end * k * v, 0.0, 0.0]]},
        },
        "simulation": {"duration": end, "rate": 2.0 / end} | options,
    }
    return StickSlip(mapping, sticks_of(block, cycles), slip_time(block), text)


def how(rng: np.random.Generator, w: float, end: float, fixed: bool) -> tuple[dict[str, Any], str]:
    """Steps from 1e-4 s to a tenth of the period, or tolerances from 1e-4 to 1e-13."""
    if not fixed:
        tolerance = 10.0 ** rng.uniform(-13.0, -4.0)
        return {"method": "dopri853", "tolerance": tolerance}, f"tolerance {tolerance:.1e}"
    longest = 0.2 * math.pi / w
    least = max(1e-4, end / MOST_STEPS)
    step = float(np.exp(rng.uniform(math.log(min(least, longest)), math.log(longest))))
    return {
        "method": "rk4",
        "step": step,
    }, f"step {step:.1e} s, a period over {10.0 * longest / step:.2g}"


def judged(found: StickSlip) -> tuple[str, float]:
    """("fine" or what is wrong, largest distance of a stick from the closed form in slips)."""
    from rb_sim import Simulation, load_scene
    from rb_sim.base.errors import RbSimError

    simulation = Simulation(load_scene(found.mapping))
    try:
        with np.errstate(all="ignore"):
            simulation.run()
    except RbSimError as error:
        return f"refused: {error}", math.inf
    sticks = [e.t for e in simulation.events if e.kind == "sticks" and e.t > 0.0]
    if len(sticks) != len(found.sticks):
        return f"missed: {len(sticks)} sticks of {len(found.sticks)}", math.inf
    late = float(np.abs(np.array(sticks) - found.sticks).max()) / found.slip_time
    return ("fine" if late <= NEAR else f"late: by {late:.2g} of a slip"), late


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--fixed", action="store_true", help="rk4 in fixed steps, not dopri853")
    options = parser.parse_args()
    seen: Counter[str] = Counter()
    worst = 0.0
    for number in range(options.first, options.first + options.count):
        found = case(options.seed, number, options.fixed)
        text, late = judged(found)
        seen[text.partition(":")[0]] += 1
        if text == "fine":
            worst = max(worst, late)
        else:
            print(f"{number} ({found.options}) {text}", flush=True)
    counts, total = ", ".join(f"{name} {n}" for name, n in seen.most_common()), sum(seen.values())
    print(f"seed {options.seed}, {total} stick-slips: {counts}; worst {worst:.1e} slips")


if __name__ == "__main__":
    main()
