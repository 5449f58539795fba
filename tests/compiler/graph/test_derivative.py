# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Jacobians of graphs against derivatives by hand and against differences."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rb_sim.compiler.graph import derivative as jacobian_columns
from rb_sim.compiler.graph.derivative import Tangents, compile_columns, jacobian
from rb_sim.compiler.graph.machine import PlainLaw, evaluate
from rb_sim.compiler.graph.symbols import (
    External,
    Graph,
    atan2,
    call,
    cos,
    floor,
    rarely,
    sin,
    sqrt,
    where,
)


def dense(law, y, p=()):
    """The Jacobian of law(y, p) by y, as numbers."""
    graph = Graph()
    inputs = graph.vector("y", len(y))
    sparse = jacobian(law(inputs, graph.vector("p", len(p))), inputs)
    values = np.zeros(len(sparse.values))
    PlainLaw(sparse.values)(0.0, np.array(y, float), np.array([*p, 0.0]), values)
    matrix = np.zeros(sparse.shape)
    matrix[sparse.rows, sparse.columns] = values
    return matrix, sparse


BY_HAND = {
    "sum": (lambda y, p: y[0] + 3.0 * y[1] - p[0], lambda a, b: (1.0, 3.0)),
    "product": (lambda y, p: y[0] * y[1] * p[0], lambda a, b: (b * 0.7, a * 0.7)),
    "quotient": (lambda y, p: y[0] / y[1], lambda a, b: (1 / b, -a / b**2)),
    "root": (
        lambda y, p: sqrt(y[0] * y[1]),
        lambda a, b: (0.5 * (b / a) ** 0.5, 0.5 * (a / b) ** 0.5),
    ),
    "sine": (
        lambda y, p: sin(y[0] * y[1]),
        lambda a, b: (b * math.cos(a * b), a * math.cos(a * b)),
    ),
    "cosine": (lambda y, p: cos(y[0]) * y[1], lambda a, b: (-math.sin(a) * b, math.cos(a))),
    "angle": (
        lambda y, p: atan2(y[0], y[1]),
        lambda a, b: (b / math.hypot(a, b) ** 2, -a / math.hypot(a, b) ** 2),
    ),
    "size": (lambda y, p: abs(-y[0]) - abs(y[1]), lambda a, b: (1.0, -1.0)),
    "select": (lambda y, p: where(y[0] < y[1], y[0] ** 2, y[1] ** 3), lambda a, b: (2 * a, 0.0)),
    "floor": (lambda y, p: floor(y[0]) * y[1], lambda a, b: (0.0, math.floor(a))),
}


@pytest.mark.parametrize("name", BY_HAND)
def test_each_operation_has_its_derivative(name: str) -> None:
    law, expected = BY_HAND[name]
    a, b = 1.3, 2.1
    found, _ = dense(lambda y, p: (law(y, p),), (a, b), (0.7,))
    np.testing.assert_allclose(found, [expected(a, b)], rtol=4e-15)


def test_a_law_of_many_operations_agrees_with_differences() -> None:
    """Fourth-order differences of a law in which everything depends on everything."""

    def law(y, p):
        a, b, c = y
        r = sqrt(a * a + b * b + c * c + 1.0)
        s = sin(a * b) / (2.0 + cos(c) * r)
        return s, where(s < r, atan2(s, r) * c, 0.0), a / r - b * s * abs(c)

    y = np.array([0.4, -0.9, 1.7])
    exact, _ = dense(law, y)
    h = 1e-3
    for j, e in enumerate(np.eye(3)):
        f = [np.array(law(tuple(y + k * h * e), ())) for k in (-2, -1, 1, 2)]
        measured = (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * h)
        np.testing.assert_allclose(exact[:, j], measured, atol=1e-11)


def test_what_cannot_differ_from_zero_is_not_there() -> None:
    """A chain: each output knows its neighbours only."""
    n = 12

    def law(y, p):
        return [y[i] * y[i] - (y[i - 1] if i else 0.0) for i in range(n)]

    _, sparse = dense(law, np.arange(1.0, n + 1.0))
    assert sorted(zip(sparse.rows, sparse.columns, strict=True)) == sorted(
        [(i, i) for i in range(n)] + [(i, i - 1) for i in range(1, n)]
    )


def test_a_function_called_by_address_has_no_derivative() -> None:
    known = External("f", 1, lambda x: (x,), lambda: 0)
    graph = Graph()
    y = graph.vector("y", 1)
    with pytest.raises(TypeError, match="no derivative"):
        jacobian(call(known, y[0]), y)


def test_a_length_times_its_vector_has_a_slope_where_it_vanishes() -> None:
    """d(|v| v)/dv = |v| 1 + v v^T / |v|, which goes to 0 with v; of |v| alone 0 stands for any of
    its slopes, and a root of what passes through 0 has an infinite one."""

    def law(y, p):
        size = sqrt(y[0] * y[0] + y[1] * y[1])
        return [size * y[0], size * y[1], size]

    matrix, _ = dense(law, [0.0, 0.0])
    np.testing.assert_array_equal(matrix, np.zeros((3, 2)))
    matrix, _ = dense(law, [3.0, 4.0])
    np.testing.assert_allclose(matrix, [[6.8, 2.4], [2.4, 8.2], [0.6, 0.8]], rtol=1e-15)
    matrix, _ = dense(lambda y, p: [sqrt(y[0])], [0.0])
    assert matrix[0, 0] > 1e299


# Jacobians by columns are those of the derivatives entry by entry, to the last bit.


def everything(t, y, p):
    """Outputs that use every operation, one that is a coordinate and one that is a number; each
    coordinate is turned by its neighbours, so that more than a vector of columns has entries."""
    n, out = len(y), []
    for i, x in enumerate(y):
        a, b = y[(i + 1) % n], y[(i + 5) % n]
        r = sqrt(x * x + a * a + 1.0)
        turned = sin(a * b) / (2.0 + cos(x) * r) - floor(3.0 * x)
        chosen = where((x < a) & ~(b <= 0.0), atan2(x, r) * t, -abs(b))
        out.append(turned * chosen + rarely(r < p[0], x * b, a) - turned / r)
    return [*out, y[2], 7.5]


def by_entries(count, t, y, p):
    """The matrix from one graph for each entry."""
    graph = Graph()
    inputs = graph.vector("y", len(y))
    sparse = jacobian(everything(graph.input("t"), inputs, graph.vector("p", len(p))), inputs)
    values, matrix = np.zeros(len(sparse.values)), np.zeros((count, len(y)))
    PlainLaw(sparse.values)(t, y, p, values)
    matrix[sparse.rows, sparse.columns] = values
    return matrix


def by_columns(count, t, y, p):
    graph = Graph()
    inputs = graph.vector("y", len(y))
    law = compile_columns(everything(graph.input("t"), inputs, graph.vector("p", len(p))), len(y))
    beyond = np.full(count * len(y) + 9, 4.25)
    evaluate(law, t, y, p, beyond[: count * len(y)])
    assert np.all(beyond[count * len(y) :] == 4.25)  # nothing is written behind the matrix
    return beyond[: count * len(y)].reshape(count, len(y))


@pytest.mark.parametrize("plain", [False, True])
@pytest.mark.parametrize("piece", [500, 7])
@pytest.mark.parametrize("n", [6, 8, 19])
def test_columns_are_the_derivatives_of_each_entry(
    n: int, piece: int, plain: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jacobian_columns, "PIECE", piece)
    monkeypatch.setenv("RB_SIM_INTERPRETED", "1" if plain else "0")
    y, p = np.random.default_rng(n).normal(size=n), np.array([1.5])
    found = by_columns(n + 2, 0.3, y, p)
    expected = by_entries(n + 2, 0.3, y, p)
    assert np.count_nonzero(expected) > 2 * n
    np.testing.assert_array_equal(found, expected)


def test_the_tangents_grow_as_the_graph() -> None:
    """Where each output depends on all before it, entries are as many as the square."""

    def tangents(n: int) -> tuple[int, int]:
        graph = Graph()
        y = graph.vector("y", n)
        x, outputs = 1.0, []
        for a in y:
            x = sin(x) * a + math.pi
            outputs.append(x)
        return sum(map(len, Tangents(outputs, n).pieces.parts)), len(jacobian(outputs, y).values)

    (few, few_entries), (many, many_entries) = tangents(10), tangents(40)
    assert many < 5 * few
    assert many_entries > 12 * few_entries
