"""Joints that follow each contact, beside dense linear algebra."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from rb_sim.contact.solvers.gauss_seidel import PROXIMAL, ease_blocks, factor_joints, fill_block
from rb_sim.contact.solvers.graph import (
    BLOCK,
    LIGHT_A,
    LIGHT_B,
    LINES,
    RULES,
    TURN_A,
    TURN_B,
    WIDTH,
    Graph,
)
from tests.interpreted import interpreted


def filled(graph: Graph, bodies: int) -> np.ndarray:
    """The own blocks of its contacts."""
    for c in range(len(graph.ends)):
        fill_block(graph, c)
    factor_joints(graph, bodies)
    ease_blocks(graph, bodies)
    return graph.blocks


def test_the_own_blocks_of_contacts_are_those_with_joints_that_follow() -> None:
    """Beside dense linear algebra: two contacts and four lines of joints between three bodies."""
    rng = np.random.default_rng(5)
    contacts, lines = [(0, -1), (2, 1)], [(0, 1), (1, -1), (1, 2), (2, -1)]
    bodies, m = 3, len(lines)
    inverse = np.zeros((6 * bodies, 6 * bodies))
    masses = rng.uniform(0.5, 2.0, bodies)
    for i in range(bodies):
        half = rng.normal(size=(3, 3))
        inverse[6 * i : 6 * i + 3, 6 * i : 6 * i + 3] = np.eye(3) / masses[i]
        inverse[6 * i + 3 : 6 * i + 6, 6 * i + 3 : 6 * i + 6] = half @ half.T + np.eye(3)

    def written(ends: list[tuple[int, int]], each: int) -> tuple[np.ndarray, np.ndarray]:
        """(rows of the graph, the same over all velocities)."""
        rows, dense = np.zeros((each * len(ends), WIDTH)), np.zeros((each * len(ends), 6 * bodies))
        for k in range(len(rows)):
            for side, i, turn, light in ((0, 0, TURN_B, LIGHT_B), (6, 1, TURN_A, LIGHT_A)):
                body = ends[k // each][i]
                if body >= 0:
                    part = rng.normal(size=6)
                    rows[k, side : side + 6] = part
                    own = slice(6 * body + 3, 6 * body + 6)
                    rows[k, turn : turn + 3] = inverse[own, own] @ part[3:]
                    rows[k, light] = 1.0 / masses[body]
                    dense[k, 6 * body : 6 * body + 6] = part
        return rows, dense

    rows, J = written(contacts, LINES)
    joint_rows, K = written(lines, 1)
    ends = np.array(contacts)
    joint_ends = np.array([[*pair, 0] for pair in lines])
    graph = Graph(
        ends, rows, np.zeros(len(rows)), np.zeros((2, RULES)), np.zeros((2, BLOCK)), joint_ends,
        joint_rows, np.zeros(m), np.zeros((m, m)), np.zeros((2, m)),
    )  # fmt: skip

    blocks = interpreted(filled, graph, bodies)
    follow = inverse - inverse @ K.T @ np.linalg.solve(K @ inverse @ K.T, K @ inverse)
    for c in range(2):
        own = J[LINES * c : LINES * c + 3]
        W = own @ follow @ own.T + PROXIMAL * np.diag(np.diag(own @ inverse @ own.T))
        assert_allclose(blocks[c], W[np.triu_indices(3)], rtol=1e-10)
