# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Samples once a period show nothing of the motion in between: none is held against it."""

from __future__ import annotations

import math
import warnings
from typing import Any

import pytest
from scipy.special import ellipk

from rb_sim import AccuracyWarning, Simulation, load_scene

STIFFNESS, DAMPING = 4000.0, 0.4
PERIOD = 2.0 * math.pi / math.sqrt(STIFFNESS - (0.5 * DAMPING) ** 2)
"""Of 1 kg on the damped spring: from rest it rests again after each [s]."""

DAMPED: dict[str, Any] = {
    "bodies": {"bob": {"mass": 1.0, "inertia": [0.1] * 3, "position": [1.3, 0.0, 0.0]}},
    "effects": {
        "s": {
            "type": "spring",
            "body": "bob",
            "stiffness": STIFFNESS,
            "damping": DAMPING,
            "rest_length": 1.0,
        }
    },
}

SWING, LENGTH = 1.2, 0.4
"""Amplitude [rad] and distance of the centre of mass [m] of a rod that hangs on a hinge."""
ABOUT_HINGE = 0.02 + LENGTH**2
SWING_PERIOD = float(
    4.0 * math.sqrt(ABOUT_HINGE / (9.81 * LENGTH)) * ellipk(math.sin(0.5 * SWING) ** 2)
)

PENDULUM: dict[str, Any] = {
    "bodies": {
        "rod": {
            "mass": 1.0,
            "inertia": [0.02, 0.02, 0.001],
            "center_of_mass": [0.0, 0.0, -LENGTH],
            "orientation": {"axis": [0.0, 1.0, 0.0], "angle": SWING},
        }
    },
    "constraints": {"hinge": {"type": "fixed_axis", "body": "rod", "axis_B": [0.0, 1.0, 0.0]}},
    "effects": {"weight": {"type": "gravity"}},
}


def findings(mapping: dict[str, Any], interval: float, **options: Any) -> set[str]:
    """What the checks say of 60 samples at this interval [s]."""
    span = {"duration": 60.0 * interval, "rate": 1.0 / interval}
    simulation = Simulation(load_scene(mapping | {"simulation": span | options}), announce=None)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)
        return {finding.watch for finding in simulation.run().findings}


@pytest.mark.parametrize("periods", [1.0, 3.0, 0.5, 0.03])
def test_a_pendulum_seen_where_it_turns_about_exchanges_energy(periods: float) -> None:
    assert findings(PENDULUM, periods * SWING_PERIOD) == set()


def driven(stiffness: float, damping: float, rate: float, force: float) -> dict[str, Any]:
    """The steady answer of 1 kg to a force that swings."""
    answer = force / complex(stiffness - rate**2, damping * rate)
    body = {"mass": 1.0, "inertia": [0.1] * 3, "position": [answer.imag, 0.0, 0.0]}
    body["linear_velocity"] = [rate * answer.real, 0.0, 0.0]
    push = {"sine_force": [force, 0.0, 0.0], "angular_frequency": rate}
    return {
        "bodies": {"bob": body},
        "effects": {
            "s": {"type": "spring", "body": "bob", "stiffness": stiffness},
            "d": {"type": "linear_drag", "body": "bob", "coefficient": damping},
            "f": {"type": "wrench", "body": "bob"} | push,
        },
    }


@pytest.mark.parametrize("periods", [1.0, 2.0, 0.5, 0.03])
def test_a_steady_swing_seen_once_a_period_is_no_little_motion(periods: float) -> None:
    swing = driven(9.0, 0.5, 2.0, 3.0)
    assert findings(swing, periods * math.pi) == set()


def test_energy_that_a_method_loses_is_told_all_the_same() -> None:
    """rk4 with 7 steps to the period, and samples that see it."""
    assert "energy" in findings(DAMPED, PERIOD / 28.0, method="rk4", step=PERIOD / 7.0)
