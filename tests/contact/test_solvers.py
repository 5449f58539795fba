# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Solvers of the friction problem on one collection, against each other and against Clarabel."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.contact.problem import CONTACT_ROWS
from rb_sim.mechanics.systems.many_bodies import INERTIA, MASS
from tests.contact.problems import COLLECTION, dense, residual
from tests.interpreted import interpreted

SETTLED = 1e-13


def swept(name: str, sweeps: int) -> tuple[Any, ...]:
    """(residual of the sweeps, graph, impulses, velocities) by Gauss-Seidel alone."""
    from rb_sim.contact.gauss_seidel import gauss_seidel

    graph, u = COLLECTION[name]()
    x = np.zeros(len(graph.targets))
    rest, _ = gauss_seidel(graph, u, x, np.zeros(0), 1.0, SETTLED, sweeps)
    return rest, graph, u, x


@pytest.mark.parametrize("name", COLLECTION)
def test_gauss_seidel_solves(name: str) -> None:
    """The residual of the problem vanishes, and the velocities that the bodies were given are those
    of the impulses."""
    rest, graph, u, x = interpreted(swept, name, 3000)
    W, q, mu, r = dense(graph, u, x)
    assert rest <= 1e-9
    assert residual(W, q, mu, r) <= 1e-8
    assert_allclose(q, dense(graph, COLLECTION[name]()[1], 0.0 * x)[1], atol=1e-12)
    pushes = r.reshape(-1, 3)
    assert (pushes[:, 0] >= 0.0).all()
    assert (np.hypot(pushes[:, 1], pushes[:, 2]) <= mu * pushes[:, 0] * (1 + 1e-12)).all()


def bodies_of(graph: Any) -> np.ndarray:
    """Masses and inertias of the balls of a graph, as the table of a system has them."""
    from rb_sim.contact.problem import LIGHT_A, LIGHT_B
    from rb_sim.mechanics.systems.many_bodies import INVERSE

    table = np.zeros((graph.ends.max() + 1, INVERSE + 6))
    table[:, MASS] = table[:, INERTIA : INERTIA + 3] = 1.0  # of a body without contacts
    for i, (b, a) in enumerate(graph.ends):
        for body, light in ((b, LIGHT_B), (a, LIGHT_A)):
            if body >= 0:
                mass = 1.0 / graph.rows[CONTACT_ROWS * i, light]
                table[body, MASS], table[body, INERTIA : INERTIA + 3] = mass, 0.4 * mass
    return table


def in_velocities(name: str, sweeps: int, enough: float = 1e-11) -> tuple[Any, ...]:
    """(residual told, graph, velocities and impulses by Newton's method in the velocities of
    bodies) after so many sweeps."""
    from rb_sim.contact.proximal_newton import proximal_newton

    _, graph, u, x = swept(name, sweeps)
    _, rest, _ = proximal_newton(graph, bodies_of(graph), u, x, enough)
    return rest, graph, u, x


@pytest.mark.parametrize("name", COLLECTION)
def test_newton_in_the_velocities_of_bodies(name: str) -> None:
    """It solves what sweeps have only begun: the residual that it tells is that of the problem, the
    velocities are those of its impulses and those that the sweeps come to in the end, which are
    determined though the impulses of redundant contacts are not."""
    rest, graph, u, x = interpreted(in_velocities, name, 5)
    W, q, mu, r = dense(graph, u, x)
    assert rest <= 1e-10
    assert residual(W, q, mu, r) <= 1e-10
    free = COLLECTION[name]()[1]
    assert_allclose(q, dense(graph, free, 0.0 * x)[1], atol=1e-12 * np.abs(free).max())
    W, q, _, other = dense(*interpreted(swept, name, 3000)[1:])
    assert_allclose(W @ r, W @ other, atol=1e-7 * np.abs(q).max())


def densely(name: str) -> tuple[Any, ...]:
    """(residual told, graph, velocities and impulses by the dense solver) after one sweep."""
    from rb_sim.contact.few_contacts import solve_few

    _, graph, u, x = swept(name, 1)
    rest, _, _ = solve_few(graph, u, x, np.zeros(0), 0.0, 1.0, False)
    return rest, graph, u, x


@pytest.mark.parametrize("name", [name for name in COLLECTION if "large" not in name])
def test_the_dense_solver(name: str) -> None:
    """It comes to the velocities of the sweeps from where one of them has led, and a box that
    stands on its corners loads all alike, which sweeps do not."""
    rest, graph, u, x = interpreted(densely, name)
    W, q, mu, r = dense(graph, u, x)
    assert rest <= 1e-10
    assert residual(W, q, mu, r) <= 1e-9
    free = COLLECTION[name]()[1]
    assert_allclose(q, dense(graph, free, 0.0 * x)[1], atol=1e-12 * np.abs(free).max())
    W, q, _, other = dense(*interpreted(swept, name, 3000)[1:])
    assert_allclose(W @ r, W @ other, atol=1e-7 * np.abs(q).max())
    if name in ("box at rest", "table on eight legs"):
        assert_allclose(r[0::3], r[0], rtol=1e-9)


@pytest.mark.parametrize("name", COLLECTION)
def test_friction_keeps_to_its_cones_before_the_laws_are_solved(name: str) -> None:
    """A heap that moves is solved to some digits only: none of them lets a contact pull, or rub
    beyond its bound, and the velocities are those of the impulses that are told."""
    reported, graph, u, x = interpreted(in_velocities, name, 1, 0.03)
    W, q, mu, r = dense(graph, u, x)
    pushes = r.reshape(-1, 3)
    assert (pushes[:, 0] >= 0.0).all()
    assert (np.hypot(pushes[:, 1], pushes[:, 2]) <= mu * pushes[:, 0] * (1 + 1e-12)).all()
    free = COLLECTION[name]()[1]
    assert_allclose(q, dense(graph, free, 0.0 * x)[1], atol=1e-12 * np.abs(free).max())
    assert residual(W, q, mu, r) <= 2.0 * reported + 1e-14


def of_graph(name: str) -> tuple[Any, ...]:
    """(residual of the program, graph, velocities and impulses) after one sweep."""
    from rb_sim.contact.problem import RIGID, lay_out_graph, residual_of

    _, graph, u, x = swept(name, 1)
    return residual_of(graph, lay_out_graph(graph, 1.0), u, x, x, RIGID, RIGID), graph, u, x


@pytest.mark.parametrize("name", COLLECTION)
def test_the_residual_is_that_of_alart_and_curnier(name: str) -> None:
    """|r_n - max(0, r_n - u_n / w)| and |r_T - P(r_T - u_T / w)| with P onto the disk of mu r_n,
    w the largest element of the contact's own block, relative to |r|."""
    told, graph, u, x = interpreted(of_graph, name)
    W, q, mu, r = dense(graph, u, x)
    error = []
    for part, speed, own, c in zip(
        r.reshape(-1, 3), (W @ r + q).reshape(-1, 3), np.diag(W).reshape(-1, 3), mu, strict=True
    ):
        ahead = part - speed / own.max()
        size, most = np.hypot(*ahead[1:]), c * part[0]
        friction = ahead[1:] if size <= most else most / size * ahead[1:]
        error += [part[0] - max(0.0, ahead[0]), *(part[1:] - friction)]
    assert told == pytest.approx(np.linalg.norm(error) / np.linalg.norm(r), rel=1e-9, abs=1e-15)


SOLVERS = {
    "sweeps": (swept, 3000),
    "Newton in velocities": (in_velocities, 60),
    "dense": (densely,),
}


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("name", COLLECTION)
def test_clarabel_agrees(name: str, solver: str) -> None:
    """With the slip's share mu |u_T| held at the solution's the problem is convex, a program with
    second-order cones whose solution has the same velocities (Acary, Cadoux, Lemarechal, Malick
    2011)."""
    clarabel = pytest.importorskip("clarabel")
    from scipy import sparse

    if solver == "dense" and "large" in name:
        pytest.skip("too many contacts for the dense solver")
    solve, *options = SOLVERS[solver]
    W, q, mu, r = dense(*interpreted(solve, name, *options)[1:])
    n, u = len(mu), W @ r + q
    slip = np.hypot(u[1::3], u[2::3])
    b = q.copy()
    b[0::3] += mu * slip
    scale = np.ones(3 * n)
    scale[0::3] = mu
    used = mu > 0.0
    cones, blocks = [], []
    for i in range(n):
        rows = -np.eye(3 * n)[3 * i : 3 * i + 3] * scale
        if used[i]:
            cones.append(clarabel.SecondOrderConeT(3))
            blocks.append(rows)
        else:
            cones += [clarabel.NonnegativeConeT(1), clarabel.ZeroConeT(2)]
            blocks.append(-np.eye(3 * n)[3 * i : 3 * i + 3])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    found = clarabel.DefaultSolver(
        sparse.csc_matrix(np.triu(W)), b, sparse.csc_matrix(np.vstack(blocks)), np.zeros(3 * n),
        cones, settings,
    ).solve()  # fmt: skip
    assert found.status == clarabel.SolverStatus.Solved  # at 1e-12 it may stall, far from it
    assert_allclose(W @ np.array(found.x), W @ r, atol=1e-5 * np.abs(q).max())


def one(seed: int, mu: float, least: float) -> tuple[Any, ...]:
    """(W, q, r) of one contact with a random block."""
    from rb_sim.contact.gauss_seidel import one_contact

    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3))
    W, q = root @ root.T + 0.05 * np.eye(3), rng.normal(size=3)
    block = (W[0, 0], W[0, 1], W[0, 2], W[1, 1], W[1, 2], W[2, 2])
    return W, q, np.array(one_contact(block, tuple(q), mu, least))


def many_ones() -> list[tuple[Any, ...]]:
    return [
        (mu, least, *one(seed, mu, least))
        for seed in range(200)
        for mu in (0.0, 0.2, 1.0)
        for least in (0.0, 0.3)
    ]


def test_one_contact_is_exact() -> None:
    """It opens, with its least impulse, sticks or slips, and each with the law of its kind, to
    rounding."""
    kinds = set()
    for mu, least, W, q, r in interpreted(many_ones):
        u = W @ r + q
        bound, size = mu * r[0], np.hypot(r[1], r[2])
        if r[0] == least:
            kinds.add("opens")
            assert u[0] >= -1e-10
        else:
            assert r[0] > least and abs(u[0]) <= 1e-10
        if size < bound * (1.0 - 1e-9):
            kinds.add("sticks")
            assert_allclose(u[1:], 0.0, atol=1e-10)
        else:
            kinds.add("slips")
            assert size == pytest.approx(bound, rel=1e-12, abs=1e-14)
            slip = np.hypot(u[1], u[2])
            assert r[1] * u[1] + r[2] * u[2] == pytest.approx(-size * slip, rel=1e-9, abs=1e-12)
    assert kinds == {"opens", "sticks", "slips"}
