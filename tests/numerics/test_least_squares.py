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

from rb_sim.numerics.linear_solves import least_squares


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
