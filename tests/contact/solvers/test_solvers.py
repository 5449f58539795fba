"""Solvers of the friction problem on one collection, against each other and against Clarabel."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.contact.solvers.newton import FrictionProblem, residual
from tests.contact.solvers.problems import COLLECTION
from tests.interpreted import interpreted

SETTLED = 1e-13


def swept(name: str, sweeps: int) -> tuple[Any, ...]:
    """(residual of the sweeps, problem, reactions, velocities) by Gauss-Seidel alone."""
    from rb_sim.contact.solvers.gauss_seidel import gauss_seidel
    from rb_sim.contact.solvers.graph import LINES
    from rb_sim.contact.solvers.newton import delassus

    graph, u = COLLECTION[name]()
    x, every = np.zeros(len(graph.targets)), np.arange(len(graph.ends))
    rest, _ = gauss_seidel(graph, u, x, np.zeros(0), 1.0, SETTLED, sweeps)
    W, q, mu, r = delassus(graph, u, x, every)
    at_contacts = np.array([graph.rows[k, :6] @ u[b] + (graph.rows[k, 6:12] @ u[a] if a >= 0 else 0)
                            for k, (b, a) in ((LINES * i + p, graph.ends[i])
                                              for i in every for p in range(3))])  # fmt: skip
    return rest, W, q, mu, r, at_contacts


def polished(name: str) -> tuple[Any, ...]:
    """(W, q, mu, r) by a few sweeps and Newton's method."""
    from rb_sim.contact.solvers.newton import newton

    _, W, q, mu, r, _ = swept(name, 60)
    r, _ = newton(W, q, mu, r, 20, SETTLED)
    return W, q, mu, r


@pytest.mark.parametrize("name", COLLECTION)
def test_gauss_seidel_solves(name: str) -> None:
    """The residual of the problem vanishes, and the velocities that the bodies were given are those
    of the Delassus matrix."""
    rest, W, q, mu, r, at_contacts = interpreted(swept, name, 3000)
    assert rest <= 1e-9
    assert residual(FrictionProblem(W, q, mu), r) <= 1e-8
    targets = COLLECTION[name]()[0].targets.reshape(-1, 6)[:, :3].reshape(-1)
    assert_allclose(W @ r + q + targets, at_contacts, atol=1e-12)
    pushes = r.reshape(-1, 3)
    assert (pushes[:, 0] >= 0.0).all()
    assert (np.hypot(pushes[:, 1], pushes[:, 2]) <= mu * pushes[:, 0] * (1 + 1e-12)).all()


@pytest.mark.parametrize("name", COLLECTION)
def test_newton_ends_where_gauss_seidel_does(name: str) -> None:
    """The same velocities, which are determined though the reactions of redundant contacts are not;
    and further than the sweeps that it started from."""
    W, q, mu, r = interpreted(polished, name)
    start = interpreted(swept, name, 60)[4]
    problem = FrictionProblem(W, q, mu)
    assert residual(problem, r) <= 1e-8
    assert residual(problem, r) <= residual(problem, start)
    _, W, q, mu, other, _ = interpreted(swept, name, 3000)
    assert_allclose(W @ r, W @ other, atol=1e-7 * np.abs(q).max())


def bodies_of(graph: Any) -> np.ndarray:
    """Masses and inertias of the balls of a graph, as the table of a system has them."""
    from rb_sim.contact.solvers.graph import LIGHT_A, LIGHT_B, LINES
    from rb_sim.mechanics.systems.many_bodies import INERTIA, INVERSE, MASS

    table = np.zeros((graph.ends.max() + 1, INVERSE + 6))
    table[:, MASS] = table[:, INERTIA : INERTIA + 3] = 1.0  # of a body without contacts
    for i, (b, a) in enumerate(graph.ends):
        for body, light in ((b, LIGHT_B), (a, LIGHT_A)):
            if body >= 0:
                mass = 1.0 / graph.rows[LINES * i, light]
                table[body, MASS], table[body, INERTIA : INERTIA + 3] = mass, 0.4 * mass
    return table


def in_velocities(name: str, sweeps: int) -> tuple[Any, ...]:
    """(residual told, W, q, mu, r, velocities by Newton's method in the velocities of bodies, and
    those that the impulses give) after so many sweeps."""
    from rb_sim.contact.solvers.gauss_seidel import gauss_seidel
    from rb_sim.contact.solvers.graph import push
    from rb_sim.contact.solvers.newton import delassus
    from rb_sim.contact.solvers.proximal_newton import proximal_newton

    graph, u = COLLECTION[name]()
    free, x, every = u.copy(), np.zeros(len(graph.targets)), np.arange(len(graph.ends))
    gauss_seidel(graph, u, x, np.zeros(0), 1.0, SETTLED, sweeps)
    _, rest, _ = proximal_newton(graph, bodies_of(graph), u, x, 1e-11)
    W, q, mu, r = delassus(graph, u, x, every)
    for k in np.flatnonzero(x):
        push(graph.rows, k, free, *graph.ends[k // 6], x[k])
    return rest, W, q, mu, r, u, free


@pytest.mark.parametrize("name", COLLECTION)
def test_newton_in_the_velocities_of_bodies(name: str) -> None:
    """It solves what sweeps have only begun: the residual that it tells is that of the problem, the
    velocities are those of its impulses and those that the sweeps come to in the end."""
    rest, W, q, mu, r, u, pushed = interpreted(in_velocities, name, 5)
    assert rest <= 1e-9
    assert residual(FrictionProblem(W, q, mu), r) <= 1e-9
    assert_allclose(u, pushed, atol=1e-12 * np.abs(COLLECTION[name]()[1]).max())
    _, W, q, mu, other, _ = interpreted(swept, name, 3000)
    assert_allclose(W @ r, W @ other, atol=1e-7 * np.abs(q).max())


def swept_near(name: str, enough: float) -> tuple[Any, ...]:
    """(residual told, W, q, mu, r) where sweeps are to come as near to the laws as `enough`."""
    from rb_sim.contact.solvers.gauss_seidel import gauss_seidel
    from rb_sim.contact.solvers.hybrid import sweep_near
    from rb_sim.contact.solvers.newton import delassus

    graph, u = COLLECTION[name]()
    x, every = np.zeros(len(graph.targets)), np.arange(len(graph.ends))
    gauss_seidel(graph, u, x, np.zeros(0), 1.0, SETTLED, 5)
    told, sweeps = sweep_near(graph, u, x, enough)
    assert told <= enough or sweeps > 0
    return told, *delassus(graph, u, x, every)


@pytest.mark.parametrize("name", COLLECTION)
def test_sweeps_tell_how_near_they_are(name: str) -> None:
    """By another map of the same laws (De Saxce's), which may be larger by what a projection
    onto the cone makes of an error, not by orders."""
    told, W, q, mu, r = interpreted(swept_near, name, 1e-4)
    left = residual(FrictionProblem(W, q, mu), r)
    assert left <= 2.0 * told + 1e-14


@pytest.mark.parametrize("name", COLLECTION)
def test_clarabel_agrees(name: str) -> None:
    """With the slip's share mu |u_T| held at the solution's the problem is convex, a program with
    second-order cones whose solution has the same velocities (Acary, Cadoux, Lemarechal, Malick
    2011)."""
    clarabel = pytest.importorskip("clarabel")
    from scipy import sparse

    W, q, mu, r = interpreted(polished, name)
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


def one(seed: int, mu: float) -> tuple[Any, ...]:
    """(W, q, r) of one contact with a random block."""
    from rb_sim.contact.solvers.one_contact import one_contact

    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3))
    W, q = root @ root.T + 0.05 * np.eye(3), rng.normal(size=3)
    block = (W[0, 0], W[0, 1], W[0, 2], W[1, 1], W[1, 2], W[2, 2])
    return W, q, np.array(one_contact(block, tuple(q), mu))


def many_ones() -> list[tuple[Any, ...]]:
    return [(mu, *one(seed, mu)) for seed in range(200) for mu in (0.0, 0.2, 1.0)]


def test_one_contact_is_exact() -> None:
    """It opens, sticks or slips, and each with the law of its kind, to rounding."""
    kinds = set()
    for mu, W, q, r in interpreted(many_ones):
        u = W @ r + q
        if q[0] >= 0.0:
            kinds.add("open")
            assert not r.any()
            continue
        bound, size = mu * r[0], np.hypot(r[1], r[2])
        assert r[0] >= 0.0 and abs(u[0]) <= 1e-10
        if size < bound * (1.0 - 1e-9):
            kinds.add("sticks")
            assert_allclose(u, 0.0, atol=1e-10)
        else:
            kinds.add("slips")
            assert size == pytest.approx(bound, rel=1e-12, abs=1e-14)
            slip = np.hypot(u[1], u[2])
            assert r[1] * u[1] + r[2] * u[2] == pytest.approx(-size * slip, rel=1e-9, abs=1e-12)
    assert kinds == {"open", "sticks", "slips"}


def test_the_residual_sees_what_is_wrong() -> None:
    """A reaction that pulls, that is beyond the cone, that lets bodies overlap, that slips free."""
    W, mu = np.eye(3), np.array([0.5])
    problem = FrictionProblem(W, np.array([-1.0, 0.2, 0.0]), mu)
    assert residual(problem, np.array([1.0, -0.2, 0.0])) <= 1e-15
    for wrong in ([-1.0, 0.0, 0.0], [1.0, -0.9, 0.0], [0.5, -0.2, 0.0], [1.0, 0.0, 0.0]):
        assert residual(problem, np.array(wrong)) > 0.05
