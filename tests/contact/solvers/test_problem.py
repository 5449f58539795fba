"""The residual of the friction problem, beside the nearest points of cones one by one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.contact.solvers import graph
from rb_sim.contact.solvers.graph import LINES, WIDTH
from rb_sim.contact.solvers.newton import (
    FrictionProblem,
    fill_equations,
    natural_map,
    onto_cone,
    residual,
)
from rb_sim.contact.solvers.proximal_newton import fill_matrix
from rb_sim.mechanics.systems.many_bodies import INERTIA, MASS
from rb_sim.numerics.kernels import python_of
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


def test_the_equations_of_newtons_method_hold_at_the_solution() -> None:
    """Of one contact that sticks, one that is open, one that slips, alone each, and of one without
    friction; whatever was in their room before."""
    W, mu = np.eye(12), np.array([0.5, 0.5, 0.5, 0.0])
    q = np.array([-1.0, 0.3, 0.0, 1.0, 0.2, 0.0, -1.0, 2.0, 0.0, -3.0, 1.0, 0.0])
    r = np.array([1.0, -0.3, 0.0, 0.0, 0.0, 0.0, 1.0, -0.5, 0.0, 3.0, 0.0, 0.0])
    A, b = np.full((12, 12), np.nan), np.full(12, np.nan)
    python_of(fill_equations)(W, q, mu, r, W @ r + q, A, b)
    assert np.isfinite(A).all() and np.isfinite(b).all()
    assert_allclose(A @ r, b, atol=1e-14)
    assert abs(np.linalg.det(A)) > 1e-6


def test_the_matrix_of_newtons_method_in_velocities_of_bodies() -> None:
    """M + J^T D J, with inertias that are no balls'; of contacts that push, which join bodies."""
    rng = np.random.default_rng(8)
    ends = np.array([[0, -1], [1, 0], [2, 1], [2, 0]])
    rows, D = rng.normal(size=(4 * LINES, WIDTH)), rng.normal(size=(4, 9))
    D[3] = 0.0
    bodies = np.zeros((3, max(INERTIA + 6, MASS + 1)))
    bodies[:, MASS], bodies[:, INERTIA : INERTIA + 6] = (1.0, 2.0, 3.0), rng.normal(size=(3, 6))
    wanted = np.zeros((18, 18))
    for b in range(3):
        xx, yy, zz, xy, xz, yz = bodies[b, INERTIA : INERTIA + 6]
        o = 6 * b
        wanted[o : o + 3, o : o + 3] = bodies[b, MASS] * np.eye(3)
        wanted[o + 3 : o + 6, o + 3 : o + 6] = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    for i, (b, a) in enumerate(ends):
        J = np.zeros((3, 18))
        own = rows[LINES * i : LINES * i + 3]
        J[:, 6 * b : 6 * b + 6] = own[:, :6]
        if a >= 0:
            J[:, 6 * a : 6 * a + 6] = own[:, 6:12]
        wanted += J.T @ D[i].reshape(3, 3) @ J
    H, linked = np.full((18, 18), np.nan), np.full((3, 3), 7)
    fill_matrix(ends, rows, bodies, D, H, linked)
    assert_allclose(H, wanted, rtol=1e-12, atol=1e-12)
    assert linked.tolist() == [[0, 1, 0], [1, 0, 1], [0, 1, 0]]


def test_loops_over_arrays_are_numpys() -> None:
    rng = np.random.default_rng(9)
    A, x, out = rng.normal(size=(3, 4)), rng.normal(size=4), np.full(3, np.nan)
    graph.times(A, x, out)
    assert_allclose(out, A @ x, rtol=1e-14)
    to, rows = np.full(5, 7.0), np.full((3, 5), 7.0)
    graph.copy(to, x)
    graph.copy_rows(rows, A)
    assert to.tolist() == [*x, 7.0] and (rows[:, :4] == A).all() and (rows[:, 4] == 7.0).all()
    assert graph.largest(np.array([0.25, -0.5, 0.125])) == 0.5
    assert graph.largest(np.zeros(3)) == 0.0 and np.isnan(graph.largest(np.array([1.0, np.nan])))
