# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The coefficients of DOP853 against scipy's copy and against the order conditions."""

import numpy as np
import pytest
from scipy.integrate._ivp import dop853_coefficients as reference

from rb_sim.integrate.methods import dopri853 as ours

STAGES = 12


def test_same_as_scipy():
    for i, row in enumerate(ours.PUBLISHED_A):
        np.testing.assert_array_equal(row, reference.A[i, :i])
    np.testing.assert_array_equal(ours.PUBLISHED_B, reference.B)
    np.testing.assert_array_equal(ours.PUBLISHED_C, reference.C[:STAGES])
    np.testing.assert_array_equal(ours.PUBLISHED_E5, reference.E5[:STAGES])
    np.testing.assert_array_equal(ours.PUBLISHED_E3, reference.E3[:STAGES])


@pytest.mark.parametrize("power", range(8))
def test_quadrature_conditions_up_to_order_8(power):
    """sum b_i c_i^(k-1) = 1/k."""
    assert np.dot(ours.PUBLISHED_B, np.array(ours.PUBLISHED_C) ** power) == pytest.approx(
        1 / (power + 1), abs=1e-15
    )


def test_stage_times_are_row_sums():
    for row, c in zip(ours.PUBLISHED_A, ours.PUBLISHED_C, strict=True):
        assert sum(row) == pytest.approx(c, abs=1e-14)
