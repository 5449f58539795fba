"""The grid of steps from event to event, by hand: what is told of it, and what ends it."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import SimulationError, StepTooLargeError
from rb_sim.contact.events import stepping
from rb_sim.contact.events.event_motion import ContactMotion
from rb_sim.contact.events.shares import (
    GRAZE,
    LAGGED,
    NO_SETTING,
    ORDER,
    TURNED_BY_ROUNDING,
    LeftOpen,
)
from rb_sim.contact.problem.order import (
    LAG,
    LAG_TIME,
    LARGEST,
    LENGTHS,
    ROUNDED,
    ROUNDED_TIME,
    SPEED,
    SUM,
    TIME,
    WAY,
    WORST_SHARE,
    WORST_TIME,
    missed_way,
)
from rb_sim.integrate.layout import (
    FLOOR,
    IS_VELOCITY,
    NOT_FINITE,
    SHARE_OF_WAY,
    UNFINISHED,
    WORK_ROWS,
)
from rb_sim.mechanics.contact.contact_kinematics import NONE, SLIDING, STUCK
from rb_sim.mechanics.contact.contact_table import CLOSED, COMPLIANT, SLIDE, STATIC
from tests.contact.scenes import ball, scene, touch

STEP, TOLERANCE = 0.01, 1e-6
MASSES = {"b0": 1.0, "b1": 2.0}
MOMENTS = {"b0": (0.1, 0.2, 0.3), "b1": (0.5, 0.4, 0.3)}


def motion(fixed: bool = False, balls: int = 2, **contact: Any) -> Any:
    """Of balls that fly 1 m above their floors, in steps of 10 ms or with a tolerance of 1e-6."""
    bodies = {
        name: ball([i, 0, 1.1]) | {"mass": MASSES[name], "inertia": list(MOMENTS[name])}
        for i, name in enumerate(list(MASSES)[:balls])
    }
    floors = {f"on_{name}": touch(name, mu=0.3, **contact) for name in bodies}
    run = {"method": "rk4", "step": STEP} if fixed else {"method": "dopri853", "tolerance": 1e-6}
    mapping = scene(bodies, floors) | {"simulation": {"duration": 1.0} | run}
    found: Any = Simulation(load_scene(mapping))._motion
    assert isinstance(found, ContactMotion)
    return found


def test_errors_of_the_work_of_contacts_are_relative_to_its_rounding() -> None:
    """1e-13 of m v^2 over the tolerance, 1 J at least; of steps of fixed length 1 J."""

    def rounding(speed: float, **method: float) -> float:
        system = SimpleNamespace(mass=3.0, speed=speed)
        compiled: Any = SimpleNamespace(system=system)
        return ContactMotion._work_of_rounding(compiled, SimpleNamespace(**method))

    assert rounding(1e3, tolerance=1e-10) == pytest.approx(3e6 * 1e-3)
    assert rounding(10.0, tolerance=1e-10) == 1.0
    assert rounding(1e3, tolerance=0.0) == rounding(1e3, step=0.1) == 1.0


def test_the_room_of_a_step() -> None:
    """Spins and velocities are the last six of thirteen; the work of contacts is behind them."""
    found = motion()
    n = 13 * 2 + 1
    assert found._work.shape == (WORK_ROWS + 3 * n + 1, n)
    assert found._work[IS_VELOCITY].tolist() == ([0.0] * 7 + [1.0] * 6) * 2 + [0.0]
    assert (found._work[FLOOR] == 1.0).all() and (found._work[SHARE_OF_WAY] == 1.0).all()
    others = np.delete(found._work, [FLOOR, SHARE_OF_WAY, IS_VELOCITY], axis=0)
    assert not others.any()


def test_each_motion_of_a_scene_has_tables_of_its_own() -> None:
    found = motion()
    for name in ("touch", "vectors", "rows", "lines"):
        own, given = getattr(found.system, name), getattr(found.compiled.system, name)
        assert not np.shares_memory(own, given)
    assert found.system.still == 30.0 * TOLERANCE
    for i, name in enumerate(MASSES):  # |A w|^2 is w . I I w / (largest moment times mass)
        moments = np.array(MOMENTS[name])
        lengths = np.diag(moments / math.sqrt(moments.max() * MASSES[name]))
        assert_allclose(found._missed[i, LENGTHS:].reshape(3, 3), lengths, rtol=1e-12)
    assert not found._missed[:, :LENGTHS].any() and not found._grazes.any()


def test_a_motion_that_starts_again_has_missed_nothing() -> None:
    found = motion()
    y = np.array(found.compiled.y)
    found._due, found._pause, found._grazes[:], found._missed[:] = 5, 1.0, 1.0, 1.0
    found.reset(y, 3.0)
    assert not found.as_compiled and found._start == found._begun == 3.0
    assert (found._due, found._mark) == (-1, (0, 3.0)) and found._pause > 3.0
    assert not found._grazes.any() and not found._missed[:, :LENGTHS].any()
    found.reset()
    assert found.as_compiled


def test_what_steps_miss_is_relative_to_the_largest_velocity() -> None:
    """Or to the speed that is none; of what is no number nothing is told."""
    found = motion(fixed=True)
    found._missed[:, SUM], found._missed[:, LARGEST] = (0.3, 0.2), (2.0, 0.0)
    still = stepping.STILL * found.system.speed
    assert_allclose(found.missed_by_steps, [0.15, 0.2 / still])
    found._missed[0, SUM] = math.nan
    assert found.missed_by_steps[0] == 0.0
    found._missed[:, WORST_SHARE], found._missed[:, WORST_TIME] = (0.1, 0.4), (5.0, 6.0)
    assert found.worst_step == (1, 0.4, 6.0)


def test_impacts_and_slips_that_may_be_missed() -> None:
    """The worst of all contacts, over the scene's speed; at most 1."""
    found = motion()
    assert found._doubted.figure == 0.0
    found._grazes[:, SPEED], found._grazes[:, TIME] = (0.1, 0.2), (5.0, 6.0)
    found._grazes[:, LAG], found._grazes[:, LAG_TIME] = (0.4, 0.3), (7.0, 8.0)
    speed = found.system.speed
    assert found._doubted == LeftOpen(0.4, 7.0, "on_b0", LAGGED, by_setting=True)
    found._grazes[:, LAG] = 0.5 * 0.2 / speed
    assert found._doubted == LeftOpen(0.2 / speed, 6.0, "on_b1", GRAZE, by_setting=True)
    found._grazes[1, ROUNDED], found._grazes[1, ROUNDED_TIME] = 0.21 / speed, 9.0
    turned = LeftOpen(0.21 / speed, 9.0, "on_b1", TURNED_BY_ROUNDING, False, NO_SETTING)
    assert found._doubted == turned
    found._grazes[0, SPEED] = 2.0 * speed
    assert found._doubted[:3] == (1.0, 5.0, "on_b0")
    assert found.left_open.figure == 1.0


@pytest.mark.parametrize("fixed", [True, False])
def test_the_order_of_impacts_is_doubted_by_what_steps_may_have_missed(fixed: bool) -> None:
    """A tolerance for each step; or how far steps of fixed length may have gone astray."""
    found = motion(fixed=fixed)
    asked: list[Any] = []

    def doubt(*told: Any) -> float:
        asked.append(told)
        return 0.3 * float(found.system.speed)

    far = np.full(2, 9.0)
    found.__class__ = type("Told", (ContactMotion,), {
        "_call": SimpleNamespace(doubt=doubt, room=SimpleNamespace(far=far))})  # fmt: skip
    found._grid = found._grid._replace(t0=4.0, t1=4.5, steps=7)
    found._missed[:, SUM], found._missed[:, WAY] = (0.3, 0.2), (0.1, 0.4)
    found._start = 1.0
    order = found._order_of(1)
    assert order == LeftOpen(pytest.approx(0.3), 4.5, "on_b1", ORDER, True)
    ((t, y, c, span, allowed, alone),) = asked
    assert (t, c, span, alone) == (4.5, 1, 0.5, False) and y is found._grid.y1
    assert allowed == (0.0 if fixed else 7.0 * TOLERANCE)
    wanted = missed_way(found._missed, slice(None), 3.5) if fixed else [9.0, 9.0]
    assert_allclose(far, wanted)
    assert motion(balls=1)._order_of(0) == LeftOpen()


def test_why_an_implicit_method_finds_no_step() -> None:
    """Of slow slips that rub the contact is named."""
    found = motion()
    for implicit, status, rubs, named in (
        (1.0, NOT_FINITE, True, True), (0.0, NOT_FINITE, True, False),
        (1.0, UNFINISHED, True, False), (1.0, NOT_FINITE, False, False),
    ):  # fmt: skip
        taken = found._stepping._replace(setting=(0.0, 1e-6, 1.0, 8.0, implicit))
        found._taken = found.method, taken
        touch = found.system.touch
        touch[:, [CLOSED, SLIDE, STATIC]] = 1.0, STUCK, 0.3
        touch[1, SLIDE] = SLIDING if rubs else STUCK
        text = found._explain(status)
        assert ("turns a slow slip (on_b1)" in text) is named
    touch[1, [CLOSED, SLIDE]] = 0.0, SLIDING
    assert "slow slip" not in found._explain(NOT_FINITE)


def test_an_implicit_step_stands_beside_where_what_gives_way_rubs() -> None:
    """The method is taken anew where it is another one."""
    assert not motion()._stepping.implicit
    found = motion(compliance={"stiffness": 100.0})
    assert found._stepping.implicit and found.system.touch[0, COMPLIANT] == 1.0
    assert found._stepping is found._stepping
    first, found.method = found._stepping, found.method._replace(tolerance=1e-3)
    assert found._stepping is not first and found._stepping.setting[1] == 1e-3
    found._taken, found.system.touch[:, STATIC] = None, 0.0
    assert not found._stepping.implicit


@pytest.mark.parametrize("fixed", [True, False])
def test_steps_without_end_in_no_time_are_refused(fixed: bool) -> None:
    """A hundred thousand within less than 1e-4 of the scene's own time."""
    found = motion(fixed=fixed)
    unit = found.system.length / found.system.speed
    kind = StepTooLargeError if fixed else SimulationError

    def at(steps: int, t: float) -> None:
        found._grid = found._grid._replace(steps=steps, t1=t)
        found._refuse_to_stall()

    found._mark = 1000, 2.0
    at(100_999, 2.0)
    assert found._mark == (1000, 2.0)
    at(101_000, 2.0 + 1.01e-4 * unit)
    assert found._mark == (101_000, 2.0 + 1.01e-4 * unit)
    with pytest.raises(kind, match="100001 steps in the last") as error:
        at(201_001, 2.0 + 2e-4 * unit)
    assert type(error.value) is kind
    assert ("step 0.01 s is too large" in str(error.value)) is fixed


def test_steps_that_are_cut_over_and_over_are_refused_where_nothing_rubs() -> None:
    """By 4096 steps and 256 times the way ahead."""
    found = motion(fixed=True)
    found._begun = 2.0
    most = 4096.0 * STEP + 256.0 * 0.25

    def creeps(cut: float) -> None:
        found._grid = found._grid._replace(t1=2.25, origin=2.0 - cut)
        found._refuse_to_creep()

    creeps(0.999 * most)
    with pytest.raises(StepTooLargeError, match="no longer finite"):
        creeps(1.001 * most)
    touch = found.system.touch
    touch[1, [CLOSED, SLIDE]] = 1.0, SLIDING
    creeps(1.001 * most)
    touch[1, [CLOSED, SLIDE]] = 1.0, NONE
    touch[0, [CLOSED, SLIDE]] = 0.0, SLIDING
    with pytest.raises(StepTooLargeError):
        creeps(1.001 * most)
    found = motion(fixed=False)
    found._begun = 2.0
    found._grid = found._grid._replace(t1=2.25, origin=-1e9)
    found._refuse_to_creep()
