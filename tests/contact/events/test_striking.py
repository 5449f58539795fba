"""What ends at an instant, step by step on instants by hand: rounds of impacts, jams, leaps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rb_sim.base.errors import SimulationError, StepTooLargeError
from rb_sim.contact.events import impact_handling, tasks
from rb_sim.contact.events.impact_handling import StrikingMotion
from rb_sim.contact.problem.bounces import EVENTS_AT_ONCE
from rb_sim.contact.problem.event_workspace import JAMS, LEAPS
from rb_sim.contact.problem.impacts import ENDLESS, GOES_ON, NO_IMPULSES, NOTHING, OVERFLOWN
from rb_sim.mechanics.contact.contact_table import CLOSED, TOUCH_WIDTH

T = 3.0
LAST = EVENTS_AT_ONCE
NAMES = ("a", "b", "c")
Told = list[tuple[int, tuple[int, int, int]]]


class Answers:
    """Tasks that give these statuses and numbers in turn; what was asked is kept."""

    def __init__(self, *answers: tuple[int, float]) -> None:
        self.answers, self.found = list(answers), 0.0
        self.asked: Told = []

    def __call__(self, task: int, t: float, y: Any, numbers: Any = (0, 0, 0)) -> int:
        assert t == T and y.tolist() == [5.0]
        self.asked.append((task, numbers))
        if task == tasks.NOTE:
            return 0
        status, self.found = self.answers.pop(0)
        return status


class Motion(StrikingMotion):
    """One that stands at an instant; what is no part of it is left out."""

    _call: Any = None  # type: ignore[assignment]

    def __init__(self, *answers: tuple[int, float], **more: Any) -> None:
        self._call, self.rims = Answers(*answers), more.get("rims", ())
        self.names, self.journal = NAMES, []
        statics = more.get("statics", (0.3, 0.3, 0.3))
        self.laws = tuple(SimpleNamespace(static=s) for s in statics)  # type: ignore[assignment]
        self.compiled: Any = SimpleNamespace(one_by_one=more.get("one_by_one", False))
        self.method = SimpleNamespace(tolerance=more.get("tolerance", 1e-6), step=0.01)
        touch = np.zeros((3, TOUCH_WIDTH))
        touch[:, CLOSED] = more.get("closed", (0.0, 1.0, 1.0))
        self.system: Any = SimpleNamespace(touch=touch, still=1e-4)
        self._journal: Any = SimpleNamespace(
            take=lambda workspace: self.journal.append("taken"),
            note=lambda *what: self.journal.append(what),
        )

    def _event(self) -> None:
        raise NotImplementedError


class At:
    """An instant of three contacts."""

    def __init__(self, **more: Any) -> None:
        self.t, self.y = T, np.array([5.0])
        self.workspace = SimpleNamespace(plastic=np.zeros(3), together=np.ones(3))
        self.pivots = more.get("pivots", (0.0, 0.0, 0.0))
        self._touching, self.slip = more.get("touching", [1, 2]), more.get("slip", 1.0)
        self.applied: list[Any] = []

    def effective_pivot(self, i: int) -> float:
        return float(self.pivots[i])

    def touching(self) -> Sequence[int]:
        return self._touching

    def slip_speed(self, c: int) -> float:
        return self.slip + c * 0.0

    def apply(self, x: Any) -> None:
        self.applied.append(x)


@pytest.fixture(autouse=True)
def aimed(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The rims that aim before a round of impacts."""
    found: list[Any] = []
    monkeypatch.setattr(impact_handling, "aim_where_it_turns", lambda at, rims: found.append(rims))
    return found


def struck(motion: Motion) -> list[tuple[int, int, int]]:
    motion._strike(At())  # type: ignore[arg-type]
    assert {task for task, _ in motion._call.asked} == {tasks.IMPACTS}
    assert motion.journal == ["taken"] * len(motion._call.asked)
    return [numbers for _, numbers in motion._call.asked]


def test_rounds_of_impacts_go_on_until_nothing_approaches() -> None:
    """All at once; where impacts are single, 20 more for each contact."""
    assert struck(Motion((NOTHING, 2.0))) == [(0, LAST, 0)]
    assert struck(Motion((GOES_ON, 2.0), (NOTHING, 5.0))) == [(0, LAST, 0), (2, LAST, 0)]
    assert struck(Motion((NOTHING, 2.0), one_by_one=True)) == [(0, LAST + 60, 60)]


def test_rims_aim_anew_before_each_round(aimed: list[Any]) -> None:
    rounds = struck(Motion((ENDLESS, 1.0), (ENDLESS, 2.0), (NOTHING, 3.0), rims=(4,)))
    assert rounds == [(0, 1, 0), (1, 2, 0), (2, 3, 0)] and aimed == [(4,)] * 3
    last = struck(Motion((ENDLESS, LAST - 1.0), (NOTHING, LAST), rims=(4,)))
    assert last == [(0, 1, 0), (LAST - 1, LAST, 0)]


def test_impacts_without_end_or_impulses_are_told() -> None:
    for kind, more in ((SimulationError, {}), (StepTooLargeError, {"tolerance": 0.0})):
        for rims in ((), (4,)):
            with pytest.raises(SimulationError, match="endless impacts at t = 3 s") as error:
                struck(Motion((ENDLESS, float(LAST)), rims=rims, **more))
            assert type(error.value) is kind
    with pytest.raises(SimulationError, match="no impulses satisfy the laws"):
        struck(Motion((NO_IMPULSES, 1.0)))
    with pytest.raises(Exception, match=r"finite|overflow"):
        struck(Motion((OVERFLOWN, 1.0)))


def test_an_impact_without_rebound_stops_at_once() -> None:
    for status in (tasks.STRUCK, NOTHING, ENDLESS):
        motion, at = Motion((status, 0.0)), At()
        motion._stop_at_once(at)  # type: ignore[arg-type]
        assert motion._call.asked == [(tasks.STRIKE, (0, 0, 0))] and motion.journal == ["taken"]
        assert at.workspace.plastic.tolist() == [1, 1, 1] and at.workspace.together.tolist() == [
            0,
            0,
            0,
        ]
    with pytest.raises(SimulationError, match="no impulses"):
        Motion((NO_IMPULSES, 0.0))._stop_at_once(At())  # type: ignore[arg-type]


@pytest.fixture
def jams(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the functions give that a jam asks; and what they were asked."""
    given: dict[str, Any] = {"impulses": {}, "lifted": 1, "rough": [], "leaps": None, "asked": []}

    def impulses(at: Any, i: int) -> Any:
        given["asked"].append(i)
        return given["impulses"].get(i)

    def leapt(self: Any, at: Any, c: int) -> bool:
        given["asked"].append(("leap", c))
        return bool(given["leaps"])

    monkeypatch.setattr(impact_handling, "impulses_of_jam", impulses)
    monkeypatch.setattr(impact_handling, "least_lifted", lambda at: given["lifted"])
    monkeypatch.setattr(
        impact_handling, "refuse_rough", lambda at, c, names: given["rough"].append(c)
    )
    monkeypatch.setattr(Motion, "_leapt_over", leapt)
    return given


@pytest.mark.parametrize(("c", "which"), [(None, 2), (1, 1), (2, 2)])
def test_a_slip_that_jams_stops_in_an_impact(jams: Any, c: int | None, which: int) -> None:
    """That of the contact, or of the first that is closed and near to a jam."""
    jams["impulses"] = {i: f"x{i}" for i in range(3)}
    pivots = (0.0, 2e-3 if c is None else 0.9e-3, 0.9e-3)
    motion, at = Motion(), At(pivots=pivots)
    motion._jam(at, c)  # type: ignore[arg-type]
    assert jams["asked"] == [which] and at.applied == [f"x{which}"]
    assert motion._call.asked == [(tasks.NOTE, (JAMS, 0, 0))] and motion.journal == ["taken"]


def test_a_jam_without_impulses_is_leapt_over_where_nothing_slips(jams: Any) -> None:
    """Contacts that stick on what gives way touch nothing rigidly: the first of those is told."""
    jams["leaps"] = True
    for c, at, leapt in (
        (None, At(), 1), (2, At(slip=0.9e-4), 1), (None, At(touching=[]), 1),
        (1, At(touching=[2], slip=1e-4), 2),
    ):  # fmt: skip
        jams["asked"].clear()
        Motion()._jam(at, c)  # type: ignore[arg-type]
        assert jams["asked"] == [1 if c is None else c, ("leap", leapt)]
    for c, slip in ((None, 1.0), (2, 0.0)):  # nothing is closed
        with pytest.raises(SimulationError, match="Painleve's paradox at t = 3 s: no force of b"):
            Motion(closed=(0, 0, 0))._jam(At(touching=[], slip=slip), None if c is None else 1)  # type: ignore[arg-type]


def test_a_jam_that_nothing_ends_is_refused(jams: Any) -> None:
    jams["leaps"] = False
    with pytest.raises(SimulationError, match="no force of b satisfies"):
        Motion()._jam(At(), None)  # type: ignore[arg-type]
    with pytest.raises(SimulationError, match="no force of c satisfies the friction law"):
        Motion()._jam(At(), 2)  # type: ignore[arg-type]
    assert ("leap", 1) not in jams["asked"][-1:]  # one that slips is not leapt over
    jams["lifted"] = None
    with pytest.raises(SimulationError, match="no force satisfies the friction law"):
        Motion()._jam(At(), None)  # type: ignore[arg-type]
    with pytest.raises(
        SimulationError, match="compliant contacts \\(b and others\\) that hardly slip"
    ):
        Motion()._jam(At(touching=[]), None)  # type: ignore[arg-type]
    with pytest.raises(SimulationError, match="no force of c satisfies the friction law"):
        Motion()._jam(At(touching=[], slip=0.0), 2)  # type: ignore[arg-type]


def test_what_never_slips_and_jams_is_told_as_rough(jams: Any) -> None:
    jams["leaps"] = True
    for c, touching, told in ((None, [1, 2], [2]), (None, [1], []), (2, [1, 2], [])):
        jams["rough"].clear()
        at = At(touching=touching, slip=0.0)
        Motion(statics=(0.3, 0.3, math.inf))._jam(at, c)  # type: ignore[arg-type]
        assert jams["rough"] == told


@pytest.mark.parametrize("possible", [True, False])
def test_a_leap_is_noted_where_it_began(monkeypatch: pytest.MonkeyPatch, possible: bool) -> None:
    """At the instant before; the next one in such short time is longer."""
    motion: Any = Motion()
    at: Any = At()
    told: list[Any] = []
    motion._chatter = SimpleNamespace(
        length_of_leap=lambda t: 0.25 if t == T else 9.0, leapt=lambda *how: told.append(how)
    )

    def leap(at: Any, length: float) -> Any:
        at.t += length
        return at if possible else None

    monkeypatch.setattr(impact_handling, "leap", leap)
    monkeypatch.setattr(impact_handling, "bring_back", lambda at: told.append("back"))
    assert motion._leapt_over(at, 2) is possible
    assert motion.journal == ([(T, 2, LEAPS)] if possible else [])
    assert told == (["back", (T + 0.25, 0.25)] if possible else [])
