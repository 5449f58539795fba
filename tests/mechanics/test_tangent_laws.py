# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Laws with their derivatives along directions: of numbers by hand, and of a body in flight."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.graph.machine import compile_law, evaluate
from rb_sim.graph.symbols import Graph
from rb_sim.numerics.vectors import sin
from rb_sim.simulation.sensitivity import TangentInputs, TangentLaws, with_tangents
from tests.mechanics.test_reduced_laws import laws_of, rate, value


def test_derivatives_of_a_law_along_two_directions() -> None:
    """f = (y0 p1, sin y1): df = (dy0 p1 + y0 dp1, cos y1 dy1); y and p of each lie in turn."""
    graph = Graph()
    y, p = graph.vector("y", 2), graph.vector("p", 2)
    law = compile_law(with_tangents([y[0] * p[1], sin(y[1])], 2, 2, 2))
    at, inputs = np.array([0.3, 0.7, 1.0, 2.0, -1.0, 4.0]), np.array([9, 5.0, 8, 0.5, 7, 0.2])
    out = np.zeros(6)
    evaluate(law, 0.0, at, inputs, out)
    first = [1.0 * 5.0 + 0.3 * 0.5, np.cos(0.7) * 2.0]
    second = [-1.0 * 5.0 + 0.3 * 0.2, np.cos(0.7) * 4.0]
    assert_allclose(out, [1.5, np.sin(0.7), *first, *second])


def test_a_single_number_and_constants_stay_as_they_are() -> None:
    (y,) = Graph().vector("y", 1)
    single = [y * y]
    assert with_tangents(single, 1, 0, 2) is single
    constant = [1.0, 2.0]
    assert with_tangents(constant, 1, 0, 2) is constant


def test_inputs_have_derivatives_by_weighted_systems() -> None:
    """(f(b) - f(a)) / 2 and 3 f(b), of what the inputs of those are at the same instant."""
    asked: list[Any] = []

    def values(system: float, t: float, onwards: bool) -> list[float]:
        asked.append((t, onwards))
        return [system, system**2]

    inputs: Any = SimpleNamespace(values=values)
    tangent = TangentInputs(inputs, [[(-0.5, 2.0), (0.5, 4.0)], [(3.0, 4.0)]])
    assert tangent.values(7.0, 1.5, False) == [7.0, 49.0, 1.0, 6.0, 12.0, 48.0]
    assert asked == [(1.5, False)] * 4
    asked.clear()
    tangent.values(7.0, 1.5)
    assert asked == [(1.5, True)] * 4


@pytest.mark.parametrize("count", [1, 2])
def test_the_rate_of_a_body_in_flight_with_its_derivatives(count: int) -> None:
    """ds/dt = (df/dy) s, beside differences of Euler's equations; samples lie beside theirs."""
    laws, y, _ = laws_of()
    tangent = TangentLaws(laws, (), [[] for _ in range(count)])
    assert (tangent.n, tangent.width) == ((1 + count) * 13, (1 + count) * laws.width)
    assert tangent.velocities == (1 + count) * ([0.0] * 7 + [1.0] * 6)
    assert tangent.whole(None) is None  # type: ignore[arg-type]
    along = np.random.default_rng(4).normal(size=(count, 13))
    out = value(tangent.rate, [*y, *along.ravel()], tangent.n).reshape(1 + count, 13)
    assert_allclose(out[0], rate(y), atol=1e-14)
    for found, s in zip(out[1:], along, strict=True):
        assert_allclose(found, (rate(y + 1e-6 * s) - rate(y - 1e-6 * s)) / 2e-6, atol=1e-8)
