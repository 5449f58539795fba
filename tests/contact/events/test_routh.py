# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The impulse that stops a contact that jams, beside what follows by hand in a plane."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim.contact.events.instant import stopping_impulse

NORMAL, COUPLED, ALONG = 1.0, 0.9, 1.0
SLIP, FRICTION = 2.0, 1.5
"""Friction drives the contact in: NORMAL - FRICTION COUPLED < 0."""


@pytest.mark.parametrize("restitution", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("turned", [0.0, 2.0])
def test_poissons_e_gives_back_its_share_of_the_compression(
    restitution: float, turned: float
) -> None:
    """The slip falls by FRICTION ALONG - COUPLED for each unit of normal impulse and ends; stuck,
    the contact rises by NORMAL - COUPLED^2 / ALONG for each until it is back at rest; e times the
    impulse of both is given back, stuck as well."""
    d = np.array([np.cos(turned), np.sin(turned)])
    A = np.block(
        [[np.array([[NORMAL]]), COUPLED * d[None]], [COUPLED * d[:, None], ALONG * np.eye(2)]]
    )
    x = stopping_impulse(A, np.array([0.0, *(SLIP * d)]), FRICTION, restitution)
    assert x is not None
    slipping = SLIP / (FRICTION * ALONG - COUPLED)
    rise = NORMAL - COUPLED**2 / ALONG
    stuck = slipping * (FRICTION * COUPLED - NORMAL) / rise
    after = A @ x + [0.0, *(SLIP * d)]
    np.testing.assert_allclose(x[0], (1.0 + restitution) * (slipping + stuck), rtol=1e-9)
    np.testing.assert_allclose(after[0], restitution * (slipping + stuck) * rise, atol=1e-9)
    np.testing.assert_allclose(after[1:], 0.0, atol=1e-9)


@pytest.mark.parametrize("mass", [1e-20, 1e15])
@pytest.mark.parametrize("speed", [1e-3, 1e3])
def test_impulses_grow_with_mass_and_speed(mass: float, speed: float) -> None:
    """The impulse of a nanogram has as many digits as that of a kilogram."""
    d = np.array([1.0, 0.0])
    A = np.block([[np.array([[NORMAL]]), COUPLED * d[None]], [COUPLED * d[:, None], np.eye(2)]])
    v = np.array([0.0, *(SLIP * d)])
    one = stopping_impulse(A, v, FRICTION, 0.3)
    other = stopping_impulse(A / mass, speed * v, FRICTION, 0.3)
    assert one is not None and other is not None
    np.testing.assert_allclose(other / (mass * speed), one, rtol=1e-9, atol=1e-12)


def test_a_slip_that_friction_turns_aside_is_not_stopped() -> None:
    """The slip along the coupling is gone first, while friction slows the other a tenth as much:
    the contact comes back while it slips, and no impulse within the bound stops it."""
    A = np.array([[NORMAL, COUPLED, 0.0], [COUPLED, 1.1, 0.0], [0.0, 0.0, 0.1]])
    assert stopping_impulse(A, np.array([0.0, 1.0, 0.8]), FRICTION, 0.0) is None
