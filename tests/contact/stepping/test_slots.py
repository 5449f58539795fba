"""Points of two boxes keep what they remember while they stay where they were on the body."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim.contact.stepping.geometry import (
    FAR,
    GAP,
    IMPULSE,
    MEMORY,
    NORMAL,
    PLACE,
    POINT,
    USED,
    place_points,
)
from rb_sim.contact.stepping.step_workspace import memory_of
from rb_sim.mechanics.systems.many_bodies import state_of
from tests.contact.stepping.tables_by_hand import Heap
from tests.interpreted import interpreted

FIRST, HALF = 2, (0.9, 0.5, 0.7)
"""The pair's first point of contact, after those of another pair; half edges of its box."""
NEAR = 0.1 * min(HALF)
OLD = {5: np.array([0.4, -0.3, 0.2]), 2: np.array([-0.5, 0.1, 0.6])}
"""Slot and place on the body of what was there before."""


def placed(points: list[np.ndarray], forget: bool, others: bool = False) -> tuple[Any, ...]:
    """(spots and memory of the pair's slots after points at these places on the body, what was
    remembered before, world places, gaps).  others: memories of places that are not in use."""
    heap = Heap(2, [(1, 0)] * (FIRST + 8), 4)
    tables = heap.tables._replace(
        entries=np.array([[0, 1, 0, 0, 0], [11, 1, 0, FIRST, 0]]), sizes=np.zeros((2, 16))
    )
    tables.sizes[1, 3:6] = HALF
    memory = memory_of(FIRST + 8)
    memory[:FIRST] = 3.0
    for slot, place in OLD.items():
        memory[FIRST + slot] = np.arange(1.0, MEMORY + 1.0) + slot
        memory[FIRST + slot, PLACE : PLACE + 3] = place
        memory[FIRST + slot, USED] = 1.0
    if others:
        memory[FIRST + 3, PLACE : PLACE + 3] = points[0]
    before, workspace = memory.copy(), heap.workspace
    gaps = -0.01 * np.arange(1.0, len(points) + 1.0)
    world = [heap.place(1) + heap.turned(1).apply(p) for p in points]
    for k, p in enumerate(world):
        workspace.polygons[2, k, :5] = *p, gaps[k], 7.0
    B, A = state_of(heap.y, 1), state_of(heap.y, 0)
    args = (
        tables,
        memory,
        workspace.spots,
        workspace.polygons,
        1,
        len(points),
        (0.0, 0.6, 0.8),
        B,
        A,
        0.0,
    )
    place_points(*args, forget)
    assert np.array_equal(memory[:FIRST], before[:FIRST])
    return workspace.spots[FIRST:].copy(), memory[FIRST:].copy(), before[FIRST:], world, gaps


def slots_of(spots: np.ndarray, world: list[np.ndarray], gaps: np.ndarray) -> list[int]:
    """The slot of each point, all others being empty."""
    used = np.flatnonzero(spots[:, GAP] < FAR)
    found = []
    for p, gap in zip(world, gaps, strict=True):
        (slot,) = (c for c in used if spots[c, GAP] == gap)
        assert_allclose(spots[slot, POINT : POINT + 3], p)
        assert_allclose(spots[slot, NORMAL : NORMAL + 3], (0.0, 0.6, 0.8))
        found.append(int(slot))
    assert sorted(found) == used.tolist()
    return found


TURN = Rotation.from_rotvec([0.4, 0.5, -0.6]).as_matrix()
NEW = np.array([0.1, 0.45, -0.2])


@pytest.mark.parametrize("forget", [True, False])
@pytest.mark.parametrize(("away", "stays"), [(0.0, True), (0.9 * NEAR, True), (1.1 * NEAR, False)])
def test_a_point_keeps_its_slot_while_it_stays(away: float, stays: bool, forget: bool) -> None:
    """Within a tenth of the body's smallest half edge, in whatever order points are found; what is
    new takes the first slot that is free and remembers nothing."""
    points = [NEW, OLD[2] + away * TURN[0], OLD[5] + away * TURN[1]]
    spots, memory, before, world, gaps = interpreted(placed, points, forget)
    assert slots_of(spots, world, gaps) == ([0, 2, 5] if stays else [0, 1, 2])
    for k, slot in enumerate([0, 2, 5] if stays else [0, 1, 2]):
        assert_allclose(memory[slot, PLACE : PLACE + 3], points[k], atol=1e-15)
        assert memory[slot, USED] == 1.0
        rest = [j for j in range(MEMORY) if not PLACE <= j <= USED]
        known = before[slot, rest] if stays and k > 0 else np.zeros(len(rest))
        assert np.array_equal(memory[slot, rest], known)
    gone = [c for c in range(8) if spots[c, GAP] == FAR]
    assert np.array_equal(memory[gone], 0.0 * before[gone] if forget else before[gone])


def test_two_points_near_one_place_share_no_slot() -> None:
    """The first that is found stays."""
    points = [OLD[2] + 0.5 * NEAR * TURN[0], OLD[2] + 0.1 * NEAR * TURN[1]]
    spots, memory, before, world, gaps = interpreted(placed, points, True)
    assert slots_of(spots, world, gaps) == [2, 0]
    assert np.array_equal(memory[2, :PLACE], before[2, :PLACE])
    assert not memory[0, :PLACE].any()


def test_what_is_not_in_use_is_no_place_to_stay_at() -> None:
    spots, memory, _, world, gaps = interpreted(placed, [NEW], True, True)
    assert slots_of(spots, world, gaps) == [0]
    assert not memory[0, IMPULSE : IMPULSE + 3].any()


def test_eight_points_take_all_slots() -> None:
    points = [NEW + np.array([0.2 * k, 0.0, 0.0]) for k in range(8)]
    spots, _, _, world, gaps = interpreted(placed, points, True)
    assert slots_of(spots, world, gaps) == list(range(8))
