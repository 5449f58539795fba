"""The impulse process of a contact that jams, beside what follows by hand in a plane."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim.contact.events.routh import impulse_process

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
    x = impulse_process(A, np.array([0.0, *(SLIP * d)]), FRICTION, restitution)
    assert x is not None
    slipping = SLIP / (FRICTION * ALONG - COUPLED)
    rise = NORMAL - COUPLED**2 / ALONG
    stuck = slipping * (FRICTION * COUPLED - NORMAL) / rise
    after = A @ x + [0.0, *(SLIP * d)]
    np.testing.assert_allclose(x[0], (1.0 + restitution) * (slipping + stuck), rtol=1e-9)
    np.testing.assert_allclose(after[0], restitution * (slipping + stuck) * rise, atol=1e-9)
    np.testing.assert_allclose(after[1:], 0.0, atol=1e-9)
