# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Code of laws: over tables, in lanes, and in C."""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rb_sim import RbSimError, load_scene
from rb_sim.compiler.graph.symbols import (
    External,
    Graph,
    atan2,
    cos,
    divide,
    floor,
    rarely,
    sin,
    sqrt,
    where,
)
from rb_sim.compiler.graph.table_program import MOST_WORKSPACE, Field, PlainProgram, Program
from rb_sim.compiler.graph.vector_code import LANES, NEAR, compile_lanes, sine_and_cosine
from rb_sim.mechanics.systems.one_body import rate
from rb_sim.scene.compile import compile_scene
from tests.compiler.graph.test_machine import run
from tools.c_law import c_law


def summing() -> Program:
    """out[i] = t y[2 i] + p[0], and the sum so far of the products y[2 i] y[2 i + 1] c_i."""
    program = Program()
    total, constants = program.workspace(1), program.keep([2.0, 3.0, 5.0])
    program.run("zero", lambda t: [[0.0]], [], [("frame", [total])])

    def kernel(t, pair, c, p, so_far):
        moved = so_far[0] + pair[0] * pair[1] * c[0]
        return [[t * pair[0] + p[0]], [moved], [moved]]

    fields = [
        Field("y", 2, [0, 2, 4]),
        Field("const", 1, [constants + i for i in range(3)]),
        Field("p", 1, [0, 0, 0]),
        Field("frame", 1, [total] * 3),
    ]
    outputs = [("out", [0, 1, 2]), ("frame", [total] * 3), ("out", [3, 4, 5])]
    program.run("summing", kernel, fields, outputs)
    return program


def test_instances_go_in_turn_and_see_what_those_before_wrote():
    y, t, p = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0), 0.5, (7.0,)
    sums = np.cumsum([1.0 * 2.0 * 2.0, 3.0 * 4.0 * 3.0, 5.0 * 6.0 * 5.0])
    expected = [7.5, 8.5, 9.5, *sums]
    assert run(summing().compiled(), 6, t, y, p).tolist() == expected
    out = np.zeros(6)
    PlainProgram(summing())(t, y, p, out)
    assert out.tolist() == expected


def test_a_frame_that_would_not_fit_on_the_stack_is_refused():
    program = summing()
    program.workspace(MOST_WORKSPACE)
    with pytest.raises(ValueError, match="must be at most"):
        program.compiled()


# Laws in lanes give in every lane the bits of the law alone; sines are those of the C library.


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


# Laws printed in C and compiled by the machine's C compiler give the numbers of the traced law.


FLAGS = ("-std=c99", "-O2", "-shared", "-fPIC", "-ffp-contract=off", "-Wall", "-Werror")
DOUBLES = ctypes.POINTER(ctypes.c_double)


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.parametrize(
    "scene", ["heavy_top", "pendulum", "free_tumble", "rolling_disk", "rolling_sphere"]
)
def test_c_gives_the_numbers_of_the_law(scene: str, tmp_path: Path) -> None:
    source, library = tmp_path / "law.c", tmp_path / "law.so"
    source.write_text(c_law(scene))
    subprocess.run(["cc", *FLAGS, str(source), "-o", str(library), "-lm"], check=True)
    printed = ctypes.CDLL(str(library)).rate
    compiled = compile_scene(load_scene(scene))
    y = np.array(compiled.y) + 0.01 * np.random.default_rng(1).normal(size=len(compiled.y))
    p, out = np.zeros(1), np.zeros(len(y))
    printed(ctypes.c_double(0.3), *(x.ctypes.data_as(DOUBLES) for x in (y, p, out)))
    expected = np.array(rate(compiled.system, 0.3, tuple(y.tolist())), float)
    np.testing.assert_allclose(out, expected, rtol=1e-14, atol=1e-14 * np.abs(expected).max())


def test_a_scene_that_is_no_single_law_is_refused() -> None:
    with pytest.raises(RbSimError, match="^bouncing_ball: must be of one body"):
        c_law("bouncing_ball")
