# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Random slips that turn aside: `python -m benchmarks.contact.turned_slips`.

A block is thrown across a slope.  Of its slip the speed v and the angle psi from the line of fall
obey dv/dt = a cos(psi) - k and v dpsi/dt = -a sin(psi), with a = g sin(slope), k = mu g cos(slope).
So d[v (k + a cos(psi))]/dt = a^2 - k^2, and where k > a the block sticks after
v0 (k + a cos(psi0)) / (k^2 - a^2).  Its slip turns towards the line of fall, the faster the slower
it is if k > 2 a.  v = c tan(psi/2)^(k/a) / sin(psi), so that a quadrature over psi gives where it
comes to rest.  Steps of fixed length that do not follow such a slip to its end miss the stick.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import quad_vec

from benchmarks.contact.stick_slips import NEAR, G, how

STANDS = 0.5
"""What the block stands for after it has come to rest, over the time of its slip."""
FAR = 1e-2
"""Distance from the place of the closed form, over the length of the way, that is too far."""


class TurnedSlip(NamedTuple):
    """One random case."""

    mapping: dict[str, Any]
    stick: float
    """when the slip ends [s]."""
    place: np.ndarray
    """where, in the plane of the slope: along the line of fall, and across it [m]."""
    options: str
    """how it is integrated, in words."""


def case(seed: int, number: int, fixed: bool) -> TurnedSlip:
    """A random throw; fixed: steps of rk4, else a tolerance of dopri853."""
    rng = np.random.default_rng([seed, number])
    slope, psi = float(rng.uniform(0.05, 0.6)), float(rng.uniform(0.2, 2.9))
    mu = math.tan(slope) * (1.0 + 10.0 ** float(rng.uniform(-1.0, 0.8)))
    speed, mass = 10.0 ** float(rng.uniform(-1.0, 1.0)), float(rng.uniform(0.3, 3.0))
    stick, place = closed_form(slope, mu, speed, psi)
    end = (1.0 + STANDS) * stick
    options, text = how(rng, 2.0 * math.pi / stick, end, fixed)
    fall = np.array([math.cos(slope), 0.0, -math.sin(slope)])
    thrown = speed * (math.cos(psi) * fall + math.sin(psi) * np.array([0.0, 1.0, 0.0]))
    normal = [math.sin(slope), 0.0, math.cos(slope)]
    floor = {
        "type": "contact",
        "body": "b",
        "points": [[0.0, 0.0, 0.0]],
        "surface": {"type": "plane", "normal": normal},
        "friction": {"type": "coulomb", "static": 1.05 * mu, "kinetic": mu},
    }
    body = {"mass": mass, "inertia": [0.01, 0.01, 0.01], "linear_velocity": thrown.tolist()}
    mapping = {
        "bodies": {"b": body},
        "constraints": {"upright": {"type": "translation", "body": "b"}, "floor": floor},
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -G]}},
        "simulation": {"duration": end, "rate": 2.0 / end} | options,
    }
    return TurnedSlip(mapping, stick, place, text)


def closed_form(slope: float, mu: float, speed: float, psi: float) -> tuple[float, np.ndarray]:
    """(when the slip ends [s], where along the line of fall and across it [m])."""
    a, k = G * math.sin(slope), mu * G * math.cos(slope)
    power = k / a

    def squared(angle: float) -> float:
        """v^2 at psi = angle; dt = -v dpsi / (a sin(psi))."""
        growth = (math.tan(0.5 * angle) / math.tan(0.5 * psi)) ** power
        return (speed * growth * math.sin(psi) / math.sin(angle)) ** 2

    def along(x: float) -> np.ndarray:
        """Of the way by x, with psi = x^m so that the integrand is smooth at the end."""
        m = max(1.0, 2.0 / (power - 1.0))
        angle = psi * x**m
        rate = squared(angle) / (a * math.sin(angle)) * psi * m * x ** (m - 1.0)
        return rate * np.array([math.cos(angle), math.sin(angle)])

    place = quad_vec(along, 0.0, 1.0, epsabs=0.0, epsrel=1e-10)[0]
    return speed * (k + a * math.cos(psi)) / (k * k - a * a), place


def judged(found: TurnedSlip) -> tuple[str, float]:
    """("fine" or what is wrong, how late it sticks in times of the slip)."""
    from rb_sim import Simulation, load_scene
    from rb_sim.base.errors import RbSimError

    simulation = Simulation(load_scene(found.mapping))
    try:
        with np.errstate(all="ignore"):
            trajectory = simulation.run()
    except RbSimError as error:
        return f"refused: {error}", math.inf
    kinds = [e.kind for e in simulation.events if e.t > 0.0]
    if kinds != ["sticks"]:
        return f"missed: {', '.join(kinds) or 'no event'} where it sticks once", math.inf
    late = abs(simulation.events[-1].t - found.stick) / found.stick
    if late > NEAR:
        return f"late: by {late:.2g} of the slip", late
    normal = np.array(found.mapping["constraints"]["floor"]["surface"]["normal"])
    fall = np.array([normal[2], 0.0, -normal[0]])
    x = trajectory.position["b"][-1]
    apart = float(np.hypot(x @ fall - found.place[0], x[1] - found.place[1]))
    if apart > FAR * float(np.linalg.norm(found.place)):
        return f"far: {apart:.2g} m from where it comes to rest", late
    return "fine", late


def main() -> None:
    parser = argparse.ArgumentParser(
        description="Random slips that turn aside, against the closed form"
    )
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
    print(f"seed {options.seed}, {total} turned slips: {counts}; worst {worst:.1e} slips")


if __name__ == "__main__":
    main()
