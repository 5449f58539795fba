"""What a step of time stepping reports, beside sums over bodies and points."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.contact.stepping.geometry import (
    AIM,
    ANCHOR,
    CLOSED,
    GAP,
    IMPULSE,
    NORMAL,
    POINT,
    SLIDE,
    TWIST,
)
from rb_sim.contact.stepping.step_kernels import (
    is_finite,
    note_aims,
    note_anchors,
    reach_of,
    report,
    steps,
)
from rb_sim.contact.stepping.step_workspace import ASTRAY, ASTRAY_AT, ASTRAY_OF, STUCK, memory_of
from rb_sim.mechanics.contact.contact_kinematics import SLIDING
from tests.contact.stepping.tables_by_hand import LENGTH, SPEED, Heap
from tests.interpreted import interpreted

H = 0.01
OWNERS = [(0, -1), (1, 0), (1, 0), (2, 1)]
MEMBERS = np.array(
    [[0, 1, 0, 0, 0, 0, 0], [2, 0, 0, 1, 0, 0, 0], [-2, 0, 0, 0, 1, 1, 0], [5, 0, 0, 0, 0, 0, 1]]
)
"""Of a joint (2 parts), the first point, both points between 1 and 0, and the last."""
HELD = (1.0, 1.0, 1.0, 0.0)
"""Points that are still closed at the end of the step."""


def reported(modes: tuple[float, ...]) -> tuple[Any, ...]:
    """(row of a sample, y, table of bodies, gravity, memory, inertias, turns of the bodies)."""
    heap, rng = Heap(3, OWNERS, 11), np.random.default_rng(1)
    heap.y[-1] = 0.7
    heap.gaps(0.2, -1e-3, -5e-3, 1e300, soft=(2,))
    memory = memory_of(len(OWNERS))
    for at in (IMPULSE, TWIST, ANCHOR):
        memory[:, at : at + 3] = rng.normal(size=(len(OWNERS), 3))
    memory[:, CLOSED], memory[:, SLIDE] = HELD, modes
    out = np.zeros(13 * 3 + 9 * len(MEMBERS) + 11 + len(OWNERS))
    report.function(heap.tables, memory, heap.workspace, MEMBERS, 2, heap.y, H, out)
    turns = [heap.turned(i).as_matrix() for i in range(3)]
    return out, heap.y, heap.masses, heap.tables.gravity, memory, heap.inertias, turns


MODES = (STUCK, SLIDING, STUCK, STUCK)


def test_reactions_are_impulses_over_the_step() -> None:
    """Of a point at the point, of several at the body's centre of mass; also of what has left."""
    out, y, _, _, memory, _, _ = interpreted(reported, MODES)
    told = out[39 : 39 + 9 * len(MEMBERS)].reshape(-1, 3, 3)
    assert not told[0].any()  # of a joint: Python's to add
    f = memory[:, IMPULSE : IMPULSE + 3] / H
    k = memory[:, TWIST : TWIST + 3] / H
    p = memory[:, ANCHOR : ANCHOR + 3]
    assert_allclose(told[1], [f[0], k[0], p[0]])
    centre = y[13:16]
    torque = k[1] + k[2] + np.cross(p[1] - centre, f[1]) + np.cross(p[2] - centre, f[2])
    assert_allclose(told[2], [f[1] + f[2], torque, centre])
    assert_allclose(told[3], [f[3], k[3], p[3]])


def test_balances_are_sums_over_bodies() -> None:
    """Energies, momentum and angular momentum; the power of each point on both its bodies."""
    out, y, masses, gravity, memory, inertias, turns = interpreted(reported, MODES)
    kinetic, potential, momentum, angular, power = 0.0, 0.0, np.zeros(3), np.zeros(3), 0.0
    spins = []
    for i in range(3):
        p, v, w = y[13 * i : 13 * i + 3], y[13 * i + 7 : 13 * i + 10], y[13 * i + 10 : 13 * i + 13]
        kinetic += 0.5 * (masses[i] * v @ v + w @ inertias[i] @ w)
        potential -= masses[i] * gravity[i] @ p
        momentum += masses[i] * v
        angular += np.cross(p, masses[i] * v) + turns[i] @ inertias[i] @ w
        spins.append(turns[i] @ w)
    for c, (b, a) in enumerate(OWNERS):
        f, k, p = (memory[c, at : at + 3] for at in (IMPULSE, TWIST, ANCHOR))
        for i, sign in ((b, 1.0), (a, -1.0)):
            if i >= 0:
                v = y[13 * i + 7 : 13 * i + 10] + np.cross(spins[i], p - y[13 * i : 13 * i + 3])
                power += sign * (f @ v + k @ spins[i]) / H
    assert np.array_equal(out[:39], y[:39])
    at = 39 + 9 * len(MEMBERS)
    assert_allclose(out[at : at + 9], [kinetic, potential, power, *momentum, *angular], rtol=1e-12)


def test_states_overlap_and_work_are_told() -> None:
    """The overlap of what is rigid and has been looked at, in lengths of the scene."""
    for modes in (MODES, (SLIDING, STUCK, SLIDING, SLIDING)):
        out = interpreted(reported, modes)[0]
        assert out[-6] == pytest.approx(1e-3 / LENGTH)
        assert out[-5] == 0.7
        told = [2.0 if mode == STUCK else 1.0 for mode in modes]
        assert out[-4:].tolist() == [t if held else 0.0 for t, held in zip(told, HELD, strict=True)]


def reaches(h: float, factor: float) -> tuple[float, float]:
    heap = Heap(3, [], 2)
    for i in range(3):
        heap.y[13 * i + 7 : 13 * i + 13] *= factor
    fastest = max(
        np.linalg.norm(heap.y[13 * i + 7 : 13 * i + 10])
        + LENGTH * np.linalg.norm(heap.y[13 * i + 10 : 13 * i + 13])
        for i in range(3)
    )
    return reach_of(heap.tables, heap.y, h), float(fastest)


def test_surfaces_lose_no_more_in_a_step_than_both_can_go() -> None:
    """Two bodies at the speed of the fastest, or of the scene, up to the scene's length."""
    looked = 1e-6 * LENGTH
    for h, factor in ((1e-3, 1.0), (1e-3, 1e-3), (10.0, 1.0)):
        found, fastest = interpreted(reaches, h, factor)
        assert found == pytest.approx(min(2.0 * h * max(SPEED, fastest), LENGTH) + looked)


def anchors() -> tuple[Any, ...]:
    heap = Heap(3, OWNERS, 3)
    heap.gaps(0.0, 1e300, -1.0, 2.0)
    memory = memory_of(len(OWNERS))
    note_anchors(memory, heap.workspace)
    return memory, heap.workspace.spots


def test_anchors_are_kept_of_points_that_are_there() -> None:
    memory, spots = interpreted(anchors)
    there = spots[:, GAP] < 1e299
    assert there.tolist() == [True, False, True, True]
    expected = np.where(there[:, None], spots[:, POINT : POINT + 3], 0.0)
    assert np.array_equal(memory[:, ANCHOR : ANCHOR + 3], expected)
    assert not memory[:, :ANCHOR].any() and not memory[:, ANCHOR + 3 :].any()


def aims() -> tuple[Any, ...]:
    """(worst, its time and contact, what is left of the aims, aims, normals) of contacts of which
    the second pushes by little, the third not at all, and the last one is not there."""
    heap = Heap(3, OWNERS, 3)
    heap.gaps(0.0, 0.1, 0.0, 1e300)
    memory = memory_of(len(OWNERS))
    given = np.random.default_rng(7).normal(size=(4, 3)) * np.array([[1.0], [0.1], [0.0], [9.0]])
    memory[:, AIM : AIM + 3] = given
    heap.workspace.notes[ASTRAY] = 1e-3
    note_aims(memory, heap.workspace, 2.5)
    found = heap.workspace.notes[[ASTRAY, ASTRAY_AT, ASTRAY_OF]].copy()
    return found, memory[:, AIM : AIM + 3], given, heap.workspace.spots[:, NORMAL : NORMAL + 3]


def test_normals_that_have_turned_are_told_of_what_has_pushed() -> None:
    """The velocity that an impulse gave, less as much along the normal at the end of the step."""
    found, left, given, normals = interpreted(aims)
    wrong = np.linalg.norm(np.linalg.norm(given, axis=1)[:, None] * normals - given, axis=1)
    assert wrong[0] > wrong[1] > 1e-3
    assert found == pytest.approx([wrong[0], 2.5, 0.0])
    assert not left.any()


def falling(first: int, count: int, speed: float) -> tuple[Any, ...]:
    """Steps of bodies that nothing touches."""
    heap = Heap(2, [], 8)
    heap.y[7:13] = 0.0
    heap.y[20:26] = 0.0
    heap.y[7] = speed
    y, before, kept = heap.y.copy(), np.zeros(27), memory_of(0)
    made = steps(heap.tables, memory_of(0), heap.workspace, 0.0, first, count, H, y, before, kept)
    return made, y, before, heap.y, heap.tables.gravity


@pytest.mark.parametrize(("first", "count"), [(0, 1), (5, 4)])
def test_steps_fall_exactly(first: int, count: int) -> None:
    """Halves at the old and the new velocity are the parabola; the state before the last step is
    kept."""
    made, y, before, start, g = interpreted(falling, first, count, 0.3)
    assert made == count
    for state, n in ((y, count), (before, count - 1)):
        t = n * H
        for i in range(2):
            v = start[13 * i + 7 : 13 * i + 10]
            p = start[13 * i : 13 * i + 3] + t * v + 0.5 * t * t * g[i]
            assert_allclose(state[13 * i : 13 * i + 3], p, rtol=1e-13, atol=1e-15)
            assert_allclose(state[13 * i + 7 : 13 * i + 10], v + t * g[i], rtol=1e-13, atol=1e-15)


def test_steps_end_where_numbers_do() -> None:
    for first, count in ((0, 3), (4, 2)):
        assert interpreted(falling, first, count, float("nan"))[0] == 0
    y = np.arange(5.0)
    assert is_finite(y)
    for at in range(5):
        for bad in (np.nan, np.inf):
            spoilt = y.copy()
            spoilt[at] = bad
            with np.errstate(invalid="ignore"):
                assert not is_finite(spoilt)
