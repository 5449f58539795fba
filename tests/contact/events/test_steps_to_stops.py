"""Where steps end for slips and rollings that end, on tables by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rb_sim.contact.events import stick_transition
from rb_sim.mechanics.contact.contact_bodies import EVENT_KINDS, FREE, ROLL_ENDS, SLIP_ENDS
from rb_sim.mechanics.contact.contact_kinematics import SLIDING, STUCK
from rb_sim.mechanics.contact.contact_table import (
    AT_ROLL,
    AT_SLIP,
    CLOSED,
    EVENT_FUNCTIONS_BEFORE,
    EVENT_RATES_BEFORE,
    NORMAL,
    POINT,
    RELATIVE_SPIN,
    ROLL,
    ROLL_DIRECTION,
    ROLLING_ARM,
    SLIDE,
    SLIP,
    SLIP_DIRECTION,
    STATIC,
    TOUCH_WIDTH,
)
from rb_sim.mechanics.systems.many_bodies import BODY, INVERSE, MASS, PARENT

MASSES, ABOUT = (2.0, 5.0), (0.5, 0.3)
UNIT = SimpleNamespace(mass=3.0, speed=2.0, length=0.5, still=1e-4)
"""One of force is 3 2^2 / 0.5 = 24 N, one of turning 2/0.5/100 = 0.04 rad/s."""


def slowing(level: float, rate: float, turned: float, **more: float) -> SimpleNamespace:
    """A system whose contact 1, of body 0 with body 1, slips and rolls at that level, whose rates
    are those, and which the last step has turned by so much; it bears 1/4 of a unit, 6 N."""
    touch = np.zeros((2, TOUCH_WIDTH))
    touch[:, [CLOSED, SLIDE, ROLL]] = 1.0, SLIDING, SLIDING
    touch[:, EVENT_FUNCTIONS_BEFORE : EVENT_FUNCTIONS_BEFORE + 5] = FREE
    touch[
        1,
        [
            EVENT_FUNCTIONS_BEFORE,
            EVENT_FUNCTIONS_BEFORE + AT_SLIP,
            EVENT_FUNCTIONS_BEFORE + AT_ROLL,
        ],
    ] = (
        -0.25,
        level,
        level,
    )
    touch[1, [EVENT_RATES_BEFORE + AT_SLIP, EVENT_RATES_BEFORE + AT_ROLL]] = rate
    touch[1, STATIC], touch[1, ROLLING_ARM] = more.get("mu", 0.4), more.get("arm", 0.4)
    c, s = np.cos(turned), np.sin(turned)
    touch[1, SLIP : SLIP + 3], touch[1, SLIP_DIRECTION : SLIP_DIRECTION + 3] = (
        (7.0 * c, 7.0 * s, 0.0),
        (1.0, 0.0, 0.0),
    )
    touch[1, NORMAL + 2] = 1.0
    touch[1, RELATIVE_SPIN : RELATIVE_SPIN + 3], touch[1, ROLL_DIRECTION + 1] = (
        (-5.0 * s, 5.0 * c, 9.0),
        1.0,
    )
    touch[1, POINT : POINT + 3] = 1.0, 2.0, 2.0
    bodies = np.zeros((2, max(INVERSE + 6, MASS + 1)))
    bodies[:, MASS] = MASSES
    bodies[:, INVERSE], bodies[:, INVERSE + 2] = ABOUT, 0.1
    lines = np.zeros((9, max(BODY, PARENT) + 1), dtype=int)
    lines[6, PARENT] = more.get("parent", 1)
    first = np.array([0, 1, 6, 9])
    return SimpleNamespace(
        **vars(UNIT), touch=touch, bodies=bodies, lines=lines, first_row=first, joints=1
    )


Y = np.zeros(26)
Y[[6, 19]] = 1.0
Y[13] = 1.0
"""The first body is at the origin, 3 m from the point of contact, the other one sqrt(8) m."""
LIGHT = 0.5 + (0.5 + 0.1) * 9.0, 0.2 + (0.3 + 0.1) * 8.0
OWN = 100.0 / 2.0 * 0.4 * 6.0 * sum(LIGHT)
OWN_ROLL = 0.4 * 6.0 * (0.6 + 0.4) / 0.04


def test_what_friction_itself_gives_a_slip_and_a_rolling() -> None:
    """mu N (1/m + r^2/I) of both bodies, in units of slip, 2 m/s over 100; arm N / I of both."""
    assert stick_transition.own_rate(slowing(0.1, 0.0, 0.0), Y, 1, AT_SLIP) == pytest.approx(OWN)
    assert stick_transition.own_rate(slowing(0.1, 0.0, 0.0), Y, 1, AT_ROLL) == pytest.approx(
        OWN_ROLL
    )
    alone = slowing(0.1, 0.0, 0.0, parent=-1)
    assert stick_transition.own_rate(alone, Y, 1, AT_SLIP) == pytest.approx(
        OWN * LIGHT[0] / sum(LIGHT)
    )
    assert stick_transition.own_rate(alone, Y, 1, AT_ROLL) == pytest.approx(OWN_ROLL * 0.6)


@pytest.mark.parametrize(("i", "mode"), [(AT_SLIP, SLIDE), (AT_ROLL, ROLL)])
def test_when_a_slip_or_a_rolling_would_be_over(i: int, mode: int) -> None:
    """Its level over its rate; never, where it does not slow down but for the error of its rate."""
    assert stick_transition.time_to_stop(slowing(0.1, -0.4, 0.0).touch, 1, i, mode) == 0.25
    assert stick_transition.time_to_stop(slowing(-0.1, -0.4, 0.0).touch, 1, i, mode) == 0.0
    assert stick_transition.time_to_stop(slowing(0.1, 0.4, 0.0).touch, 1, i, mode) == FREE
    assert stick_transition.time_to_stop(slowing(0.1, -0.9e-3, 0.0).touch, 1, i, mode) == FREE
    assert stick_transition.time_to_stop(slowing(0.1, -1.1e-3, 0.0).touch, 1, i, mode) < 100.0
    for column, value in ((CLOSED, 0.0), (mode, STUCK), (EVENT_FUNCTIONS_BEFORE + i, FREE)):
        system = slowing(0.1, -0.4, 0.0)
        system.touch[1, column] = value
        assert stick_transition.time_to_stop(system.touch, 1, i, mode) == FREE


@pytest.mark.parametrize(("i", "mode"), [(AT_SLIP, SLIDE), (AT_ROLL, ROLL)])
def test_what_a_step_may_take_of_a_slip_that_ends(i: int, mode: int) -> None:
    """1.5 |s|/a; of the time that is left at least a 25th, of one that was turned a thousandth, at
    most three quarters.  At its end what is left; where it does not slow down a step at least."""
    own = OWN if i == AT_SLIP else OWN_ROLL

    def longest(level: float, rate: float, turned: float = 1e-3, h: float = 0.1) -> float:
        return stick_transition.longest_step(slowing(level, rate, turned), Y, 1, i, mode, h)

    free = 1.5 * 0.1 / own
    assert longest(0.1, -0.1 / (2.0 * free)) == pytest.approx(free)
    assert longest(0.1, -0.1 / free) == pytest.approx(0.75 * free)
    assert longest(0.1, -0.1 / (1e4 * free)) == pytest.approx(10.0 * free)
    assert longest(0.1, -0.1 / (1e4 * free), 1e-7) == pytest.approx(400.0 * free)
    assert longest(1e-11, -2.0) == pytest.approx(5e-12)
    assert longest(1e-11, -2.0, h=1e-12) == 1e-12
    assert longest(0.1, 0.1) == pytest.approx(max(free, 1.5e-3 * 0.1))
    assert longest(1e-6, 0.1) == pytest.approx(1.5e-4)
    assert longest(0.1, 0.1, 1e-7) == 0.1
    nothing = slowing(0.1, 0.1, 1e-3, mu=0.0, arm=0.0)
    assert stick_transition.longest_step(nothing, Y, 1, i, mode, 0.1) == 0.1


@pytest.mark.parametrize("i", [AT_SLIP, AT_ROLL])
def test_whether_a_step_has_turned_a_slip_or_a_rolling(i: int) -> None:
    """By more than so much; turning about the normal is no rolling."""
    for angle, turned in ((0.9e-2, False), (1.1e-2, True), (-1.1e-2, True), (3.0, True)):
        assert bool(stick_transition.was_turned(slowing(0.1, 0.0, angle), 1, i, 1e-2)) is turned


def method(step: float = 0.1, tolerance: float = 0.0, implicit: float = 0.0) -> Any:
    return SimpleNamespace(setting=(step, tolerance, 1.0, 4.0, implicit))


GRID = SimpleNamespace(t0=3.0, t1=3.1, y0=Y)


def test_fixed_steps_end_before_a_slip_does() -> None:
    """By the least of all contacts, slips and rollings; implicit ones go on."""
    system = slowing(0.1, -2.0, 1e-3)
    steps = [
        stick_transition.longest_step(system, Y, 1, *of, 0.1)
        for of in ((AT_SLIP, SLIDE), (AT_ROLL, ROLL))
    ]
    assert stick_transition.before_stop(method(), system, GRID, False) == 3.0 + min(steps) < 3.1
    system.touch[1, SLIDE] = STUCK
    assert stick_transition.before_stop(method(), system, GRID, False) == 3.0 + steps[1]
    system.touch[1, ROLL] = STUCK
    assert stick_transition.before_stop(method(), system, GRID, False) == 3.1
    assert (
        stick_transition.before_stop(method(implicit=1.0), slowing(0.1, -2.0, 1e-3), GRID, False)
        == 3.1
    )
    assert (
        stick_transition.before_stop(method(tolerance=1e-6), slowing(0.1, -2.0, 1e-3), GRID, False)
        == 3.1
    )


def test_adaptive_steps_end_before_errors_keep_a_slip_alive() -> None:
    """One that ends, of up to 30 times what is still, 100 1e-4 m/s / 2 m/s, and was turned by a
    hundredth; after five times |s|/a."""
    adaptive, still = method(tolerance=1e-6), 100.0 * 1e-4 / 2.0

    def last(level: float, rate: float, turned: float) -> float:
        return stick_transition.before_stop(adaptive, slowing(level, rate, turned), GRID, False)

    assert last(29.0 * still, -1.0, 0.02) == pytest.approx(min(3.1, 3.0 + 5.0 * 29.0 * still / OWN))
    assert last(2.0 * still, -1.0, 0.02) == pytest.approx(3.0 + 5.0 * 2.0 * still / OWN)
    assert last(31.0 * still, -1.0, 0.02) == last(0.9 * still, -1.0, 0.02) == 3.1
    assert last(2.0 * still, -1.0, 0.009) == 3.1
    assert last(2.0 * still, -0.9e-4 * OWN, 0.02) == 3.1
    assert last(2.0 * still, -1.1e-4 * OWN, 0.02) < 3.1
    assert (
        stick_transition.before_stop(adaptive, slowing(2.0 * still, -1.0, 0.02), GRID, True) == 3.1
    )
    implicit = method(tolerance=1e-6, implicit=1.0)
    assert (
        stick_transition.before_stop(implicit, slowing(2.0 * still, -1.0, 0.02), GRID, False) == 3.1
    )


def test_a_slip_is_over_where_steps_have_come_to_its_end() -> None:
    """1e-13 of the unit of 1/4 s, or what the clock tells at 3 s."""
    for left, t, due in ((2e-14, 0.0, True), (3e-14, 0.0, False), (2.9e-15, 3.0, True),
                         (4e-12, 5e3, True), (6e-12, 5e3, False)):  # fmt: skip
        system = slowing(2.0 * left, -2.0, 0.0)
        found = stick_transition.stop_that_is_due(method(), system, t)
        assert found == (EVENT_KINDS + SLIP_ENDS if due else -1)
        system.touch[1, SLIDE] = STUCK
        found = stick_transition.stop_that_is_due(method(), system, t)
        assert found == (EVENT_KINDS + ROLL_ENDS if due else -1)
        assert stick_transition.stop_that_is_due(method(tolerance=1.0), system, t) == -1
        assert stick_transition.stop_that_is_due(method(implicit=1.0), system, t) == -1
