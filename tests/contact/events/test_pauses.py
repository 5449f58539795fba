"""Pauses and events on the way to samples, of a loop whose answers are told by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from rb_sim.base.errors import SimulationError
from rb_sim.contact.events import stepping
from rb_sim.contact.events.event_motion import ContactMotion
from rb_sim.contact.events.steps import EVENT
from rb_sim.contact.events.tasks import BEGIN
from rb_sim.integrate.layout import FINE, NOT_FINITE, UNFINISHED
from tests.contact.events.test_stepping import motion


class Told(ContactMotion):
    """One whose loop and events are told here."""

    asked: list[Any]

    def _event(self) -> None:
        self.asked.append("event")
        self._due = -1

    def _refuse_to_stall(self) -> None:
        self.asked.append("stall")

    def _refuse_to_creep(self) -> None:
        self.asked.append("creep")

    def _pass_pause(self) -> None:
        self.asked.append("pause")
        self._pause = math.inf


def carried(patch: pytest.MonkeyPatch, answers: Any, pause: float = math.inf) -> Any:
    """A motion whose loop gives (status, times reached) in turn, and tells what it is asked."""
    found = motion()
    found.__class__, found.asked, found._pause = Told, [], pause
    found.watch = lambda: found.asked.append("watch")

    def record(*told: Any) -> Any:
        times, upto, sampling, rows = told[3:7]
        found.asked.append((times.tolist(), upto, sampling, rows[:, 0].tolist()))
        status, reached = answers.pop(0)
        return found._grid, status, reached, 3 if status == EVENT else -1

    patch.setattr(stepping, "record_contacts", record)
    return found


TIMES = np.array([1.0, 2.0, 3.0])


def test_a_run_goes_on_after_each_event(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the samples that are left, in the rows that are left."""
    answers = [(EVENT, 1), (EVENT, 0), (UNFINISHED, 1), (FINE, 1)]
    found = carried(monkeypatch, answers)
    found._advance(TIMES, math.inf, np.array([[7.0], [8.0], [9.0]]))
    assert found.asked == [
        ([1.0, 2.0, 3.0], math.inf, True, [7.0, 8.0, 9.0]), "event",
        ([2.0, 3.0], math.inf, True, [8.0, 9.0]), "event",
        ([2.0, 3.0], math.inf, True, [8.0, 9.0]), "watch", "stall", "creep",
        ([3.0], math.inf, True, [9.0]),
    ]  # fmt: skip
    assert found.time == 3.0 and found._due == -1


def test_a_pause_comes_before_samples_beyond_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is sampled on the way to it; one that lies on it is."""
    found = carried(monkeypatch, [(FINE, 1), (FINE, 2)], pause=0.5)
    found._advance(TIMES[:2], 9.0, np.array([[7.0], [8.0]]))
    assert found.asked == [([0.5], 0.5, False, []), "pause", ([1.0, 2.0], 9.0, True, [7.0, 8.0])]
    found = carried(monkeypatch, [(FINE, 2), (FINE, 1), (FINE, 1)], pause=2.0)
    found._advance(TIMES, 3.0, None)
    assert found.asked[0] == ([1.0, 2.0], 2.0, False, []) and found.asked[1:3] == [
        ([2.0], 2.0, False, []), "pause"]  # fmt: skip
    assert found.asked[3] == ([3.0], 3.0, False, []) and found.time == 3.0


def test_an_event_on_the_way_to_a_pause(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is dealt with before the pause is passed, which an unfinished piece does not pass."""
    found = carried(monkeypatch, [(EVENT, 0), (UNFINISHED, 0), (FINE, 1), (FINE, 1)], pause=0.5)
    found._advance(TIMES[:1], 9.0, None)
    names = [told for told in found.asked if isinstance(told, str)]
    assert names == ["event", "watch", "stall", "creep", "pause"]


def test_a_loop_that_fails_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    found = carried(monkeypatch, [(NOT_FINITE, 1)])
    with pytest.raises(SimulationError, match="the equations are singular"):
        found._advance(TIMES, math.inf, None)
    assert found.time == 1.0


@pytest.mark.parametrize(("due", "goes_on"), [(-1, True), (0, False), (5, False)])
def test_a_pause_is_passed_on_a_new_grid(
    monkeypatch: pytest.MonkeyPatch, due: int, goes_on: bool
) -> None:
    """Unless an event is due."""
    found: Any = motion()
    begun: list[Any] = []
    monkeypatch.setattr(ContactMotion, "_continue_from", lambda self, *at: begun.append(at))
    found._due, found._pause = due, 0.5
    found._pass_pause()
    assert found._pause == math.inf
    assert begun == ([(found._grid.t1, found._grid.y1)] if goes_on else [])


def test_a_new_grid_begins_where_an_event_was() -> None:
    """With the step to try next that is given, or that of before; tables are those of its start."""
    found = motion()
    asked: list[Any] = []
    found.__class__ = type("Asked", (ContactMotion,), {
        "_call": lambda self, task, t, y, c: asked.append((task, t, c))})  # fmt: skip
    y = np.array(found.compiled.y)
    y[2] += 0.5
    for h, wanted in ((None, 0.125), (0.25, 0.25)):
        found._grid = found._grid._replace(h=0.125)
        found._continue_from(3.0, y, h)
        assert (found._grid.t1, found._grid.h, found._begun) == (3.0, wanted, 3.0)
        assert np.array_equal(found._grid.y1, y)
        ((task, t, c),) = asked
        assert (task, t) == (BEGIN, 3.0) and c is found._grid.c1
        asked.clear()
