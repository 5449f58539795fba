"""What is left of a slip that ends is taken away where it is, and stops nothing else."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rb_sim.contact.events.event_motion import stop
from rb_sim.contact.events.tasks import SETTLE
from rb_sim.mechanics.contact.contact_kinematics import STUCK
from rb_sim.mechanics.contact.contact_table import (
    CREEPS,
    RELATIVE_SPIN,
    ROLL,
    SLIDE,
    SLIP,
    TOUCH_WIDTH,
)
from tests.contact.scenes import box, scene, touch
from tests.runs import trajectory

CREEP = 1e-6
"""Slip at which the corner of the law is rounded that the other is compared with [m/s]."""
BOXES = {
    "tall": (
        box((0.113, 0.133, 0.192), [0.0, 0.0, 0.09552298875])
        | {
            "mass": 0.778,
            "orientation": {"axis": [-0.519, 0.158, 0.0], "angle": 7.66e-4},
            "linear_velocity": [4.09e-4, -3.67e-4, 4.72e-4],
            "angular_velocity": [-0.0152, -0.0158, -0.0106],
        },
        {"stiffness": 4000.0},
        0.368,
    ),
    "flat": (
        box((0.184, 0.122, 0.0936), [0.0, 0.0, 0.04664671875])
        | {
            "mass": 0.475,
            "orientation": {"axis": [0.919, 0.993, 0.0], "angle": 3.71e-4},
            "linear_velocity": [2.67e-4, 3.54e-4, 1.09e-3],
            "angular_velocity": [0.00683, 0.04, 0.00492],
        },
        {"stiffness": 7600.0},
        0.498,
    ),
}
"""(box, its support, coefficient of friction)."""


@pytest.mark.parametrize("name", BOXES)
def test_corners_that_creep_let_a_box_rock(name: str) -> None:
    """A box rocks on a floor that gives way, its corners creep.  Two of them at rest leave no
    rocking across the line through both: where the slip of one turned, it was ended, and the
    rocking with it, over and over, which left angular velocities wrong by a tenth."""
    moving, compliance, mu = BOXES[name]

    def of(friction: dict[str, Any]) -> Any:
        floor = touch(friction=friction, compliance=compliance)
        mapping = scene(moving, floor)
        return trajectory(mapping | {"simulation": {"duration": 0.01, "rate": 1000.0}})

    found = of({"type": "coulomb", "static": mu})
    rounded = of({"type": "regularised", "coefficient": mu, "speed": CREEP})
    for field in ("angular_velocity", "linear_velocity"):
        error = getattr(found, field) - getattr(rounded, field)
        np.testing.assert_allclose(error, 0.0, atol=1e-4, err_msg=field)


def stopped(mode: int, dv: list[float], dw: list[float], still: float = 1e-6) -> bool:
    """Whether contact 1, which slips by 3e-3 m/s and turns by 3e-3 rad/s about its scene's 2 m, has
    stopped where settling without it changes the second of two bodies by so much; `A` is 4 m about
    z. What is not taken away stays as it was."""
    touch, y = np.full((2, TOUCH_WIDTH), 0.7), np.arange(26.0)
    touch[:, CREEPS] = 0.0
    touch[1, SLIP : SLIP + 3] = touch[1, RELATIVE_SPIN : RELATIVE_SPIN + 3] = 1e-3, 2e-3, 2e-3
    system = SimpleNamespace(touch=touch, length=2.0, still=still, bodies=np.zeros((2, 1)))
    at: Any = SimpleNamespace(system=system, t=4.0, y=y, refreshed=0)
    before, table = y.copy(), touch.copy()

    def settle(task: int, t: float, where: np.ndarray) -> None:
        assert task == SETTLE and t == 4.0 and touch[1, mode] == STUCK
        where[20:23] += dv
        where[23:26] += dw
        touch[0, SLIDE] = STUCK

    def refresh() -> None:
        at.refreshed += 1

    at.call, at.refresh = settle, refresh
    stops = stop(at, [1], mode, np.stack([np.eye(3), np.diag([1.0, 1.0, 4.0])]))
    assert at.refreshed == (1 if stops else 2)
    assert stops == bool((y != before).any() or (touch != table).any())
    assert touch[1, mode] == (STUCK if stops else 0.7)
    return stops


@pytest.mark.parametrize(("mode", "most"), [(SLIDE, 3e-2), (ROLL, 6e-2)])
def test_what_is_left_is_taken_away_where_bodies_hardly_move_for_it(mode: int, most: float) -> None:
    """By ten times what is left of the slip, or of the rolling over the scene's length; turns count
    by their A."""
    for part in (0.99, 1.01):
        assert stopped(mode, [0.0, -0.6 * part * most, 0.8 * part * most], [0.0] * 3) is (part < 1)
        assert stopped(mode, [0.0] * 3, [0.0, 0.0, -0.25 * part * most]) is (part < 1)
        assert stopped(mode, [0.0] * 3, [part * most, 0.0, 0.0]) is (part < 1)
    assert stopped(mode, [0.0, 0.0, 1.01 * most], [0.0] * 3, still=2.0 * most)
