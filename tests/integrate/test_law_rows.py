# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The least number of a law at many instants."""

import numpy as np
import pytest

from rb_sim.checks.singular_configuration import LeastOf
from rb_sim.graph.machine import compile_law
from rb_sim.graph.symbols import Graph


def law():
    """(y0 - t, p0 / y1, y1, y0)."""
    graph = Graph()
    t, y, p = graph.input("t"), graph.vector("y", 2), graph.vector("p", 1)
    return compile_law([y[0] - t, p[0] / y[1], y[1], y[0]])


@pytest.mark.parametrize("told", [False, True])
def test_least_number_and_its_place(told):
    t = np.array([0.5, 0.0, 0.0, 0.0, 0.0])
    # the least is the first, the second, none below 1, one beside no numbers, none of both at all
    y = np.array([[0.7, 10.0], [9.0, 4.0], [9.0, 1.5], [0.25, 0.0], [3.0, np.nan]])
    least, which = LeastOf(law(), np.array([3.0]), 4, told)(t, y)
    if told:  # the last two numbers of the law
        np.testing.assert_array_equal(least, [10.0, 4.0, 1.5, 0.0, 1.0])
        np.testing.assert_array_equal(which[:4], [0, 9, 9, 0])
        return
    np.testing.assert_allclose(least, [0.2, 0.75, 1.0, 0.0, 1.0], rtol=1e-15)
    np.testing.assert_array_equal(which[[0, 1, 3]], [0, 1, 2])
