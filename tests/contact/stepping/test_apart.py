"""How bodies are moved apart after a step, beside least squares, and what they pay for it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import nnls

from rb_sim.contact.stepping.geometry import CLOSED, MOVES, NORMAL
from rb_sim.contact.stepping.step_kernels import (
    deepest_overlap,
    pay_for_lift,
    push_apart,
    shift_deepest,
)
from rb_sim.contact.stepping.step_workspace import memory_of
from rb_sim.mechanics.systems.many_bodies import LOAD
from tests.contact.stepping.tables_by_hand import LENGTH, Heap, same_poses
from tests.interpreted import interpreted

OWNERS = [(0, -1), (1, 0), (2, 1), (2, -1), (1, -1)]
NONE = 0.5e-12 * LENGTH
"""Overlap that is none [m]."""


def least_shift(heap: Heap, gaps: np.ndarray, near: list[int]) -> np.ndarray:
    """The least displacements by mass, s . M s / 2, with gap + J s >= 0 of the near points: s =
    M^-1 J^T x, x >= 0, where the least of |L (x - ...)| of the dual is one of least squares."""
    if not near:
        return np.zeros(6 * len(heap.masses))
    J, W = heap.lines()[near], heap.inverse_mass()
    half = np.linalg.cholesky(W)
    # of the least distance from the origin to {G v >= h} (Lawson and Hanson 1974, ch. 23)
    G, h = J @ half, -gaps[near]
    E, f = np.vstack([G.T, h]), np.append(np.zeros(G.shape[1]), 1.0)
    u, _ = nnls(E, f)
    r = E @ u - f
    return half @ (-r[:-1] / r[-1])


def pushed(gaps: tuple[float, ...], soft: tuple[int, ...], seed: int) -> tuple[object, ...]:
    heap = Heap(3, OWNERS, seed)
    heap.gaps(*gaps, soft=soft)
    deepest, found = deepest_overlap(heap.tables, heap.workspace)
    near = [c for c in range(5) if c not in soft and gaps[c] <= -4.0 * deepest]
    expected = heap.moved(least_shift(heap, np.array(gaps), near))
    y = heap.y.copy()
    done = push_apart(heap.tables, heap.workspace, y)
    return done, y, expected, heap.y, (deepest, found)


TINY = 1e-4


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("gaps", "soft", "deepest"),
    [
        ((-2.0, 90.0, 90.0, 90.0, 90.0), (), 0),
        ((90.0, -2.0, 90.0, 90.0, 90.0), (), 1),
        ((-1.0, -2.0, -0.5, 1.0, 7.9), (), 1),
        ((0.0, 3.0, -2.0, 0.0, 8.1), (), 2),
        ((-1.0, -2.0, -0.5, 1.0, -9.0), (4,), 1),
    ],
)
def test_bodies_move_apart_by_as_little_as_can_be(
    gaps: tuple[float, ...], soft: tuple[int, ...], deepest: int, seed: int
) -> None:
    """To first order in the overlaps; what gives way, or is farther than four times the deepest
    overlap, is left alone."""
    small = tuple(TINY * gap for gap in gaps)
    done, y, expected, before, found = interpreted(pushed, small, soft, seed)
    assert done is False
    assert found == (small[deepest], deepest)
    assert not same_poses(y, before, 0.1 * TINY)
    assert same_poses(y, expected, 1e-4 * TINY)
    for i in range(3):
        assert np.array_equal(y[13 * i + 7 : 13 * i + 13], before[13 * i + 7 : 13 * i + 13])


@pytest.mark.parametrize("gap", [0.0, 1.0, -NONE])
def test_what_does_not_overlap_stays(gap: float) -> None:
    done, y, _, before, _ = interpreted(pushed, (gap, 1.0, 1.0, 1.0, -1.0), (4,), 0)
    assert done is True
    assert np.array_equal(y, before)


def shifted(gaps: tuple[float, ...], soft: tuple[int, ...]) -> tuple[object, ...]:
    heap = Heap(3, OWNERS, 7)
    heap.gaps(*gaps, soft=soft)
    y = heap.y.copy()
    done = shift_deepest(heap.tables, heap.workspace, y)
    return done, y - heap.y, heap.masses, heap.workspace.spots[:, NORMAL : NORMAL + 3]


def test_the_deepest_pair_alone_is_shifted_along_its_normal() -> None:
    """Each body by its share of the inverse masses; the world stays."""
    done, way, masses, normals = interpreted(shifted, (-0.1, -0.3, 0.2, 0.0, -0.9), (4,))
    assert done is False
    share = (1.0 / masses[:2]) / (1.0 / masses[:2]).sum()
    assert_allclose(way[13:16], 0.3 * share[1] * normals[1], atol=1e-15)
    assert_allclose(way[:3], -0.3 * share[0] * normals[1], atol=1e-15)
    assert not way[3:13].any() and not way[16:].any()
    done, way, _, normals = interpreted(shifted, (-0.4, -0.3, 0.2, 0.0, 0.1), ())
    assert done is False
    assert_allclose(way[:3], 0.4 * normals[0], atol=1e-15)
    assert not way[3:].any()
    done, way, _, _ = interpreted(shifted, (0.0, -NONE, 0.2, 0.0, 0.1), ())
    assert done is True and not way.any()


def paid(lift: float, driven: tuple[float, ...] = (), closed: float = 1.0) -> tuple[object, ...]:
    """(kinetic energies before and after, work before and after, what the loads lost, velocities)
    of two bodies that were moved along their loads: 0 against it, 1 with it.  driven: how the
    support of body 0 moves and turns."""
    heap = Heap(2, [(0, -1)], 5)
    heap.workspace.spots[0, MOVES : MOVES + len(driven)] = driven
    memory = memory_of(1)
    memory[0, CLOSED] = closed
    load = np.array([[0.3, -0.5, -2.0], [1.0, 0.4, -1.0]])
    heap.tables.bodies[:, LOAD : LOAD + 3] = load
    before, y, lost = heap.y.copy(), heap.y.copy(), []
    for i, sign in ((0, -1.0), (1, 0.5)):
        way = sign * lift * load[i]
        y[13 * i : 13 * i + 3] += way
        lost.append(float(-load[i] @ way))
    y[-1] = before[-1] = 0.25

    def kinetic(state: np.ndarray, i: int) -> float:
        v, w = state[13 * i + 7 : 13 * i + 10], state[13 * i + 10 : 13 * i + 13]
        return 0.5 * float(heap.masses[i] * v @ v + w @ heap.inertias[i] @ w)

    start = [kinetic(y, i) for i in range(2)]
    velocities = y.copy()
    made = pay_for_lift(heap.tables, memory, heap.workspace, y, before)
    assert made == pytest.approx(max(0.0, lost[0] - start[0]) if not (driven and closed) else 0.0)
    ways = [y[13 * i + 7 : 13 * i + 13] / velocities[13 * i + 7 : 13 * i + 13] for i in range(2)]
    poses = np.array_equal(y[:7], velocities[:7]) and np.array_equal(y[13:20], velocities[13:20])
    return start, [kinetic(y, i) for i in range(2)], float(y[-1]), lost, ways, poses


@pytest.mark.parametrize("lift", [1e-3, 1e3])
def test_what_was_lifted_pays_with_its_speed(lift: float) -> None:
    """All velocities of it by one factor, down to none; the rest, and what was lowered, is work of
    the contacts."""
    start, end, work, lost, ways, poses = interpreted(paid, lift)
    assert lost[0] > 0.0 > lost[1]
    assert (lost[0] > start[0]) == (lift > 1.0)
    assert end[0] == pytest.approx(max(0.0, start[0] - lost[0]), rel=1e-12)
    assert end[1] == pytest.approx(start[1], rel=1e-15)
    assert work == pytest.approx(0.25 + max(0.0, lost[0] - start[0]) + lost[1], rel=1e-12)
    assert_allclose(ways[0], ways[0][0], atol=1e-15)
    assert poses


@pytest.mark.parametrize("driven", [(0.0, 0.1), (0.0, 0.0, 0.0, 0.0, 0.2)])
def test_what_a_driven_support_lifts_is_its_work(driven: tuple[float, ...]) -> None:
    """Whatever the body's speed; one that has left it pays for itself."""
    for lift in (1e-3, 1e3):
        start, end, work, lost, _, _ = interpreted(paid, lift, driven)
        assert end == start
        assert work == pytest.approx(0.25 + lost[0] + lost[1], rel=1e-12)
    start, end, _, _, _, _ = interpreted(paid, 1e-3, driven, 0.0)
    assert end[0] < start[0]
