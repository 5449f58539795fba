"""An event is located in a handful of states, however many points there are that touch."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rb_sim.contact.events.search import (
    BEGIN,
    EARLY,
    END,
    LATE,
    LOCATED,
    begin_bracket,
    crossing,
    first_crossing,
    note_event_functions,
)
from rb_sim.mechanics.contact.contact_bodies import FREE
from rb_sim.mechanics.contact.contact_table import (
    CLOSED,
    EVENT_FUNCTION_KINDS,
    EVENT_FUNCTIONS,
    EVENT_FUNCTIONS_BEFORE,
    EVENT_RATES_BEFORE,
    GAP_RATE,
    GAP_RATE_BEFORE,
    TOUCH_WIDTH,
)
from tests.contact.scenes import box, scene, touch
from tests.contact_runs import contact_run
from tests.interpreted import interpreted

MOST = 8
"""States looked at for one event, one of them at the end of the step."""


def looks(mapping: dict[str, Any], duration: float) -> tuple[int, int]:
    """(events located, states looked at for them)."""
    from rb_sim import Simulation, load_scene
    from rb_sim.contact.events import next_event as inside

    counted = {"states": 0, "events": 0}
    level_at, begin = inside.level_at, inside.begin_bracket

    def looked(*arguments: Any) -> Any:
        counted["states"] += 1
        return level_at(*arguments)

    def begun(*arguments: Any) -> Any:
        counted["events"] += 1
        return begin(*arguments)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(inside, "level_at", looked)
        patch.setattr(inside, "begin_bracket", begun)
        mapping["simulation"] |= {"duration": duration}
        Simulation(load_scene(mapping)).run()
    return counted["events"], counted["states"]


def falling(**more: Any) -> dict[str, Any]:
    """A tilted box that falls onto its corners, bounces and slips."""
    tilted = box(
        [0.3, 0.2, 0.1], [0, 0, 0.15],
        orientation={"axis": [0.6, 0.8, 0.0], "angle": 0.2}, linear_velocity=[0.3, 0.0, 0.0],
    )  # fmt: skip
    return scene(tilted, touch(mu=0.3, restitution=0.3, **more))


def test_a_handful_of_states_tells_an_instant() -> None:
    """Regula falsi on the lowest of all event functions, which has kinks, took 26."""
    events, states = interpreted(looks, falling(), 0.13)
    assert events >= 8
    assert states <= MOST * events


def test_the_instants_are_those_of_free_fall() -> None:
    """The first touch to the last digits: where the lowest corner's parabola meets the floor."""
    run = contact_run(falling(), [0.0, 0.2], tolerance=1e-12)
    first = min(event.t for event in run.events)
    turn = np.array([0.6, 0.8, 0.0])
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    r = corners * [0.15, 0.1, 0.05]
    heights = (r * np.cos(0.2) + np.cross(turn, r) * np.sin(0.2))[:, 2]
    heights += turn[2] * (r @ turn) * (1.0 - np.cos(0.2))
    assert abs(first - np.sqrt(2.0 * (0.15 + heights.min()) / 9.81)) < 1e-14


FALLS = np.polynomial.Polynomial([0.5, -0.2, -0.3, 0.05])
"""An event function of t, which vanishes once in a step from 1 to 3 s, between 1.2 and 1.6 s."""
CONSTANT = 0.01
ZERO, LOWER = (
    float(next(z.real for z in (FALLS - c).roots() if abs(z.imag) < 1e-12 and 1.0 < z.real < 3.0))
    for c in (0.0, CONSTANT)
)


def seen(early: float, late: float, away: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """The rows of the function and of the times in a bracket; away: what it is less at both places
    than the cubic of the whole step says, whose values and rates at the ends are known."""
    slope, one, step = FALLS.deriv(), np.zeros(8), np.zeros(8)
    one[EARLY], one[LATE] = FALLS(early) - away, FALLS(late) - away
    one[EARLY + 1], one[LATE + 1] = slope(early), slope(late)
    one[BEGIN], one[END], one[BEGIN + 1], one[END + 1] = FALLS(1), FALLS(3), slope(1), slope(3)
    step[BEGIN], step[END] = 1.0, 3.0
    return one, step


def test_the_zero_of_a_cubic_whose_rates_are_known() -> None:
    """Of a flight; rates at the ends of the step serve where those at both instants are unknown,
    up to a constant that the nearer value tells."""
    early, late = ZERO - 0.1, ZERO + 0.3
    one, step = seen(early, late)
    for flies in (True, False):
        t, slope = crossing(one, step, flies, early, late)
        assert t == pytest.approx(ZERO, abs=1e-15) and slope == pytest.approx(FALLS.deriv()(ZERO))
    one, step = seen(LOWER - 0.1, LOWER + 0.3, CONSTANT)
    t, slope = crossing(one, step, False, LOWER - 0.1, LOWER + 0.3)
    assert t == pytest.approx(LOWER, abs=1e-15) and slope == pytest.approx(FALLS.deriv()(LOWER))
    one[LATE] -= 0.5  # further away: hardly believed
    assert crossing(one, step, False, LOWER - 0.1, LOWER + 0.3)[0] == pytest.approx(
        LOWER, abs=1e-15
    )
    one, step = seen(LOWER - 0.3, LOWER + 0.1, CONSTANT)
    one[EARLY] += 0.5
    assert crossing(one, step, False, LOWER - 0.3, LOWER + 0.1)[0] == pytest.approx(
        LOWER, abs=1e-15
    )


def test_a_straight_line_where_no_rates_are_known() -> None:
    """3 above zero at 1 s, 1 below it at 2 s: 1.75 s. What begins at no number, in the middle; what
    begins below by rounding and falls, at once."""
    one, step = np.full(8, FREE), np.zeros(8)
    one[EARLY], one[LATE] = 3.0, -1.0
    assert crossing(one, step, False, 1.0, 2.0) == (1.75, -4.0)
    assert crossing(one, step, False, 1.0, 1.5) == (1.375, -8.0)
    one[EARLY] = FREE
    assert crossing(one, step, True, 1.0, 1.5) == (1.25, -2.0)
    one[EARLY], one[BEGIN + 1] = -1e-9, -1e-3
    assert crossing(one, step, False, 1.0, 2.0) == (1.0, 0.0)
    one[BEGIN + 1] = 2e-9  # rises out of it first
    assert crossing(one, step, False, 1.0, 2.0)[0] == 1.5
    assert crossing(one, step, False, 1.0, 1.25)[0] == 1.0


def bracket_of(*rows: tuple[float, float]) -> tuple[SimpleNamespace, np.ndarray]:
    """Of contacts whose last event function has these values."""
    bracket = np.full((len(rows), EVENT_FUNCTION_KINDS + 1, 8), FREE)
    for c, (a, b) in enumerate(rows):
        bracket[c, EVENT_FUNCTION_KINDS - 1, EARLY], bracket[c, EVENT_FUNCTION_KINDS - 1, LATE] = (
            a,
            b,
        )
    touch = np.zeros((len(rows), TOUCH_WIDTH))
    touch[:, CLOSED] = 1.0
    return SimpleNamespace(touch=touch, length=2.0), bracket


def test_the_first_of_several_is_looked_for_just_behind_its_zero() -> None:
    """At 1.75, 1.25 and 1.5 s; the second falls by 4 a second: half of 1e-15 later."""
    system, bracket = bracket_of((3.0, -1.0), (1.0, -3.0), (1.0, -1.0), (0.5, 0.9))
    t = first_crossing(system, bracket, 1.0, 2.0)
    assert 0.0 < t - 1.25 < 2e-15
    system, bracket = bracket_of((3e-9, -1e-9), (1.0, 2.0))
    behind = first_crossing(system, bracket, 1.0, 2.0) - 1.75
    assert behind == pytest.approx(0.5 * LOCATED / 4e-9, rel=1e-3)
    system, bracket = bracket_of((1.0, -1e-16))  # just before the later instant
    assert 0.0 < 2.0 - first_crossing(system, bracket, 1.0, 2.0) < 1e-14
    end = 1.0 + 2.0**-51  # of two units in the last place the one in the middle
    system, bracket = bracket_of((1e-15, -1e-15))
    assert first_crossing(system, bracket, 1.0, end) == 1.0 + 2.0**-52


def test_what_a_bracket_takes_from_the_table_of_contacts() -> None:
    system, _ = bracket_of((0.0, 0.0), (0.0, 0.0))
    numbers = np.random.default_rng(3).normal(size=(6, 2, EVENT_FUNCTION_KINDS))
    before, slopes, levels, rates, early, _ = numbers
    touch = system.touch
    touch[:, EVENT_FUNCTIONS_BEFORE : EVENT_FUNCTIONS_BEFORE + EVENT_FUNCTION_KINDS] = before
    touch[:, EVENT_RATES_BEFORE : EVENT_RATES_BEFORE + EVENT_FUNCTION_KINDS] = slopes
    touch[:, EVENT_FUNCTIONS : EVENT_FUNCTIONS + EVENT_FUNCTION_KINDS] = levels
    touch[:, GAP_RATE_BEFORE], touch[:, GAP_RATE] = (0.4, 0.6), (0.8, 1.0)
    for late in (3.0, 2.0):
        bracket = begin_bracket(system, SimpleNamespace(t0=1.0, t1=3.0), rates, late)
        found = bracket[:, :EVENT_FUNCTION_KINDS]
        for column, wanted in (
            (EARLY, before),
            (BEGIN, before),
            (BEGIN + 1, slopes),
            (LATE, levels),
        ):
            np.testing.assert_array_equal(found[:, :, column], wanted)
        for column, wanted in ((END, levels), (END + 1, rates)):
            np.testing.assert_array_equal(
                found[:, :, column], wanted if late == 3.0 else np.full_like(wanted, FREE)
            )
        assert (bracket[:, EVENT_FUNCTION_KINDS, [BEGIN, END]] == [1.0, 3.0]).all()
        assert found[:, 0, EARLY + 1].tolist() == [0.2, 0.3]
        assert found[:, 0, LATE + 1].tolist() == [0.4, 0.5]
    touch[:, EVENT_FUNCTIONS : EVENT_FUNCTIONS + EVENT_FUNCTION_KINDS], touch[:, GAP_RATE] = (
        early,
        (1.2, 1.4),
    )
    note_event_functions(system, bracket, False)
    np.testing.assert_array_equal(bracket[:, :EVENT_FUNCTION_KINDS, EARLY], early)
    np.testing.assert_array_equal(bracket[:, :EVENT_FUNCTION_KINDS, LATE], levels)
    assert bracket[:, 0, EARLY + 1].tolist() == [0.6, 0.7]
