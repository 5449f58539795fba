"""Elimination by blocks of bodies against LAPACK's dense one."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.contact.solvers.proximal_newton import SIZE, eliminate
from tests.interpreted import interpreted

PILES = {
    "alone": [],
    "tower": [(0, 1), (1, 2), (2, 3), (3, 4)],
    "hub": [(0, 1), (0, 2), (0, 3), (0, 4)],
    "ring": [(0, 1), (1, 2), (2, 3), (3, 4), (4, 0)],
    "two heaps": [(0, 3), (1, 4), (1, 2), (2, 4)],
}


def solved(pairs: list[tuple[int, int]]) -> tuple[np.ndarray, np.ndarray]:
    """(by blocks, by LAPACK) of a matrix as heaps have them: masses and unsymmetric couplings."""
    rng, count = np.random.default_rng(5), 5
    linked = np.zeros((count, count), np.int64)
    for b, a in pairs:
        linked[b, a] = linked[a, b] = 1
    blocks = np.kron(linked + np.eye(count), np.ones((SIZE, SIZE)))
    H = blocks * rng.normal(size=blocks.shape) + 30.0 * np.eye(SIZE * count)
    g = rng.normal(size=SIZE * count)
    expected = np.linalg.solve(H, g)
    assert eliminate(H, g, linked, *(np.zeros(count, np.int64) for _ in range(3)))
    return g, expected


@pytest.mark.parametrize("name", PILES)
def test_elimination_of_bodies(name: str) -> None:
    x, expected = interpreted(solved, PILES[name])
    assert_allclose(x, expected, rtol=1e-12)


def without_mass() -> bool:
    workspace = (np.zeros(1, np.int64) for _ in range(3))
    return eliminate(np.zeros((SIZE, SIZE)), np.ones(SIZE), np.zeros((1, 1), np.int64), *workspace)


def test_what_has_no_mass_is_told() -> None:
    assert not interpreted(without_mass)
