"""Products of lines and inverse mass in loops over bodies are those of the dense matrices."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.contact.problem import delassus
from rb_sim.contact.problem.delassus import set_velocities, spread, velocities
from rb_sim.contact.problem.event_workspace import Workspace, workspace_for
from rb_sim.contact.problem.modes import find_held, may_share
from rb_sim.mechanics.contact.contact_bodies import SHARES
from rb_sim.mechanics.contact.contact_kinematics import SLIDING, STUCK
from rb_sim.mechanics.contact.contact_table import CLOSED, COMPLIANT, ROLL, SLIDE, SPIN, TOUCH_WIDTH
from rb_sim.mechanics.systems.many_bodies import BODY, MASS, PARENT
from rb_sim.numerics.rank import JUDGED_BY_CONTACT
from rb_sim.scene.compile import compile_scene
from tests.contact.scenes import ball, box, scene, touch

INERTIA = [[0.05, 0.002, -0.003], [0.002, 0.04, 0.001], [-0.003, 0.001, 0.06]]


def two_boxes(seed: int) -> tuple[Any, Workspace]:
    """A system of two boxes that touch each other and the floor, with random lines in the room."""
    from rb_sim import load_scene

    boxes = {
        "upper": box([0.3, 0.1, 0.2], [0.0, 0.0, 0.2]),
        "body": box([0.2, 0.4, 0.1], [0.0, 0.0, 0.05], mass=2.5, inertia=INERTIA),
    }
    mapping = scene(boxes, touch(mu=0.5))
    mapping["constraints"]["stack"] = {
        "type": "contact", "body": "upper", "parent": "body", "surface": {"type": "shape"},
    }  # fmt: skip
    system = compile_scene(load_scene(mapping)).system
    rng, workspace = np.random.default_rng(seed), workspace_for(system)
    for k, line in enumerate(system.lines):
        for i in {int(line[BODY]), int(line[PARENT])} - {-1}:
            workspace.J[k, 6 * i : 6 * i + 6] = rng.normal(size=6)
            workspace.W[k, 6 * i : 6 * i + 6] = rng.normal(size=6)
    return system, workspace


def test_the_inverse_mass_is_that_of_masses_and_inertias() -> None:
    system, _ = two_boxes(0)
    inverse = delassus.inverse_mass(system)
    assert inverse.shape == (12, 12)
    heavy, light = sorted(range(2), key=lambda i: system.bodies[i, MASS], reverse=True)
    assert_allclose(inverse[6 * heavy : 6 * heavy + 3, 6 * heavy : 6 * heavy + 3], np.eye(3) / 2.5)
    block = inverse[6 * heavy + 3 : 6 * heavy + 6, 6 * heavy + 3 : 6 * heavy + 6]
    assert_allclose(block @ np.array(INERTIA), np.eye(3), atol=1e-13)
    assert_allclose(inverse[6 * light : 6 * light + 3, 6 * light : 6 * light + 3], np.eye(3))
    assert np.count_nonzero(inverse) == 3 + 9 + 3 + 3


def test_the_matrix_of_some_lines() -> None:
    system, workspace = two_boxes(1)
    n = len(workspace.J) // 2
    workspace.used[:n] = np.random.default_rng(2).permutation(len(workspace.J))[:n]
    some = workspace.used[:n]
    expected = workspace.J[some] @ delassus.inverse_mass(system) @ workspace.W[some].T
    assert set(system.lines[:, PARENT]) == {-1, 1}
    for fill in (delassus.fill_delassus, delassus.fill_in_loops):
        A = np.full((n + 1, n + 1), np.nan)
        fill(system, workspace.J, workspace.W, workspace.used, n, A)
        assert_allclose(A[:n, :n], expected, rtol=1e-13, atol=1e-13 * np.abs(expected).max())


def test_products_with_all_lines() -> None:
    system, workspace = two_boxes(3)
    rng = np.random.default_rng(4)
    u, x = rng.normal(size=workspace.J.shape[1]), rng.normal(size=len(workspace.J))
    x[0] = 0.0
    p, du = np.empty_like(u), np.empty_like(u)
    delassus.momentum_of(system, workspace.J, x, p)
    delassus.inverse_mass_times(system, p, du)
    assert_allclose(p, workspace.J.T @ x, rtol=1e-13, atol=1e-13)
    assert_allclose(du, delassus.inverse_mass(system) @ p, rtol=1e-13, atol=1e-13)
    rates = [delassus.line_times(system, workspace.J, k, u) for k in range(len(x))]
    sizes = [delassus.size_of_terms(system, workspace.J, k, u) for k in range(len(x))]
    assert_allclose(rates, workspace.J @ u, rtol=1e-13, atol=1e-13)
    assert_allclose(sizes, np.abs(workspace.J) @ np.abs(u), rtol=1e-13)


@pytest.mark.parametrize("smallest", [1.0, 1e-3, 1e-9, 1e-11, 0.0])
@pytest.mark.parametrize("seed", range(5))
def test_what_has_one_set_of_reactions_is_never_taken_for_less(seed: int, smallest: float) -> None:
    """Pushes of rank less than lines, as `shares` counts it, may always share their load."""
    from rb_sim import load_scene

    mapping = scene(ball([0.0, 0.0, 0.1]), touch(mu=0.5))
    mapping["bodies"] |= {f"b{i}": ball([2.0 * i + 2.0, 0.0, 0.1]) for i in range(2)}
    for i in range(2):
        mapping["constraints"][f"c{i}"] = touch(mu=0.5) | {"body": f"b{i}"}
    system = compile_scene(load_scene(mapping)).system
    workspace, rng, n = workspace_for(system), np.random.default_rng(seed), len(system.lines)
    assert n == 9
    system.touch[:, CLOSED], system.touch[:, SLIDE] = 1.0, STUCK
    system.vectors[SHARES] = 1.0
    for c in range(3):  # each body has its own three lines, A their blocks
        u, _, v = np.linalg.svd(rng.normal(size=(3, 6)))
        size = 1e4 ** (seed % 2)  # all of it relative to the largest
        block = size * (u @ np.diag([1.0, 0.5, smallest if c == 1 else 0.3]) @ v[:3])
        workspace.J[3 * c : 3 * c + 3, 6 * c : 6 * c + 6] = workspace.W[
            3 * c : 3 * c + 3, 6 * c : 6 * c + 6
        ] = block
    A = workspace.J @ delassus.inverse_mass(system) @ workspace.W.T
    s = np.linalg.svd(A)[1]
    shares = may_share(system, workspace)
    assert shares or s[-1] > JUDGED_BY_CONTACT * s[0]
    if smallest == 1.0:
        assert not shares
    assert (system.vectors[SHARES] == 0.0).all()
    system.touch[:, SLIDE] = SLIDING  # normals alone, each of its own body: what holds is certain
    assert not may_share(system, workspace)


def test_lines_spread_over_all_bodies_and_velocities() -> None:
    """12 columns, of the body and of its parent, if it has one."""
    system, workspace = two_boxes(5)
    columns = np.random.default_rng(6).normal(size=(len(workspace.J), 12))
    found = spread(system, columns)
    assert found.shape == (len(columns), 12)
    for k, line in enumerate(system.lines):
        wanted = np.zeros(12)
        wanted[6 * line[BODY] : 6 * line[BODY] + 6] = columns[k, :6]
        if line[PARENT] >= 0:
            wanted[6 * line[PARENT] : 6 * line[PARENT] + 6] = columns[k, 6:]
        assert_allclose(found[k], wanted)
    y = np.arange(27.0)
    u = velocities(system, y)
    assert u.tolist() == [*range(7, 13), *range(20, 26)]
    set_velocities(system, y, 2.0 * u)
    assert_allclose(velocities(system, y), 2.0 * u)
    assert y[[0, 6, 13, 19, 26]].tolist() == [0.0, 6.0, 13.0, 19.0, 26.0]


def test_lines_of_joints_and_of_what_rests_hold() -> None:
    """Of a contact n, two tangents, two of rolling and one of spinning."""
    touch = np.zeros((4, TOUCH_WIDTH))
    touch[:3, CLOSED], touch[1, COMPLIANT] = 1.0, 1.0
    touch[0, [ROLL, SPIN]] = STUCK
    touch[1, SLIDE] = touch[3, SLIDE] = STUCK
    touch[0, SLIDE] = touch[2, ROLL] = SLIDING
    first = np.array([0, 2, 8, 11, 14, 20])
    system: Any = SimpleNamespace(touch=touch, first_row=first, joints=1)
    workspace: Any = SimpleNamespace(used=np.full(20, -1))
    n = find_held(system, workspace)
    assert workspace.used[:n].tolist() == [0, 1, 2, 5, 6, 7, 9, 10, 11]
