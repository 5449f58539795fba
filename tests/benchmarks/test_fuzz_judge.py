# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The judge of random scenes: silent on what holds, however fast, and not on what does not."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from benchmarks.fuzz import judge, newton_euler
from rb_sim import Simulation, Trajectory

ROD = {
    "bodies": {
        "rod": {
            "mass": 0.1,
            "shape": {"type": "rod", "length": 0.9},
            "orientation": {"axis": [-0.2, 0.1, 0.97], "angle": 2.7},
            "position": [0.5, 0.9, 1.0],
            "angular_velocity": [0.17, 0.28, -0.07],
        }
    },
    "effects": {
        "spring": {
            "type": "spring",
            "body": "rod",
            "stiffness": 6e3,
            "point_A": [-0.6, -0.9, 0.2],
            "point_B": [0.3, -0.05, 0.26],
            "rest_length": 0.7,
        },
    },
    "simulation": {"duration": 0.05, "rate": 100.0},
}
"""A spring on a thin rod, which it turns to and fro about its own axis at 1e5 rad/s: no spacing of
1e-5 s tells its acceleration."""

DAMPED = {
    "bodies": {
        "rod": {
            "mass": 0.1156,
            "shape": {"type": "rod", "length": 0.825},
            "orientation": {"axis": [-0.5851, -0.1054, -0.8041], "angle": -6.1327e-5},
            "position": [-0.0604, 0.1129, 0.0209],
            "angular_velocity": [0.9523, 0.5081, -0.1929],
            "linear_velocity": [-0.1961, -0.2037, 0.5885],
        }
    },
    "effects": {
        "spring": {
            "type": "spring",
            "body": "rod",
            "stiffness": 31869.5,
            "damping": 0.1482,
            "point_A": [-0.732, 0.4692, -0.0937],
            "point_B": [-0.0668, -0.1897, -0.2635],
        },
    },
    "simulation": {"duration": 0.1, "rate": 100.0},
}
"""Another with a damper, whose work no samples at 25 kHz tell."""

DYING = {
    "bodies": {"ball": {"mass": 1.0, "inertia": [1e-3] * 3, "angular_velocity": [1.0, 0.5, -2.0]}},
    "effects": {"damping": {"type": "angular_damping", "body": "ball", "coefficient": 3.0}},
    "simulation": {"duration": 0.1, "rate": 100.0},
}
"""Of the spin nothing but the error is left where it is looked."""


SLOW = {
    "bodies": {"ball": {"mass": 1.0, "inertia": [0.1, 0.2, 0.25], "angular_velocity": [1, 2, 3]}},
    "effects": {
        "spring": {"type": "spring", "body": "ball", "stiffness": 9.0, "point_A": [1.0, 0.0, 0.0]},
        "damping": {"type": "angular_damping", "body": "ball", "coefficient": 0.1},
    },
}


@pytest.mark.parametrize("scene", [ROD, DAMPED, DYING])
def test_nothing_is_found_in_what_holds(scene: dict[str, Any]) -> None:
    verdict = judge.of_scene(scene, 60.0)
    assert (verdict.kind, verdict.find) == ("ran", "")


def test_what_a_finer_look_finds_to_lose_little_is_no_find() -> None:
    """A push that turns with its body, once between two samples, seems to work all the time; closer
    samples show that Kutta's steps miss some thousandths."""
    rotor = {"mass": 1.0, "inertia": [0.01] * 3, "linear_velocity": [1.0, 0.0, 0.0]}
    push = {"type": "wrench", "body": "rotor", "force": [500.0, 0.0, 0.0], "frame": "body"}
    scene: dict[str, Any] = {
        "bodies": {"rotor": rotor | {"angular_velocity": [0.0, 0.0, 300.0]}},
        "effects": {"push": push},
        "simulation": {"rate": 150.0 / math.pi, "method": "rk4", "step": 3.7e-3},
    }
    scene["simulation"]["duration"] = 24.0 / scene["simulation"]["rate"]
    simulation = Simulation(scene, announce=None)
    assert judge.run(simulation, 60.0, math.inf) in judge.HOLDS
    assert judge.run(judge.fresh(simulation), 60.0, math.inf, judge.FINER[0]) == ("told", "")


@pytest.mark.parametrize("part", ["linear_acceleration", "angular_acceleration"])
def test_a_law_that_is_broken_is_found(part: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A thousandth too much of what the wrenches give."""
    right: Any = getattr(Trajectory, part)

    def wrong(self: Trajectory) -> dict[str, np.ndarray]:
        return {body: 1.001 * values for body, values in right.fget(self).items()}

    assert newton_euler.broken_law(SLOW) == ""
    monkeypatch.setattr(Trajectory, part, property(wrong))
    assert newton_euler.broken_law(SLOW).startswith("ball: dv/dt")
