"""Steps that end before a contact jams, or that have no solution as long as they are: by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rb_sim.contact.events import steps
from rb_sim.contact.events.next_event import (
    GRADE,
    cut_grid,
    is_none,
    nearly_stopped,
    slip_that_is_lost,
    slip_vanishes,
)
from rb_sim.contact.events.steps import before_jam, jam_that_is_due, kind_of, shorter_step
from rb_sim.contact.events.stick_transition import FAINT
from rb_sim.contact.grid_motion import start_grid
from rb_sim.integrate.layout import FINE, NOT_FINITE
from rb_sim.mechanics.contact.contact_bodies import (
    EVENT_KINDS,
    FREE,
    JAMMED,
    JAMS,
    NEAR_JAM,
    ROLL_ENDS,
    SLIP_ENDS,
)
from rb_sim.mechanics.contact.contact_kinematics import SLIDING, STUCK
from rb_sim.mechanics.contact.contact_table import (
    AT_JAM,
    AT_SLIP,
    CLOSED,
    EVENT_FUNCTIONS,
    EVENT_FUNCTIONS_BEFORE,
    EVENT_RATES_BEFORE,
    SLIDE,
    SLIP,
    STATIC,
    TOUCH_WIDTH,
)

LEVEL, SLOPE = EVENT_FUNCTIONS_BEFORE + AT_JAM, EVENT_RATES_BEFORE + AT_JAM


def slipping(*pivots: tuple[float, float]) -> Any:
    """Closed contacts whose effective pivots have these values and rates."""
    touch = np.zeros((len(pivots), TOUCH_WIDTH))
    touch[:, CLOSED] = 1.0
    touch[:, LEVEL], touch[:, SLOPE] = zip(*pivots, strict=True)
    return SimpleNamespace(touch=touch)


GRID = SimpleNamespace(t0=2.0, t1=3.0)


@pytest.mark.parametrize(
    ("pivots", "end"),
    [
        ([(0.2, -0.5)], 2.2),  # half of the time
        ([(0.2, -0.5), (0.2, -1.0)], 2.1),
        ([(0.2, -0.05)], 3.0),
        ([(0.2, 0.5), (0.0, -0.5), (-0.2, -0.5), (FREE, -1e301)], 3.0),
        ([(0.9 * JAMMED, -10.0 * JAMMED)], 2.135),  # the last step goes beyond
        ([(1.1 * JAMMED, -10.0 * JAMMED)], 2.055),
    ],
)
def test_steps_come_near_a_jam_and_the_last_goes_beyond(pivots: Any, end: float) -> None:
    system = slipping(*pivots)
    assert before_jam(system, GRID) == pytest.approx(end, rel=1e-14)
    system.touch[:, CLOSED] = 0.0
    assert before_jam(system, GRID) == 3.0


def test_a_jam_is_due_where_the_pivot_has_all_but_vanished() -> None:
    far, near = (1.1 * NEAR_JAM, -1.0), (0.9 * NEAR_JAM, -1.0)
    assert jam_that_is_due(slipping(far, far)) == -1
    assert jam_that_is_due(slipping(far, near, near)) == EVENT_KINDS + JAMS
    assert kind_of(EVENT_KINDS + JAMS) == (1, JAMS) and kind_of(JAMS) == (0, JAMS)
    system = slipping(near)
    system.touch[0, CLOSED] = 0.0
    assert jam_that_is_due(system) == -1


@pytest.mark.parametrize(("solved", "code"), [(0, 7), (1, -1), (3, -1), (19, -1), (99, -1)])
def test_a_step_without_a_solution_is_taken_shorter(
    monkeypatch: pytest.MonkeyPatch, solved: int, code: int
) -> None:
    """By a factor more each time, up to nineteen; where a slip has all but stopped at its start,
    that is the event."""
    tried: list[float] = []
    asked: list[Any] = []

    def branch(method: Any, system: Any, grid: Any, t: float, work: Any, y: Any, c: Any) -> None:
        tried.append(t)
        y[:] = 5.0 if len(tried) == solved else np.nan

    monkeypatch.setattr(steps, "branch", branch)
    monkeypatch.setattr(steps, "nearly_stopped", lambda system: code)
    monkeypatch.setattr(steps, "contact_accelerations", lambda *of: asked.append(of))
    monkeypatch.setattr(steps, "cut_grid", lambda grid, t, y, c, h: (t, y.copy(), c.copy(), h))
    grid = start_grid(2.0, np.array([1.0, 2.0]), np.array([3.0, 4.0]))._replace(t1=3.0, h=0.125)
    status, found, (t, y, c, h) = shorter_step(None, "system", grid, None)
    assert [of[:2] for of in asked] == [("system", 2.0)] and found == code and h == 0.125
    if solved == 0:
        assert (status, t) == (FINE, 2.0) and not tried
        assert y.tolist() == [1.0, 2.0] and c.tolist() == [3.0, 4.0]
        return
    assert len(tried) == min(solved, 19)
    np.testing.assert_allclose(tried, 2.0 + 1.0 / float(GRADE) ** np.arange(1, len(tried) + 1))
    assert status == (FINE if solved < 20 else NOT_FINITE) and t == tried[-1]


@pytest.mark.parametrize(("part", "told"), [(0.99, True), (1.01, False)])
def test_a_slip_that_is_none_has_ended(part: float, told: bool) -> None:
    """1e-10 of the scene's speed, of what is closed, slides and has a law of rest."""
    system = slipping((FREE, 0.0), (FREE, 0.0))
    system.speed, touch = 2.0, system.touch
    touch[:, SLIDE], touch[:, STATIC] = SLIDING, 0.5
    touch[0, SLIP], touch[1, SLIP + 1] = 1.0, part * 2e-10
    code = EVENT_KINDS + SLIP_ENDS if told else -1
    assert nearly_stopped(system) == code
    for column, value in ((CLOSED, 0.0), (SLIDE, STUCK), (STATIC, 0.0)):
        kept, touch[1, column] = touch[1, column], value
        assert nearly_stopped(system) == -1
        touch[1, column] = kept


def test_a_slip_that_was_to_fall_and_did_not_is_lost() -> None:
    """By half of what its rate says of the step, where it is as slow as what is still."""

    def lost(level: float, rate: float = -0.2, slip: float = 1e-3, **columns: float) -> int:
        system = slipping((FREE, 0.0), (FREE, 0.0))
        system.still, system.creep, touch = 1e-3, 0.0, system.touch
        touch[:, SLIDE], touch[:, STATIC], touch[0, SLIP] = SLIDING, 0.5, 1.0
        touch[1, SLIP + 2], touch[1, EVENT_FUNCTIONS_BEFORE + AT_SLIP] = slip, 0.3
        touch[1, EVENT_FUNCTIONS + AT_SLIP], touch[1, EVENT_RATES_BEFORE + AT_SLIP] = level, rate
        for name, value in columns.items():
            touch[1, {"closed": CLOSED, "slide": SLIDE, "static": STATIC}[name]] = value
        return slip_that_is_lost(system, 0.5)

    assert lost(0.3 - 0.049) == EVENT_KINDS + SLIP_ENDS and lost(0.3 - 0.051) == -1
    assert lost(0.3, slip=1.01e-3) == lost(0.3, 0.2) == lost(0.31, -0.9 * FAINT) == -1
    assert lost(0.3, closed=0.0) == lost(0.3, slide=STUCK) == lost(0.3, static=0.0) == -1


def test_a_grid_is_cut_where_its_last_step_ends() -> None:
    """Fixed steps go on from there: their origin moves with the end."""
    grid = start_grid(2.0, np.zeros(2))._replace(t1=3.0, steps=4, rejected=2, h=0.5, origin=1.0)
    y, c = np.array([1.0, 2.0]), np.array([3.0, 4.0])
    cut = cut_grid(grid, 2.75, y, c, 0.125)
    assert (cut.origin, cut.steps, cut.rejected, cut.t0, cut.t1, cut.h) == (
        0.75,
        4,
        2,
        2.0,
        2.75,
        0.125,
    )
    assert (cut.y1 == y).all() and (cut.c1 == c).all() and cut.y1 is not y and cut.c1 is not c
    assert is_none(0.9e-15, 1.0) and not is_none(1.1e-15, 1.0) and is_none(0.9e-14, -10.0)
    assert not is_none(1e-30, 0.0)
    kinds = [slip_vanishes(EVENT_KINDS + kind) for kind in (SLIP_ENDS, ROLL_ENDS, JAMS)]
    assert kinds == [True, True, False]
