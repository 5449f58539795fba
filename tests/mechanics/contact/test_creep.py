"""Which contacts creep, on a table by hand: bounds on either side of each threshold."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rb_sim.mechanics.contact.contact_bodies import FREE
from rb_sim.mechanics.contact.contact_kinematics import NONE, SLIDING, STUCK
from rb_sim.mechanics.contact.contact_table import (
    AT_SLIP,
    CLOSED,
    COMPLIANT,
    CREEPS,
    EVENT_FUNCTIONS_BEFORE,
    EVENT_RATES_BEFORE,
    SLIDE,
    SLIP,
    SLIP_DIRECTION,
    STATIC,
    TOUCH_WIDTH,
)
from rb_sim.mechanics.contact.creep import fastest_creep, note_creep, rubs, slides_on_what_gives

CREEP = 2e-6
"""Slip at which friction is rounded [m/s]."""
DIRECTION = np.array([0.0, 0.6, -0.8])
OTHERS = {CLOSED: 0.0, SLIDE: STUCK, STATIC: 0.0, COMPLIANT: 0.0}
"""Columns of a contact, and what it has in them where it does not slip on what gives way."""


def sliding(*slips: float, creeps: float = 0.0, creep: float = CREEP) -> Any:
    """A system of contacts that slip so fast on what gives way."""
    touch = np.full((len(slips), TOUCH_WIDTH), 0.3)
    touch[:, [CLOSED, SLIDE, COMPLIANT, CREEPS]] = 1.0, SLIDING, 1.0, creeps
    touch[:, SLIP : SLIP + 3] = np.outer(slips, DIRECTION)
    return SimpleNamespace(touch=touch, creep=creep)


def noted(slip: float, creeps: float = 0.0, **other: Any) -> tuple[float, list[float]]:
    """What contact 1 of 2 keeps: the slip below which it may rest; its direction, and the event
    function of its slip and the rate of that, which were 0.3 each."""
    system = sliding(7.0, slip, creeps=creeps, creep=other.get("creep", CREEP))
    for column, value in other.get("has", {}).items():
        system.touch[1, column] = value
    first = system.touch[0].copy()
    note_creep(system, 1)
    assert np.array_equal(system.touch[0], first)
    at = [
        *range(SLIP_DIRECTION, SLIP_DIRECTION + 3),
        EVENT_FUNCTIONS_BEFORE + AT_SLIP,
        EVENT_RATES_BEFORE + AT_SLIP,
    ]
    return system.touch[1, CREEPS], system.touch[1, at].tolist()


AS_BEFORE, FORGOTTEN = [0.3] * 5, [0.0, 0.0, 0.0, FREE, 0.0]


@pytest.mark.parametrize(
    ("slip", "before", "after", "keeps"),
    [
        (10.1 * CREEP, 1e-7, 0.0, AS_BEFORE),
        (9.9 * CREEP, 1e-7, 0.9 * CREEP, FORGOTTEN),
        (1.1 * CREEP, 1e-7, 0.9 * CREEP, FORGOTTEN),
        (0.9 * CREEP, 1e-7, 1e-7, FORGOTTEN),
        (9.9 * CREEP, 0.0, 0.0, AS_BEFORE),
        (1.1 * CREEP, 0.0, 0.0, AS_BEFORE),
        (0.9 * CREEP, 0.0, 2.0 * CREEP, FORGOTTEN),
        (1.1e-3 * CREEP, 0.0, 2.0 * CREEP, FORGOTTEN),
        (0.9e-3 * CREEP, 0.0, 1e-300, FORGOTTEN),
    ],
)
def test_what_creeps_and_when_it_may_rest(
    slip: float, before: float, after: float, keeps: list[float]
) -> None:
    """Below the speed of creeping a contact begins to creep, and above ten times that it ends."""
    found, kept = noted(slip, before)
    assert found == pytest.approx(after, rel=1e-15)
    assert kept == keeps


@pytest.mark.parametrize(("column", "value"), OTHERS.items())
def test_what_does_not_slip_on_what_gives_way_does_not_creep(column: int, value: float) -> None:
    assert noted(0.5 * CREEP, 1e-7, has={column: value}) == (0.0, AS_BEFORE)


def test_nothing_creeps_in_steps_of_fixed_length() -> None:
    for slip in (0.0, 1e-7):
        assert noted(slip, 1e-7, creep=0.0) == (0.0, AS_BEFORE)


def test_the_fastest_of_those_that_creep() -> None:
    """A contact that is open, or does not creep, does not count, whatever its columns say."""
    system = sliding(9.0, 1e-6, 3e-6, 2e-6, 8.0)
    system.touch[:, CREEPS] = 1e-7, 4e-7, 3e-7, 5e-7, 0.0
    system.touch[0, CLOSED] = 0.0
    most, bound, first = fastest_creep(system)
    assert (most, bound, first) == (pytest.approx(3e-6), 3e-7, 1)
    assert fastest_creep(sliding(1e-6, 2e-6, creeps=1e-7))[2] == 0
    system.touch[:, CREEPS] = 0.0
    assert fastest_creep(system) == (0.0, FREE, -1)


def test_what_rubs() -> None:
    for column, value in OTHERS.items():
        system = sliding(1.0)
        assert rubs(system.touch, 0) and slides_on_what_gives(system.touch, 0)
        system.touch[0, column] = value
        assert bool(rubs(system.touch, 0)) is (column == COMPLIANT)
        assert not slides_on_what_gives(system.touch, 0)
    system = sliding(1.0)
    system.touch[0, SLIDE] = NONE
    assert not rubs(system.touch, 0)
