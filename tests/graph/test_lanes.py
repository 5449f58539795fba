# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Laws in lanes give in every lane the bits of the law alone; sines are those of the C library."""

from __future__ import annotations

import ctypes
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rb_sim.graph.functions import atan2, cos, divide, floor, rarely, sin, sqrt, where
from rb_sim.graph.symbols import External, Graph
from rb_sim.graph.vector_code import LANES, NEAR, compile_lanes, sine_and_cosine

POINTER = ctypes.POINTER(ctypes.c_double)
LAW = ctypes.CFUNCTYPE(None, ctypes.c_double, POINTER, POINTER, POINTER)


def everything(t, y, p):
    """A law with every operation but sine and cosine."""
    a, b, c = y
    return (
        sqrt(a * a + b * b) / (1.0 + c * c) + t,
        where((a < b) & ~(c <= 0.0), a - 2.0, b * t),
        where((a >= b) | (c > 1.0), atan2(a, b), floor(10.0 * c)),
        abs(a - b) + p[0],
        -(a + b) * (a - b) ** 2,
        divide(a, b),
        rarely(a < b, c, a * 2.0),
        7.5,
        c,
    )


def in_lanes(function, y, p, count):
    """What the law gives for y and p of shape (numbers, LANES); the last row of p is the time."""
    graph = Graph()
    symbols = graph.vector("y", len(y)), graph.vector("p", len(p) - 1)
    law = compile_lanes(function(graph.input("t"), *symbols), len(p) - 1)
    assert law is not None
    out = np.zeros((count, LANES))
    LAW(law.address)(0.0, *(x.ctypes.data_as(POINTER) for x in (y, p, out)))
    return out


def test_every_lane_has_the_bits_of_plain_python() -> None:
    random = np.random.default_rng(3)
    y, p = random.normal(size=(3, LANES)), random.normal(size=(2, LANES))
    y[:, 2] = y[0, 2]  # a comparison of equals
    y[1, 5] = 0.0  # a division by zero
    out = in_lanes(everything, y, p, 9)
    for lane in range(LANES):
        expected = everything(float(p[1, lane]), tuple(y[:, lane].tolist()), p[:, lane].tolist())
        np.testing.assert_array_equal(out[:, lane], expected)


@given(st.floats(-NEAR, NEAR) | st.floats(-10.0, 10.0))
def test_sine_and_cosine_of_arithmetic(x: float) -> None:
    sine, cosine = sine_and_cosine(x)
    assert sine == pytest.approx(math.sin(x), rel=1e-12, abs=2.5e-16)
    assert cosine == pytest.approx(math.cos(x), rel=1e-12, abs=2.5e-16)
    assert sine == pytest.approx(math.sin(x), abs=2.5e-16)
    assert cosine == pytest.approx(math.cos(x), abs=2.5e-16)


def test_a_lane_far_out_changes_nothing_in_the_others() -> None:
    def turns(t, y, p):
        return sin(y[0]), cos(y[0]), cos(y[0] + t)

    angles = np.linspace(-7.0, 9.0, LANES)[None].copy()
    zero = np.zeros((1, LANES))
    near = in_lanes(turns, angles, zero, 3)
    np.testing.assert_allclose(near[0], np.sin(angles[0]), rtol=0.0, atol=2.5e-16)
    np.testing.assert_allclose(near[1], np.cos(angles[0]), rtol=0.0, atol=2.5e-16)
    angles[0, 1:4] = 1e9, math.inf, math.nan
    far = in_lanes(turns, angles, zero, 3)
    others = [0, *range(4, LANES)]
    np.testing.assert_array_equal(far[:, others], near[:, others])
    assert far[0, 1] == math.sin(1e9) and far[1, 1] == math.cos(1e9)
    assert np.isnan(far[:, 2:4]).all()


def test_a_law_that_calls_by_address_has_no_lanes() -> None:
    graph = Graph()
    outer = External("outer", 1, lambda x: (x,), lambda: 0)
    assert compile_lanes(graph.call(outer, graph.vector("y", 1)), 0) is None
