# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The solve of constraint matrices against numpy: full rank, dependent rows, least norm."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.numerics.linear_solves import solve_semidefinite

RNG = np.random.default_rng(3)


def solved(A: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, int]:
    n = len(b)
    x, L, order = np.zeros(n), np.zeros((n, n)), np.zeros(n, np.int64)
    return x, solve_semidefinite(A, b, x, L, order, n)


def gram(n: int, rank: int) -> np.ndarray:
    """A matrix of that rank whose rows differ in size by orders of magnitude."""
    G = RNG.normal(size=(n, rank)) * 10.0 ** RNG.uniform(-3, 3, n)[:, None]
    return G @ G.T


@pytest.mark.parametrize(("n", "rank"), [(1, 1), (4, 4), (4, 3), (9, 5), (6, 1)])
def test_rank_and_solution(n: int, rank: int) -> None:
    A = gram(n, rank)
    b = A @ RNG.normal(size=n)
    x, found = solved(A, b)
    scale = np.sqrt(np.diag(A))
    assert found == rank
    assert_allclose((A @ x) / scale, b / scale, atol=1e-9 * np.abs(b / scale).max())


def test_nothing_to_solve() -> None:
    x, rank = solved(np.zeros((3, 3)), np.zeros(3))
    assert rank == 0 and not x.any()


def test_equal_lines_do_not_hide_the_others() -> None:
    """Pivots go by size: those of equal lines vanish at once, those of the others do not."""
    G = np.array([[1.0, 0.5, 0.0], [1.0, 0.5, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    A = G @ G.T
    b = A @ np.arange(1.0, 5.0)
    x, rank = solved(A, b)
    assert rank == 3
    assert_allclose(A @ x, b, atol=1e-13)
