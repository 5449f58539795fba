# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Where bodies on guides are, by hand, and the share of a step that the first of them may take."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from numpy.testing import assert_allclose

from rb_sim.catalogue.curves import SHARE, Pieces
from rb_sim.graph.machine import evaluate
from rb_sim.graph.symbols import call
from rb_sim.mechanics.systems.translation import share_law
from tests.mechanics.test_guides import LOOP, VALLEY, Straight, parabola, pieces
from tests.moving import difference

FIRST, SECOND = parabola(31), VALLEY


def share(curves: list[Any], steps: list[tuple[float, ...]], h: float, tolerance: float) -> float:
    """steps: of each curve s and its rate before, then after."""
    law = share_law(curves)
    assert law is not None
    before = [x for step in steps for x in step[:2]]
    after = [x for step in steps for x in step[2:]]
    found = np.zeros(1)
    evaluate(law, 0.0, np.array([h, tolerance, *before, *after]), np.zeros(1), found)
    return float(found[0])


def test_the_first_break_of_all_curves_ends_a_step() -> None:
    """Kinks at 1, 2 and 3 of one curve; of a closed one where it closes."""
    kinked, closed = Straight.pieces, pieces(LOOP, True)
    period = closed.period
    idle = (1.2, 0.0, 1.2, 0.0)
    ahead, later = (0.5, 1.0, 1.5, 1.0), (0.25, 1.0, 1.25, 1.0)
    assert share([kinked], [ahead], 1.0, 1e-9) == pytest.approx(0.5)
    assert share([kinked, kinked], [idle, ahead], 1.0, 1e-9) == pytest.approx(0.5)
    assert share([kinked, kinked], [ahead, later], 1.0, 1e-9) == pytest.approx(0.5)
    assert share([kinked, kinked], [later, ahead], 1.0, 1e-9) == pytest.approx(0.5)
    assert share([kinked], [idle], 1.0, 1e-9) == 1.0
    half = (0.5, 2.0, 1.5, 2.0)
    assert share([kinked], [half], 0.5, 1e-9) == pytest.approx(0.5)
    around = (period - 0.1, 0.3, period + 0.2, 0.3)
    assert share([kinked, closed], [idle, around], 1.0, 1e-9) == pytest.approx(1.0 / 3.0)
    assert share_law([]) is None


KINKS = (1.0, 3.0, 0.5)
"""Sizes of those at 1, 2 and 3."""


def kinked() -> Pieces:
    """Along the x axis, each piece of length 1, the second derivative with these kinks."""
    thirds = np.cumsum([0.0, *KINKS]) / 6.0
    straight = [[[third, 0.0, 1.0, 0.0], [0.0] * 4, [0.0] * 4] for third in thirds]
    return Pieces(np.arange(5.0), np.array(straight), 0.0)


@pytest.mark.parametrize("ahead", [1.0, -1.0])
@pytest.mark.parametrize(("at", "kink"), [(1.0, 1.0), (2.0, 3.0), (3.0, 0.5)])
def test_a_break_may_be_crossed_where_that_costs_less_than_its_share_of_the_tolerance(
    at: float, kink: float, ahead: float
) -> None:
    """A kink that is u away costs u times its size times h |s'| min(1, |s'|)."""
    for u, v, h in ((0.5, 1.0, 1.0), (0.25, 0.5, 1.0), (0.5, 2.0, 0.5)):
        step = (at - u * ahead, v * ahead, at + u * ahead, v * ahead)
        cost = u * kink * h * v * min(1.0, v) / SHARE
        assert share([kinked()], [step], h, 0.99 * cost) == pytest.approx(0.5)
        assert share([kinked()], [step], h, 1.01 * cost) == 1.0


def test_breaks_that_are_crossed_add_up() -> None:
    """Three pieces on, each kink counts by the way on its shorter side."""
    step, (first, second, _) = (0.25, 2.5, 2.75, 2.5), KINKS
    costs = 2.5 * np.array([0.75 * first, 0.75 * second]) / SHARE
    assert share([kinked()], [step], 1.0, 0.99 * costs[0]) == pytest.approx(0.75 / 2.5)
    assert share([kinked()], [step], 1.0, 1.01 * costs[0]) == pytest.approx(1.75 / 2.5)
    assert share([kinked()], [step], 1.0, 0.99 * costs.sum()) == pytest.approx(1.75 / 2.5)
    assert share([kinked()], [step], 1.0, 1.01 * costs.sum()) == 1.0


@pytest.mark.parametrize(
    ("start", "bow", "rise"),
    [(0.5, 12, 0), (0.5, -12, 0), (1.3, 8, 0), (0.7, -8, 0), (0.5, 6, 0.6), (1.5, -6, -0.6)],
)
def test_a_step_that_turns_twice_ends_where_it_first_meets_a_break(
    start: float, bow: float, rise: float
) -> None:
    """s = start + bow x (x - 1/2) (x - 1) + rise x meets 1 before, between and after its turns."""
    way = Polynomial([start]) + bow * Polynomial.fromroots([0.0, 0.5, 1.0])
    way = way + rise * Polynomial([0.0, 1.0])
    roots = (way - 1.0).roots()
    meets: list[Any] = [x.real for x in roots if abs(x.imag) < 1e-9 and 0.0 < x.real < 1.0]
    step = (way(0.0), way.deriv()(0.0), way(1.0), way.deriv()(1.0))
    assert share([Straight.pieces], [step], 1.0, 1e-12) == pytest.approx(min(meets), abs=1e-12)


@pytest.mark.parametrize("turns", [-2, 0, 1, 3])
def test_a_closed_curve_goes_on_and_on(turns: int) -> None:
    """In every turn it is where it was, with the same breaks; also a step of more than a turn."""
    closed = pieces(LOOP, True)
    period, first = closed.period, float(closed.breaks[1])
    for s in (0.3, 0.9 * period):
        assert_allclose(closed.point(s + turns * period), closed.point(s), atol=1e-12)
    s0 = turns * period + 0.4 * first
    for way in (first, 1.3 * period):
        step = (s0, way, s0 + way - math.floor((s0 + way) / period) * period, way)
        found = share([closed], [step], 1.0, 1e-12)
        assert found == pytest.approx(0.6 * first / way, abs=1e-10)
        back = (s0, -way, s0 - way - math.floor((s0 - way) / period) * period, -way)
        assert share([closed], [back], 1.0, 1e-12) == pytest.approx(0.4 * first / way, abs=1e-10)


def test_slope_and_bend_are_derivatives() -> None:
    for points, closed in ((LOOP, True), (FIRST, False)):
        curve = pieces(points, closed)
        for s in curve.breaks[:-1] + 0.37 * np.diff(curve.breaks):
            _, slope, bend = curve.point(float(s))
            for order, found in ((0, slope), (1, bend)):
                expected = difference(lambda t, k=order, s=s, c=curve: c.point(float(s) + t)[k])
                assert_allclose(found, expected, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("axes", [(0, 1, 2), (1, 2, 0), (2, 0, 1)])
def test_the_nearest_point_is_looked_for_in_all_directions(axes: tuple[int, ...]) -> None:
    """Of a coil, whose turns are close to each other, from a little beside it."""
    s = np.linspace(0.0, 20.0, 120)
    coil = np.stack([np.cos(s), np.sin(s), 0.1 * s], axis=-1)[:, axes]
    curve = pieces(coil.tolist())
    for at in np.linspace(0.3, float(curve.breaks[-1]) - 0.3, 9):
        c, slope, bend = (np.array(x) for x in curve.point(at))
        aside = np.cross(slope, bend) / np.linalg.norm(np.cross(slope, bend))
        assert call(curve.nearest, *(c + 0.02 * aside))[0] == pytest.approx(at, abs=1e-12)
