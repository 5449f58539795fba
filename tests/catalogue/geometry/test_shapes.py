# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The lowest point of a rim that lies flat, or nearly; of other surfaces: test_pairs."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.interpreted import interpreted

CENTRE = (0.02, -0.01, 0.03)
AXIS = (0.48, -0.6, 0.64)
GAMMA = (0.6, 0.48, 0.64)
GAMMA_DOT = tuple(np.cross(GAMMA, (0.7, -1.1, 0.4)).tolist())


def lying(gamma: tuple[float, ...]) -> tuple[np.ndarray, ...]:
    """Support and rate of a rim that may lie flat, then those of one that may not."""
    from rb_sim.catalogue.geometry import smooth_surfaces as c

    both = c.LyingRimSurface(CENTRE, 0.3, AXIS), c.RimSurface(CENTRE, 0.3, AXIS)
    of = [(c.support(rim, gamma), c.support_rate(rim, gamma, GAMMA_DOT)) for rim in both]
    return tuple(np.array(values) for pair in of for values in pair)


@pytest.mark.parametrize("lean", [1.0, 0.1, 1e-6, 1e-9])
def test_a_rim_that_may_lie_flat_is_a_rim_as_long_as_it_leans(lean: float) -> None:
    flat = np.array(AXIS) / np.linalg.norm(AXIS)
    gamma = flat + lean * (np.array(GAMMA) - flat)
    point, rate, expected, its_rate = interpreted(lying, tuple(gamma.tolist()))
    assert_allclose(point, expected, atol=1e-15)
    assert_allclose(rate, its_rate, rtol=1e-12)


def test_a_rim_that_lies_flat_touches_somewhere() -> None:
    """The rim has no lowest point then: one of its points, which stays."""
    from rb_sim.catalogue.geometry import smooth_surfaces as c

    axis = tuple((np.array(AXIS) / np.linalg.norm(AXIS)).tolist())
    rim = c.LyingRimSurface(CENTRE, 0.3, axis)
    point = np.array(interpreted(c.support, rim, axis)) - CENTRE
    assert_allclose([np.linalg.norm(point), point @ axis], [0.3, 0.0], atol=1e-15)
    assert interpreted(c.support_rate, rim, axis, GAMMA_DOT) == (0.0, 0.0, 0.0)
