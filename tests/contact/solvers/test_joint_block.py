"""Joints of a heap hold all at once, or one after the other, beside dense linear algebra."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.contact.solvers import gauss_seidel
from rb_sim.contact.solvers.gauss_seidel import BODY, LEFT_OUT, PARENT, relax_joints
from rb_sim.contact.solvers.graph import LIGHT_A, LIGHT_B, TURN_A, TURN_B, WIDTH, Graph

ENDS = [(0, -1), (1, 0), (2, 1), (2, 0), (1, -1)]
BODIES, MASSES = 3, np.array([1.0, 2.0, 0.5])


def joined(seed: int, factor: bool = True) -> tuple[Any, np.ndarray, np.ndarray]:
    """(graph, J, M^-1 J^T) of five lines between three balls, and from them to the world."""
    rng = np.random.default_rng(seed)
    m = len(ENDS)
    rows, ends = np.zeros((m, WIDTH)), np.zeros((m, 3), np.int64)
    J, pushes = np.zeros((m, 6 * BODIES)), np.zeros((6 * BODIES, m))
    for k, (b, a) in enumerate(ENDS):
        ends[k, BODY], ends[k, PARENT] = b, a
        rows[k, :12] = rng.normal(size=12)
        for body, at, light, turn in ((b, 0, LIGHT_B, TURN_B), (a, 6, LIGHT_A, TURN_A)):
            if body >= 0:
                rows[k, light] = 1.0 / MASSES[body]
                rows[k, turn : turn + 3] = rows[k, at + 3 : at + 6] / (0.4 * MASSES[body])
                o = 6 * body
                J[k, o : o + 6] = rows[k, at : at + 6]
                pushes[o : o + 3, k] = rows[k, at : at + 3] / MASSES[body]
                pushes[o + 3 : o + 6, k] = rows[k, turn : turn + 3]
    none = np.zeros((0, WIDTH))
    size = m if factor else 0
    graph = Graph(
        np.zeros((0, 2), np.int64), none, np.zeros(0), np.zeros((0, 8)), np.zeros((0, 6)),
        ends, rows, rng.normal(size=m), np.full((size, size), np.nan), np.full((2, m), np.nan),
    )  # fmt: skip
    return graph, J, pushes


@pytest.mark.parametrize("seed", range(4))
def test_all_joints_hold_at_once(seed: int) -> None:
    """By the impulses A^-1 (target - J u); the largest of them is told."""
    graph, J, pushes = joined(seed)
    rng = np.random.default_rng(50 + seed)
    u, x = rng.normal(size=(BODIES, 6)), rng.normal(size=len(ENDS))
    gauss_seidel.factor_joints(graph, BODIES)
    start, before = u.copy(), x.copy()
    most = relax_joints(graph, u, x)
    d = np.linalg.solve(J @ pushes, graph.joint_targets - J @ start.ravel())
    assert_allclose(x - before, d, rtol=1e-9, atol=1e-12)
    assert_allclose(J @ u.ravel(), graph.joint_targets, atol=1e-10)
    assert_allclose(u.ravel() - start.ravel(), pushes @ d, rtol=1e-9, atol=1e-12)
    assert most == pytest.approx(np.abs(d).max(), rel=1e-9)


@pytest.mark.parametrize("told", [True, False])
def test_lines_that_depend_on_others_get_no_impulse(told: bool) -> None:
    """Twice the same line: the second is left out by its pivot, or as it is told."""
    graph, J, pushes = joined(7)
    last, first = 4, 0
    graph.joint_ends[last] = graph.joint_ends[first]
    if told:
        graph.joint_ends[last, LEFT_OUT] = 1
    else:
        graph.joint_rows[last] = graph.joint_rows[first]
    gauss_seidel.factor_joints(graph, BODIES)
    u, x = np.ones((BODIES, 6)), np.zeros(len(ENDS))
    relax_joints(graph, u, x)
    kept = slice(0, last)
    assert x[last] == 0.0 and np.isfinite(x).all()
    assert_allclose(J[kept] @ u.ravel(), graph.joint_targets[kept], atol=1e-10)


def test_lines_too_many_for_that_hold_in_turn() -> None:
    """Each as the ones before have left it."""
    graph, J, pushes = joined(3, factor=False)
    graph.joint_targets[:] *= 1e-3
    u, x = 1e-3 * np.ones((BODIES, 6)), np.zeros(len(ENDS))
    wanted, changes = u.ravel().copy(), []
    for k in range(len(ENDS)):
        d = (graph.joint_targets[k] - J[k] @ wanted) / (J[k] @ pushes[:, k])
        wanted += pushes[:, k] * d
        changes.append(d)
    most = relax_joints(graph, u, x)
    assert_allclose(u.ravel(), wanted, rtol=1e-12)
    assert_allclose(x, changes, rtol=1e-12)
    assert most == pytest.approx(np.abs(changes).max())
