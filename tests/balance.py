# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Two bodies in any motion: what their samples change by, and what the samples report."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from tests.interpreted import interpreted
from tests.moving import difference, unit
from tests.one_body_scenes import INERTIA, Mapping

CLOSE = 1e-7
"""Of the differences, relative to the size of what they are taken of."""
EFFECTS = ("spring", "torsion_spring", "angular_damping")
"""Types of effects that may act between two bodies."""


def two_bodies(own: Mapping, **more: Mapping) -> Mapping:
    """Bodies `a` and `body`, uneven and unlike, with one effect or constraint between them; more:
    own fields of either."""
    solid = {"inertia": INERTIA, "center_of_mass": [0.04, -0.03, 0.05]}
    a = solid | {"mass": 2.3, "position": [0.3, 0.8, -0.4]} | more.get("a", {})
    shape = {"type": "sphere", "radius": 0.2, "center_B": [0.02, 0.01, 0.03]}
    body = solid | {"mass": 1.1, "position": [-0.5, 0.2, 0.6], "shape": shape}
    body |= more.get("body", {})
    return {
        "bodies": {"a": a, "body": body},
        "effects": {},
        "constraints": {},
        "simulation": {"duration": 1.0, "project_initial": True},
        "effects" if own["type"] in EFFECTS else "constraints": {
            "between": own | {"body": "body", "parent": "a"}
        },
    }


def random_motion(system: Any, y: np.ndarray, rng: np.random.Generator, posed: bool) -> np.ndarray:
    """Random velocities and, if `posed`, places and attitudes of all bodies, brought onto the
    manifold."""
    from tests.numbers import projected

    y = y.copy()
    for i in range(system.bodies.shape[0]):
        if posed:
            y[13 * i : 13 * i + 3] = rng.normal(size=3)
            y[13 * i + 3 : 13 * i + 7] = unit(rng, 4)
        y[13 * i + 7 : 13 * i + 13] = 2.0 * rng.normal(size=6)
    return projected(system, 0.0, y)


class Balance(NamedTuple):
    """Rates along the motion, and what is reported there."""

    energy_rate: float
    """d(kinetic + potential)/dt [W]."""
    power: float
    momentum_rate: np.ndarray
    """of both bodies together [N]."""
    turning_rate: np.ndarray
    """of their angular momentum about the world's origin [N m]."""
    unexplained: float
    """largest part of m a, or of d(angular momentum about C)/dt, of any of the two that the
    reported reactions do not give; only where no effect acts."""
    size: float


def balance_at(compiled: Any, y: np.ndarray) -> Balance:
    """From the samples at y and near it, along the accelerations of the equations."""
    from tests.numbers import rate_at, sample_at

    system, reactions = compiled.system, len(compiled.layout.reactions)
    slope = rate_at(compiled, 0.0, y)
    at = 13 * system.bodies.shape[0] + 9 * reactions

    def reported(t: float) -> np.ndarray:
        return sample_at(compiled, t, y + t * slope)[at : at + 10]

    rates, out = difference(reported), sample_at(compiled, 0.0, y)
    here = out[at : at + 10]
    totals = [i for i, name in enumerate(compiled.layout.reactions) if "/" not in name]
    wrenches = out[13 * system.bodies.shape[0] : at].reshape(-1, 9)[totals]
    return Balance(
        energy_rate=float(rates[0] + rates[1]),
        power=float(here[2]),
        momentum_rate=rates[3:6],
        turning_rate=rates[6:9],
        unexplained=unexplained(system, y, slope, wrenches),
        size=1.0 + float(np.abs(y).max() ** 2 + np.abs(slope).max() ** 2),
    )


def unexplained(system: Any, y: np.ndarray, slope: np.ndarray, wrenches: np.ndarray) -> float:
    """Newton's and Euler's equations (LL 38.6) of `a` (body 0), which takes the opposites, and
    `body`; wrenches: [force, torque about the anchor, anchor], world axes."""
    worst = 0.0
    for i, sign in ((0, -1.0), (1, 1.0)):
        own, rate = y[13 * i : 13 * i + 13], slope[13 * i : 13 * i + 13]
        xx, yy, zz, xy, xz, yz = system.bodies[i, 1:7]
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        w = own[10:13]
        force = system.bodies[i, 0] * rate[7:10]
        torque = inertia @ rate[10:13] + np.cross(w, inertia @ w)
        torque = Rotation.from_quat(own[3:7]).apply(torque)
        for f, k, p in wrenches.reshape(-1, 3, 3):
            force = force - sign * f
            torque = torque - sign * (k + np.cross(p - own[:3], f))
        worst = max(worst, float(np.abs(force).max()), float(np.abs(torque).max()))
    return worst


def balance_of(own: Mapping, seed: int, posed: bool = True) -> Balance:
    """Of two bodies with `own` between them, in a random motion; interpreted."""
    return interpreted(_balance_of, own, seed, posed)


def _balance_of(own: Mapping, seed: int, posed: bool) -> Balance:
    from rb_sim import load_scene
    from rb_sim.scene.compile import compile_scene

    compiled = compile_scene(load_scene(two_bodies(own)), coordinates="maximal")
    y = random_motion(compiled.system, compiled.y, np.random.default_rng(seed), posed)
    return balance_at(compiled, y)


def assert_balanced(found: Balance) -> None:
    """Nothing is gained from inside, and the energy changes by the power reported."""
    small = CLOSE * found.size
    assert np.abs(found.momentum_rate).max() <= small
    assert np.abs(found.turning_rate).max() <= small
    assert abs(found.energy_rate - found.power) <= small
