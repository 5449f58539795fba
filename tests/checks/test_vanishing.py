"""Where a figure passes through zero as |x| does, of motions and figures in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim.checks.singular_configuration import Follower, Vanishing, between, suspects

SPIN = 1.3
"""[rad/s] about z, beside a body that stands."""
LENGTH = 0.5


def spun(t: np.ndarray) -> np.ndarray:
    """A body that turns about z beside one that stands, shape (n, 26); every other quaternion has
    the other sign."""
    y = np.zeros((len(t), 2, 13))
    half, sign = 0.5 * SPIN * t, np.where(np.arange(len(t)) % 2, 1.0, -1.0)
    y[:, 1, 5], y[:, 1, 6], y[:, 1, 12] = sign * np.sin(half), sign * np.cos(half), SPIN
    y[:, 0, 6] = 1.0
    return y.reshape(len(t), -1)


def angle_of(y: np.ndarray) -> np.ndarray:
    return np.mod(2.0 * np.arctan2(y[:, 13 + 5], y[:, 13 + 6]), 2.0 * np.pi)


def run_of(t: np.ndarray) -> np.ndarray:
    """Two bodies that part by 1.3 LENGTH a second while both go on, as fast as they like."""
    y = np.zeros((len(t), 2, 13))
    y[:, :, 6], y[:, :, 7] = 1.0, (50.0, 50.0 + 2.0 * SPIN * LENGTH)
    y[:, :, 0] = t[:, None] * y[0, :, 7]
    return y.reshape(len(t), -1)


def way_of(y: np.ndarray) -> np.ndarray:
    return (y[:, 13] - y[:, 0]) / (2.0 * LENGTH)


KINDS = {"turns": (spun, angle_of), "goes on": (run_of, way_of)}


def follow(
    t: np.ndarray, kind: str, least: float, pieces: int = 1, at: float = 2.0
) -> Vanishing | None:
    """What is found of s, which is least where the body has turned, or gone on, by `at`: there a V
    of line 1, between one of slope 1/2 and s = 1 that belong to line 0."""
    states, place = KINDS[kind]

    def figure(_: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x = np.sin(0.5 * (place(y) - at)) * 2.0
        s = np.minimum(np.hypot(x, least), 1.0)
        return s, (s < 1.0).astype(int)

    follower, y = Follower(figure, LENGTH), states(t)
    for part in np.array_split(np.arange(len(t)), pieces):
        found = follower.add(t[part], y[part])
        if found is not None:
            return found
    return None


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("pieces", [1, 2, 3, 7])
@pytest.mark.parametrize("turn", [0.03, 0.13, 0.37, 0.71])
def test_a_figure_that_passes_through_zero_is_found(turn: float, pieces: int, kind: str) -> None:
    """However far apart samples are, and wherever blocks end."""
    t = np.arange(0.0, 4.0, turn) / SPIN
    found = follow(t, kind, 0.0, pieces=pieces)
    assert found is not None and found.line == 1
    assert found.at == pytest.approx(2.0 / SPIN, abs=2e-3)
    assert found.s < 0.02
    assert 4 <= len(found.t) == len(found.y) <= 9
    assert found.t[0] < found.at < found.t[-1]
    place = KINDS[kind][1](found.y)
    assert_allclose(place, SPIN * found.t, atol=2e-3)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("pieces", [1, 3])
@pytest.mark.parametrize("turn", [0.03, 0.13, 0.37, 0.71])
@pytest.mark.parametrize("least", [0.03, 0.3])
def test_one_that_comes_near_zero_is_not(turn: float, least: float, pieces: int, kind: str) -> None:
    t = np.arange(0.0, 4.0, turn) / SPIN
    assert follow(t, kind, least, pieces=pieces) is None


def test_a_place_at_which_it_is_zero_is_found_as_it_is() -> None:
    t = np.arange(0.0, 4.0, 0.25) / SPIN
    found = follow(t, "turns", 0.0)
    assert found is not None and found.at == t[8] and found.s < 1e-12
    assert follow(t[:3], "turns", 0.0, at=0.25 * 3.0) is None
    assert follow(t[:4], "turns", 0.0, at=0.25 * 3.0) is not None


def test_the_first_of_several_is_told() -> None:
    t = np.arange(0.0, 20.0, 0.37) / SPIN
    found = follow(t, "turns", 0.0, at=1.0)
    assert found is not None and found.at == pytest.approx(1.0 / SPIN, abs=2e-3)


@pytest.mark.parametrize(
    ("s", "found"),
    [
        ([3.0, 2.0, 1.0, 0.0, 1.0], [2, 3]),  # at it, and after the one before
        ([2.5, 1.5, 0.5, 0.5, 1.5], [2]),  # two lowest that add up to a step of the sides
        ([2.64, 1.64, 0.64, 0.64, 1.64, 2.64], [2]),
        ([2.66, 1.66, 0.66, 0.66, 1.66, 2.66], []),
        ([4.0, 1.0, 0.9, 1.4, 2.0], [1]),  # of the steeper side
        ([2.0, 1.4, 0.9, 1.0, 4.0], [2]),
        ([2.0, 1.0, 1.0, 1.0, 2.0], []),  # a smooth one
        ([3.0, 2.0, 1.0, 0.5], []),
        ([0.5, 1.0, 2.0, 3.0], []),
        ([1e-5, 1.0], [0]),
        ([2e-5, 1.0], []),
    ],
)
def test_places_that_are_suspect(s: list[float], found: list[int]) -> None:
    assert suspects(np.array(s)) == found


def test_states_between_two_of_a_motion_that_a_cubic_tells() -> None:
    """Of another body as far as four digits of its turn, whose quaternions may change sign."""
    t = np.array([1.0, 1.5, 2.5])
    jerk, push, start = np.array([[0.2, -0.1, 0.3], [1.0, 2.0, -1.5], [3.0, 0.1, 0.2]])
    axis = np.array([2.0, -1.0, 2.0]) / 3.0

    def motion(t: np.ndarray) -> np.ndarray:
        x = t[:, None]
        y = np.zeros((len(t), 2, 13))
        y[:, 0, :3] = jerk * x**3 + push * x**2 + start * x
        y[:, 0, 7:10] = 3.0 * jerk * x**2 + 2.0 * push * x + start
        y[:, :, 6] = 1.0
        y[:, 1, 3:7] = Rotation.from_rotvec(0.4 * x * axis).as_quat()
        y[:, 1, 10:13] = 0.4 * axis
        return y

    y = motion(t)
    y[1, 1, 3:7] *= -1.0
    k, share = np.array([0, 0, 1, 1]), np.array([0.0, 0.3, 0.5, 0.9])
    times, states = between(t, y.reshape(3, -1), k, share)
    assert_allclose(times, [1.0, 1.15, 2.0, 2.4], rtol=1e-15)
    found, wanted = states.reshape(4, 2, 13), motion(times)
    assert_allclose(found[:, 0, :3], wanted[:, 0, :3], rtol=1e-13)
    straight = y[k, 0, 7:10] + share[:, None] * (y[k + 1, 0, 7:10] - y[k, 0, 7:10])
    assert_allclose(found[:, 0, 7:10], straight, rtol=1e-14)
    turns = Rotation.from_quat(found[:, 1, 3:7]) * Rotation.from_quat(wanted[:, 1, 3:7]).inv()
    assert turns.magnitude().max() < 2e-5
    assert_allclose(np.linalg.norm(found[:, 1, 3:7], axis=1), 1.0, rtol=1e-15)
    assert_allclose(found[:, 1, 10:13], wanted[:, 1, 10:13], rtol=1e-14)
