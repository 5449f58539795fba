# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Least squares of any rank agree with LAPACK's, and leave numbers alone that are exact."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.numerics.linear_solves import (
    least_norm,
    least_squares,
    solve_semidefinite,
    solve_unsymmetric,
)


def solved(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    n, x = len(b), np.zeros(len(b))
    least_squares(A.reshape(-1), b, n, x, np.empty(n * (n + 4)))
    return x


@pytest.mark.parametrize("seed", range(60))
def test_any_rank(seed: int) -> None:
    """The least x, whether or not an x solves the equations, also with lines of the identity."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 13))
    rank = int(rng.integers(0, n + 1))
    A = rng.normal(size=(n, rank)) @ rng.normal(size=(rank, n))
    A[: int(rng.integers(0, 2))] = np.eye(n)[0]
    b = rng.normal(size=n) if seed % 2 else A @ rng.normal(size=n)
    expected, _, rank, sizes = np.linalg.lstsq(A, b, rcond=1e-12)
    condition = sizes[0] / sizes[rank - 1] if rank else 1.0
    assert np.abs(solved(A, b) - expected).max() <= 1e-13 * condition * (1.0 + np.linalg.norm(b))


def test_what_needs_no_reflection_is_not_rounded() -> None:
    """A ball that stops stops exactly."""
    A, b = np.diag([7.0, 3.0, 1.0 / 3.0, 0.0]), np.array([7e-9, 3.3, -0.1, 0.0])
    assert (solved(A, b) == b / np.array([7.0, 3.0, 1.0 / 3.0, 1.0])).all()


# The solve of constraint matrices against numpy: full rank, dependent rows, least norm.


RNG = np.random.default_rng(3)


def solved_symmetric(A: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, int]:
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
    x, found = solved_symmetric(A, b)
    scale = np.sqrt(np.diag(A))
    assert found == rank
    assert_allclose((A @ x) / scale, b / scale, atol=1e-9 * np.abs(b / scale).max())


def test_equal_lines_do_not_hide_the_others() -> None:
    """Pivots go by size: those of equal lines vanish at once, those of the others do not."""
    G = np.array([[1.0, 0.5, 0.0], [1.0, 0.5, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    A = G @ G.T
    b = A @ np.arange(1.0, 5.0)
    x, rank = solved_symmetric(A, b)
    assert rank == 3
    assert_allclose(A @ x, b, atol=1e-13)


# The solve with friction against numpy: full rank, dependent lines, zero lines, least norm.


SHAPES = [(1, 1), (3, 3), (6, 6), (6, 4), (9, 5), (12, 6), (5, 1), (24, 6)]


def solved_with_friction(A: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, int]:
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
def test_rank_and_solution_unsymmetric(n: int, rank: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    A = product(rng, n, rank)
    b = A @ rng.normal(size=n)
    x, found = solved_with_friction(A, b)
    assert found == rank == np.linalg.matrix_rank(A, tol=1e-9)
    assert_allclose(A @ x, b, atol=1e-10 * np.abs(b).max())
    if rank == n:
        assert_allclose(x, np.linalg.solve(A, b), rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
def test_units_do_not_matter(size: float) -> None:
    """Lines of other units (torques against forces) change neither rank nor solution."""
    rng = np.random.default_rng(5)
    A = product(rng, 6, 4)
    b = A @ rng.normal(size=6)
    s = np.where(np.arange(6) < 3, 1.0, size)
    scaled = s[:, None] * A
    x, rank = solved_with_friction(scaled, s * b)
    assert rank == 4
    assert_allclose(A @ x, b, atol=1e-9 * np.abs(b).max())


@pytest.mark.parametrize(("n", "rank"), SHAPES)
def test_least_norm_is_that_of_the_pseudo_inverse(n: int, rank: int) -> None:
    rng = np.random.default_rng(100 + n)
    A = product(rng, n, rank)
    b = A @ rng.normal(size=n)
    x, found = solved_with_friction(A, b)
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
