# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Degrees of polynomials in time against the derivatives of the motions themselves."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from rb_sim.graph.functions import atan2, cos, sin, sqrt, where
from rb_sim.graph.symbols import Graph, in_order
from rb_sim.graph.taylor import Series, degrees

FORMS: dict[str, tuple[Callable[..., Any], float]] = {
    "time": (lambda t, p, v, x, q: t, 1),
    "parameter": (lambda t, p, v, x, q: p, 0),
    "constant rate": (lambda t, p, v, x, q: v, 1),
    "fall": (lambda t, p, v, x, q: x, 2),
    "what follows nothing": (lambda t, p, v, x, q: q, math.inf),
    "sum": (lambda t, p, v, x, q: -(x - v) + p, 2),
    "size": (lambda t, p, v, x, q: abs(x), 2),
    "product": (lambda t, p, v, x, q: x * (p * v), 3),
    "product with all else": (lambda t, p, v, x, q: v * q, math.inf),
    "over a parameter": (lambda t, p, v, x, q: x / p, 2),
    "over time": (lambda t, p, v, x, q: p / t, math.inf),
    "root": (lambda t, p, v, x, q: sqrt(t), math.inf),
    "sine": (lambda t, p, v, x, q: sin(v), math.inf),
    "cosine": (lambda t, p, v, x, q: cos(v), math.inf),
    "angle": (lambda t, p, v, x, q: atan2(v, p), math.inf),
    "selection": (lambda t, p, v, x, q: where(t < p, v, x), 2),
}


@pytest.mark.parametrize("name", FORMS)
def test_degree(name: str) -> None:
    """v' = p, x' = v, and q' = q t, whose solution is no polynomial."""
    law, expected = FORMS[name]
    graph = Graph()
    t, p, (v, x, q) = graph.input("t"), graph.input("p"), graph.vector("y", 3)
    outputs = [p, v, q * t]
    form = law(t, p, v, x, q)
    nodes = in_order([*outputs, form])
    moving = {one.number for one in nodes if one is not p}
    assert degrees(outputs, nodes, moving)(form) == expected


def test_a_turn_at_a_steady_rate_has_sums_of_one_term() -> None:
    """w' = p and q' = w q / 2: order k of w q has w_1 q_(k-1) alone between its ends."""
    graph = Graph()
    p, y = graph.input("p"), graph.vector("y", 4)
    steady = Series([p, y[0] * y[1], y[2] * y[0], y[3] * y[0]])
    assert steady.terms == [1]
    driven = Series([y[1], y[0] * y[1], y[2] * y[0], y[3] * y[0]])
    assert driven.terms == [math.inf]
