"""Where bodies on guides are, by hand, and the share of a step that the first of them may take."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim import load_scene
from rb_sim.engine.guides import on_guides, share_law, splines_of, ways
from rb_sim.graph.machine import evaluate
from rb_sim.scene.compile import compile_scene
from tests.engine.test_guides import LOOP, VALLEY, Straight, parabola, pieces, sliding
from tests.interpreted import interpreted

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
    assert share([kinked], [ahead], 1.0, 1e3) == 1.0
    assert share_law([]) is None
