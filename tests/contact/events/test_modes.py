"""Which contacts may close, how they begin, and what moves at once: on tables by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.catalogue.geometry.corners_and_rims import ABSENT
from rb_sim.contact.problem import modes
from rb_sim.contact.problem.event_workspace import find_touching
from rb_sim.contact.problem.forces import CANDIDATE, PRESSED, add_bound, add_line
from rb_sim.mechanics.contact.contact_bodies import LIFT_OFF, SLIP_BEGINS
from rb_sim.mechanics.contact.contact_kinematics import NONE, SLIDING, STUCK
from rb_sim.mechanics.contact.contact_table import (
    BILATERAL,
    CLOSED,
    COMPLIANT,
    GAP,
    GAP_RATE,
    LEAN_SIGN,
    NORMAL,
    NORMAL_SIGN,
    RELATIVE_SPIN,
    ROLL,
    ROLL_DIRECTION,
    ROLLING_ARM,
    SLIDE,
    SLIP,
    SLIP_DIRECTION,
    SPIN,
    SPIN_SIGN,
    SPINNING_ARM,
    SPRING,
    STATIC,
    TOUCH_WIDTH,
)
from rb_sim.numerics.complementarity import FIRST, PUSH, SECOND
from rb_sim.numerics.vectors import perpendicular

NEW = {
    "bilateral": (BILATERAL, 1.0), "far": (GAP, 1e-9), "under": (GAP, -1e-3),
    "parts": (GAP_RATE, 3e-10), "comes": (GAP_RATE, -3e-10),
    "soft": (COMPLIANT, 1.0), "pressed": (SPRING, 5.0),
    "absent": (LEAN_SIGN, float(ABSENT)),
}  # fmt: skip
"""What is said of a contact that touches at rest, of a scene of 2 m/s and 0.5 m."""


def tables(*contacts: str) -> tuple[Any, Any]:
    touch = np.zeros((len(contacts), TOUCH_WIDTH))
    touch[:, [CLOSED, SLIDE, ROLL, SPIN]] = 1.0, STUCK, SLIDING, STUCK
    touch[:, NORMAL : NORMAL + 3], touch[:, LEAN_SIGN] = (0.6, 0.0, 0.8), 1.0
    for c, words in enumerate(contacts):
        for column, value in (NEW[word] for word in words.split()):
            touch[c, column] = value
    n = len(contacts)
    workspace = SimpleNamespace(
        taking_part=np.full(n, 9), opened=np.zeros(n, dtype=int), moved=np.zeros((n, 3), dtype=int)
    )
    first = np.array([0, *range(0, 6 * n + 1, 6)])
    return SimpleNamespace(touch=touch, speed=2.0, length=0.5, first_row=first, joints=1), workspace


@pytest.mark.parametrize(
    ("contact", "part"),
    [
        ("", CANDIDATE), ("under", CANDIDATE), ("far", 0), ("parts", 0), ("comes", 0),
        ("absent", 0),
        ("bilateral far parts", CANDIDATE), ("soft", 0), ("soft under", 0), ("soft pressed", 0),
        ("soft under pressed", PRESSED), ("soft under pressed absent", 0),
        ("soft under pressed parts", PRESSED),
    ],
)  # fmt: skip
def test_who_may_close(contact: str, part: int) -> None:
    """What touches and neither comes nor parts; what a support that gives way presses."""
    system, workspace = tables("far", contact, "")
    assert modes.sort_contacts(system, workspace, (-1, -1)) == 1 + (part != 0)
    assert workspace.taking_part.tolist() == [0, part, CANDIDATE]
    of_it = system.touch[1, [CLOSED, SLIDE, ROLL, SPIN]].tolist()
    assert of_it == ([1.0, STUCK, SLIDING, STUCK] if part else [NONE] * 4)
    assert not system.touch[0, [CLOSED, SLIDE, ROLL, SPIN]].any()


def test_what_is_opened_or_lifts_off_does_not_close() -> None:
    for code, opened, parts in (
        ((1, LIFT_OFF), 0, [CANDIDATE, 0, CANDIDATE]),
        ((1, SLIP_BEGINS), 0, [CANDIDATE] * 3),
        ((2, LIFT_OFF), 0, [CANDIDATE] * 3),  # held both ways
        ((-1, -1), 1, [0, CANDIDATE, CANDIDATE]),
    ):
        system, workspace = tables("", "", "bilateral")
        workspace.opened[0] = opened
        modes.sort_contacts(system, workspace, code)
        assert workspace.taking_part.tolist() == parts


@pytest.mark.parametrize(("speed", "slides"), [(1.9e-10, False), (2.1e-10, True)])
def test_what_moves_slides_at_first_and_all_else_is_stuck(speed: float, slides: bool) -> None:
    """A slip of 1e-10 of the scene's speed is none, nor is a turning of as much over its length."""
    system, _ = tables("")
    touch = system.touch
    touch[0, [STATIC, ROLLING_ARM, SPINNING_ARM]] = 0.5, 0.1, 0.2
    across, along = np.array([0.8, 0.0, -0.6]), np.array([0.6, 0.0, 0.8])
    touch[0, SLIP : SLIP + 3] = speed * across
    touch[0, RELATIVE_SPIN : RELATIVE_SPIN + 3] = 2.0 * speed * (
        0.0 - along
    ) + 2.0 * speed * np.array([0.0, 1.0, 0.0])
    modes.first_guess(system, 0, False)
    mode = SLIDING if slides else STUCK
    assert touch[0, [SLIDE, ROLL, SPIN, NORMAL_SIGN]].tolist() == [mode, mode, mode, 1.0]
    if slides:
        assert_allclose(touch[0, SLIP_DIRECTION : SLIP_DIRECTION + 3], across)
        assert_allclose(touch[0, ROLL_DIRECTION : ROLL_DIRECTION + 3], [0.0, 1.0, 0.0], atol=1e-14)
        assert touch[0, SPIN_SIGN] == -1.0
    else:
        assert not touch[
            0, [SLIP_DIRECTION, SLIP_DIRECTION + 2, ROLL_DIRECTION + 1, SPIN_SIGN]
        ].any()
    touch[0, [STATIC, ROLLING_ARM, SPINNING_ARM]] = 0.0
    modes.first_guess(system, 0, True)
    assert touch[0, [SLIDE, ROLL, SPIN, NORMAL_SIGN]].tolist() == [SLIDING, NONE, NONE, 1.0]
    touch[0, BILATERAL] = 1.0
    modes.first_guess(system, 0, True)
    assert touch[0, NORMAL_SIGN] == -1.0


def begun(way: int, x: tuple[float, float], w: tuple[float, float], moved: int = 0) -> Any:
    """The table and what has moved, after the bound of contact 1 in one of its ways."""
    system, workspace = tables("", "")
    workspace.bounds = np.array([[0, 1, 9], [3, 4 if way < 2 else -1, 9]])
    workspace.moves, workspace.moved[1, way] = np.array([[0, 0], [1, way]]), moved
    values = np.zeros((2, 6))
    values[:, 3:5] = x, w
    modes.begin_to_move(system, workspace, 1, values[0], values[1], 10.0)
    return system.touch[1], workspace.moved


@pytest.mark.parametrize(("way", "ahead"), [(0, SLIP_DIRECTION), (1, ROLL_DIRECTION)])
def test_what_begins_to_move_goes_where_it_is_driven(way: int, ahead: int) -> None:
    """By w of 1e-10 of the largest acceleration, or that over the length; against the force where
    it has left its rest but has no acceleration."""
    t1, t2 = map(np.array, perpendicular((0.6, 0.0, 0.8)))
    least = 1e-9 if way == 0 else 2e-9
    touch, moved = begun(way, (3.0, 4.0), (0.6 * 1.01 * least, -0.8 * 1.01 * least))
    assert touch[SLIDE + way] == SLIDING and moved[1].tolist() == [k == way for k in range(3)]
    assert_allclose(touch[ahead : ahead + 3], 0.6 * t1 - 0.8 * t2, atol=1e-14)
    touch, moved = begun(way, (3.0, 4.0), (0.6 * 0.99 * least, -0.8 * 0.99 * least))
    assert touch[SLIDE + way] == STUCK and not moved.any()
    touch, _ = begun(way, (3.0, 4.0), (0.0, 0.0), 1)
    assert touch[SLIDE + way] == SLIDING
    assert_allclose(touch[ahead : ahead + 3], -0.6 * t1 - 0.8 * t2, atol=1e-14)


@pytest.mark.parametrize("w", [3e-9, -3e-9])
def test_what_begins_to_spin_has_a_sense(w: float) -> None:
    touch, moved = begun(2, (1.0, 7.0), (w, 9.0))
    assert touch[SPIN] == SLIDING and touch[SPIN_SIGN] == np.sign(w) and moved[1, 2] == 1
    touch, _ = begun(2, (w, 7.0), (0.0, 9.0), 1)
    assert touch[SPIN_SIGN] == -np.sign(w)
    assert begun(2, (1.0, 7.0), (1.9e-9, 9.0))[0][SPIN] == STUCK


def test_modes_that_follow_from_forces_and_accelerations() -> None:
    """What parts opens, of accelerations up to 3 and loads up to 7 m/s^2; what is held both ways
    pulls or pushes as its force says, unless it slides."""
    system, workspace = tables("", "", "bilateral", "bilateral")
    touch = system.touch
    touch[3, SLIDE], touch[:, NORMAL_SIGN] = SLIDING, 5.0
    workspace.taking_part[:] = CANDIDATE, CANDIDATE, CANDIDATE, CANDIDATE
    workspace.place_of = np.zeros(24, dtype=int)
    workspace.place_of[[0, 6, 12, 18]] = 0, 1, 2, 3
    workspace.free_accelerations = np.array([2.0, -7.0, 0.0])
    x, w = np.array([4.0, 0.0, -2.0, -2.0, 0.0]), np.array([0.9e-9, 1.1e-9, 3e-9, 3e-9, -3.0])
    workspace.bounds, workspace.moves = (
        np.array([[4, -1, 0], [4, -1, 0]]),
        np.array([[0, 2], [1, 2]]),
    )
    modes.read_modes(system, workspace, 5, 2, x, w)
    assert touch[:2, SPIN].tolist() == [SLIDING, NONE] and touch[0, SPIN_SIGN] == -1.0
    assert workspace.moved[:2].tolist() == [[0, 0, 1], [0, 0, 0]]
    workspace.moved[:] = 0
    assert touch[:, CLOSED].tolist() == [1.0, 0.0, 1.0, 1.0]
    assert touch[:, NORMAL_SIGN].tolist() == [5.0, 5.0, -1.0, 5.0]
    workspace.moved[1] = 0, 1, 1
    workspace.moved[2, 0] = 1
    assert modes.moving(workspace) == 3


def test_what_touches_takes_part_and_the_fastest_is_told() -> None:
    """A contact that is held both ways touches anywhere, one that gives way never."""
    contacts = ("", "far", "bilateral far", "soft", "absent", "under comes", "soft bilateral")
    system, workspace = tables(*contacts)
    system.touch[0, GAP_RATE], system.touch[2, GAP_RATE] = 3.0, -1e-10
    assert modes.touches(system, 0) and not modes.touches(system, 1)
    assert find_touching(system, workspace) == 5
    assert workspace.taking_part.tolist() == [1, 0, 1, 0, 0, 1, 0]
    system, workspace = tables("far", "soft")
    assert find_touching(system, workspace) == -1 and not workspace.taking_part.any()


def test_lines_and_bounds_are_laid_out_one_after_the_other() -> None:
    workspace: Any = SimpleNamespace(
        used=np.full(3, -1), place_of=np.full(9, -1), rules=np.full(3, -1), least=np.full(3, 7.0),
        bounds=np.full((2, 3), -1), limits=np.zeros(2), moves=np.full((2, 2), -1),
    )  # fmt: skip
    assert add_line(workspace, add_line(workspace, 0, 8, 2), 4, 1) == 2
    assert workspace.used.tolist() == [8, 4, -1] and workspace.rules.tolist() == [2, 1, -1]
    assert workspace.place_of[[8, 4]].tolist() == [0, 1] and workspace.least.tolist() == [
        0.0,
        0.0,
        7.0,
    ]
    assert (
        add_bound(
            workspace, add_bound(workspace, 0, (4, 5, 3), 0.5, (1, 0)), (6, -1, 3), 0.25, (2, 2)
        )
        == 2
    )
    assert workspace.bounds[:, [FIRST, SECOND, PUSH]].tolist() == [[4, 5, 3], [6, -1, 3]]
    assert workspace.limits.tolist() == [0.5, 0.25] and workspace.moves.tolist() == [[1, 0], [2, 2]]
