# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Recurrences of the Taylor series against Cauchy's integrals of the same functions.

On a circle of radius r about the start, the mean of g(z) e^(-i k phi) is g_k r^k (Lyness & Moler
1967), to round-off of the largest value on the circle.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.compiler.graph import symbols as functions
from rb_sim.compiler.graph import taylor_code
from rb_sim.compiler.graph.machine import evaluate
from rb_sim.compiler.graph.symbols import (
    External,
    Graph,
    atan2,
    cos,
    rarely,
    sin,
    sqrt,
    stepwise,
    where,
)
from rb_sim.compiler.graph.taylor_code import SeriesLaws
from rb_sim.compiler.graph.taylor_series import NoSeriesError, Series

ORDER = 24
START = 0.7
PARAMETER = 1.3
RADIUS, POINTS = 0.35, 128
"""All functions are regular well beyond the circle."""


def unknown(x: float) -> tuple[float]:
    return (2.0 * x,)


CALLED = External("unknown_to_series", 1, unknown, lambda: 0)
JUMPS = CALLED._replace(slopes=stepwise)

FORMS: dict[str, tuple[Callable[[Any, Any], Any], Callable[[Any, Any], Any]]] = {
    "time": (lambda t, p: t, lambda t, p: t),
    "constant": (lambda t, p: p * 2.0, lambda t, p: 2 * p),
    "sum": (lambda t, p: (t + p) - (2.0 - t) * 3.0, lambda t, p: t + p - (2 - t) * 3),
    "negative": (lambda t, p: -(t * t), lambda t, p: -t * t),
    "square": (lambda t, p: (t - p) * (t - p), lambda t, p: (t - p) ** 2),
    "product": (lambda t, p: sin(t) * sqrt(t), lambda t, p: np.sin(t) * np.sqrt(t)),
    "power": (lambda t, p: (sin(t) + 2.0) ** 4, lambda t, p: (np.sin(t) + 2) ** 4),
    "scaled": (lambda t, p: p * sin(t), lambda t, p: p * np.sin(t)),
    "quotient": (lambda t, p: cos(t) / (2.0 + sin(t)), lambda t, p: np.cos(t) / (2 + np.sin(t))),
    "number over": (lambda t, p: 3.0 / (1.0 + t * t), lambda t, p: 3 / (1 + t * t)),
    "over a parameter": (lambda t, p: sin(t) / p, lambda t, p: np.sin(t) / p),
    "root": (lambda t, p: sqrt(1.0 + p * t * t), lambda t, p: np.sqrt(1 + p * t * t)),
    "sine": (lambda t, p: sin(p * t * t), lambda t, p: np.sin(p * t * t)),
    "cosine": (lambda t, p: cos(1.0 - p * t), lambda t, p: np.cos(1 - p * t)),
    "angle": (
        lambda t, p: atan2(sin(t), 2.0 + cos(p * t)),
        lambda t, p: np.arctan(np.sin(t) / (2 + np.cos(p * t))),
    ),
    "angle over a number": (lambda t, p: atan2(t * t, 2.0), lambda t, p: np.arctan(t * t / 2)),
    "angle of a number": (lambda t, p: atan2(-2.0, t), lambda t, p: np.arctan(t / 2) - np.pi / 2),
    "size": (lambda t, p: abs(t * t - p), lambda t, p: p - t * t),
    "selection": (lambda t, p: where(t * t < p, sin(t), cos(t)), lambda t, p: np.sin(t)),
    "other selection": (lambda t, p: where(t * t > p, sin(t), t), lambda t, p: t),
    "rare selection": (lambda t, p: rarely(t <= 0.0, 0.0, 1.0 / t), lambda t, p: 1 / t),
}  # fmt: skip
"""dy/dt on symbols and on complex numbers."""


@cache
def bell(n: int) -> int:
    """The number of partitions of a set of n."""
    return sum(math.comb(n - 1, k) * bell(k) for k in range(n)) if n else 1


def laws_of(outputs: list[Any], monkeypatch: pytest.MonkeyPatch, how: str) -> SeriesLaws:
    """whole: one function; few: with most orders in a loop; parts: by laws of their own; plain: in
    Python."""
    if how == "few":
        monkeypatch.setattr(taylor_code, "MOST", 5)
    if how == "parts":
        monkeypatch.setattr(taylor_code, "WHOLE", 0)
    if how == "plain":
        monkeypatch.setattr(taylor_code, "interpreted", lambda: True)
    return SeriesLaws(outputs)


def workspace_of(laws: SeriesLaws, order: int, t: float, y: list[float]) -> np.ndarray:
    """The series from (t, y) on, with its parameter."""
    workspace = np.zeros(laws.size(order))
    workspace[0] = order
    evaluate(laws.expand, t, np.array(y), np.array([PARAMETER]), workspace)
    return workspace


def rows(laws: SeriesLaws, workspace: np.ndarray, order: int) -> np.ndarray:
    """The coefficients of y, an order a row."""
    return workspace[laws.first : laws.first + order * laws.width].reshape(order, -1)[:, : laws.n]


@pytest.mark.parametrize("how", ["whole", "few", "parts", "plain"])
@pytest.mark.parametrize("name", FORMS)
def test_each_recurrence(name: str, how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    law, exact = FORMS[name]
    graph = Graph()
    outputs = [law(graph.input("t"), graph.input("p")), graph.input("y", 0)]
    laws = laws_of(outputs, monkeypatch, how)
    found = rows(laws, workspace_of(laws, ORDER, START, [0.25, -1.0]), ORDER)
    circle = np.exp(2j * np.pi * np.arange(POINTS) / POINTS)
    values = exact(START + RADIUS * circle, PARAMETER) + 0.0 * circle
    terms = (np.fft.fft(values) / POINTS).real
    powers, k = RADIUS ** np.arange(1, ORDER + 1), np.arange(1, ORDER + 1)
    first = RADIUS * terms[:ORDER] / k
    second = np.append(0.25 * RADIUS, RADIUS * first[:-1] / k[1:])
    size = 1e-15 * np.abs(values).max()
    assert_allclose(found[:, 0] * powers, first, rtol=0.0, atol=size)
    assert_allclose(found[:, 1] * powers, second, rtol=0.0, atol=size)


@pytest.mark.parametrize("how", ["whole", "few", "parts", "plain"])
@pytest.mark.parametrize("order", [2, 3, 4, 5, 6, 7, 40])
def test_every_order(order: int, how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """y' = y, x' = x y with y(0) = x(0) = 1: y = e^t, x = e^(e^t - 1), whose series has the Bell
    numbers; and the workspace may hold another series."""
    graph = Graph()
    y, x = graph.vector("y", 2)
    laws = laws_of([y, x * y], monkeypatch, how)
    workspace = np.full(laws.size(order), 0.0)
    workspace[0] = order
    for start in ([2.0, -3.0], [1.0, 1.0]):
        evaluate(laws.expand, 0.0, np.array(start), np.zeros(1), workspace)
    found = rows(laws, workspace, order)
    orders = range(1, order + 1)
    ones = [1 / math.factorial(k) for k in orders]
    bells = [bell(k) / math.factorial(k) for k in orders]
    assert_allclose(found[:, 0], ones, rtol=4e-15)
    assert_allclose(found[:, 1], bells, rtol=4e-15)


@pytest.mark.parametrize("how", ["whole", "plain"])
@pytest.mark.parametrize("n", [1, 3, 4, 7, 19])
def test_sum_of_series_and_slope(n: int, how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """y_i' = -i y_i: exponentials."""
    graph = Graph()
    outputs = [-float(i + 1) * y for i, y in enumerate(graph.vector("y", n))]
    laws = laws_of(outputs, monkeypatch, how)
    workspace = workspace_of(laws, 30, 0.0, [1.0] * n)
    out, h, rates = np.full(2 * n + 1, 7.0), 0.1, -np.arange(1.0, n + 1.0)
    evaluate(laws.add, h, workspace[laws.first :], workspace, out)
    assert_allclose(out[:n], np.expm1(rates * h), rtol=1e-14)
    assert_allclose(out[n : 2 * n], rates * np.exp(rates * h), rtol=1e-13)
    assert out[-1] == 7.0


def test_events_have_series_of_their_own() -> None:
    graph = Graph()
    t = graph.input("t")
    laws = SeriesLaws([where(t * t < 1.0, t, 1.0) + abs(t - 3.0)])
    workspace = workspace_of(laws, 4, START, [0.0])
    at, events = laws.events_at, sorted([START**2 - 1.0, START - 3.0])
    assert laws.events == 2
    assert_allclose(sorted(workspace[at : at + 2]), events)
    table = workspace[laws.first :].reshape(-1, laws.width)
    assert_allclose(sorted(table[0, 1:3]), [1.0, 2.0 * START])
    assert_allclose(sorted(table[1, 1:3]), [0.0, 1.0])


def test_what_only_jumps_is_constant(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the coefficients of a spline's piece are."""
    graph = Graph()
    t = graph.input("t")
    laws = laws_of([functions.call(JUMPS, t)[0] * t], monkeypatch, "plain")
    found = rows(laws, workspace_of(laws, 3, START, [0.0]), 3)
    assert_allclose(found[:, 0], [2.0 * START * START, START, 0.0], rtol=1e-15)


def test_what_has_no_series_is_named() -> None:
    graph = Graph()
    y = graph.input("y", 0)
    with pytest.raises(NoSeriesError, match="unknown_to_series has no Taylor series"):
        Series([functions.call(CALLED, y)[0]])
