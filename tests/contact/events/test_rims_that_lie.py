"""Which points of rims hold them, on tables by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rb_sim.base.errors import SimulationError
from rb_sim.catalogue.geometry.corners_and_rims import RimOnPlane
from rb_sim.contact.events import flat_rims as rims_that_lie
from rb_sim.mechanics.contact.contact_bodies import LIES_FLAT
from rb_sim.mechanics.contact.contact_table import (
    AXIS,
    CLOSED,
    LEAN_BEFORE,
    LOW,
    NORMAL,
    NORMAL_FORCE,
    POINT,
    RELATIVE_SPIN,
    SLIDE,
    SPIN_SIGN,
    TOUCH_WIDTH,
)
from rb_sim.mechanics.systems.many_bodies import BODY

PLANES = [rims_that_lie.Rim(0, (k,), False) for k in range(2)]
RIMS = dict.fromkeys(range(4), PLANES[0]) | {4: PLANES[1], 5: PLANES[1]._replace(alone=True)}


def by_hand(leans: list[float], touching: list[int]) -> Any:
    """Contacts 0 to 3 of one rim, 4 and 5 of others, 6 of none, that lean so much."""
    touch_of = np.zeros((7, TOUCH_WIDTH))
    touch_of[:, AXIS] = leans
    touch_of[:, NORMAL + 2] = touch_of[:, LOW] = touch_of[:, CLOSED] = 1.0
    system = SimpleNamespace(
        touch=touch_of, speed=2.0, length=0.5, lines=np.zeros((7, BODY + 1), dtype=int)
    )
    y = np.zeros(13)
    y[5], y[6] = np.sin(0.5), np.cos(0.5)  # turned by 1 rad about z
    at: Any = SimpleNamespace(
        system=system, y=y, t=3.0, still=1e-6, first=list(range(7)), refreshed=0, called=[]
    )
    at.touching = lambda: touching
    at.refresh = lambda: setattr(at, "refreshed", at.refreshed + 1)
    at.call = lambda *task: at.called.append(task)
    return at


FLATLY = [0.9e-10, -0.9e-10, 0.0, 1.1e-10, 0.0, 0.0, 0.0]


def test_which_rims_lie() -> None:
    at = by_hand(FLATLY, [0, 1, 3, 4, 6])
    assert rims_that_lie.lying(at, RIMS) == [0, 1, 4] and rims_that_lie.lying(at, {}) == []


def test_a_point_is_aimed_where_the_rim_goes_down() -> None:
    """By turn x n, in axes of the body; what hardly turns, or has its point there, is left."""
    at = by_hand(FLATLY, [0, 1, 2])
    touch_of = at.system.touch
    touch_of[0, RELATIVE_SPIN : RELATIVE_SPIN + 3] = 0.0, 0.3, 0.0  # down along x
    touch_of[1, RELATIVE_SPIN : RELATIVE_SPIN + 3] = 0.0, 1.9e-6, 0.0
    touch_of[2, RELATIVE_SPIN : RELATIVE_SPIN + 3] = (
        -0.3 * np.sin(1.0),
        0.3 * np.cos(1.0),
        5.0,
    )  # where it looks
    assert rims_that_lie.falling(at, 0) == pytest.approx([0.3, 0.0, 0.0])
    before = touch_of.copy()
    assert rims_that_lie.aim_where_it_turns(at, RIMS) and at.refreshed == 1
    aimed = touch_of[0, LEAN_BEFORE : LEAN_BEFORE + 3]
    np.testing.assert_allclose(aimed, [np.cos(1.0), -np.sin(1.0), 0.0], atol=1e-15)
    touch_of[0, LEAN_BEFORE : LEAN_BEFORE + 3] = 0.0
    assert (touch_of == before).all()
    touch_of[0, LOW : LOW + 3] = np.cos(1.0 + 0.9e-8), -np.sin(1.0 + 0.9e-8), 0.0
    assert not rims_that_lie.aim_where_it_turns(at, RIMS) and at.refreshed == 1
    touch_of[1, RELATIVE_SPIN + 1] = 2.1e-6  # above 1e-6 m/s over 0.5 m
    assert rims_that_lie.aim_where_it_turns(at, RIMS)


@pytest.mark.parametrize(
    ("closed", "going"),
    [
        ([1, 1, 1, 1], set()),
        ([0, 0, 0, 0], set()),
        ([1, 0, 0, 0], set()),
        ([1, 1, 0, 0], {1, 2, 3}),
        ([0, 0, 1, 1], {0, 1, 3}),
        ([0, 0, 1, 0], set()),
        ([0, 1, 0, 0], {0, 1, 2, 3}),
    ],
)
def test_a_rim_that_tips_keeps_one_point(closed: list[int], going: set[int]) -> None:
    """Its first, or the one opposite."""
    at = by_hand([0.0] * 7, [0, 1, 2, 3])
    at.system.touch[:4, CLOSED] = closed
    assert rims_that_lie.letting_go(at, RIMS) == going
    assert rims_that_lie.letting_go(at, {}) == frozenset()


def test_a_point_is_aimed_under_the_load() -> None:
    """Of pushes 3, 1, 1 and 1 at the corners of a square its first point lies beyond their middle;
    modes are those of before, and what turns is left."""
    at = by_hand([0.0] * 7, [0, 1, 2, 3, 4])
    touch_of = at.system.touch
    touch_of[:4, NORMAL_FORCE] = 3.0, 1.0, 1.0, 1.0
    touch_of[:4, POINT : POINT + 3] = [[6, 5, 2], [5, 6, 2], [4, 5, 2], [5, 4, 2]]
    touch_of[:4, POINT + 3] = 7.0, 0.0, 0.0, -9.0  # of another quantity
    touch_of[:4, CLOSED], touch_of[1, SLIDE], touch_of[4, RELATIVE_SPIN] = (
        (0.0, 1.0, 0.0, 1.0),
        2.0,
        9.0,
    )
    modes = touch_of[:, CLOSED : SPIN_SIGN + 1].copy()
    asked: list[np.ndarray] = []
    at.call = lambda task, t, y: asked.append(touch_of[:, [CLOSED, SLIDE]].copy())
    assert rims_that_lie.aim_under_the_load(at, RIMS)
    assert asked[0][:4].tolist() == [[1.0, 2.0]] * 4 and asked[0][4].tolist() == [1.0, 0.0]
    assert (touch_of[:, CLOSED : SPIN_SIGN + 1] == modes).all()
    for c in range(4):
        np.testing.assert_allclose(
            touch_of[c, LEAN_BEFORE : LEAN_BEFORE + 3], [np.cos(1.0), -np.sin(1.0), 0.0], atol=1e-14
        )
    assert not touch_of[4:, LEAN_BEFORE : LEAN_BEFORE + 3].any()
    touch_of[:4, LEAN_BEFORE : LEAN_BEFORE + 3], touch_of[:4, NORMAL_FORCE] = 0.0, 1.0
    assert not rims_that_lie.aim_under_the_load(at, RIMS)  # it bears in the middle
    touch_of[0, NORMAL_FORCE] = 3.0
    touch_of[:4, RELATIVE_SPIN] = 4.1e-7  # above 1e-7 of 2 m/s over 0.5 m
    assert not rims_that_lie.aim_under_the_load(at, RIMS)
    touch_of[:4, RELATIVE_SPIN], touch_of[:4, CLOSED] = 3.9e-7, 0.0
    assert not rims_that_lie.aim_under_the_load(at, RIMS)
    touch_of[2, CLOSED] = 1.0
    assert rims_that_lie.aim_under_the_load(at, RIMS)


@pytest.mark.parametrize(("more", "aims"), [(3e-6, False), (5e-6, True)])
def test_what_it_bears_is_in_its_middle_within_a_millionth_of_its_radius(
    more: float, aims: bool
) -> None:
    """A push that is larger by so much moves the middle of four by a quarter of that."""
    at = by_hand([0.0] * 7, [0, 1, 2, 3])
    at.system.touch[:4, NORMAL_FORCE] = 1.0 + more, 1.0, 1.0, 1.0
    at.system.touch[:4, POINT : POINT + 2] = 0.01 * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
    assert rims_that_lie.aim_under_the_load(at, RIMS) is aims


def test_a_rim_with_one_point_that_comes_to_lie_is_refused() -> None:
    names = [f"c{k}" for k in range(7)]
    rims_that_lie.refuse_to_lie(by_hand([0.0] * 7, [0, 1, 4, 6]), RIMS, names, (0, LIES_FLAT + 1))
    with pytest.raises(SimulationError, match="contact c5 lies flat at t = 3 s"):
        rims_that_lie.refuse_to_lie(by_hand([0.0] * 7, [4, 5]), RIMS, names, None)
    with pytest.raises(SimulationError, match="contact c0"):
        rims_that_lie.refuse_to_lie(by_hand([1.0] * 7, []), RIMS, names, (0, LIES_FLAT))
    rims_that_lie.refuse_to_lie(by_hand([1.0] * 7, []), RIMS, names, (6, LIES_FLAT))


def test_points_are_of_one_rim_by_body_centre_and_plane() -> None:
    """Not by how they lie on the rim; what is no point of a rim on a plane is left out."""
    z, here, away = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.1, 0.0, 0.0)

    def one(body: int, parent: int, centre: Any, r_A: Any, n_A: Any, alone: float = 0.0) -> Any:
        pair = RimOnPlane(centre, 0.4, z, float(body), 0.0, alone, r_A, n_A)
        return SimpleNamespace(body=body, parent=parent, row=SimpleNamespace(pair=pair))

    same = one(0, -1, here, here, z), one(0, -1, here, here, z)
    others = [one(1, -1, here, here, z), one(0, 2, here, here, z), one(0, -1, away, here, z)]
    others += [one(0, -1, here, away, z), one(0, -1, here, here, (0.0, 1.0, 0.0))]
    others.append(one(0, -1, here, here, z, 1.0))
    none = SimpleNamespace(body=0, parent=-1, row=SimpleNamespace(pair=None))
    found = rims_that_lie.rims_of(SimpleNamespace(contacts=(same, (none,), tuple(others))))  # type: ignore[arg-type]
    assert sorted(found) == [0, 1, 3, 4, 5, 6, 7, 8]
    assert found[0] == found[1] and len(set(found.values())) == 7
    assert [found[c].alone for c in (0, 8)] == [False, True]
