# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""How multipliers of least norm change, beside differences of what they are."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim.graph.machine import compile_law, evaluate
from rb_sim.graph.symbols import Graph
from rb_sim.mechanics.systems.elimination import changes_of_least_norm, least_norm
from tests.interpreted import interpreted


def projected(matrix: np.ndarray, x: np.ndarray, rank: int) -> np.ndarray:
    """The part of x in the span of the eigenvectors of the `rank` largest eigenvalues."""
    kept = np.linalg.eigh(matrix)[1][:, len(matrix) - rank :]
    return kept @ (kept.T @ x)


def changed(
    matrix: np.ndarray, x: np.ndarray, rank: int, d_matrix: np.ndarray, d_x: np.ndarray
) -> np.ndarray:
    """Its change by the formula of Golub and Pereyra, from eigenvectors."""
    values, vectors = np.linalg.eigh(matrix)
    kept, values = vectors[:, len(matrix) - rank :], values[len(matrix) - rank :]
    shares = kept.T @ x
    outward = d_matrix @ (kept @ (shares / values))
    inward = d_matrix @ (x - kept @ shares)
    return outward + kept @ (kept.T @ (d_x - outward) + (kept.T @ inward) / values)


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


def by_law(matrix: np.ndarray, x: np.ndarray, rank: int) -> np.ndarray:
    """The multipliers of least norm as laws call for them."""
    n = len(x)
    given = list(Graph().vector("y", n * n + n))
    law = compile_law(list(least_norm(given[: n * n], given[n * n :], float(rank))))
    found = np.zeros(n)
    evaluate(law, 0.0, np.concatenate([matrix.ravel(), x]), np.zeros(1), found)
    return found


def change_by_law(rank: int, *numbers: np.ndarray) -> np.ndarray:
    """How they change: of A, x, dA and dx."""
    n = len(numbers[1])
    half = n * n + n
    given = list(Graph().vector("y", 2 * half))
    now, change = [float(n), float(rank), *given[:half]], [0.0, 0.0, *given[half:]]
    law = compile_law(list(changes_of_least_norm(*now, *change)))
    found = np.zeros(n)
    evaluate(law, 0.0, np.concatenate([a.ravel() for a in numbers]), np.zeros(1), found)
    return found


@pytest.mark.parametrize("plain", [False, True])
@pytest.mark.parametrize(("n", "rank"), [(1, 1), (3, 1), (5, 3), (9, 9), (20, 17)])
def test_laws_call_for_the_same(n: int, rank: int, plain: bool) -> None:
    """Compiled and as Python: what numpy's pseudo-inverse leaves of x, and its change."""
    rng = np.random.default_rng(n)
    G, x, slope = rng.normal(size=(n, rank)), rng.normal(size=n), rng.normal(size=n)
    matrix, d_matrix = G @ G.T, rng.normal(size=(n, n))
    d_matrix = d_matrix + d_matrix.T
    expected = np.linalg.pinv(matrix, rcond=1e-9) @ matrix @ x
    own = interpreted(by_law, matrix, x, rank) if plain else by_law(matrix, x, rank)
    np.testing.assert_allclose(own, expected, atol=1e-11)
    given = rank, matrix, x, d_matrix, slope
    own = interpreted(change_by_law, *given) if plain else change_by_law(*given)
    found = changed(matrix, x, rank, d_matrix, slope)
    np.testing.assert_allclose(own, found, atol=1e-9 * (1.0 + np.abs(found).max()))


@pytest.mark.parametrize("plain", [False, True])
def test_what_is_not_finite_stays_so(plain: bool) -> None:
    """As Python; compiled it is no number either."""
    x = np.array([1.0, np.nan, 0.0])
    own = interpreted(by_law, np.eye(3), x, 2) if plain else by_law(np.eye(3), x, 2)
    assert np.isnan(own).any()
    given = 2, np.eye(3), x, np.eye(3), np.ones(3)
    own = interpreted(change_by_law, *given) if plain else change_by_law(*given)
    assert np.isnan(own).any()
