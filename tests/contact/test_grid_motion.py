"""A run on a grid of steps: instants at which loads jump, and what a new grid keeps."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rb_sim.catalogue.geometry.corners_and_rims import RimOnCylinder, RimOnPlane
from rb_sim.contact.grid_motion import GridMotion
from rb_sim.mechanics.contact.contact_bodies import (
    BILATERAL,
    COMPLIANT,
    DRAGS,
    KINETIC,
    LEAN_BEFORE,
    LEAN_SIGN,
    NORMAL_SIGN,
    RESTITUTION,
    RIM,
    ROLLING_ARM,
    SPINNING_ARM,
    STATIC,
)
from rb_sim.scene.compile_contacts import grouped_contacts, groups_of, rims_of_points, touch_table
from rb_sim.scene.load import scene_from_mapping
from rb_sim.scene.place import InitialPlace
from tests.contact.scenes import ball, box, scene, touch


class Recorded(GridMotion):
    """Carries its grid by steps of 1/4 s, of states that are the time and its double."""

    def __init__(self, breakpoints: tuple[float, ...]) -> None:
        self.compiled: Any = SimpleNamespace(
            system=None, breakpoints=breakpoints, y=np.array([0.0, 0.0])
        )
        self.asked: list[tuple[list[float], float, Any]] = []
        self.reset()

    def _record(self, times: Any, stop: float, out: Any) -> None:
        self.asked.append((times.tolist(), stop, None if out is None else len(out)))
        self.time = float(times[-1])
        grid = self._grid
        steps = grid.steps + math.ceil(4.0 * (self.time - grid.t1))
        y = np.array([self.time, 2.0 * self.time])
        self._grid = grid._replace(
            steps=steps, rejected=grid.rejected + 1, t0=self.time - 0.25, t1=self.time, y=y, y1=y,
            c1=np.array([1e-20, 2e-20]), h=0.125,
        )  # fmt: skip


@pytest.mark.parametrize("as_array", [True, False])
def test_loads_that_jump_begin_a_new_grid(as_array: bool) -> None:
    """Samples up to them, and at them, are of the grid before; steps and attempts are of all."""
    motion, out = Recorded((1.0, 2.5, 9.0)), np.zeros((5, 2))
    times = [0.5, 1.0, 1.5, 2.0, 4.0]
    assert motion.run_to(np.array(times) if as_array else times, out) == 5
    assert motion.asked == [
        ([0.5, 1.0], 1.0, 2),
        ([1.5, 2.0], 2.5, 2),
        ([2.5], 2.5, None),
        ([4.0], 9.0, 1),
    ]
    assert motion.steps == 16 and motion.rejected_steps == 4
    assert motion.frontier == (4.0, 0.25) and motion.step_end[0] == 4.0
    assert motion.coordinates.tolist() == motion.step_end[1].tolist() == [4.0, 8.0]
    motion.run_to([20.0])
    assert motion.asked[-1] == ([20.0], math.inf, None) and motion.asked[-2][0] == [9.0]
    motion.reset(np.array([7.0, 7.0]), 3.0)
    assert motion.steps == motion.rejected_steps == 0 and motion.frontier == (3.0, 0.0)
    assert motion.coordinates.tolist() == [7.0, 7.0] and motion.time == 3.0


def test_a_new_grid_keeps_the_low_digits_of_what_stays() -> None:
    motion = Recorded(())
    motion.run_to([1.0])
    motion._begin_grid(1.0, np.array([1.0, 5.0]), 0.03)
    assert motion._grid.c1.tolist() == [1e-20, 0.0] and motion._grid.h == 0.03
    assert motion._grid.y1.tolist() == [1.0, 5.0] and motion.steps == 4


def test_the_table_of_contacts_at_the_start() -> None:
    law = SimpleNamespace(
        static=0.5, rolling_arm=0.1, spinning_arm=0.2, restitution=0.6, kinetic=0.4, drags=True,
        bilateral=True, compliant=True,
    )  # fmt: skip
    other = SimpleNamespace(**vars(law) | {"drags": False, "bilateral": False, "compliant": False})
    placed: Any = [SimpleNamespace(row=SimpleNamespace(pair=None))] * 2
    touch = touch_table([law, other], placed)  # type: ignore[list-item]
    columns = [STATIC, ROLLING_ARM, SPINNING_ARM, RESTITUTION, KINETIC]
    assert touch[:, columns].tolist() == [[0.5, 0.1, 0.2, 0.6, 0.4]] * 2
    assert touch[:, [DRAGS, BILATERAL, COMPLIANT]].tolist() == [[1.0] * 3, [0.0] * 3]
    assert (
        touch[:, [RIM, NORMAL_SIGN, LEAN_SIGN, LEAN_BEFORE + 6]].tolist()
        == [[-1.0, 1.0, 1.0, 1.0]] * 2
    )
    assert np.count_nonzero(touch) == 5 * 2 + 3 + 4 * 2


def test_points_of_one_rim_know_the_first_of_them() -> None:
    """On a plane and on a cylinder: of the same body, support, centre and side."""
    z, up, off = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.1, 0.0, 0.0)
    flat = [RimOnPlane(up, 0.4, z, float(k), 0.0, 0.0, up, z) for k in range(2)]
    below = RimOnPlane(up, 0.4, z, 0.0, 0.0, 0.0, up, (0.0, 0.0, -1.0))
    other = RimOnPlane(off, 0.4, z, 0.0, 0.0, 0.0, up, z)
    away = RimOnPlane(up, 0.4, z, 0.0, 0.0, 0.0, off, z)
    round_ = [RimOnCylinder(up, 0.4, z, up, z, 2.0, 1.0, float(k)) for k in range(2)]
    inside = round_[0]._replace(side=-1.0)

    def placed(body: int, parent: int, pair: Any) -> Any:
        return SimpleNamespace(body=body, parent=parent, row=SimpleNamespace(pair=pair))

    points = [placed(0, -1, pair) for pair in (None, *flat, below, other, away)]
    points += [placed(1, -1, flat[0]), placed(0, 1, flat[0]), placed(0, -1, flat[1])]
    points += [placed(0, -1, pair) for pair in (*round_, inside)] + [placed(0, 1, round_[1])]
    points.append(placed(0, -1, round_[1]))
    found = rims_of_points(points)
    assert found == [-1, 1, 1, 3, 4, 5, 6, 7, 1, 9, 9, 11, 12, 9]


def test_points_of_one_kind_are_side_by_side() -> None:
    def placed(pair: Any, spring: tuple[float, ...] = (), friction: Any = 1.0) -> Any:
        row = SimpleNamespace(
            pair=pair, friction=friction, resistance=None, carrier=None, spring=spring
        )
        return SimpleNamespace(row=row)

    kinds = [placed("a"), placed("b"), placed(2.0), placed("a", (1.0,)), placed("a", (2.0,)),
             placed("a", (), 1), placed("a")]  # fmt: skip
    groups = groups_of(kinds)
    assert [len(group) for group in groups] == [2, 1, 2, 1, 1]
    assert [one for group in groups for one in group] == kinds


def test_points_are_named_after_their_contact_and_numbered_where_there_are_several() -> None:
    """Those of one kind one after the other, in the order in which the kinds come first."""
    bodies = {"b": box([0.2, 0.2, 0.2], [0, 0, 1]), "s": ball([1, 0, 1]), "t": ball([2, 0, 1])}
    floors = {"one": touch("s"), "many": touch("b"), "rubs": touch("t", mu=0.5), "two": touch("t")}
    given = scene_from_mapping(scene(bodies, floors))
    found = grouped_contacts(given, InitialPlace(given))
    names = [name for _, _, _, name in found]
    corners = [f"many/{k}" for k in range(1, 9)]
    assert names == ["one", "two", *corners, "rubs"]
    assert [owner for owner, _, _, _ in found] == ["one", "two", *["many"] * 8, "rubs"]
    assert all(spec is given.constraints[owner] for owner, spec, _, _ in found)
