# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Tractions and torques of each law of friction, by their formulas."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.catalogue.contacts import friction
from rb_sim.catalogue.contacts.friction import resisting, straight_on, traction

AHEAD, LEAST = (0.6, 0.8, 0.0), 1e-9
SLIP = (0.3, 0.4, 1.2)
"""1.3 m/s."""
UNIT = np.array(SLIP) / 1.3
NORMAL = (0.48, 0.6, 0.64)


@pytest.mark.parametrize(
    ("law", "per_normal", "direct"),
    [
        (friction.Smooth(), 0.0 * UNIT, 0.0 * UNIT),
        (friction.Rough(), 0.0 * UNIT, 0.0 * UNIT),
        (friction.Coulomb(0.5, 0.3), -0.3 * UNIT, 0.0 * UNIT),
        (friction.Viscous(0.7), 0.0 * UNIT, -0.7 * np.array(SLIP)),
        (friction.ViscousPerNormal(0.7), -0.7 * np.array(SLIP), 0.0 * UNIT),
        (friction.Regularised(0.4, 0.5), -0.4 * np.array(SLIP) / math.hypot(1.3, 0.5), 0.0 * UNIT),
    ],
)
def test_traction_of_each_law(law: friction.Friction, per_normal: object, direct: object) -> None:
    """(force per unit of normal force, force); mu s/|s| rounded off at the speed v."""
    found = traction(law, SLIP, AHEAD, LEAST, False)
    assert_allclose(found[0], per_normal, rtol=1e-15, atol=1e-16)
    assert_allclose(found[1], direct, rtol=1e-15, atol=1e-16)


def test_what_sticks_and_what_does_not() -> None:
    assert friction.Rough().static == math.inf
    creeping = (
        friction.Smooth(), friction.Viscous(1.0), friction.ViscousPerNormal(1.0),
        friction.Regularised(1.0, 1.0),
    )  # fmt: skip
    assert all(law.static == 0.0 for law in creeping)


def test_a_slip_that_has_passed_through_zero_goes_straight_on() -> None:
    """Its direction is turned round, so that the equations stay smooth; at rest it is `ahead`."""
    back = tuple(-x for x in SLIP)
    assert_allclose(straight_on(SLIP, AHEAD, LEAST), UNIT, rtol=1e-15)
    assert_allclose(straight_on(back, AHEAD, LEAST), UNIT, rtol=1e-15)
    assert straight_on((0.0, 0.0, LEAST), AHEAD, LEAST) == AHEAD
    assert_allclose(straight_on((0.0, 0.0, 2.0 * LEAST), AHEAD, LEAST), (0.0, 0.0, 1.0))


@pytest.mark.parametrize("modes", [(1.0, 1.0), (1.0, 2.0), (2.0, 1.0), (0.0, 0.0)])
@pytest.mark.parametrize("spin_sign", [1.0, -1.0])
def test_resistance_to_rolling_and_to_spinning(
    modes: tuple[float, float], spin_sign: float
) -> None:
    """-arm w_t/|w_t| in the tangent plane, -arm sign about the normal; only of what slides."""
    law, turn, n = friction.Resistance(0.02, 0.05), np.array([0.5, 2.0, -1.0]), np.array(NORMAL)
    across = turn - (turn @ n) * n
    across /= np.linalg.norm(across)
    expected = np.zeros(3)
    if modes[0] == 1.0:
        expected -= 0.02 * across
    if modes[1] == 1.0:
        expected -= 0.05 * spin_sign * n
    ahead = tuple(float(x) for x in across)
    found = resisting(law, tuple(turn.tolist()), NORMAL, modes, ahead, spin_sign, LEAST)
    assert_allclose(found, expected, rtol=1e-14, atol=1e-16)


def test_without_resistance_nothing_resists() -> None:
    none = friction.NoResistance()
    assert resisting(none, SLIP, NORMAL, (1.0, 1.0), AHEAD, 1.0, LEAST) == (0.0, 0.0, 0.0)
