# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Problems between lines and laws do not depend on how lines are numbered, nor on their units."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.numerics.problems import Bounded, Normal, solved

MU = 0.4


def two_contacts(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """(A, b) of lines n, t1, t2 of two contacts of a body; one solution, as A is positive definite
    and friction is little."""
    rng = np.random.default_rng(seed)
    G = rng.normal(size=(6, 6)) + 2.0 * np.eye(6)
    return G @ np.diag(rng.uniform(0.5, 2.0, 6)) @ G.T, 3.0 * rng.normal(size=6)


def forces(A: np.ndarray, b: np.ndarray, at: np.ndarray) -> np.ndarray:
    """x of the lines n, t1, t2, n, t1, t2, which have the numbers `at`."""
    normals = [Normal(int(at[k]), least=0.1) for k in (0, 3)]
    bounded = [Bounded((int(at[k + 1]), int(at[k + 2])), int(at[k]), MU) for k in (0, 3)]
    wide, right = np.empty_like(A), np.empty_like(b)
    wide[np.ix_(at, at)], right[at] = A, b
    found = solved(wide, right, normals, bounded)
    assert found is not None
    return found.x[at]


@pytest.mark.parametrize("seed", range(6))
def test_lines_may_have_any_numbers(seed: int) -> None:
    """Also where the second line of a bound is number 0, or its push comes after it."""
    A, b = two_contacts(seed)
    expected = forces(A, b, np.arange(6))
    for at in ([1, 2, 0, 3, 4, 5], [2, 1, 0, 5, 4, 3], [5, 4, 3, 2, 1, 0], [3, 0, 4, 1, 5, 2]):
        assert_allclose(forces(A, b, np.array(at)), expected, atol=1e-9)


@pytest.mark.parametrize("unit", [1e-8, 1e-3, 3.0, 1e7])
@pytest.mark.parametrize("second", [False, True])
def test_units_of_a_contact_scale_its_forces(unit: float, second: bool) -> None:
    """Lines in other units: A by both, b by one; the least pushes with them."""
    A, b = two_contacts(11)
    scale = np.ones(6)
    scale[3 if second else 0 :] = unit
    x = forces_in(A, b, np.ones(6))
    assert_allclose(forces_in(A, b, scale) * scale, x, rtol=1e-7, atol=1e-9)


def forces_in(A: np.ndarray, b: np.ndarray, scale: np.ndarray) -> np.ndarray:
    normals = [Normal(k, least=0.1 / scale[k]) for k in (0, 3)]
    bounded = [Bounded((k + 1, k + 2), k, MU) for k in (0, 3)]
    found = solved(A * np.outer(scale, scale), b * scale, normals, bounded)
    assert found is not None
    return found.x
