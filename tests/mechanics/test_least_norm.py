"""How multipliers of least norm change, beside differences of what they are."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim.mechanics.systems.elimination import (
    changed,
    projected,
)

SIXTH = {-3: -1 / 60, -2: 3 / 20, -1: -3 / 4, 1: 3 / 4, 2: -3 / 20, 3: 1 / 60}


@pytest.mark.parametrize(("n", "rank"), [(1, 1), (4, 4), (5, 3), (20, 17)])
def test_changes_of_the_projection_by_differences(n: int, rank: int) -> None:
    """A = G G^T with n lines of which `rank` are independent, wherever it is looked at."""
    rng = np.random.default_rng(n)
    combined, lines, turned = (rng.normal(size=s) for s in ((n, rank), (rank, n), (n, rank)))
    x, slope = rng.normal(size=n), rng.normal(size=n)

    def matrix(s: float) -> np.ndarray:
        G = (combined + s * turned) @ lines
        return G @ G.T

    def value(s: float) -> np.ndarray:
        return projected(matrix(s), x + s * slope, rank)

    h = 1e-3
    differences = sum(w * value(j * h) for j, w in SIXTH.items()) / h
    d_matrix = sum(w * matrix(j * h) for j, w in SIXTH.items()) / h
    found = changed(matrix(0.0), x, rank, np.asarray(d_matrix), slope)
    np.testing.assert_allclose(found, differences, atol=1e-8)
