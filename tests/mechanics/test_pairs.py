"""Bodies between which something acts: who is moved at once, who parts, who turns back."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim.catalogue.constraints.rows import PlaneRow, PointRow
from rb_sim.mechanics.error_scales import (
    Turn,
    bent,
    held_to_parents,
    held_together,
    of_pair,
    pairs_of,
    parting,
    seen_from_parents,
    that_do_not_act,
    that_turn_back,
)
from tests.moving import difference, flown, random_state


def placed(body: int, parent: int, row: Any = None) -> Any:
    return SimpleNamespace(body=body, parent=parent, row=row)


def test_bodies_in_groups_in_which_nothing_acts_between_two() -> None:
    effects = (placed(0, -1), placed(1, 0), placed(2, 1), placed(4, 0))
    system = SimpleNamespace(effects=effects)
    groups = that_do_not_act(system, [0, 1, 2, 3, 4])
    assert sorted(body for group in groups for body in group) == [0, 1, 2, 3, 4]
    for pair in ({0, 1}, {1, 2}, {0, 4}):
        assert not any(pair <= set(group) for group in groups)
    assert len(groups) == 2
    assert that_do_not_act(SimpleNamespace(effects=()), [3, 5]) == [[3, 5]]


def test_who_is_kept_from_going_straight() -> None:
    point, plane = PointRow((0.0,) * 3, (0.0,) * 3), PlaneRow(*((0.0,) * 3,) * 3)
    constraints = (placed(0, -1, point), placed(1, -1, plane), placed(3, 2, plane))
    system: Any = SimpleNamespace(constraints=constraints, effects=(placed(4, 1),))
    assert bent(system) == {0, 2, 3}
    assert pairs_of(system, set()) == [(3, 2), (4, 1)]
    assert pairs_of(system, {2}) == [(4, 1)]


def test_a_body_as_its_parent_sees_it() -> None:
    """Place and attitude in axes of the parent, and their rates."""
    rng = np.random.default_rng(2)
    states = [random_state(rng) for _ in range(3)]

    def seen(t: float) -> np.ndarray:
        y = np.concatenate([np.concatenate(flown(S, t)) for S in states])
        return seen_from_parents(y, np.array([2, 0]), np.array([1, 1])).reshape(2, 13)

    found, rates = seen(0.0), difference(seen)
    A = Rotation.from_quat(states[1].q_WB)
    for own, rate, B in zip(found, rates, (states[2], states[0]), strict=True):
        way = A.inv().apply(np.array(B.p_WC) - states[1].p_WC)
        assert_allclose(own[:3], way, atol=1e-14)
        turn = A.inv() * Rotation.from_quat(B.q_WB)
        assert (Rotation.from_quat(own[3:7]).inv() * turn).magnitude() < 1e-7
        assert_allclose(own[7:10], rate[:3], atol=1e-8)
        w = np.array(B.w_WB_B) - turn.inv().apply(states[1].w_WB_B)
        assert_allclose(own[10:13], w, atol=1e-14)


@pytest.mark.parametrize(
    ("v", "a", "parts"),
    [
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), False),
        ((0.0, 2.0, 0.0), (-8.0, 0.0, 0.0), False),  # on a circle of radius 0.5
        ((0.0, 2.0, 0.0), (-7.99, 0.0, 0.0), True),
        ((0.0, 2.0, 0.0), (0.0, 0.0, 0.0), True),
        ((1e-3, 2.0, 0.0), (-8.0, 0.0, 0.0), True),
        ((0.0, 0.0, 0.0), (0.01, 0.0, 0.0), True),
        ((0.0, 0.0, 0.0), (0.0, 5.0, 0.0), False),  # across, from rest
    ],
)
def test_whose_distance_changes(v: Any, a: Any, parts: bool) -> None:
    """Body 2 at 0.5 m from its parent 0, which flies and falls with it; body 1 acts on neither."""
    common, falling = np.array([3.0, -1.0, 2.0]), np.array([0.0, 0.0, -9.81])
    y = np.zeros((3, 13))
    y[2, :3] = 0.5, 0.0, 0.0
    y[1, :3] = 9.0, 9.0, 9.0
    y[:, 7:10] = common
    y[2, 7:10] += v

    def rate(t: float, at: np.ndarray) -> np.ndarray:
        dy = np.zeros((3, 13))
        dy[:, :3], dy[:, 7:10] = at.reshape(3, 13)[:, 7:10], falling
        dy[2, 7:10] += a
        return dy.ravel()

    bodies = np.zeros((3, 25))
    bodies[:, 0] = 1.0, 2.0, 0.5
    system: Any = SimpleNamespace(
        effects=(placed(2, 0), placed(1, -1)), constraints=(), bodies=bodies, speed=1.0
    )
    assert parting(rate, y.ravel(), system) == (((2, 0),) if parts else ())
    y[0, 3] = np.nan
    assert parting(rate, y.ravel(), system) == ()


GOES, BACK, RESTS = Turn(1.0, 1.0, False), Turn(1.0, 1.0, True), Turn(0.0, 0.0, False)


def test_which_pairs_turn_back() -> None:
    """Both of place and attitude, if they move; of what joints hold together all, or none."""
    turns = {
        (1, 0): (BACK, RESTS),
        (2, 1): (BACK, BACK),
        (3, 1): (RESTS, RESTS),
        (5, 4): (BACK, GOES),
        (6, 4): (BACK, BACK),
        (8, 7): (BACK, GOES),
        (9, 7): (BACK, BACK),
    }
    joints = {(1, 0), (2, 1), (5, 4), (6, 4)}
    assert that_turn_back(turns, joints, 1e-3) == [(1, 0), (2, 1), (9, 7)]


def test_what_joints_hold_together() -> None:
    found = held_together({(1, 0), (2, 1), (5, 4), (4, 6), (2, 0)})
    assert set(found) == {0, 1, 2, 4, 5, 6}
    assert len({found[k] for k in (0, 1, 2)}) == 1
    assert len({found[k] for k in (4, 5, 6)}) == 1
    assert found[0] != found[4]


def test_an_attitude_is_held_to_what_it_turns_of_the_other_body() -> None:
    place, turn = Turn(1e-6, 2e-6, True), Turn(1e-4, 3e-4, True)
    assert of_pair(place, turn, 1e-9, 1e-3) == (place, turn)
    assert of_pair(place, turn, 1e-9, 2.0) == (place, Turn(0.5e-6, 1e-6, True))
    assert of_pair(place, turn._replace(speed=1e-7), 1e-9, 2.0)[1] == Turn(0.5e-6, 1e-7, True)
    still = Turn(1.0, 1.0, True)
    assert of_pair(place, RESTS, 1e-9, 1e-9) == (place, still)
    assert of_pair(RESTS, turn, 1e-9, 2.0) == (still, turn)


@pytest.mark.parametrize(
    ("place", "amplitude", "least"),
    [(0.0, 1e-6, 2.2e-12), (0.0, 1e-12, 2.2e-12), (1e6, 1e-4, 2.2e-6), (1e6, 1e-6, 2.2e-6)],
)
def test_who_is_far_away_is_held_to_no_less_than_doubles_tell(
    place: float, amplitude: float, least: float
) -> None:
    """A body of which its parent, at rest beside it, sees A cos 10 t: it goes as far as 2 A, with
    up to 10 A; the least is 1e4 roundings of where both are, but for the metre between them."""
    y = np.zeros((2, 13))
    y[:, 0], y[:, 6] = (place, place + (1.0 if place else 0.5) + amplitude), 1.0
    rest = y[1, 0] - amplitude

    def rate(t: float, at: np.ndarray) -> np.ndarray:
        dy = np.zeros((2, 13))
        dy[:, :3] = at.reshape(2, 13)[:, 7:10]
        dy[1, 7] = -100.0 * (at[13] - rest)
        return dy.ravel()

    system: Any = SimpleNamespace(effects=(placed(1, 0),), constraints=())
    held, time = held_to_parents(rate, y.ravel(), system, set(), 0.1, 1e-3)
    assert set(held) == ({0, 1} if 2.0 * amplitude > least else set())
    for body, groups in held.items():
        group, turn = groups[0]
        assert group.places == slice(13 * body, 13 * body + 3)
        assert turn.way == pytest.approx(2.0 * amplitude, rel=0.1)
        assert turn.speed == pytest.approx(10.0 * amplitude, rel=0.1)
        assert 0.1 * np.pi < time < 0.2 * np.pi
