"""What a step misses beside its halves, added up by body, on motions by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rb_sim.contact.problem import order as looks
from rb_sim.contact.problem.order import (
    LARGEST,
    LENGTHS,
    MISSED_WIDTH,
    SUM,
    WAY,
    WORST_SHARE,
    WORST_TIME,
)
from rb_sim.integrate.layout import AT, DY

STEP = np.zeros((2, 13))
STEP[0, 0], STEP[0, 7], STEP[1, 9] = 0.25, 1.0, 0.5
"""What each half of a step adds."""


def noted(
    monkeypatch: pytest.MonkeyPatch, end: dict[tuple[int, int], float], times: int = 1,
    to_come: float = 0.0, lost: bool = False, before: float = 2.0, weight: float = 3.0,
) -> tuple[np.ndarray, np.ndarray, list[Any]]:  # fmt: skip
    """The table of two bodies after a step from 4 s to 6 s that ends so much beside its halves."""
    asked: list[Any] = []

    def increment(method: Any, system: Any, t: float, y: Any, h: float, work: Any) -> float:
        asked.append((t, h, float(system.touch[0, 0])))
        work[DY, :26] = STEP.ravel() if not lost else np.nan
        return 0.0

    def rates(
        method: Any, system: Any, t: float, y: Any, other: Any, mixed: Any, work: Any
    ) -> None:
        asked.append((t, float(y[7] - other[7]), float(system.touch[0, 0])))
        work[DY], work[AT] = 0.0, 0.0
        work[DY, 7] = to_come

    monkeypatch.setattr(looks, "increment", increment)
    monkeypatch.setattr(looks, "settle", lambda system, t, y: asked.append(t))
    monkeypatch.setattr(looks, "rates_of_both", rates)
    monkeypatch.setattr(looks, "pointer", lambda table: table.ravel())
    monkeypatch.setattr(looks, "part", lambda table, at: table[at:])
    y0 = np.zeros((2, 13))
    y0[0, 7] = before
    y1 = y0 + 2.0 * STEP
    for place, change in end.items():
        y1[place] += change
    touch = np.array([[8.0]])
    system = SimpleNamespace(touch=touch, length=5.0, speed=1.0, bodies=np.zeros((2, 1)))
    grid = SimpleNamespace(t0=4.0, t1=6.0, y0=y0.ravel(), y1=y1.ravel(), c0=np.zeros(26))
    table = np.zeros((2, MISSED_WIDTH))
    table[:, LENGTHS : LENGTHS + 9] = np.eye(3).ravel()
    work = np.zeros((max(AT, DY) + 1, 26))
    for _ in range(times):
        looks.note_missed(None, system, grid, np.array([[7.0]]), work, table, weight)
    assert touch[0, 0] == 8.0 and (y0.ravel() == grid.y0).all()
    return table, y1, asked


def test_a_step_is_taken_in_halves_from_the_table_before_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _, _, asked = noted(monkeypatch, {(0, 7): 0.5})
    assert asked == [(4.0, 1.0, 7.0), 5.0, (5.0, 1.0, 7.0), 6.0, (6.0, 0.5, 7.0)]


def test_what_it_misses_adds_up_by_body(monkeypatch: pytest.MonkeyPatch) -> None:
    """0.5 m/s beside 4 m/s and a change of 2 m/s, 0.1 m; the other body nothing; of steps that
    stand for three each."""
    table, _, _ = noted(monkeypatch, {(0, 7): 0.5, (0, 1): 0.1}, 2)
    assert table[0, SUM] == pytest.approx(3.0) and table[0, WAY] == pytest.approx(0.6)
    assert table[0, LARGEST] == pytest.approx(4.5)
    assert table[0, WORST_SHARE] == pytest.approx(0.25) and table[0, WORST_TIME] == 4.0
    assert table[1, LARGEST] == pytest.approx(1.0)
    assert not table[1, [SUM, WAY, WORST_SHARE, WORST_TIME]].any()


def test_what_comes_of_its_places_counts_where_it_is_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """A rate of 0.4 m/s^2 over the whole step of 2 s."""
    table, _, _ = noted(monkeypatch, {(0, 7): 0.5}, to_come=0.4)
    assert table[0, SUM] == pytest.approx(3.0 * 0.8)
    table, _, _ = noted(monkeypatch, {(0, 7): 0.5}, to_come=0.2)
    assert table[0, SUM] == pytest.approx(3.0 * 0.5)


@pytest.mark.parametrize(("change", "told"), [(0.0119, False), (0.0121, True)])
def test_a_share_counts_where_the_step_misses_some_of_the_speed(
    monkeypatch: pytest.MonkeyPatch, change: float, told: bool
) -> None:
    """More than 3e-3 of 4 m/s, or of the scene's 1 m/s."""
    table, _, _ = noted(monkeypatch, {(0, 8): change})
    assert bool(table[0, WORST_SHARE] > 0.0) is told
    table, _, _ = noted(monkeypatch, {(1, 8): 0.25 * change}, before=0.0)
    assert table[1, WORST_SHARE] == (pytest.approx(0.25 * change) if told else 0.0)


def test_what_ends_nowhere_says_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    table, _, asked = noted(monkeypatch, {(0, 7): 0.5}, lost=True)
    assert not table[:, :LENGTHS].any() and len(asked) == 4


def test_rates_at_both_places(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the velocities of one state, and with those at the places of the other."""
    y, other, work = np.arange(27.0), 100.0 + np.arange(27.0), np.zeros((max(AT, DY) + 1, 27))
    asked = []

    def law(rate: str, t: float, at: Any, system: str, out: Any) -> None:
        asked.append((rate, t, system))
        out[:27] = at[:27]

    monkeypatch.setattr(looks, "call_law", law)
    monkeypatch.setattr(looks, "pointer", lambda table: table.reshape(-1))
    monkeypatch.setattr(looks, "part", lambda table, at: table[at:])
    monkeypatch.setattr(looks, "address", lambda system: "there")
    system = SimpleNamespace(bodies=np.zeros((2, 1)))
    looks.rates_of_both(SimpleNamespace(rate="law"), system, 3.0, y, other, np.zeros(27), work)
    assert asked == [("law", 3.0, "there")] * 2
    assert (work[DY] == y).all() and (y == np.arange(27.0)).all()
    places = [*range(7), *range(13, 20)]
    assert (work[AT, places] == other[places]).all()
    rest = sorted(set(range(27)) - set(places))
    assert (work[AT, rest] == y[rest]).all()
