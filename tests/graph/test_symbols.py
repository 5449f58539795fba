# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What a trace records, folds and refuses."""

from __future__ import annotations

import math

import pytest

from rb_sim.graph.functions import maximum, minimum, sqrt, where
from rb_sim.graph.symbols import Graph, Symbol, in_order, operations


def test_equal_parts_are_one_node():
    x, y = Graph().vector("y", 2)
    assert x * y is y * x
    assert x + 2.0 is 2.0 + x
    assert sqrt(x - y) is sqrt(x - y)
    assert x - y is not y - x


def test_constants_and_exact_zeros_vanish():
    x = Graph().input("y")
    assert 0.0 * x == 0.0 and x * 1.0 is x and x + 0.0 is x and 0.0 / x == 0.0 and x / 1.0 is x
    assert x - x == 0.0
    negative = -x
    assert -negative is x
    assert operations([x + (-x * -1.0)]) == 1


def test_zero_and_minus_zero_are_two_numbers():
    x = Graph().input("y")
    assert (0.0 / (x + 1.0)) == 0.0
    graph = x.graph
    assert graph.node("atan2", x, 0.0) is not graph.node("atan2", x, -0.0)


def test_a_law_cannot_branch_on_a_symbol():
    x = Graph().input("y")
    with pytest.raises(TypeError, match="where"):
        if x < 1.0:
            pass
    with pytest.raises(TypeError, match="functions"):
        math.sqrt(x)


def test_two_graphs_do_not_mix():
    with pytest.raises(ValueError, match="two graphs"):
        Graph().input("y") + Graph().input("y")


def test_operands_come_before_their_users():
    x, y = Graph().vector("y", 2)
    order = in_order([(x + y) * (x - y), sqrt(x + y)])
    place = {node.number: i for i, node in enumerate(order)}
    for node in order:
        for o in node.operands:
            if isinstance(o, Symbol):
                assert place[o.number] < place[node.number]


@pytest.mark.parametrize(("a", "b"), [(1.0, 2.0), (2.0, 1.0), (math.nan, 1.0), (1.0, math.nan)])
def test_extremes_are_those_of_python(a, b):
    assert repr(maximum(a, b)) == repr(max(a, b))
    assert repr(minimum(a, b)) == repr(min(a, b))


def test_selection_of_equal_numbers_is_no_operation():
    x = Graph().input("y")
    assert where(x < 0.0, (1.0, x), (1.0, x)) == (1.0, x)
