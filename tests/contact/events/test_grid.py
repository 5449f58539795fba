"""The grid of steps, on x' = f whose steps are exact: where steps end, what is refused, states
inside a step."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from rb_sim.contact.events import grid as steps
from rb_sim.contact.grid_motion import Grid, start_grid
from rb_sim.integrate.layout import DY, FINE, NOT_FINITE, STEP_UNDERFLOW

SLOPE = np.array([2.0, -3.0])
FIXED = steps.Stepping(None, None, (0.25, 0.0, 0.25, 4.0, 0.0), 0, 0)
TOLERANCE = 1e-6
LEAST = [0.0]
"""Length of a step that is short enough for rims that hardly miss flat."""
ADAPTIVE = steps.Stepping(None, None, (0.25, TOLERANCE, 10.0, 4.0, 0.0), 0, 0)


@pytest.fixture(autouse=True)
def exact(monkeypatch: pytest.MonkeyPatch) -> list[tuple[float, float]]:
    """Steps that are exact; their error is estimated as (h/2)^5 of the tolerance, and steps longer
    than 1 s end nowhere. Returns those that are tried."""
    tried: list[tuple[float, float]] = []

    def increment(method: Any, system: Any, t: float, y: Any, h: float, work: np.ndarray) -> float:
        tried.append((t, h))
        work[DY, :2] = SLOPE * h if h <= 1.0 or method is ADAPTIVE else math.nan
        return TOLERANCE * (0.5 * h) ** 5

    def settle(system: list[float], t: float, y: np.ndarray) -> None:
        system.append(t)

    monkeypatch.setattr(steps, "increment", increment)
    monkeypatch.setattr(steps, "settle", settle)
    monkeypatch.setattr(steps, "step_of_swings", lambda system: LEAST[0])
    LEAST[0] = 0.0
    return tried


def advance(method: Any, grid: Grid, stop: float) -> tuple[Grid, int, list[float]]:
    settled: list[float] = []
    after, status = steps.advance_grid(method, settled, grid, stop, np.zeros((DY + 1, 2)))
    return after, status, settled


def test_fixed_steps_end_at_multiples_and_at_the_stop(exact: list[tuple[float, float]]) -> None:
    """Of the step from where the grid starts: rounding does not add up."""
    grid = start_grid(0.1, np.array([1.0, 5.0]))
    for k in range(1, 4):
        grid, status, settled = advance(FIXED, grid, 0.95)
        assert status == FINE and (grid.steps, grid.rejected, grid.h) == (k, 0, 0.0)
        assert grid.t1 == 0.1 + 0.25 * k and settled == [grid.t1]
        assert exact[-1] == (grid.t0, 0.25) and grid.t0 == 0.1 + 0.25 * (k - 1)
        np.testing.assert_allclose(grid.y1, [1.0 + 2.0 * 0.25 * k, 5.0 - 3.0 * 0.25 * k])
        np.testing.assert_allclose(grid.y1 - grid.y0, SLOPE * 0.25)
    grid, _, _ = advance(FIXED, grid, 0.95)
    assert grid.t1 == 0.95 and exact[-1] == (grid.t0, pytest.approx(0.1))


def test_adaptive_steps_are_refused_and_grow(exact: list[tuple[float, float]]) -> None:
    """The first is cut until its error is within; then each is as its error tells, 2 s at most; one
    that the stop has cut short says nothing of the next."""
    grid, status, _ = advance(ADAPTIVE, start_grid(1.0, np.zeros(2)), 100.0)
    assert status == FINE and grid.rejected == 0
    h = grid.t1 - grid.t0
    assert 0.2 < h <= 2.0 and exact[0] == (1.0, 10.0)
    np.testing.assert_allclose(grid.y1, SLOPE * h)
    assert h < grid.h < 2.5
    forced, _, _ = advance(ADAPTIVE, grid._replace(h=8.0), 100.0)
    assert forced.rejected == 1 and forced.t1 - forced.t0 == pytest.approx(0.2 * 8.0)
    assert forced.h <= forced.t1 - forced.t0
    assert forced.t0 == grid.t1 and forced.steps == 2
    np.testing.assert_allclose(forced.y1, SLOPE * (forced.t1 - 1.0))
    cut, _, _ = advance(ADAPTIVE, forced._replace(h=1.5), forced.t1 + 0.01)
    assert cut.t1 == forced.t1 + 0.01 and cut.h >= 1.5


def test_a_step_that_comes_to_nothing_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(steps, "increment", lambda *arguments: 1.0)
    grid, status, _ = advance(ADAPTIVE, start_grid(1.0, np.zeros(2))._replace(h=0.1), 2.0)
    assert status == STEP_UNDERFLOW and grid.t1 - grid.t0 < 1e-13 and grid.rejected > 10
    lost = start_grid(1.0, np.array([0.0, math.nan]))
    assert advance(FIXED, lost, 2.0)[1] == NOT_FINITE
    assert not steps.finite(lost.y1) and not steps.finite(np.array([1.0, math.inf]))
    assert steps.finite(np.array([1.0, 2.0]))


def test_no_step_is_shorter_than_rounding_asks_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever its error, but where it comes to nothing that is finite; up to twice that length."""
    tried: list[float] = []
    top = [0.0]

    def increment(method: Any, system: Any, t: float, y: Any, h: float, work: np.ndarray) -> float:
        tried.append(h)
        return math.nan if h > top[0] else 1.0

    monkeypatch.setattr(steps, "increment", increment)
    for finite, least, length in ((1.0, 0.01, 0.01), (1.0, 0.06, 0.1), (0.004, 0.01, None)):
        top[0], LEAST[0] = finite, least
        grid, status, _ = advance(ADAPTIVE, start_grid(1.0, np.zeros(2))._replace(h=0.1), 2.0)
        assert status == (FINE if length else STEP_UNDERFLOW)
        assert min(tried) == pytest.approx(length or 0.0, abs=1e-13)
        tried.clear()
    LEAST[0] = 0.5
    assert advance(ADAPTIVE, start_grid(1.0, np.zeros(2))._replace(h=0.1), 1.3)[0].t1 == 1.3


def test_sums_are_compensated() -> None:
    """A thousand of 1e-11 on 1e6, of which each alone is rounded away."""
    y, c, work = np.array([1e6, 0.0]), np.zeros(2), np.zeros((DY + 1, 2))
    work[DY] = 1e-11, 0.5
    for _ in range(1000):
        steps.add_increment(y, c, work)
    assert y[0] + c[0] - 1e6 == pytest.approx(1e-8, rel=1e-2) and y[1] == 500.0


@pytest.mark.parametrize(("span", "parts"), [(0.8, 1), (1.6, 2), (3.2, 4), (50.0, 64)])
def test_states_inside_a_step_by_as_many_parts_as_it_takes(
    exact: list[tuple[float, float]], span: float, parts: int
) -> None:
    """One, two, four ... up to 64, of a method that has no solution in steps beyond 1 s."""
    start, end = np.array([1.0, 2.0]), np.array([7.0, 8.0])
    grid = start_grid(2.0, start)._replace(t1=90.0, y1=end)
    settled: list[float] = []
    work = np.zeros((DY + 1, 2))
    found = steps.state_at(FIXED, settled, grid, 2.0 + span, work)
    np.testing.assert_allclose(found, start + span * SLOPE, rtol=1e-13)
    assert found is grid.y and (grid.y0 == start).all()
    tried = [(2.0 + k * span / parts, span / parts) for k in range(parts)]
    np.testing.assert_allclose(exact[-parts:], tried, rtol=1e-14)
    assert settled[-1] == pytest.approx(2.0 + span) and len(settled) == 2 * parts - 1
    exact.clear()
    assert (steps.state_at(FIXED, settled, grid, 90.0 * (1.0 - 1e-16), work) == end).all()
    assert (steps.state_at(FIXED, settled, grid, 2.0 * (1.0 + 2e-16), work) == start).all()
    assert not exact and found is grid.y
    assert not steps.finite(steps.state_at(FIXED, settled, grid, 80.0, work))
