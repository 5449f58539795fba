# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The rank rule beside matrices whose rank is known."""

from __future__ import annotations

import ast
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.numerics.rank import (
    LEAST_SINGULAR,
    RANK_TOLERANCE,
    null_space,
    ranked,
    scaled_rows,
    solved,
    split,
)

PACKAGE = Path(__file__).parents[2] / "rb_sim"


def lines_of_rank(m: int, n: int, rank: int, seed: int, units: float = 1.0) -> np.ndarray:
    """m lines of n numbers, of that rank, whose units differ by up to `units`."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(m, rank)) @ rng.normal(size=(rank, n))
    return rows * units ** rng.uniform(-1.0, 1.0, size=(m, 1))


SIZES = [(3, 6, 3), (6, 6, 4), (9, 6, 5), (9, 12, 7), (5, 6, 1)]


@pytest.mark.parametrize("units", [1.0, 1e8])
@pytest.mark.parametrize(("m", "n", "rank"), SIZES)
def test_units_do_not_decide(m: int, n: int, rank: int, units: float) -> None:
    rows = lines_of_rank(m, n, rank, m + n, units)
    null = null_space(rows)
    assert null.shape == (n, n - rank)
    assert_allclose(null.T @ null, np.eye(n - rank), atol=1e-12)
    assert np.abs(scaled_rows(rows) @ null).max(initial=0.0) < 1e-7
    assert ranked(rows @ rows.T).rank == rank


@pytest.mark.parametrize(("m", "n", "rank"), SIZES)
def test_a_split_gives_null_space_and_the_least_solution(m: int, n: int, rank: int) -> None:
    rows = lines_of_rank(m, n, rank, 7 * m + n)
    found = split(*np.linalg.svd(rows))
    assert found.rank == rank and found.null.shape == (n, n - rank)
    assert_allclose(rows @ found.null, 0.0, atol=1e-12)
    b = np.arange(1.0, m + 1.0)
    assert_allclose(found.least(b), np.linalg.pinv(rows, rcond=1e-9) @ b, atol=1e-9)
    assert_allclose(solved(rows, b), found.least(b), atol=1e-9)


@pytest.mark.parametrize("units", [1.0, 1e3])
@pytest.mark.parametrize(("m", "n", "rank"), SIZES)
def test_the_least_solution_of_a_matrix_of_lines(m: int, n: int, rank: int, units: float) -> None:
    """x of least norm, whatever the units of the lines; what A maps to zero; a line of zeros."""
    rows = lines_of_rank(m, n, rank, 3 * m + n, units)
    rows = np.vstack([rows, np.zeros((1, n))])
    found = ranked(rows @ rows.T)
    assert found.rank == rank and found.null.shape == (m + 1, m + 1 - rank)
    assert_allclose(found.null.T @ found.null, np.eye(m + 1 - rank), atol=1e-12)
    sizes = np.linalg.norm(rows, axis=1).max()
    assert_allclose(rows.T @ found.null, 0.0, atol=1e-7 * sizes)
    u = np.arange(1.0, n + 1.0)
    x = found.least(rows @ u)  # of A x = G G^T x = G u
    least = np.linalg.pinv(rows.T, rcond=1e-9 / units) @ (
        np.linalg.pinv(rows, 1e-9 / units) @ (rows @ u)
    )
    assert_allclose(x, least, atol=1e-6 * np.abs(least).max())


def test_of_whole_rank_the_inverse_is_the_inverse() -> None:
    rows = lines_of_rank(4, 6, 4, 1, 1e3)
    matrix = rows @ rows.T
    found = ranked(matrix)
    assert found.rank == 4 and found.null.shape == (4, 0)
    assert_allclose(found.inverse @ matrix, np.eye(4), atol=1e-6)
    nothing = ranked(np.zeros((0, 0)))
    assert nothing.rank == 0 and nothing.null.shape == nothing.inverse.shape == (0, 0)
    assert split(np.eye(2), np.zeros(0), np.eye(3)).rank == 0
    assert split(*np.linalg.svd(np.diag([0.0, 0.0]))).rank == 0
    assert split(*np.linalg.svd(np.diag([3e-14, 1e-14]))).rank == 2


def test_the_threshold_of_eigenvalues_is_times_their_number() -> None:
    """Two lines at an angle e have the eigenvalue e^2 / 2 when scaled."""
    for share, rank in ((0.9, 1), (1.1, 2)):
        rows = np.array([[1.0, 0.0], [1.0, math.sqrt(2.0 * share * 2.0 * RANK_TOLERANCE)]])
        assert null_space(rows).shape == (2, 2 - rank)
        assert ranked(rows @ rows.T).rank == rank


def test_what_lies_on_either_side_of_the_threshold() -> None:
    for least, rank in ((0.5 * LEAST_SINGULAR, 1), (2.0 * LEAST_SINGULAR, 2)):
        assert split(*np.linalg.svd(np.diag([1.0, least]))).rank == rank
    assert split(*np.linalg.svd(np.diag([1.0, 1e-11])), 1e-10).rank == 1


def test_lines_that_vanish_stay_zero_and_restrict_nothing() -> None:
    rows = np.array([[0.0, 0.0], [3.0, 4.0]])
    assert_allclose(scaled_rows(rows), [[0.0, 0.0], [0.6, 0.8]])
    assert null_space(rows).shape == (2, 1)


ELSEWHERE = {
    "numerics/rank.py", "accuracy/certify.py",  # a straight line through logarithms
    "contact/events/instant.py",  # the error of a solve that is not finite
    "catalogue/geometry/hull.py",  # axes of a cloud of points, whose rank is not asked
    "bags/fit/fit.py", "equilibrium/statics_picture.py",  # likewise: of residuals, of a drawing
    "contact/events/shares.py",  # which way of sharing a load changes the motion most
    "bags/fit/unknowns.py",  # what a recording tells, above its noise or that of differences
    "numerics/cone_program.py",  # a step of an iteration, which the next one mends
    "equilibrium/state_space.py",  # null spaces of powers of A, which split off multiple zeros
    "scene/initial.py",  # how far from dependent lines are that are not
    "equilibrium/equilibrium.py",  # whole rank by construction, and `split`
}  # fmt: skip
"""Modules that decompose matrices themselves, and why that decides no rank."""


def test_ranks_are_decided_in_one_file() -> None:
    names, found = {"lstsq", "svd", "pinv", "matrix_rank", "null_space", "rank_revealing"}, set()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            called = node.func if isinstance(node, ast.Call) else None
            if isinstance(called, ast.Attribute) and called.attr in names:
                found.add(path.relative_to(PACKAGE).as_posix())
    assert found == ELSEWHERE
