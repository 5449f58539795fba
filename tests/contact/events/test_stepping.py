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
from rb_sim.contact.events.event_motion import ContactMotion
from rb_sim.contact.events.next_event import LAG, LAG_TIME, ROUNDED, ROUNDED_TIME
from rb_sim.contact.events.shares import LAGGED, NO_SETTING, TURNED_BY_ROUNDING, LeftOpen
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
        assert_allclose(found._arms[i].reshape(3, 3), lengths, rtol=1e-12)
    assert not found._kept.any()


def test_a_motion_that_starts_again_has_left_nothing_open() -> None:
    found = motion()
    y = np.array(found.compiled.y)
    found._due, found._pause, found._kept[:] = 5, 1.0, 1.0
    found.reset(y, 3.0)
    assert not found.as_compiled and found._begun == 3.0
    assert (found._due, found._mark) == (-1, (0, 3.0)) and found._pause > 3.0
    assert not found._kept.any()
    found.reset()
    assert found.as_compiled


def test_the_widest_of_what_errors_leave_open_is_told() -> None:
    """Of all contacts the slip that friction lags behind most, or the rim that rounding turned."""
    found = motion()
    assert found._doubted.figure == 0.0
    found._kept[:, LAG], found._kept[:, LAG_TIME] = (0.4, 0.3), (7.0, 8.0)
    assert found._doubted == LeftOpen(0.4, 7.0, "on_b0", LAGGED, by_setting=True)
    found._kept[1, ROUNDED], found._kept[1, ROUNDED_TIME] = 0.5, 9.0
    turned = LeftOpen(0.5, 9.0, "on_b1", TURNED_BY_ROUNDING, False, NO_SETTING)
    assert found._doubted == found.left_open == turned


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
        assert ("slow slips with friction (on_b1)" in text) is named
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
