"""The kernels of one body and its parent, on numbers, by the formulas that they have."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim.catalogue.constraints.rows import PointRow
from rb_sim.mechanics.systems.many_bodies import BODY_WIDTH, INERTIA, MASS
from rb_sim.mechanics.tables import local

RNG = np.random.default_rng(12)
Y = RNG.normal(size=13)
Y[3:7] = Rotation.random(random_state=13).as_quat()
PUSH = RNG.normal(size=6)


def test_a_body_is_hastened_moved_and_has_its_slopes() -> None:
    (after,) = local.hastened(0.0, Y.tolist(), PUSH.tolist())
    assert_allclose(after, [*Y[:7], *(Y[7:] + PUSH)], rtol=1e-15)
    (slope,) = local.slopes(0.0, Y.tolist(), PUSH.tolist())
    assert_allclose(slope[:3], Y[7:10])
    assert_allclose(slope[7:], PUSH)
    q = Rotation.from_quat(Y[3:7])
    ahead = (q * Rotation.from_rotvec(1e-6 * Y[10:13])).as_quat()
    back = (q * Rotation.from_rotvec(-1e-6 * Y[10:13])).as_quat()
    assert_allclose(slope[3:7], (ahead - back) / 2e-6, atol=1e-9)
    little = 1e-6 * PUSH
    (moved,) = local.moved(0.0, Y.tolist(), little.tolist())
    assert_allclose(moved[:3], Y[:3] + little[:3], rtol=1e-15)
    assert_allclose(moved[3:7], (q * Rotation.from_rotvec(little[3:])).as_quat(), atol=1e-11)
    assert moved[7:] == Y[7:].tolist() and len(moved) == len(after) == len(slope) == 13
    assert local.kept(0.0, Y) == [Y]


def test_what_of_a_hub_is_unknown() -> None:
    """-M packed by lower rows; -f, the gyroscopic torque taken from the load's."""
    body = np.zeros(BODY_WIDTH)
    body[MASS], body[INERTIA : INERTIA + 6] = 3.0, (1.0, 2.0, 2.5, 0.1, 0.2, 0.3)
    xx, yy, zz, xy, xz, yz = body[INERTIA : INERTIA + 6]
    M = np.zeros((6, 6))
    M[:3, :3], M[3:, 3:] = 3.0 * np.eye(3), [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    wanted = -M[np.tril_indices(6)]
    load = RNG.normal(size=6)
    matrix, right = local.of_hub(body.tolist(), 0.0, Y.tolist(), load.tolist())
    assert_allclose(matrix, wanted)
    w = Y[10:13]
    torque = load[3:] - np.cross(w, M[3:, 3:] @ w)
    assert_allclose(right[:6], [*-load[:3], *-torque], rtol=1e-13)
    assert len(right) == 12 and not any(right[6:])
    matrix, right = local.still_hub(body.tolist(), 0.0)
    assert_allclose(matrix, wanted)
    assert right == [0.0] * 12


def test_a_reaction_is_the_sum_of_its_lines_at_its_anchor() -> None:
    """Of two parts with two lines and one: forces, and torques that are turned to the world."""
    row = PointRow((0.1, 0.2, -0.3), (0.5, 0.6, 0.7))
    parts = [(RNG.normal(size=12), [2.0, -3.0]), (RNG.normal(size=6), [0.5])]
    fields = [x.tolist() if hasattr(x, "tolist") else x for part in parts for x in part]
    (found,) = local.reaction((row, False), 0.0, Y.tolist(), *fields)
    force, torque_B = np.zeros(3), np.zeros(3)
    for lines, multipliers in parts:
        for k, x in enumerate(multipliers):
            force += x * lines[6 * k : 6 * k + 3]
            torque_B += x * lines[6 * k + 3 : 6 * k + 6]
    turn, point = Rotation.from_quat(Y[3:7]), np.array(found[6:9])
    assert_allclose(found[:3], force, rtol=1e-13)
    about = turn.apply(torque_B) + np.cross(Y[:3] - point, force)
    assert_allclose(found[3:6], about, rtol=1e-12)
    (power,) = local.power(0.0, [2.0, 3.0], [5.0, -1.0], [0.25])
    assert power == [0.25 + 10.0 - 3.0]
