# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A wheel beside another body rolls as it does alone, whatever its axis and the plane's normal.

Alone it has reduced coordinates, beside another body multipliers: two derivations of one motion.
"""

from __future__ import annotations

from itertools import permutations
from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene

R = 0.3
AXES = {"x": [1.0, 0.0, 0.0], "y": [0.0, 1.0, 0.0], "z": [0.0, 0.0, 1.0]}


def scene(axis: str, normal: str, others: bool) -> dict[str, Any]:
    n, a = np.array(AXES[normal]), np.array(AXES[axis])
    spin = 2.0 * a + 0.7 * n
    velocity = -np.cross(spin, -R * n)
    wheel = {
        "mass": 1.0,
        "shape": {"type": "disk", "radius": R, "axis_B": AXES[axis]},
        "position": (R * n).tolist(),
        "linear_velocity": velocity.tolist(),
        "angular_velocity": spin.tolist(),
    }
    frame = {"frame": {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "position": [0.0, 0.0, 5.0]}}
    roll = {"type": "rolling", "body": "wheel", "normal_A": AXES[normal]}
    return {
        "bodies": {"wheel": wheel} | (frame if others else {}),
        "constraints": {"roll": roll},
        "effects": {
            "g": {"type": "gravity", "acceleration": (-9.81 * n).tolist(), "bodies": ["wheel"]}
        },
        "simulation": {"duration": 1.0, "rate": 20.0},
    }


@pytest.mark.parametrize(("axis", "normal"), list(permutations("xyz", 2)))
def test_rolls_as_it_does_alone(axis, normal):
    alone, beside = (
        Simulation(load_scene(scene(axis, normal, o))).run(checks=False) for o in (False, True)
    )
    np.testing.assert_allclose(beside.position["wheel"], alone.position["wheel"], atol=1e-9)
    there, here = beside.reaction["roll"].force, alone.reaction["roll"].force
    np.testing.assert_allclose(there, here, atol=1e-7)
    assert np.abs(beside.position["wheel"][-1] - beside.position["wheel"][0]).max() > 0.1


def test_a_rod_may_end_at_any_point():
    """Whether a line is holonomic is no question of numbers: a rod may end at round ones, too.

    With z up, m hangs at rest below (0.3, 0.2, 0.7): the rod carries its weight.
    """
    bob = {"mass": 2.0, "inertia": [1.0, 1.0, 1.0], "position": [0.3, 0.2, 0.0]}
    scene = {
        "bodies": {"bob": bob, "other": bob | {"position": [2.0, 0.0, 0.0]}},
        "constraints": {"rod": {"type": "distance", "body": "bob", "point_A": [0.3, 0.2, 0.7]}},
        "effects": {"g": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
        "simulation": {"duration": 0.1, "rate": 10.0},
    }
    run = Simulation(load_scene(scene)).run(checks=False)
    np.testing.assert_allclose(run.reaction["rod"].force, [[0.0, 0.0, 19.62]] * 2, atol=1e-9)


@pytest.mark.parametrize(("axis", "normal"), [("x", "z"), ("z", "y")])
def test_a_plank_on_rollers(axis, normal):
    """A force F on a plank M upon two rollers m: a = F / (M + 3/4 m), the rollers at half of it."""
    a, n = np.array(AXES[axis]), np.array(AXES[normal])
    along = np.cross(a, n)
    mass, m, force = 3.0, 2.0, 5.0
    roller = {"mass": m, "shape": {"type": "cylinder", "radius": R, "length": 0.2}}
    roller["shape"]["axis_B"] = AXES[axis]
    bodies = {f"r{s}": roller | {"position": (R * n + s * along).tolist()} for s in (0, 1)}
    plank = {"mass": mass, "inertia": [1.0, 1.0, 1.0], "position": (2 * R * n + along / 2).tolist()}
    floor = {"type": "rolling", "normal_A": AXES[normal]}
    below = {"type": "rolling", "normal_A": (-n).tolist(), "parent": "plank"}
    constraints = {f"floor{s}": floor | {"body": f"r{s}"} for s in (0, 1)}
    constraints |= {f"plank{s}": below | {"body": f"r{s}"} for s in (0, 1)}
    push = {"type": "wrench", "body": "plank", "force": (force * along).tolist()}
    scene = {
        "bodies": bodies | {"plank": plank},
        "constraints": constraints,
        "effects": {"push": push},
        "simulation": {"duration": 0.5, "rate": 4.0},
    }
    run = Simulation(load_scene(scene)).run(checks=False)
    way = (run.position["plank"] - run.position["plank"][0]) @ along
    half = (run.position["r0"] - run.position["r0"][0]) @ along
    exact = 0.5 * force / (mass + 0.75 * m) * run.t**2
    np.testing.assert_allclose(way, exact, atol=1e-9)
    np.testing.assert_allclose(half, exact / 2.0, atol=1e-9)
