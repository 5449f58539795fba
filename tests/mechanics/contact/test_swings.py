"""How far a step may go with rims that are held at a point and nearly lie flat: tables by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim.catalogue.geometry.corners_and_rims import FLAT, IN_FLIGHT, SLAMS
from rb_sim.mechanics.contact import near_flat_rims
from rb_sim.mechanics.contact.contact_bodies import FREE
from rb_sim.mechanics.contact.contact_table import (
    AXIS,
    CLOSED,
    LEAN_BEFORE,
    LEAN_SIGN,
    LOW,
    NEARS,
    NORMAL,
    RELATIVE_SPIN,
    RIM,
    SWING,
    TOUCH_WIDTH,
)

FIXED, ADAPTIVE = (SimpleNamespace(setting=(0.1, tolerance)) for tolerance in (0.0, 1e-9))


def leaning(lean: Any, rate: Any, seed: int = 0, sense: float = 1.0) -> np.ndarray:
    """Two points of one rim, the second held, whose lean is `lean` along two axes of its plane and
    changes at `rate`; the rim turns about the plane's normal, too."""
    e = Rotation.random(random_state=seed).as_matrix()
    touch = np.zeros((3, TOUCH_WIDTH))
    touch[:, RIM], touch[:, CLOSED], touch[:, LEAN_SIGN] = (0.0, 0.0, -1.0), (0.0, 1.0, 1.0), sense
    across, n = np.array(lean) @ e[:2], e[2]
    axis = across + n * np.sqrt(1.0 - across @ across)
    moves = np.array(rate) @ e[:2]
    moves = moves - n * (moves @ axis) / (n @ axis)  # the axis stays as long
    touch[:2, AXIS : AXIS + 3], touch[:2, NORMAL : NORMAL + 3] = across, n
    touch[:2, RELATIVE_SPIN : RELATIVE_SPIN + 3] = np.cross(axis, moves) + 7.0 * axis
    touch[:2, LOW : LOW + 3] = 0.1, 0.2, 0.3
    return touch


def noted(*arguments: Any, **more: Any) -> np.ndarray:
    touch = leaning(*arguments, **more)
    for c in range(3):
        near_flat_rims.note_lean(touch, c)
    return touch


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("rate", [(-2.0, -1.0), (2.0, 1.0), (-1.0, 1.5)])
def test_where_a_rim_goes(seed: int, rate: tuple[float, float]) -> None:
    """Its low point may go round within tilt over rate; to flat, aside, or away from it."""
    x, v = np.array([0.3, 0.1]), np.array(rate)
    touch = noted(x, v, seed)
    assert_allclose(touch[:2, SWING], np.linalg.norm(x) / np.linalg.norm(v))
    assert_allclose(touch[:2, NEARS], -x @ v / np.linalg.norm(x) / np.linalg.norm(v))
    assert (touch[:2, LEAN_BEFORE + 6] == 1.0).all()
    assert_allclose(touch[:2, LEAN_BEFORE : LEAN_BEFORE + 3], [[0.1, 0.2, 0.3]] * 2)
    assert touch[2, SWING] == FREE and touch[2, NEARS] == 0.0


@pytest.mark.parametrize("sense", [1.0, -1.0, SLAMS, -SLAMS, IN_FLIGHT])
@pytest.mark.parametrize(
    ("tilt", "missed", "slams"),
    [(0.9e-7, 0.4e-10, True), (0.9e-7, 0.6e-10, False), (1.1e-7, 0.4e-10, False)],
)
def test_what_misses_flat_by_nothing_slams(
    tilt: float, missed: float, slams: bool, sense: float
) -> None:
    """And keeps what was low; from nearly flat on."""
    touch = noted((tilt, missed), (-3.0, 0.0), sense=sense)
    side = 1.0 if sense > 0.0 else -1.0
    assert (touch[:2, LEAN_BEFORE + 6] == side * (SLAMS if slams else 1.0)).all()
    away = noted((tilt, missed), (3.0, 0.0), sense=sense)
    assert (away[:2, LEAN_BEFORE + 6] == side).all()


def test_what_lies_or_flies_goes_nowhere() -> None:
    touch = noted((0.9 * FLAT, 0.0), (-3.0, 0.0))
    assert (touch[:2, SWING] == FREE).all()
    touch = leaning((0.3, 0.1), (-2.0, -1.0), sense=-1.0)
    touch[1, CLOSED] = 0.0
    for c in range(3):
        near_flat_rims.note_lean(touch, c)
    assert (touch[:, SWING] == FREE).all()
    assert touch[:2, LEAN_BEFORE + 6].tolist() == [IN_FLIGHT] * 2
    assert touch[2, LEAN_BEFORE + 6] == -1.0


@pytest.mark.parametrize(
    ("tilt", "turned", "sense", "far"),
    [
        (0.2, 1.04, 1.0, False),  # by less than 60 degrees
        (0.2, 1.06, 1.0, True),
        (0.2, 3.0, SLAMS, False),
        (0.2, 3.0, -SLAMS, False),
        (0.9e-10, 3.0, 1.0, False),  # flat
        (0.91, 3.0, 1.0, False),  # all but upright
    ],
)
def test_a_low_point_may_turn_by_sixty_degrees(
    tilt: float, turned: float, sense: float, far: bool
) -> None:
    """Of a rim that is held, beside how it leant before."""
    system = SimpleNamespace(touch=leaning((tilt, 0.0), (0.0, 0.0)))
    touch = system.touch
    touch[1, LEAN_BEFORE + 6] = sense
    before = Rotation.from_rotvec(turned * touch[1, NORMAL : NORMAL + 3])
    touch[1, LEAN_BEFORE + 3 : LEAN_BEFORE + 6] = before.apply(touch[1, AXIS : AXIS + 3])
    assert near_flat_rims.end_for_rims(system, 2.0, 3.0) == (2.5 if far else 3.0)
    touch[1, LEAN_BEFORE + 3 : LEAN_BEFORE + 6] *= 10.0  # what counts is where it leans
    assert near_flat_rims.end_for_rims(system, 2.0, 3.0) == (2.5 if far else 3.0)
    touch[1, CLOSED] = 0.0
    assert near_flat_rims.end_for_rims(system, 2.0, 3.0) == 3.0


def test_steps_of_fixed_length_follow_a_swing() -> None:
    """By 0.03 of its time, where they would take more than 0.3; before by half the way."""
    for lean, rate, part in (
        ((0.3, 0.1), (-2.0, 1.0), 0.03),
        ((0.3, 0.1), (2.0, 1.0), 0.03),
        ((0.3, 0.1), (-3.0, -1.0), 0.5),
        ((0.3, 0.1), (3.0, 1.0), 1.0),
    ):
        system = SimpleNamespace(touch=noted(lean, rate))
        swing = np.linalg.norm(lean) / np.linalg.norm(rate)
        for span in (0.31, 0.6):
            found = near_flat_rims.before_swing(FIXED, system, 2.0, 2.0 + span * swing)
            assert found == pytest.approx(2.0 + min(part, span) * swing, abs=1e-15)
        end = 2.0 + 0.29 * swing
        assert near_flat_rims.before_swing(FIXED, system, 2.0, end) == end
        assert near_flat_rims.before_swing(ADAPTIVE, system, 2.0, 3.0) == 3.0
        system.touch[1, CLOSED] = 0.0
        assert near_flat_rims.before_swing(FIXED, system, 2.0, 3.0) == 3.0


def test_what_rounding_turns() -> None:
    """Of a lean of 1e-6 rad that goes aside by 4e-10 rad; steps within 0.02 of its time do."""
    system = SimpleNamespace(touch=noted((1e-6, 0.0), (-0.3, 0.4)))
    touch = system.touch
    touch[:, LEAN_BEFORE + 3 : LEAN_BEFORE + 6] = touch[:, AXIS : AXIS + 3]
    assert near_flat_rims.step_of_swings(system) == pytest.approx(0.02 * 2e-6)
    assert near_flat_rims.turned_by_rounding(touch, 1) == pytest.approx(4e-10)
    assert (
        near_flat_rims.turned_by_rounding(touch, 0)
        == near_flat_rims.turned_by_rounding(touch, 2)
        == 0.0
    )
    touch[1, LEAN_BEFORE + 3 : LEAN_BEFORE + 6] *= 11.0
    assert near_flat_rims.step_of_swings(system) == 0.0
    straight = noted((1e-6, 0.0), (0.3, 0.001))
    straight[:, LEAN_BEFORE + 3 : LEAN_BEFORE + 6] = straight[:, AXIS : AXIS + 3]
    assert near_flat_rims.turned_by_rounding(straight, 1) == 0.0
