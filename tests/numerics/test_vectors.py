# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Vectors, quaternions and symmetric matrices against numpy and SciPy."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim.numerics import vectors as v

RNG = np.random.default_rng(7)


def random(n: int) -> tuple[float, ...]:
    return tuple(RNG.normal(size=n).tolist())


def unit(n: int) -> tuple[float, ...]:
    a = RNG.normal(size=n)
    return tuple((a / np.linalg.norm(a)).tolist())


def matrix(s: tuple[float, ...]) -> np.ndarray:
    return np.array([[s[0], s[3], s[4]], [s[3], s[1], s[5]], [s[4], s[5], s[2]]])


def test_rotations_are_those_of_scipy() -> None:
    q, a = unit(4), random(3)
    assert_allclose(v.rotate(q, a), Rotation.from_quat(q).apply(a), atol=1e-15)
    assert_allclose(v.unrotate(q, a), Rotation.from_quat(q).inv().apply(a), atol=1e-15)


def test_quaternion_product_turns_by_the_second_first() -> None:
    p, q, a = unit(4), unit(4), random(3)
    assert_allclose(
        v.rotate(v.quaternion_product(p, q), a), v.rotate(p, v.rotate(q, a)), atol=1e-14
    )


def test_quaternion_rate_is_the_derivative() -> None:
    q, w, h = unit(4), random(3), 1e-5

    def after(t: float) -> np.ndarray:
        turned = Rotation.from_quat(q) * Rotation.from_rotvec(t * np.array(w))
        other = turned.as_quat()
        return other * np.sign(other @ np.array(q))

    assert_allclose(v.quaternion_rate(q, w), (after(h) - after(-h)) / (2.0 * h), atol=1e-9)


def test_symmetric_matrices() -> None:
    root = RNG.normal(size=(3, 3))
    m = root @ root.T + 0.1 * np.eye(3)
    s = (m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2])
    a = random(3)
    assert_allclose(v.symmetric_times(s, a), m @ a, rtol=1e-13)
    assert_allclose(v.symmetric_solve(s, a), np.linalg.solve(m, a), rtol=1e-11)
    assert_allclose(v.gyroscopic(s, a), np.cross(a, m @ a), atol=1e-13 * np.abs(m).max())


def test_gyroscopic_moment_of_a_symmetric_body_has_no_axial_part() -> None:
    """Not even by rounding: a thin rod would be spun up by it."""
    moment = v.gyroscopic((1.0 / 3.0, 1.0 / 3.0, 1e-9, 0.0, 0.0, 0.0), random(3))
    assert moment[2] == 0.0


def test_steiner() -> None:
    """The inertia of points about another origin, point by point."""
    masses, points = RNG.uniform(0.1, 1.0, 6), RNG.normal(size=(6, 3))
    points -= masses @ points / masses.sum()
    r = np.array(random(3))

    def about(origin: np.ndarray) -> np.ndarray:
        d = points - origin
        outer = np.einsum("k,ki,kj->ij", masses, d, d)
        return np.trace(outer) * np.eye(3) - outer

    own = about(np.zeros(3))
    six = (own[0, 0], own[1, 1], own[2, 2], own[0, 1], own[0, 2], own[1, 2])
    shifted = v.shifted_inertia(six, float(masses.sum()), tuple(r.tolist()))
    assert_allclose(matrix(shifted), about(-r), rtol=1e-12)


def test_perpendicular_completes_a_right_handed_frame() -> None:
    for n in (unit(3), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)):
        frame = np.array([*v.perpendicular(n), n])
        assert_allclose(frame @ frame.T, np.eye(3), atol=1e-15)
        assert_allclose(np.linalg.det(frame), 1.0)


def test_vectors_are_those_of_numpy() -> None:
    a, b, q = random(3), random(3), unit(4)
    x, y = np.array(a), np.array(b)
    for found, expected in (
        (v.add(a, b), x + y),
        (v.sub(a, b), x - y),
        (v.scale(0.7, a), 0.7 * x),
        (v.neg(a), -x),
        (v.cross(a, b), np.cross(x, y)),
        (v.dot(a, b), x @ y),
        (v.norm(a), np.linalg.norm(x)),
        (v.quaternion_product(q, v.conjugate(q)), [0.0, 0.0, 0.0, 1.0]),
    ):
        assert_allclose(found, expected, atol=1e-15)
