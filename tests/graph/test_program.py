# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Programs over tables: instances in turn, fields of every array, workspace that fits on the
stack."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim.graph.table_program import MOST_WORKSPACE, Field, PlainProgram, Program
from tests.graph.test_machine import run


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
