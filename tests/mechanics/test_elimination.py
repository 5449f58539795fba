# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The sparse elimination on numbers, beside numpy: solutions, ranks in any units, and its order."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.mechanics.systems.elimination import Factors, Matrix
from rb_sim.numerics.rank import RANK_TOLERANCE


def sparse(matrix: np.ndarray) -> Matrix:
    return {i: {int(j): float(row[j]) for j in np.flatnonzero(row)} for i, row in enumerate(matrix)}


def chained(n: int, seed: int, units: float) -> np.ndarray:
    """G G^T of lines that share numbers with their neighbours alone, in very different units."""
    rng = np.random.default_rng(seed)
    G = np.zeros((n, n + 2))
    for i in range(n):
        G[i, i : i + 3] = rng.normal(size=3)
    G *= units ** rng.uniform(-1.0, 1.0, (n, 1))
    return G @ G.T


@pytest.mark.parametrize("units", [1.0, 1e4])
@pytest.mark.parametrize("order", [[0, 1, 2, 3, 4, 5, 6], [6, 0, 3, 1, 5, 2, 4]])
def test_the_solution_is_that_of_numpy(order: list[int], units: float) -> None:
    A = chained(7, 1, units)
    x = np.arange(1.0, 8.0) / np.sqrt(np.diag(A))
    b = A @ x
    found = Factors(sparse(A), order)
    assert found.rank == 7.0 and set(found.kept) == set(order)
    solved = found.solve(dict(enumerate(b)))
    assert_allclose([solved[k] for k in range(7)], x, rtol=1e-9)
    first = order[0]
    assert found.shares[first] == pytest.approx(1.0)
    last = order[-1]
    inverse = np.linalg.inv(A)  # the last pivot is the inverse of its element
    assert found.shares[last] == pytest.approx(1.0 / inverse[last, last] / A[last, last], rel=1e-9)


@pytest.mark.parametrize("units", [1e-5, 1.0, 1e5])
def test_lines_that_depend_on_those_before_get_no_multiplier(units: float) -> None:
    """In any units, of all lines and of one; G^T x is what it has to be all the same."""
    rng = np.random.default_rng(2)
    G = units * rng.normal(size=(5, 3))
    G[1] *= 1e3
    G = np.vstack([G[:2], 3.0 * G[0] - G[1], G[2], G[3]])
    u = rng.normal(size=3)
    A, b = G @ G.T, G @ u
    found = Factors(sparse(A), range(5))
    assert found.rank == 3.0 and set(found.kept) == {0, 1, 3}
    solved = found.solve(dict(enumerate(b)))
    assert solved[2] == solved[4] == 0.0
    assert_allclose(G.T @ [solved[k] for k in range(5)], u, atol=1e-8)


def test_what_lies_on_either_side_of_the_threshold() -> None:
    """A pivot relative to the diagonal element, or to the scale that is given for it."""
    for share, rank in ((0.5 * RANK_TOLERANCE, 1.0), (2.0 * RANK_TOLERANCE, 2.0)):
        for size in (1e-6, 1e6):
            matrix = {0: {0: 1.0, 1: size}, 1: {0: size, 1: size**2 * (1.0 + share)}}
            assert Factors(matrix, [0, 1]).rank == rank
    for smallest, rank in ((0.3, 2.0), (0.6, 1.0)):
        matrix = {0: {0: 4.0, 1: 2.0}, 1: {0: 2.0, 1: 2.0}}
        assert Factors(matrix, [0, 1], smallest).rank == rank
    for scale, rank in ((1.0, 2.0), (1e12, 1.0)):
        assert Factors({0: {0: 2.0}, 1: {1: 3.0}}, [0, 1], scales={1: scale}).rank == rank


def test_unknowns_that_are_no_lines_keep_their_pivots_whatever_their_sign() -> None:
    """As [A G; G^T -M]: their right sides are zero, and they do not count."""
    A, G, M = np.array([[2.0, 0.3], [0.3, 1.0]]), np.array([[1.0, 0.5], [0.2, -0.7]]), np.eye(2)
    whole = np.block([[A, G], [G.T, -M]])
    found = Factors(sparse(whole), [0, 1, 2, 3], sure=frozenset({2, 3}))
    solved = found.solve({0: 1.0, 1: -2.0})
    expected = np.linalg.solve(whole, [1.0, -2.0, 0.0, 0.0])
    assert_allclose([solved[k] for k in range(4)], expected, rtol=1e-12)
    assert found.rank == 2.0 and set(found.kept) == {0, 1}
