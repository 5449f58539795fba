"""The parts of the friction problem: matrices of Newton's method, loops over arrays."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from rb_sim.contact.solvers import graph
from rb_sim.contact.solvers.graph import LINES, WIDTH
from rb_sim.contact.solvers.proximal_newton import fill_matrix
from rb_sim.mechanics.systems.many_bodies import INERTIA, MASS


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
    A, x = rng.normal(size=(3, 4)), rng.normal(size=4)
    to, rows = np.full(5, 7.0), np.full((3, 5), 7.0)
    graph.copy(to, x)
    graph.copy_rows(rows, A)
    assert to.tolist() == [*x, 7.0] and (rows[:, :4] == A).all() and (rows[:, 4] == 7.0).all()
    assert graph.largest(np.array([0.25, -0.5, 0.125])) == 0.5
    assert graph.largest(np.zeros(3)) == 0.0 and np.isnan(graph.largest(np.array([1.0, np.nan])))
