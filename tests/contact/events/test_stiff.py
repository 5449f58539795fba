"""Where slow slips that go on make equations stiff, on tables by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rb_sim.contact.events.grid import note_stiffness, shortened
from rb_sim.mechanics.contact.contact_bodies import FREE
from rb_sim.mechanics.contact.contact_kinematics import SLIDING, STUCK
from rb_sim.mechanics.contact.contact_table import (
    AT_SLIP,
    CLOSED,
    COMPLIANT,
    CREEPS,
    EVENT_FUNCTIONS_BEFORE,
    EVENT_RATES_BEFORE,
    SLIDE,
    SLIP,
    STIFF,
    TOUCH_WIDTH,
)
from tests.contact.events.test_steps_to_stops import OWN, UNIT, Y, slowing

STILL, CREEP = 1e-4, 1e-3
"""Slips [m/s]: that of a method's errors, and that which creeps."""
UNIT_SLIP = UNIT.speed / 100.0


def stiffness(slip: float, rate: float, creep: float = CREEP, **has: float) -> float:
    """Rate at which friction turns the slip [m/s] of contact 1, which changes by so much [1/s]."""
    system = slowing(slip / UNIT_SLIP, rate, 0.0)
    system.creep, touch = creep, system.touch
    touch[1, SLIP : SLIP + 3], touch[:, STIFF] = (0.0, 0.6 * slip, 0.8 * slip), 9.0
    touch[1, [COMPLIANT, CREEPS]] = 1.0, has.get("creeps", 0.0)
    touch[1, SLIDE] = has.get("mode", SLIDING)
    touch[1, EVENT_FUNCTIONS_BEFORE + AT_SLIP] = has.get("level", slip / UNIT_SLIP)
    note_stiffness(system, Y)
    assert touch[0, STIFF] == 0.0
    return float(touch[1, STIFF])


def test_a_slip_that_goes_on_is_turned_at_a_rate_of_its_own() -> None:
    """a over the slip, where it would not be over within twenty times the inverse of that."""
    own = OWN * UNIT_SLIP / 0.1
    assert stiffness(0.1, 0.5) == pytest.approx(own)
    assert stiffness(0.1, -OWN / 21.0) == pytest.approx(own)
    assert stiffness(0.1, -OWN / 19.0) == 0.0


def test_slips_that_end_or_have_no_direction_are_not_stiff() -> None:
    assert stiffness(1.1 * CREEP, 0.5) == pytest.approx(OWN * UNIT_SLIP / (1.1 * CREEP))
    assert stiffness(0.9 * CREEP, 0.5) == 0.0
    assert stiffness(1.1 * STILL, 0.5, creep=0.0) == pytest.approx(OWN * UNIT_SLIP / (1.1 * STILL))
    assert stiffness(0.9 * STILL, 0.5, creep=0.0) == 0.0
    assert stiffness(0.1, 0.5, level=FREE) == 0.0
    assert stiffness(0.1, 0.5, mode=STUCK) == stiffness(0.1, 0.5, mode=STUCK, creeps=1e-9) == 0.0


def test_what_creeps_is_turned_at_most_as_its_law_is_rounded() -> None:
    """Whatever its event function says, which it has not."""
    for slip in (0.1, 1.1 * CREEP):
        rate = stiffness(slip, -1e9, creeps=1e-9, level=FREE)
        assert rate == pytest.approx(OWN * UNIT_SLIP / slip)
    for slip in (0.9 * CREEP, 1e-9):
        rate = stiffness(slip, -1e9, creeps=1e-9, level=FREE)
        assert rate == pytest.approx(OWN * UNIT_SLIP / CREEP)


@pytest.mark.parametrize("unit", [1.0, 100.0])
@pytest.mark.parametrize("order", [slice(None), slice(None, None, -1)])
@pytest.mark.parametrize(
    ("left", "tried", "due", "length"),
    [
        (0.3, 0.19, False, 0.19),
        (0.2, 0.19, False, 0.19),
        (0.3, 0.21, True, 0.21),
        (0.3, 0.5, True, 0.225),
        (0.2, 0.5, False, 0.15),
        (FREE, 0.5, True, 0.5),
    ],
)
def test_steps_that_stiff_slips_turn_too_often_are_implicit(
    unit: float, order: slice, left: float, tried: float, due: bool, length: float
) -> None:
    """Of 10/s, twice in 0.2 s, in any unit of time; they take three quarters of what is left of a
    slip that ends."""
    touch: Any = np.zeros((3, TOUCH_WIDTH))
    touch[:, [CLOSED, SLIDE]] = 1.0, SLIDING
    touch[:, STIFF] = np.array([10.0, 3.0, 0.0])[order] / unit
    touch[:, EVENT_FUNCTIONS_BEFORE + AT_SLIP] = 2.0
    rates = np.array([2.0, -2.0 / left, -2.0 / min(1.5 * left, 1e9)])
    touch[:, EVENT_RATES_BEFORE + AT_SLIP] = rates[order] / unit
    found = shortened(SimpleNamespace(touch=touch), unit * tried)
    assert bool(found[0]) is due
    assert found[1] == pytest.approx(unit * length)
