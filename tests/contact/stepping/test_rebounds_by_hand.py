"""Rebounds that would create energy, on tables by hand: impulses, energies and Poisson's law."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.contact.solvers.graph import LINES
from rb_sim.contact.stepping import step as law
from rb_sim.contact.stepping.geometry import MOVES, NORMAL
from rb_sim.contact.stepping.scene_tables import COMPLIANT, RESTITUTION
from tests.contact.stepping.tables_by_hand import Heap

OWNERS = [(0, -1), (1, 0), (1, -1)]
"""Bodies of the points of contact."""
ACTIVE = (1, 2)
"""Points that take part, in the order of the problem."""
STILL = 0.3
"""Speed along the normal with which the surfaces of both stay together [m/s]."""
E = 0.6


def struck(seed: int, factor: float) -> tuple[Heap, np.ndarray]:
    """Bodies after an impact on moving supports at both contacts, and the energy that each has
    given [J], in a frame in which its support rests; tangential impulses times `factor`."""
    heap, rng = Heap(2, OWNERS, seed), np.random.default_rng(seed)
    workspace, n = heap.workspace, len(ACTIVE)
    workspace.active[:n] = ACTIVE
    heap.tables.laws[:, RESTITUTION] = E
    columns = rng.normal(size=(LINES * n, 12))
    workspace.x[: LINES * n] = rng.uniform(0.5, 1.0, LINES * n)
    lines, push = np.zeros((LINES * n, 12)), np.zeros(12)
    u = np.concatenate([heap.y[13 * i + 7 : 13 * i + 13] for i in range(2)])
    for i, c in enumerate(ACTIVE):
        b, a = workspace.ends[i] = OWNERS[c]
        rows = slice(LINES * i, LINES * i + LINES)
        lines[rows, 6 * b : 6 * b + 6] = workspace.rows[rows, :6] = columns[rows, :6]
        if a >= 0:
            lines[rows, 6 * a : 6 * a + 6] = workspace.rows[rows, 6:12] = columns[rows, 6:]
        workspace.x[LINES * i + 1 : LINES * i + LINES] *= factor
        spot = workspace.spots[c]
        spot[MOVES : MOVES + 3] = STILL * spot[NORMAL : NORMAL + 3] + np.cross(
            spot[NORMAL : NORMAL + 3], [3.0, 1.0, 2.0]
        )
        workspace.targets[rows] = rng.uniform(0.1, 0.2, LINES)
        workspace.targets[LINES * i] = STILL + 0.7
    push = lines.T @ workspace.x[: LINES * n]
    after = u + heap.inverse_mass() @ push
    workspace.u[:] = after.reshape(2, 6)
    still = workspace.targets[: LINES * n].copy()
    still[::LINES] = STILL
    work = workspace.x[: LINES * n] * (0.5 * lines @ (u + after) - still)
    moved = still @ workspace.x[: LINES * n]
    mass = np.linalg.inv(heap.inverse_mass())
    gained = 0.5 * (after @ mass @ after - u @ mass @ u) - moved
    assert work.sum() == pytest.approx(gained)  # the work of impulses is what the energy gains
    return heap, work.reshape(n, LINES)


def creates(heap: Heap, i: int) -> bool:
    return bool(law.creates(*law.made_in(heap.workspace, heap.y, i, ACTIVE[i])))


def test_an_impact_creates_energy_where_its_work_is_positive() -> None:
    """Of impulses on both bodies, along the normal and across, of which friction gives some."""
    told = {True: 0, False: 0}
    for seed in range(40):
        heap, work = struck(seed, 1.0 if seed % 2 else 0.1)
        for i in range(2):
            expected = bool(work[i].sum() > 0.0 and work[i, 1:].sum() > 0.0)
            assert creates(heap, i) is expected
            told[expected] += 1
    assert min(told.values()) > 10


def creating() -> tuple[Heap, np.ndarray]:
    """One of those where both contacts do."""
    found = (struck(seed, 1.0) for seed in range(200))
    return next((h, w) for h, w in found if (w.sum(axis=1) > 0.1).all() and (w[:, 0] < 0.0).all())


@pytest.mark.parametrize("i", [0, 1])
def test_what_neither_rebounds_nor_pushes_creates_none(i: int) -> None:
    for change in ("target", "push", "friction", "still"):
        heap, _ = creating()
        workspace, k = heap.workspace, LINES * i
        assert creates(heap, i)
        if change == "target":
            workspace.targets[k] = STILL - 1e-6
        elif change == "push":
            workspace.x[k] = 0.0
        elif change == "friction":
            workspace.x[k + 1 : k + LINES] = 0.0
        else:  # a support that comes along faster gives energy of its own
            spot = workspace.spots[ACTIVE[i]]
            spot[MOVES : MOVES + 3] += 1e3 * spot[NORMAL : NORMAL + 3]
        assert not creates(heap, i)


def test_rounding_creates_none() -> None:
    """Work of less than 1e-5 of the push times the speed of the rebound."""
    for part, told in ((0.5e-5, False), (2e-5, True)):
        heap, work = creating()
        workspace = heap.workspace
        rebound = workspace.targets[0] - STILL
        wanted = part * workspace.x[0] * rebound - work[0, 0]
        workspace.targets[1] += (work[0, 1:].sum() - wanted) / workspace.x[1]
        assert creates(heap, 0) is told


def test_what_rebounds() -> None:
    """Points of rigid contacts with restitution, whose target is beyond what stays together."""
    heap, _ = creating()
    tables, workspace = heap.tables, heap.workspace
    assert law.some_rebound(tables, workspace, 2) and law.some_rebound(tables, workspace, 1)
    assert not law.some_rebound(tables, workspace, 0)
    workspace.targets[0] = STILL - 1e-6
    assert law.some_rebound(tables, workspace, 2) and not law.some_rebound(tables, workspace, 1)
    for column, value in ((RESTITUTION, 0.0), (COMPLIANT, 1.0)):
        before = tables.laws[2, column]
        tables.laws[2, column] = value
        assert not law.bounces(tables, 2) and law.bounces(tables, 1)
        assert not law.some_rebound(tables, workspace, 2)
        tables.laws[2, column] = before
    assert law.bounces(tables, 2)


def table(heap: Heap) -> Any:
    return np.full((2, law.REBOUND_WIDTH), 7.0)


def test_rebounds_that_create_energy_are_taken_away_at_first() -> None:
    for first, second in ((True, True), (True, False), (False, True), (False, False)):
        heap, _ = creating()
        workspace, found, speeds = heap.workspace, table(heap), []
        for i, does in enumerate((first, second)):
            if not does:
                heap.tables.laws[ACTIVE[i], RESTITUTION] = 0.0
            speeds.append(0.7 if does else 0.0)
        before = workspace.targets.copy()
        assert law.note_gains(heap.tables, workspace, heap.y, 2, found) == first + second
        assert_allclose(found[:, law.WHOLE], speeds)
        for i in range(2):
            if speeds[i] > 0.0:
                assert_allclose(found[i, [law.PUSH, law.SPEED]], [workspace.x[LINES * i], 0.7])
            before[LINES * i] -= speeds[i]
        assert_allclose(workspace.targets, before)


def test_pushes_are_noted_of_each_contact() -> None:
    heap, _ = creating()
    found = table(heap)
    law.note_pushes(heap.workspace, 2, found, law.WITHOUT)
    assert_allclose(found[:, law.WITHOUT], heap.workspace.x[[0, LINES]])
    found[:, law.WITHOUT] = 7.0
    assert (found == 7.0).all()


def test_the_next_try_is_poissons_where_pushes_grow_in_proportion() -> None:
    """N = N0 + k s: with N = (1 + e) N0 at s = e N0 / k, but for what Newton's law allows."""
    heap, _ = creating()
    tables, workspace = heap.tables, heap.workspace
    for slopes, whole in (
        ((2.0, 5.0), 1.0),
        ((0.1, 0.2), 1.0),
        ((2.0, -1.0), 1.0),
        ((2.0, 5.0), 0.0),
    ):
        found = table(heap)
        found[:, law.WITHOUT], found[:, law.SPEED], found[:, law.WHOLE] = (
            (0.8, 1.2),
            (0.5, 0.4),
            whole,
        )
        found[:, law.PUSH] = found[:, law.WITHOUT] + np.array(slopes) * found[:, law.SPEED]
        wanted = [
            min(e / k, whole) if k > 0.0 else 0.0
            for e, k in zip((E * 0.8, E * 1.2), slopes, strict=True)
        ]
        before, tried = workspace.targets.copy(), found[:, law.SPEED].copy()
        law.aim_at_poisson(tables, workspace, 2, found)
        if whole == 0.0:
            assert np.array_equal(workspace.targets, before)
            assert np.array_equal(found[:, law.SPEED], tried)
            continue
        assert_allclose(found[:, law.SPEED], wanted)
        before[[0, LINES]] = STILL + np.array(wanted)
        assert_allclose(workspace.targets, before)
