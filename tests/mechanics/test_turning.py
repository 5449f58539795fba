"""How far coordinates go before they turn, of motions whose way is known in closed form.

Whole runs whose errors are held to such ways are in test_small_motions, test_small_swings and
test_relative_motions.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.mechanics.error_scales import (
    LEAST,
    SMALL,
    Group,
    Small,
    Turn,
    ends,
    first_step,
    itself,
    rate_seen,
    sizes,
    step,
    turns_of,
    ways_along,
    ways_of,
    whole_body,
)

ROUGH = 0.15
"""Relative: ways are looked at for their size."""
FREQUENCY, AMPLITUDE = 10.0, 1e-6
PLACE = Group(slice(0, 2), slice(2, 4))


def swing(t: float, y: np.ndarray) -> np.ndarray:
    """Two directions of one spring, about (0.5, 0)."""
    return np.concatenate([y[2:], -(FREQUENCY**2) * (y[:2] - [0.5, 0.0])])


def test_a_swing_goes_twice_its_amplitude_from_where_it_is_let_go() -> None:
    y = np.array([0.5 + 0.6 * AMPLITUDE, 0.8 * AMPLITUDE, 0.0, 0.0])
    (turn,), time = turns_of(swing, y, [PLACE], 1e-3, LEAST)
    assert turn.turned_back
    assert turn.way == pytest.approx(2.0 * AMPLITUDE, rel=ROUGH)
    assert turn.speed == pytest.approx(FREQUENCY * AMPLITUDE, rel=ROUGH)
    half = math.pi / FREQUENCY
    assert half < time < 2.0 * half


def test_from_its_middle_it_goes_its_amplitude() -> None:
    y = np.array([0.5, 0.0, 0.6 * FREQUENCY * AMPLITUDE, 0.8 * FREQUENCY * AMPLITUDE])
    (turn,), _ = turns_of(swing, y, [PLACE], 1e-3, LEAST)
    assert turn.turned_back
    assert turn.way == pytest.approx(AMPLITUDE, rel=ROUGH)
    assert turn.speed == pytest.approx(FREQUENCY * AMPLITUDE, rel=ROUGH)


@pytest.mark.parametrize("small", [1e-3, np.array([1e-3, 1e-3])])
def test_each_group_by_itself_until_the_last_has_turned(small: Any) -> None:
    """A slow swing beside a quick one, and one that is larger than what is small."""
    groups = [Group(slice(0, 1), slice(2, 3)), Group(slice(1, 2), slice(3, 4))]

    def both(t: float, y: np.ndarray) -> np.ndarray:
        return np.array([y[2], y[3], -(10.0**2) * y[0], -y[1]])

    found, time = turns_of(both, np.array([1e-6, 1e-5, 0.0, 0.0]), groups, small, LEAST)
    assert [t.turned_back for t in found] == [True, True]
    assert_allclose([t.way for t in found], [2e-6, 2e-5], rtol=ROUGH)
    assert_allclose([t.speed for t in found], [1e-5, 1e-5], rtol=ROUGH)
    assert math.pi < time < 2.0 * math.pi
    found, _ = turns_of(both, np.array([1e-6, 0.1, 0.0, 0.0]), groups, small, LEAST)
    assert [t.turned_back for t in found] == [True, False]


def test_what_goes_straight_on_and_what_rests_do_not_turn() -> None:
    def free(t: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[2:], [0.0, 0.0]])

    (turn,), _ = turns_of(free, np.array([0.0, 0.0, 3e-4, 4e-4]), [PLACE], 1e-3, LEAST)
    assert not turn.turned_back and turn.way >= 1e-3
    assert turn.speed == pytest.approx(5e-4)
    (turn,), time = turns_of(free, np.zeros(4), [PLACE], 1e-3, LEAST)
    assert turn == Turn(0.0, 0.0, False) and time == 0.0


def test_what_falls_from_rest_goes_on() -> None:
    def falls(t: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[2:], [0.0, -9.81]])

    (turn,), time = turns_of(falls, np.zeros(4), [PLACE], 1e-3, LEAST)
    assert not turn.turned_back
    assert turn.way == pytest.approx(0.5 * 9.81 * time**2, rel=1e-9)
    assert turn.speed == pytest.approx(9.81 * time, rel=1e-9)


def test_what_is_seen_is_followed_not_what_it_is_seen_of() -> None:
    """A swing that drifts by 1 m/s, seen from what drifts with it."""

    def drifts(t: float, y: np.ndarray) -> np.ndarray:
        return np.array([y[2], y[3], -(FREQUENCY**2) * (y[0] - y[1]), 0.0])

    def view(y: np.ndarray) -> np.ndarray:
        return np.array([y[0] - y[1], y[2] - y[3]])

    groups = [Group(slice(0, 1), slice(1, 2))]
    y = np.array([AMPLITUDE, 0.0, 1.0, 1.0])
    (turn,), _ = turns_of(drifts, y, groups, 1e-3, LEAST, view)
    assert turn.turned_back and turn.way == pytest.approx(2.0 * AMPLITUDE, rel=ROUGH)
    assert turn.speed == pytest.approx(FREQUENCY * AMPLITUDE, rel=ROUGH)


def test_the_first_step_goes_straight_as_far_as_is_small() -> None:
    """small / v, or sqrt(small / a), of the quickest group; infinite at rest."""
    groups = [Group(slice(0, 1), slice(2, 3)), Group(slice(1, 2), slice(3, 4))]
    rest = np.zeros(4)
    for y, slope, expected in (
        ([0.0, 0.0, 0.3, -0.5], rest, 1e-3 / 0.5),
        (rest, [0.0, 0.0, 4.0, -1.0], math.sqrt(1e-3 / 4.0)),
        ([0.0, 0.0, 0.3, 0.0], [0.0, 0.0, 0.0, 1e-9], 1e-3 / 0.3),
        ([9.0, 9.0, 0.0, 0.0], [9.0, 9.0, 0.0, 0.0], math.inf),
    ):
        assert first_step(np.array(y), np.array(slope), groups, 1e-3) == pytest.approx(expected)


def test_the_rate_of_what_is_seen() -> None:
    """Of a curved view: J dy/dt; of y itself dy/dt."""
    y = np.array([0.6, -0.4, 1.0, 2.0])

    def law(t: float, y: np.ndarray) -> np.ndarray:
        return np.array([y[2], y[3], -3.0 * y[0], -y[1]])

    def view(y: np.ndarray) -> np.ndarray:
        return np.array([y[0] * y[1], np.sin(y[2])])

    slope = law(0.0, y)
    expected = [slope[0] * y[1] + y[0] * slope[1], np.cos(y[2]) * slope[2]]
    assert_allclose(rate_seen(law, y, view), expected, rtol=1e-6)
    assert_allclose(rate_seen(law, y, itself), slope)
    assert_allclose(rate_seen(lambda t, y: 0.0 * y, y, view), 0.0)


def test_a_step_is_of_fourth_order() -> None:
    def grows(t: float, y: np.ndarray) -> np.ndarray:
        return y

    for h in (0.1, -0.2):
        series = sum(h**k / math.factorial(k) for k in range(5))
        assert step(grows, np.array([2.0]), h)[0] == pytest.approx(2.0 * series, rel=1e-15)


def test_sizes_of_parts_and_where_a_body_has_its_own() -> None:
    numbers = np.array([3.0, 4.0, 5.0, 12.0, 0.0, 8.0])
    parts = ends([slice(0, 2), slice(2, 4), slice(3, 6)])
    assert_allclose(sizes(numbers, parts), [5.0, 13.0, math.hypot(12.0, 8.0)])
    place, attitude = whole_body(13)
    assert place == Group(slice(13, 16), slice(20, 23))
    assert attitude == Group(slice(16, 20), slice(23, 26))


WIDE = 10.0 ** (1.0 / 8.0)
"""Ratio of places at which the work is looked at."""


@pytest.mark.parametrize(
    ("y0", "v0", "way"), [(1e-6, 0.0, 2e-6), (0.0, 1e-5, 1e-6), (1e-9, 0.0, 2e-9)]
)
def test_work_uses_up_the_speed_where_a_swing_turns(y0: float, v0: float, way: float) -> None:
    """Moved alone along its acceleration or its speed: two bodies at once, one of them free."""

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        dy = np.zeros(26)
        dy[0:3], dy[13:16] = y[7:10], y[20:23]
        dy[7] = -(FREQUENCY**2) * y[0]
        return dy

    y = np.zeros(26)
    y[0], y[7], y[20] = y0, v0, 1e-3
    places = np.array([[0, 1, 2], [13, 14, 15]])
    toward = -1.0 if y0 else 1.0
    directions = np.array([[toward, 0.0, 0.0], [1.0, 0.0, 0.0]])
    found = ways_along(rate, y, places, directions)
    assert way / WIDE**2 < found[0] < way * WIDE**2
    assert found[1] == SMALL


def test_the_longer_way_of_each_body_along_its_speed_and_its_pull() -> None:
    """One let go at rest, one that passes its middle, one at rest for good, one that goes on."""

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        rows = y.reshape(-1, 13)
        dy = np.zeros_like(rows)
        dy[:, :3] = rows[:, 7:10]
        dy[:3, 8] = -(FREQUENCY**2) * rows[:3, 1]
        return dy.ravel()

    y = np.zeros((4, 13))
    y[0, 1], y[1, 8], y[3, 9] = 1e-6, 1e-4, 1.0
    found = ways_of(rate, y.ravel(), SimpleNamespace(effects=()), [0, 1, 2, 3])
    assert 2e-6 / WIDE**2 < found[0] < 2e-6 * WIDE**2
    assert 1e-5 / WIDE**2 < found[1] < 1e-5 * WIDE**2
    assert found[2:] == [0.0, SMALL]


def test_floors_never_ask_for_more_than_rounding_leaves() -> None:
    small, y = Small(13), np.arange(13.0)
    place, attitude = whole_body(0)
    small.hold(y, place, 1e-3, 1e-2)
    small.hold(y, place, 1e-2, 1e-3)
    assert_allclose(small.floors, [1e-3] * 3 + [1.0] * 4 + [1e-3] * 3 + [1.0] * 3)
    assert_allclose(small.starts, [0.0, 1.0, 2.0] + [0.0] * 10)
    eps = float(np.finfo(float).eps)
    assert_allclose(small.rounding, 4.0 * eps * small.starts)
    assert_allclose(small.within(1e-15)[:3], [1e-3, 4.0 * eps / 1e-15, 1.0])
    assert_allclose(small.within(0.0), small.floors)
    small.hold_others(0.1)
    assert_allclose(small.floors[3:7], 0.1)
    assert_allclose(small.shares(1e-10), 1.0)
    small.drift([(place, Turn(1.0, 1.0, True))])
    share = 4.0 * eps / 1e-10
    assert_allclose(small.shares(1e-10), [share] * 3 + [1.0] * 4 + [share] * 3 + [1.0] * 3)
    assert_allclose(small.shares(0.0), 1.0)
    assert_allclose(small.shares(1e-20), 1.0)
    assert attitude.places == slice(3, 7)
