"""Where bodies on guides are, by hand, and the share of a step that the first of them may take."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from numpy.testing import assert_allclose

from rb_sim import load_scene
from rb_sim.catalogue.curves import HEAD, LEAST_POINTS, SHARE, Pieces
from rb_sim.graph.functions import call
from rb_sim.graph.machine import evaluate
from rb_sim.mechanics.systems.translation import on_guides, share_law, splines_of, ways
from rb_sim.scene.compile import compile_scene
from tests.interpreted import interpreted
from tests.mechanics.test_guides import LOOP, VALLEY, Straight, parabola, pieces, sliding
from tests.moving import difference

Mapping = dict[str, Any]
FIRST, SECOND = parabola(31), VALLEY


def two_on_guides(s: float, other: float) -> Mapping:
    """A body at s on one curve, a body at `other` on the next, one on a line and one that is free,
    each with an origin beside its centre of mass and its guided point."""
    whole = sliding(FIRST, s, 2.0)
    one = whole["bodies"]["b"] | {"center_of_mass": [0.1, -0.2, 0.3]}
    second = sliding(SECOND, other, -1.5)
    two = second["bodies"]["b"] | {"center_of_mass": [-0.3, 0.1, 0.2]}
    free = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "linear_velocity": [1.0, 0.0, 0.0]}
    line = {"type": "line", "direction": [1.0, 0.0, 0.0]}
    return whole | {
        "bodies": {"free": free, "one": one, "sled": free, "two": two},
        "constraints": {
            "first": whole["constraints"]["guide"] | {"body": "one"},
            "rail": {"type": "translation", "body": "sled", "guide": line},
            "second": second["constraints"]["guide"] | {"body": "two"},
        },
    }


def told(mapping: Mapping) -> tuple[list[float], bool, int]:
    compiled = compile_scene(load_scene(mapping))
    found = [float(x) for x in ways(compiled.system, compiled.y)]
    within = on_guides(compiled.system, compiled.y) if not compiled.reduced else True
    return found, bool(within), len(splines_of(compiled.system))


def test_parameters_and_rates_of_bodies_on_curves() -> None:
    found, within, count = interpreted(told, two_on_guides(0.7, 2.5))
    assert_allclose(found, [0.7, 2.0, 2.5, -1.5], atol=1e-12)
    assert within and count == 2


ENDS = [float(pieces(points).breaks[-1]) for points in (FIRST, SECOND)]


@pytest.mark.parametrize(
    ("s", "other"), [(0.7, ENDS[1] + 0.1), (0.7, -0.1), (ENDS[0] + 0.1, 2.5), (-0.1, 2.5)]
)
def test_one_that_has_left_its_curve_is_enough(s: float, other: float) -> None:
    found, within, _ = interpreted(told, two_on_guides(s, other))
    assert_allclose(found[::2], [s, other], atol=1e-9)
    assert not within


def test_reduced_coordinates_are_parameter_and_rate() -> None:
    found, _, count = interpreted(told, sliding(FIRST, 0.7, 2.0))
    assert_allclose(found, [0.7, 2.0], atol=1e-12)
    assert count == 1
    straight = sliding(FIRST, 0.7, 2.0)
    straight["constraints"]["guide"]["guide"] = {"type": "line", "direction": [1.0, 0.0, 0.0]}
    assert interpreted(told, straight)[2] == 0


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
    meets = [x.real for x in roots if abs(x.imag) < 1e-9 and 0.0 < x.real < 1.0]
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


def test_the_table_of_a_spline() -> None:
    """Its breaks, how far the highest derivative jumps at each, and points along it."""
    for curve, closed in ((Straight.pieces, False), (pieces(LOOP, True), True)):
        table, m = curve.table, len(curve.breaks) - 1
        k = curve.coefficients.shape[2] - 1
        assert table[:3].tolist() == [m, k, curve.period]
        assert_allclose(table[HEAD : HEAD + m + 1], curve.breaks)
        jumps, h = [], 1e-7
        for i in range(m + 1):
            here = curve.breaks[i]
            before, after = (np.array(curve.point(here + d)) for d in (-h, h))
            far = np.array(curve.point(here - 2.0 * h)), np.array(curve.point(here + 2.0 * h))
            third = (far[1][2] - after[2]) / h - (before[2] - far[0][2]) / h
            jumps.append(float(np.linalg.norm(third)) / float(np.linalg.norm(after[1])))
        if not closed:
            jumps[0] = jumps[-1] = 0.0
        assert k == 3  # c'' changes its slope by that
        assert_allclose(table[HEAD + m + 1 : HEAD + 2 * (m + 1)], jumps, rtol=1e-6, atol=1e-6)
        points = table[-4 * int(table[3]) :].reshape(-1, 4)
        assert len(points) == 1 + m * math.ceil(LEAST_POINTS / m)
        assert points[0, 0] == curve.breaks[0] and points[-1, 0] == curve.breaks[-1]
        assert set(curve.breaks) <= set(points[:, 0])
        assert_allclose(np.diff(points[:, 0]).max(), np.diff(curve.breaks).max() * m / 64.0)
        for s, *place in points[:-1]:
            assert_allclose(place, curve.point(s)[0], atol=1e-14)
        assert_allclose(points[-1, 1:], curve.point(curve.breaks[-1] - 1e-13)[0], atol=1e-12)
