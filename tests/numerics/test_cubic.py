# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The cubic through values and rates, against numpy's polynomials."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from numpy.testing import assert_allclose

from rb_sim.integrate.quadrature import cubic_at, cubic_minimum, cubic_range, tangents_meet

SEEDS = st.integers(0, 2**32 - 1)


def example(seed: int) -> tuple[Polynomial, tuple[float, float, float, float], float]:
    """A cubic p(s), its values and rates at the ends of a span, the span's width."""
    rng = np.random.default_rng(seed)
    p, width = Polynomial(rng.normal(size=4) * 10.0 ** rng.integers(-2, 3, 4)), rng.uniform(0.1, 9)
    rate = p.deriv()
    ends = float(p(0.0)), float(rate(0.0)) / width, float(p(1.0)), float(rate(1.0)) / width
    return p, ends, float(width)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(SEEDS)
def test_value_slope_bounds_and_minimum(seed: int) -> None:
    p, ends, width = example(seed)
    size = 1.0 + float(np.abs(p.coef).max())
    for s in (0.0, 0.31, 1.0):
        value, slope = cubic_at(*ends, width, s)
        assert_allclose([value, slope], [p(s), p.deriv()(s)], atol=1e-12 * size)
    lowest, highest = cubic_range(*ends, width)
    inside = p(np.linspace(0.0, 1.0, 101))
    assert lowest - 1e-12 * size <= inside.min() and inside.max() <= highest + 1e-12 * size
    roots = p.deriv().roots()
    real = roots[np.isreal(roots)].real
    minima = [r for r in real if 1e-9 < r < 1.0 - 1e-9 and p.deriv(2)(r) > 0.0]
    found = cubic_minimum(*ends, width)
    if minima:
        assert_allclose(found, minima[0], atol=1e-6)
    elif found > 0.0:  # at an end, but for rounding
        assert min(found, 1.0 - found) < 1e-6


def test_tangents_meet_below_what_is_convex() -> None:
    place, value = tangents_meet(1.0, -2.0, 1.0, 2.0, 2.0)  # of (t - 1)^2 on 0..2: t = 1
    assert_allclose([place, value], [0.5, -1.0])
    place, value = tangents_meet(0.3, -1.0, 1.4, 2.0, 1.0)  # of a kink, the function itself
    assert_allclose([place, value], [0.3, 0.0], atol=1e-15)
    place, value = tangents_meet(1.0, -1.0, 9.0, 1.0, 1.0)  # not convex: an end of the span
    assert_allclose([place, value], [0.0, 8.0])
