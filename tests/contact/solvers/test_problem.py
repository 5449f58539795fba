"""The residual of the friction problem, beside the nearest points of cones one by one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.contact.problem import FrictionProblem, natural_map, onto_cone, residual
from tests.interpreted import interpreted


def projected(points: list[list[float]], mu: float) -> list[tuple[float, ...]]:
    return [onto_cone(*point, mu) for point in points]


@pytest.mark.parametrize("mu", [0.0, 0.3, 1.0, 4.0])
def test_the_nearest_point_of_a_cone(mu: float) -> None:
    """It lies in the cone; the rest is across it, in the polar cone (Moreau)."""
    points = np.random.default_rng(3).normal(size=(60, 3))
    found = np.array(interpreted(projected, points.tolist(), mu))
    rest = points - found
    sizes = np.hypot(found[:, 1], found[:, 2])
    assert (found[:, 0] >= 0.0).all() and (sizes <= mu * found[:, 0] * (1.0 + 1e-12) + 1e-15).all()
    assert_allclose((rest * found).sum(axis=1), 0.0, atol=1e-14)
    assert (mu * np.hypot(rest[:, 1], rest[:, 2]) <= -rest[:, 0] + 1e-12).all()
    inside = np.hypot(points[:, 1], points[:, 2]) <= mu * points[:, 0]
    assert inside.any() == (mu > 0.0) and (found[inside] == points[inside]).all()


def mapped(W: Any, q: Any, mu: Any, r: Any) -> Any:
    return natural_map(W, q, mu, r)


@pytest.mark.parametrize("seed", range(4))
def test_the_natural_map_of_three_contacts(seed: int) -> None:
    """r - P(r - (u + mu |u_T| n)/w) of each, with w the largest of its own block."""
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(9, 12))
    W, q, r, mu = J @ J.T, rng.normal(size=9), rng.normal(size=9), rng.uniform(0.1, 1.0, 3)
    found, u = interpreted(mapped, W, q, mu, r), W @ r + q
    for i in range(3):
        k = slice(3 * i, 3 * i + 3)
        of_it = u[k] + [mu[i] * np.hypot(*u[3 * i + 1 : 3 * i + 3]), 0.0, 0.0]
        x, y, z = r[k] - of_it / np.diag(W)[k].max()
        (nearest,) = interpreted(projected, [[x, y, z]], mu[i])
        assert_allclose(found[k], r[k] - nearest, rtol=1e-12, atol=1e-13)
    needed = np.abs(q) / np.diag(W)
    wanted = np.abs(found).max() / max(np.abs(r).max(), needed.max())
    assert_allclose(interpreted(told, W, q, mu, r), wanted, rtol=1e-12)
    assert interpreted(told, W, 0.0 * q, mu, 0.0 * r) == 0.0


def told(W: Any, q: Any, mu: Any, r: Any) -> float:
    return residual(FrictionProblem(W, q, mu), r)
