"""The parts of a step that move bodies, beside rotations and rigid bodies by other means."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import fsolve
from scipy.spatial.transform import Rotation

from rb_sim.contact.stepping import step
from rb_sim.contact.stepping.step import (
    after_turn,
    drift,
    free_velocities,
    is_quiet,
    load_gravity,
    spin_after,
)
from rb_sim.contact.stepping.step_workspace import (
    ALL_SWEEPS,
    FRESH,
    RESIDUAL,
    STEPS,
    SWEPT,
    TOLD,
    UNSOLVED,
    WORST,
    memory_of,
)
from rb_sim.contact.stepping.step_workspace import LENGTH as LENGTH_OF_STEP
from rb_sim.mechanics.systems.many_bodies import LOAD
from tests.contact.stepping.tables_by_hand import LENGTH, SPEED, Heap, same_poses
from tests.interpreted import interpreted


def turned(w: tuple[float, float, float], h: float) -> tuple[object, object]:
    q = Rotation.from_rotvec([0.3, -0.5, 0.9])
    found = after_turn(tuple(q.as_quat().tolist()), w, h)
    return np.array(found), (q * Rotation.from_rotvec(h * np.array(w))).as_quat()


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-9, 1e-7, 1e-3, 1.0, 30.0])
def test_a_turn_is_exact_however_long(size: float) -> None:
    found, expected = interpreted(turned, (0.6 * size, -0.48 * size, 0.64 * size), 0.1)
    sign = 1.0 if found @ expected > 0.0 else -1.0
    assert_allclose(found, sign * expected, rtol=0.0, atol=1e-15)
    assert_allclose(np.linalg.norm(found), 1.0, rtol=1e-15)


def drifted(h: float) -> tuple[object, object]:
    heap = Heap(3, [], 2)
    y = heap.y.copy()
    velocities = np.concatenate([heap.y[13 * i + 7 : 13 * i + 13] for i in range(3)])
    drift(heap.tables, y, h)
    kept = all(
        np.array_equal(y[13 * i + 7 : 13 * i + 13], velocities[6 * i : 6 * i + 6]) for i in range(3)
    )
    return same_poses(y, heap.moved(h * velocities), 1e-14), kept


@pytest.mark.parametrize("h", [0.01, 1.0])
def test_bodies_drift_at_their_own_velocities(h: float) -> None:
    assert interpreted(drifted, h) == (True, True)


def free(h: float, scale: float) -> tuple[object, ...]:
    """(velocities with the loads of h and half of the gyroscopic torque, and with that alone; those
    by the midpoint rule solved by other means)."""
    heap = Heap(2, [], 3)
    rng = np.random.default_rng(0)
    for i in range(2):
        heap.y[13 * i + 10 : 13 * i + 13] *= scale
    load_gravity(heap.tables)
    gravity = heap.tables.gravity * heap.masses[:, None]
    assert_allclose(heap.tables.bodies[:, LOAD : LOAD + 3], gravity)
    assert not heap.tables.bodies[:, LOAD + 3 : LOAD + 6].any()
    loads = rng.normal(size=(2, 6))
    heap.tables.bodies[:, LOAD : LOAD + 6] = loads
    free_velocities(heap.tables, heap.workspace, heap.y, h)
    expected, alone = np.zeros((2, 6)), np.zeros((2, 6))
    for i in range(2):
        v, w = heap.y[13 * i + 7 : 13 * i + 10], heap.y[13 * i + 10 : 13 * i + 13]
        inertia = heap.inertias[i]

        def missed(w1: np.ndarray, w: np.ndarray = w, inertia: np.ndarray = inertia) -> np.ndarray:
            mean = 0.5 * (w + w1)
            return inertia @ (w1 - w) + 0.5 * h * np.cross(mean, inertia @ mean)

        spin = np.asarray(fsolve(missed, w, xtol=1e-14), float)
        alone[i] = np.concatenate([v, spin])
        expected[i, :3] = v + h * loads[i, :3] / heap.masses[i]
        expected[i, 3:] = spin + h * np.linalg.solve(inertia, loads[i, 3:])
    return heap.workspace.u.copy(), heap.workspace.turning.copy(), expected, alone


def test_free_velocities_are_those_of_the_midpoint_rule() -> None:
    u, turning, expected, alone = interpreted(free, 0.01, 1.0)
    assert_allclose(u, expected, rtol=1e-12, atol=1e-13)
    assert_allclose(turning, alone, rtol=1e-12, atol=1e-13)
    assert np.abs(u - turning).max() > 1e-3


def spun(h: float, scale: float) -> tuple[object, ...]:
    heap = Heap(1, [], 4)
    w = scale * heap.y[10:13]
    table = heap.tables.bodies[0]
    found = spin_after(tuple(table[1:7]), tuple(table[7:13]), tuple(w), h)
    return np.array(found), w, heap.inertias[0]


@pytest.mark.parametrize(("h", "scale", "follows"), [(1e-2, 1.0, True), (1.0, 100.0, False)])
def test_a_spin_keeps_its_energy_or_is_left(h: float, scale: float, follows: bool) -> None:
    """The midpoint rule keeps w . I w; where its rounds do not converge, w stays as it is."""
    found, w, inertia = interpreted(spun, h, scale)
    assert found @ inertia @ found == pytest.approx(w @ inertia @ w, rel=1e-10)
    assert np.array_equal(found, w) != follows


def quiet(speeds: tuple[tuple[float, float], ...]) -> bool:
    """Of bodies that move and turn so fast."""
    heap = Heap(len(speeds), [], 6)
    for i, (v, w) in enumerate(speeds):
        heap.y[13 * i + 7 : 13 * i + 13] = 0.6 * v, 0.0, -0.8 * v, 0.0, w, 0.0
    return bool(is_quiet(heap.tables, heap.y))


def test_a_heap_is_quiet_if_all_its_bodies_are_slow() -> None:
    """By a thousandth of the scene's speed, a turn at the arm of its length."""
    bound = 1e-3 * SPEED
    for part, expected in ((0.9, True), (1.1, False)):
        for slow in ((part * bound, 0.0), (0.0, part * bound / LENGTH)):
            for others in ([(0.0, 0.0), slow], [slow, (0.0, 0.0)]):
                assert interpreted(quiet, tuple(others)) == expected
    assert not interpreted(quiet, ((0.6 * bound, 0.6 * bound / LENGTH),))


def counted(rests: tuple[float, ...], sweeps: int) -> list[float]:
    """What the room notes of steps whose solver leaves that much."""
    heap, left, kept = Heap(2, [(0, -1), (1, 0)], 4), iter(rests), step.solve_impulses
    heap.gaps(0.0, 0.0)
    memory = memory_of(2)
    step.solve_impulses = lambda *tables: (next(left), sweeps)
    try:
        for k in range(len(rests)):
            step.solve_step(heap.tables, memory, heap.workspace, heap.y, 0.01 / (k + 1.0))
    finally:
        step.solve_impulses = kept
    told = (STEPS, ALL_SWEEPS, SWEPT, UNSOLVED, WORST, RESIDUAL, FRESH, LENGTH_OF_STEP)
    return heap.workspace.notes[list(told)].tolist()


def test_steps_that_their_solver_leaves_are_counted() -> None:
    """Those of which more is left than TOLD; the worst stays, what is left of the last is shown."""
    rests = (1e-9, 2.0 * TOLD, 3e-3, 0.5 * TOLD, TOLD)
    found = interpreted(counted, rests, 7)
    assert found == [5.0, 35.0, 7.0, 2.0, 3e-3, TOLD, 0.0, 0.002]
