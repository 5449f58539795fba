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
from typing import Any

import numpy as np
import pytest

from rb_sim.compiler.graph.machine import Law, compile_law
from rb_sim.compiler.graph.symbols import (
    Graph,
    Symbol,
    explored,
    in_order,
    maximum,
    minimum,
    operations,
    sqrt,
    where,
)
from rb_sim.numerics.kernels import branching


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
    with pytest.raises(TypeError, match="use rb_sim.compiler.graph.symbols"):
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


# Functions that branch on symbols: every way is traced, and selected by its conditions.


def sorted_three(a: Any, b: Any, c: Any) -> tuple[Any, Any, Any]:
    """The three in order: up to six ways."""
    if b < a:
        a, b = b, a
    if c < b:
        b, c = c, b
        if b < a:
            a, b = b, a
    return a, b, c


@branching
def clipped(x: Any) -> Any:
    if x > 1.0:
        return 1.0
    return -1.0 if x < -1.0 else x


def value_of(outputs: list[Any], y: list[float]) -> list[float]:
    import ctypes

    law, out, given = compile_law(outputs), np.zeros(len(outputs)), np.array(y)
    if isinstance(law, Law):
        address, real = ctypes.c_void_p, ctypes.c_double
        call = ctypes.CFUNCTYPE(None, real, address, address, address)(law.address)
        call(0.0, given.ctypes.data, given.ctypes.data, out.ctypes.data)
    else:
        law(0.0, given, given, out)
    return out.tolist()


def test_every_way_is_taken() -> None:
    y = Graph().vector("y", 3)
    outputs = list(explored(sorted_three, *y))
    rng = np.random.default_rng(5)
    for _ in range(20):
        given = rng.normal(size=3).tolist()
        assert value_of(outputs, given) == sorted(given)


@pytest.mark.parametrize(("x", "wanted"), [(0.3, 0.3), (4.0, 1.0), (-7.0, -1.0)])
def test_function_within_a_function(x: float, wanted: float) -> None:
    (y,) = Graph().vector("y", 1)

    def both(x: Any) -> Any:
        return clipped(x) if x > 0.0 else -clipped(-x)

    assert value_of([explored(both, y)], [x]) == [wanted]
    assert clipped(x) == wanted


def test_equality_of_a_symbol_is_a_condition() -> None:
    (y,) = Graph().vector("y", 1)
    outputs = [explored(lambda x: 5.0 if x == 2.0 else 6.0, y)]
    assert value_of(outputs, [2.0]) == [5.0]
    assert value_of(outputs, [2.5]) == [6.0]


def test_a_law_may_not_branch_outside() -> None:
    (y,) = Graph().vector("y", 1)
    with pytest.raises(TypeError, match="branch"):
        _ = 1.0 if y > 0.0 else 2.0
    explored(clipped, y)
    with pytest.raises(TypeError, match="branch"):
        bool(y > 0.0)
