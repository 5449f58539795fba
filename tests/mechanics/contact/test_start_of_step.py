"""What a step starts from, on tables by hand: directions, event functions along them, leans."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.catalogue.geometry.corners_and_rims import IN_FLIGHT
from rb_sim.contact.events.next_event import look_ahead, note_lean
from rb_sim.mechanics.contact.contact_bodies import FREE
from rb_sim.mechanics.contact.contact_kinematics import SLIDING, STUCK
from rb_sim.mechanics.contact.contact_table import (
    AT_ROLL,
    AT_SLIP,
    AT_SPIN,
    CLOSED,
    COMPLIANT,
    CREEPS,
    EVENT_FUNCTION_KINDS,
    EVENT_FUNCTIONS,
    EVENT_FUNCTIONS_BEFORE,
    EVENT_RATES_BEFORE,
    FASTEST,
    FASTEST_BEFORE,
    GAP,
    GAP_BEFORE,
    GAP_RATE,
    GAP_RATE_BEFORE,
    LEAN_BEFORE,
    LEAN_SIGN,
    LEAN_WIDTH,
    LOW,
    NORMAL,
    RELATIVE_SPIN,
    RIM,
    ROLL,
    ROLL_DIRECTION,
    ROLL_RATE,
    SLIDE,
    SLIP,
    SLIP_DIRECTION,
    SLIP_RATE,
    SPIN,
    SPIN_SIGN,
    STATIC,
    TOUCH_WIDTH,
)

SPEED, LENGTH, STILL = 4.0, 0.5, 1e-3
"""Of the scene [m/s, m], and the slip whose direction is lost [m/s]: of turning 2e-3 rad/s."""
UNIT_SLIP, UNIT_TURN = SPEED / 100.0, SPEED / LENGTH / 100.0
N = np.array([0.0, 0.6, 0.8])
ALONG, ACROSS = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.8, -0.6])
"""Across the normal."""
RATES = np.arange(2.0 * EVENT_FUNCTION_KINDS).reshape(2, EVENT_FUNCTION_KINDS) + 50.0


def moving(slip: float, roll: float, about: float, has: dict[int, float] | None = None) -> Any:
    """Two contacts; the second slips, rolls and turns about N so fast, along and across, while it
    was slipping across, rolling along and turning against N before."""
    rng = np.random.default_rng(3)
    touch = rng.normal(size=(2, TOUCH_WIDTH))
    touch[:, [CLOSED, SLIDE, ROLL, SPIN]] = 1.0, SLIDING, SLIDING, SLIDING
    touch[:, [STATIC, COMPLIANT, RIM]] = 0.4, 0.0, -1.0
    touch[1, NORMAL : NORMAL + 3] = N
    touch[1, SLIP : SLIP + 3], touch[1, SLIP_DIRECTION : SLIP_DIRECTION + 3] = slip * ALONG, ACROSS
    touch[1, RELATIVE_SPIN : RELATIVE_SPIN + 3], touch[1, ROLL_DIRECTION : ROLL_DIRECTION + 3] = (
        roll * ACROSS,
        ALONG,
    )
    touch[1, RELATIVE_SPIN : RELATIVE_SPIN + 3] += about * N
    touch[1, SPIN_SIGN] = -1.0
    for column, value in (has or {}).items():
        touch[1, column] = value
    return SimpleNamespace(touch=touch, speed=SPEED, length=LENGTH, still=STILL, creep=0.0)


def looked(system: Any) -> tuple[np.ndarray, np.ndarray]:
    """The second contact, before and after."""
    before = system.touch[1].copy()
    look_ahead(system, RATES)
    return before, system.touch[1]


def levels(row: np.ndarray, i: int) -> tuple[float, float]:
    return row[EVENT_FUNCTIONS_BEFORE + i], row[EVENT_RATES_BEFORE + i]


def test_gaps_speeds_and_event_functions_are_kept() -> None:
    """Of a contact that is open all of them are as they were found."""
    before, after = looked(moving(0.3, 0.7, 0.9, {CLOSED: 0.0}))
    for at, of in ((GAP_BEFORE, GAP), (GAP_RATE_BEFORE, GAP_RATE), (FASTEST_BEFORE, FASTEST)):
        assert after[at] == before[of]
    kept, slopes = (
        after[at : at + EVENT_FUNCTION_KINDS] for at in (EVENT_FUNCTIONS_BEFORE, EVENT_RATES_BEFORE)
    )
    assert np.array_equal(kept, before[EVENT_FUNCTIONS : EVENT_FUNCTIONS + EVENT_FUNCTION_KINDS])
    assert np.array_equal(slopes, RATES[1])
    assert np.array_equal(after[LEAN_BEFORE : LEAN_BEFORE + 7], before[LOW : LOW + LEAN_WIDTH])
    assert_allclose(after[SLIP_DIRECTION : SLIP_DIRECTION + 3], ALONG)
    assert_allclose(after[ROLL_DIRECTION : ROLL_DIRECTION + 3], ACROSS)
    assert after[SPIN_SIGN] == 1.0 and after[CREEPS] == 0.0


def test_event_functions_along_the_new_directions() -> None:
    """Speeds, and their rates along; of a spin that has turned round both with the other sign."""
    system = moving(0.3, 0.7, 0.9)
    before, after = looked(system)
    found = levels(after, AT_SLIP)
    assert_allclose(found, [0.3 / UNIT_SLIP, before[SLIP_RATE : SLIP_RATE + 3] @ ALONG / UNIT_SLIP])
    found = levels(after, AT_ROLL)
    rate = before[ROLL_RATE : ROLL_RATE + 3] @ ACROSS
    assert_allclose(found, [0.7 / UNIT_TURN, rate / UNIT_TURN])
    assert levels(after, AT_SPIN) == (-before[EVENT_FUNCTIONS + AT_SPIN], -RATES[1, AT_SPIN])
    for i in (0, 4):
        assert levels(after, i) == (before[EVENT_FUNCTIONS + i], RATES[1, i])


@pytest.mark.parametrize(
    ("mode", "i"), [(SLIDE, AT_SLIP), (ROLL, AT_ROLL), (SPIN, AT_SPIN), (CLOSED, AT_SPIN)]
)
def test_event_functions_of_what_holds_are_as_they_were_found(mode: int, i: int) -> None:
    before, after = looked(moving(0.3, 0.7, 0.9, {mode: 0.0 if mode == CLOSED else STUCK}))
    assert levels(after, i) == (before[EVENT_FUNCTIONS + i], RATES[1, i])


def test_directions_that_are_lost_in_errors_stay_those_of_before() -> None:
    """Of slips below what is still, turnings below that over the length, in either sense."""
    for part, now in ((0.9, False), (1.1, True)):
        for sign in (1.0, -1.0):
            turn = part * STILL / LENGTH
            _, after = looked(moving(part * STILL, turn, sign * turn, {SPIN_SIGN: -sign}))
            assert_allclose(
                after[SLIP_DIRECTION : SLIP_DIRECTION + 3], ALONG if now else ACROSS, atol=1e-12
            )
            rolls = after[ROLL_DIRECTION : ROLL_DIRECTION + 3]
            assert_allclose(rolls, ACROSS if now else ALONG, atol=1e-12)
            assert after[SPIN_SIGN] == (sign if now else -sign)


def test_a_spin_that_goes_on_keeps_its_event_function() -> None:
    before, after = looked(moving(0.3, 0.7, -0.9))
    assert levels(after, AT_SPIN) == (before[EVENT_FUNCTIONS + AT_SPIN], RATES[1, AT_SPIN])


def test_slow_slips_on_what_gives_way_creep() -> None:
    system = moving(0.5e-6, 0.7, 0.9)
    system.touch[:, COMPLIANT], system.touch[:, CREEPS], system.creep = 1.0, 0.0, 1e-6
    _, after = looked(system)
    assert after[CREEPS] == pytest.approx(2e-6)
    assert levels(after, AT_SLIP) == (FREE, 0.0)


@pytest.mark.parametrize(
    ("rims", "closed", "sense", "kept"),
    [
        ((0.0, 0.0), (0.0, 1.0), 0.25, 0.25),
        ((0.0, 0.0), (1.0, 0.0), -1.0, -1.0),
        ((0.0, 0.0), (1.0, 0.0), IN_FLIGHT, 1.0),
        ((0.0, 0.0), (0.0, 0.0), -1.0, IN_FLIGHT),
        ((0.0, 1.0), (0.0, 1.0), -1.0, IN_FLIGHT),
        ((-1.0, -1.0), (0.0, 1.0), -1.0, -1.0),
        ((-1.0, -1.0), (0.0, 1.0), IN_FLIGHT, IN_FLIGHT),
    ],
)
def test_a_rim_that_nothing_holds_is_in_flight(
    rims: tuple[float, float], closed: tuple[float, float], sense: float, kept: float
) -> None:
    """It is held by any of its points; where it lands it begins to lean one way."""
    touch = np.arange(2.0 * TOUCH_WIDTH).reshape(2, TOUCH_WIDTH)
    touch[:, RIM], touch[:, CLOSED], touch[0, LEAN_SIGN] = rims, closed, sense
    before = touch.copy()
    note_lean(touch, 0)
    assert touch[0, LEAN_BEFORE + 6] == kept
    assert np.array_equal(touch[0, LEAN_BEFORE : LEAN_BEFORE + 6], before[0, LOW : LOW + 6])
    assert np.array_equal(touch[1], before[1])
