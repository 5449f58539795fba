# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The solve with friction against numpy: full rank, dependent lines, zero lines, least norm."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.numerics.linear_solves import least_norm, solve_unsymmetric

SHAPES = [(1, 1), (3, 3), (6, 6), (6, 4), (9, 5), (12, 6), (5, 1), (24, 6)]


def solved(A: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, int]:
    n = len(b)
    columns = np.zeros(n, np.int64)
    x, L = np.full(n, np.nan), np.full((n, n), np.nan)
    given = A.copy(), b.copy()
    rank = solve_unsymmetric(A, b, x, L, columns, n)
    assert (A == given[0]).all()
    assert (b == given[1]).all()
    return x, rank


def product(rng: np.random.Generator, n: int, rank: int) -> np.ndarray:
    """G M^-1 W^T of that rank: the pushes W stray from G by friction."""
    G = rng.normal(size=(n, rank))
    W = G + 0.4 * rng.normal(size=(n, rank))
    return G @ W.T


@pytest.mark.parametrize(("n", "rank"), SHAPES)
@pytest.mark.parametrize("seed", range(4))
def test_rank_and_solution(n: int, rank: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    A = product(rng, n, rank)
    b = A @ rng.normal(size=n)
    x, found = solved(A, b)
    assert found == rank == np.linalg.matrix_rank(A, tol=1e-9)
    assert_allclose(A @ x, b, atol=1e-10 * np.abs(b).max())
    if rank == n:
        assert_allclose(x, np.linalg.solve(A, b), rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize(("n", "rank"), SHAPES)
def test_lines_that_do_not_hold_drop_out(n: int, rank: int) -> None:
    """Zero rows with the columns of the same number: x = 0 there, the rest as without them."""
    rng = np.random.default_rng(n)
    A, kept = product(rng, n, rank), rng.permutation(2 * n)[:n]
    b = A @ rng.normal(size=n)
    wide, right = np.zeros((2 * n, 2 * n)), np.zeros(2 * n)
    wide[np.ix_(kept, kept)], right[kept] = A, b
    x, found = solved(wide, right)
    assert found == rank
    others = np.setdiff1d(np.arange(2 * n), kept)
    assert (x[others] == 0.0).all()
    assert_allclose(A @ x[kept], b, atol=1e-10 * np.abs(b).max())
    least_norm(wide, right, x, rank, len(right))
    assert_allclose(x[kept], np.linalg.pinv(A, rcond=1e-10) @ b, atol=1e-9 * np.abs(b).max())
    assert np.abs(x[others]).max(initial=0.0) <= 1e-12 * np.abs(x).max()


def test_nothing_holds() -> None:
    x, rank = solved(np.zeros((3, 3)), np.zeros(3))
    assert rank == 0
    assert (x == 0.0).all()


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
def test_units_do_not_matter(size: float) -> None:
    """Lines of other units (torques against forces) change neither rank nor solution."""
    rng = np.random.default_rng(5)
    A = product(rng, 6, 4)
    b = A @ rng.normal(size=6)
    s = np.where(np.arange(6) < 3, 1.0, size)
    scaled = s[:, None] * A
    x, rank = solved(scaled, s * b)
    assert rank == 4
    assert_allclose(A @ x, b, atol=1e-9 * np.abs(b).max())


@pytest.mark.parametrize(("n", "rank"), SHAPES)
def test_least_norm_is_that_of_the_pseudo_inverse(n: int, rank: int) -> None:
    rng = np.random.default_rng(100 + n)
    A = product(rng, n, rank)
    b = A @ rng.normal(size=n)
    x, found = solved(A, b)
    least_norm(A, b, x, found, len(b))
    assert_allclose(x, np.linalg.pinv(A, rcond=1e-10) @ b, atol=1e-9 * np.abs(x).max())
    assert_allclose(A @ x, b, atol=1e-9 * np.abs(b).max())


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_not_finite_stays_so(bad: float) -> None:
    """A step that overflowed is refused for its error, not for an exception."""
    A, b = np.eye(3), np.array([1.0, bad, 0.0])
    x = np.zeros(3)
    with np.errstate(invalid="ignore"):
        least_norm(A, b, x, 3, len(b))
    assert np.isnan(x).all()
    A[1, 2] = bad
    least_norm(A, np.ones(3), x, 2, 3)
    assert np.isnan(x).all()
