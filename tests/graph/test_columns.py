# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Jacobians by columns are those of the derivatives entry by entry, to the last bit."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rb_sim.graph import derivative as jacobian_columns
from rb_sim.graph.derivative import Tangents, compile_columns, jacobian
from rb_sim.graph.functions import atan2, cos, floor, rarely, sin, sqrt, where
from rb_sim.graph.machine import PlainLaw, evaluate
from rb_sim.graph.symbols import Graph


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
