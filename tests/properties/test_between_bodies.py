# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Laws between two bodies, both in any motion: effects, joints and contacts of the catalogue.

A wrench and its opposite change neither the momentum nor the angular momentum of the two; the
energy changes by the power that is reported; what dissipates never gives energy.  All from
differences of what the samples report, along the motion that the equations give.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rb_sim.catalogue import constraints, effects
from tests.balance import EFFECTS as BETWEEN_TYPES
from tests.balance import assert_balanced, balance_of
from tests.interpreted import interpreted
from tests.one_body_scenes import EFFECTS, Mapping

SEEDS = st.integers(0, 2**32 - 1)
FEW = settings(max_examples=6, deadline=None, derandomize=True)

BETWEEN: dict[str, Mapping] = {
    name: effect for name, effect in EFFECTS.items() if effect["type"] in BETWEEN_TYPES
}
"""Effects that may act between two bodies."""
DISSIPATIVE: dict[str, Mapping] = {
    "damper along a line": {"type": "spring", "damping": 0.6, "rest_length": 0.3},
    "isotropic damper": {"type": "spring", "damping": 0.6},
    "damper of a twist": {"type": "torsion_spring", "axis_B": [1.0, 2.0, 0.5], "damping": 0.5},
    "damper of the spin": {"type": "angular_damping", "coefficient": 0.2},
}
"""Dampers alone; ends off the centres where they have any."""
ENDS = {"point_B": [0.1, 0.05, -0.1], "point_A": [0.4, -0.3, 0.6]}
JOINTS: dict[str, Mapping] = {
    "fixed_point": {"type": "fixed_point", "point_B": [0.1, -0.2, 0.3]},
    "fixed_axis": {"type": "fixed_axis", "axis_B": [0.2, 0.3, 0.9], "point_B": [0.1, 0.0, -0.3]},
    "distance": {"type": "distance", "point_B": [0.1, -0.2, 0.3], "point_A": [0.4, 0.1, 0.2]},
    "plane": {"type": "plane", "point_B": [0.1, -0.2, 0.3], "normal_A": [0.1, 0.3, 0.9]},
    "weld": {"type": "weld"},
    "rolling": {"type": "rolling", "point_A": [0.1, 0.2, 0.0], "normal_A": [0.1, 0.2, 0.97]},
    "parallel": {"type": "parallel", "axis_B": [0.2, 0.3, 0.9]},
}


def test_every_kind_that_takes_a_parent_is_here() -> None:
    """What may open is in tests/contact: test_between_bodies and test_string."""
    of = {name for name, spec in effects.SPECS.items() if "parent" in spec.model_fields}
    assert of == set(BETWEEN_TYPES)
    of = {name for name, spec in constraints.SPECS.items() if "parent" in spec.model_fields}
    assert of == {own["type"] for own in JOINTS.values()} | {"contact", "string"}


@pytest.mark.parametrize("name", BETWEEN)
@FEW
@given(SEEDS)
def test_effect_between_bodies_balances(name: str, seed: int) -> None:
    """Wrench and opposite sum to zero about any point; dE/dt is the power reported."""
    assert_balanced(balance_of(BETWEEN[name], seed))


@pytest.mark.parametrize("name", DISSIPATIVE)
@FEW
@given(SEEDS)
def test_damper_never_gives_energy(name: str, seed: int) -> None:
    """However both turn; and it takes some."""
    ends = ENDS if DISSIPATIVE[name]["type"] == "spring" else {}
    found = balance_of(DISSIPATIVE[name] | ends, seed)
    assert_balanced(found)
    assert found.power < 0.0
    assert found.energy_rate < 0.0


@pytest.mark.parametrize("name", JOINTS)
@FEW
@given(SEEDS)
def test_joint_between_bodies_balances(name: str, seed: int) -> None:
    """Ideal reactions and their opposites: nothing is gained, whatever the parent does."""
    found = balance_of(JOINTS[name], seed, False)
    assert_balanced(found)
    assert abs(found.power) <= 1e-12 * found.size
    assert found.unexplained <= 1e-11 * found.size


def bushing_motion() -> tuple[float, ...]:
    """Energy over 1 s, and the largest change of momentum and angular momentum."""
    from rb_sim import Simulation, load_scene

    scene = {
        "bodies": {
            "a": {"mass": 5.0, "inertia": [1.0, 1.0, 1.0], "angular_velocity": [0, 0, 10.0]},
            "b": {
                "mass": 1.0,
                "inertia": [0.1, 0.1, 0.1],
                "position": [1.0, 0, 0],
                "linear_velocity": [0, 5.0, 0],
            },
        },
        "effects": {"d": {"type": "spring", "body": "b", "parent": "a", "damping": 0.5}},
        "simulation": {"duration": 1.0, "rate": 20, "method": "dopri853", "tolerance": 1e-12},
    }
    block = Simulation(load_scene(scene)).run(checks=False).block
    drift = max(np.ptp(block.momentum, axis=0).max(), np.ptp(block.angular_momentum, axis=0).max())
    return float(np.diff(block.energy).max()), float(block.energy[0]), float(drift)


def test_damper_without_rest_length_takes_energy_from_a_spinning_parent() -> None:
    """62.5 J once became 75.8 J: the velocity was that of one point, the force at another."""
    rise, start, drift = interpreted(bushing_motion)
    assert start == pytest.approx(62.5)
    assert rise < 0.0
    assert drift <= 1e-10
