"""Each task asks its own function with what it is told, and gives what that has found."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rb_sim.contact.events import tasks
from rb_sim.contact.problem.event_workspace import IMPACT
from rb_sim.contact.problem.impacts import GOES_ON, NOTHING, STRUCK

T, Y, C = 2.5, np.arange(27.0), np.zeros(27)
FUNCTIONS = (
    "write_rows", "write_lines", "contact_accelerations", "settle", "begin_step", "take_before",
    "strike_in_rounds", "strike", "note_impulses", "apply_impulses", "choose", "may_share",
    "note_changes", "time_of_flights", "pass_through", "read_velocities",
    "answer_over", "workspace_left",
)  # fmt: skip
SYSTEM = SimpleNamespace()


def workspace(parted: tuple[int, ...] = (0, 0)) -> Any:
    return SimpleNamespace(
        parted=np.array(parted), impulses="impulses", free_accelerations=np.zeros(12)
    )


def answering(patch: pytest.MonkeyPatch, **answers: Any) -> list[Any]:
    """Let all functions of the module give these, or nothing; returns what they are asked."""
    asked: list[Any] = []

    def answer(name: str) -> Any:
        def found(*told: Any) -> Any:
            asked.append((name, *(x for x in told if not isinstance(x, np.ndarray))))
            return answers.get(name)

        return found

    for name in FUNCTIONS:
        if name != "pass_through" or name in answers:
            patch.setattr(tasks, name, answer(name))
    return asked


def done(task: int, *numbers: int, before: tuple[float, float] = (0.0, 0.0)) -> Any:
    """(status, what is found, whether the laws leave something open) of a task."""
    call = tasks.Tasks(SYSTEM, None, WORKSPACE)  # type: ignore[arg-type]
    call._numbers[1:] = before
    given: Any = (*numbers, *[0] * (3 - len(numbers)))
    return call(task, T, Y, given, C), call.found, call.undecided


WORKSPACE = workspace()


@pytest.mark.parametrize(
    ("task", "numbers", "calls"),
    [
        (tasks.WRITE, (), [("write_rows", SYSTEM, T)]),
        (tasks.LINES, (), [("write_lines", SYSTEM, T, WORKSPACE)]),
        (tasks.ACCELERATE, (), [("contact_accelerations", SYSTEM, T)]),
        (tasks.SETTLE, (), [("write_rows", SYSTEM, T), ("settle", SYSTEM, T)]),
        (tasks.BEGIN, (), [("begin_step", SYSTEM, T)]),
        (
            tasks.ARRIVE,
            (),
            [("take_before", SYSTEM, WORKSPACE), ("write_lines", SYSTEM, T, WORKSPACE)],
        ),
        (tasks.APPLY, (), [("apply_impulses", SYSTEM, WORKSPACE, T, "impulses")]),
        (tasks.NOTE, (7,), [("note_impulses", SYSTEM, WORKSPACE, T, 7)]),
    ],
)
def test_tasks_that_give_no_number(
    monkeypatch: pytest.MonkeyPatch, task: int, numbers: Any, calls: Any
) -> None:
    asked = answering(monkeypatch)
    assert done(task, *numbers) == (0, 0.0, False)
    assert asked == calls


def test_rounds_of_impacts_and_one_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """Impulses are noted of one that has struck."""
    asked = answering(monkeypatch, strike_in_rounds=(GOES_ON, 4))
    assert done(tasks.IMPACTS, 1, 9, 3)[:2] == (GOES_ON, 4.0)
    assert asked == [("strike_in_rounds", SYSTEM, WORKSPACE, T, 1, 9, 3)]
    for status in (STRUCK, NOTHING):
        asked = answering(monkeypatch, strike=status)
        assert done(tasks.STRIKE)[0] == status
        noted = [("note_impulses", SYSTEM, WORKSPACE, T, IMPACT)] if status == STRUCK else []
        assert asked == [("strike", SYSTEM, WORKSPACE, T, False), *noted]


@pytest.mark.parametrize(
    ("status", "shares", "undecided"), [(0, True, True), (0, False, False), (1, True, False)]
)
def test_the_choice_of_modes(
    monkeypatch: pytest.MonkeyPatch, status: int, shares: bool, undecided: bool
) -> None:
    asked = answering(monkeypatch, choose=status, may_share=shares)
    assert done(tasks.CHOOSE, 1, 3) == (status, 0.0, undecided)
    assert asked[0] == ("choose", SYSTEM, WORKSPACE, T, (1, 3))


@pytest.mark.parametrize("fixed", [0, 1])
def test_the_end_of_an_event(monkeypatch: pytest.MonkeyPatch, fixed: int) -> None:
    asked = answering(monkeypatch, time_of_flights=(0.25, 2), pass_through=(1, 0.5))
    assert done(tasks.LEAVE, fixed)[:2] == (2, 0.25)
    assert done(tasks.PASS, 6, fixed)[:2] == (1, 0.5)
    assert asked == [
        ("note_changes", SYSTEM, WORKSPACE, T),
        ("time_of_flights", SYSTEM, WORKSPACE, T, bool(fixed)),
        ("pass_through", SYSTEM, WORKSPACE, T, 6, bool(fixed)),
    ]


def test_a_leap(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its time stands where it gives what it finds."""
    asked = answering(monkeypatch, answer_over=3)
    assert done(tasks.OVER, before=(0.2, 0.0))[0] == 3
    assert asked == [("read_velocities", SYSTEM), ("answer_over", SYSTEM, WORKSPACE, 0.2)]
