# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Rotations of arrays, beside scipy's."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim.numerics.rotations import (
    angle_between,
    conjugate,
    continuous,
    cross,
    from_rotation_vector,
    other_triple,
    product,
    roll_pitch_yaw,
    rotate,
    turn_between,
    without_jumps,
)

P, Q = (Rotation.random(6, random_state=seed) for seed in (1, 2))
VECTORS = np.random.default_rng(3).normal(size=(6, 3))


def test_products_and_rotated_vectors_beside_scipy() -> None:
    p, q = P.as_quat(), Q.as_quat()
    assert_allclose(rotate(product(p, conjugate(q)), VECTORS), (P * Q.inv()).apply(VECTORS))
    assert_allclose(rotate(3.0 * q, VECTORS), Q.apply(VECTORS))  # of any length
    assert_allclose(product(p[0], q), (P[0] * Q).as_quat())  # broadcast


@pytest.mark.parametrize("size", [0.0, 1e-200, 1e-9, 1.0, 3.0, 7.0])
def test_a_rotation_vector_beside_scipy(size: float) -> None:
    wanted = Rotation.from_rotvec(size * VECTORS).apply(VECTORS)
    assert_allclose(rotate(from_rotation_vector(size * VECTORS), VECTORS), wanted, atol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 1.0, np.pi - 1e-6, np.pi])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_turn_between_two_attitudes(angle: float, sign: float) -> None:
    """Of either sign of the quaternions, to all digits near none and near half a turn."""
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    p, q = P.as_quat(), sign * product(P.as_quat(), from_rotation_vector(angle * axis))
    assert_allclose(angle_between(p, q), angle, rtol=1e-3 if angle == 1e-12 else 1e-9, atol=1e-15)
    turn = turn_between(p, q)
    assert_allclose(np.abs(turn @ axis), 2.0 * np.sin(0.5 * angle), atol=1e-14)
    if angle < np.pi:  # there both senses are the same
        assert_allclose(turn, 2.0 * np.sin(0.5 * angle) * np.tile(axis, (6, 1)), atol=1e-14)


def test_signs_of_quaternions_go_on() -> None:
    turns = from_rotation_vector(np.outer(np.linspace(0.0, 20.0, 200), [0.6, 0.0, 0.8]))
    flipped = turns * np.where(np.arange(200) % 3, 1.0, -1.0)[:, None]
    assert_allclose(continuous(flipped), -turns)


def test_long_doubles_stay_long() -> None:
    q, v = P.as_quat().astype(np.longdouble), VECTORS.astype(np.longdouble)
    assert rotate(product(q, conjugate(q)), v).dtype == np.longdouble


def test_roll_pitch_yaw_beside_scipy() -> None:
    angles = roll_pitch_yaw(P.as_quat())
    assert_allclose(angles, P.as_euler("xyz"))
    for triple in (angles, other_triple(angles)):
        turns = Rotation.from_euler("xyz", triple)
        assert_allclose(angle_between(turns.as_quat(), P.as_quat()), 0.0, atol=1e-14)


def test_angles_go_on_where_the_pitch_passes_a_quarter_turn() -> None:
    """A body that tumbles about y, beside the axes of another: no angle leaps, none comes back."""
    turns = Rotation.from_rotvec(np.outer(np.linspace(0.1, 20.0, 400), [0.0, 1.0, 0.0]))
    q = (Rotation.from_euler("z", 0.3) * turns).as_quat()
    angles = without_jumps(roll_pitch_yaw(q))
    assert_allclose(
        angles, np.outer(np.linspace(0.1, 20.0, 400), [0, 1, 0]) + [0, 0, 0.3], atol=1e-13
    )
    both = [without_jumps(roll_pitch_yaw(q[:150]))]
    both.append(without_jumps(roll_pitch_yaw(q[150:]), both[0][-1]))
    assert_allclose(np.concatenate(both), angles, atol=1e-13)


def test_cross_is_the_cross_product_to_the_bit() -> None:
    a, b = np.random.default_rng(1).normal(size=(2, 4, 5, 3))
    np.testing.assert_array_equal(cross(a, b), np.cross(a, b))
    np.testing.assert_array_equal(cross(a, b[0, 0]), np.cross(a, b[0, 0]))
