# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Inertia of the shapes against an integration over their volume, area or length."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from rb_sim.scene.reduced import principal_axes
from rb_sim.scene.shapes import SHAPES, THIN_ROD, Box, Cylinder, Disk, Ellipsoid, Rod, Shape, Sphere

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)  # exact for polynomials of degree 15
ANGLES = np.arange(8) * math.pi / 4  # exact for trigonometric polynomials of degree 7
TILTED = (2 / 7, -3 / 7, 6 / 7)


def interval(low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """Quadrature points and weights of [low, high]."""
    half = 0.5 * (high - low)
    return half * NODES + 0.5 * (low + high), half * WEIGHTS


def tensor(x: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Mean of |x|^2 E - x x over the weighted points x, (3, 3)."""
    second = np.einsum("n,ni,nj->ij", weight, x, x) / weight.sum()
    return np.trace(second) * np.eye(3) - second


def ball_points(a: float, b: float, c: float) -> tuple[np.ndarray, np.ndarray]:
    """The ellipsoid by spherical coordinates r, cos(theta), phi stretched along the axes."""
    (r, wr), (u, wu) = interval(0, 1), interval(-1, 1)
    r, u, phi = np.meshgrid(r, u, ANGLES, indexing="ij")
    s = np.sqrt(1 - u**2)
    x = np.stack([a * r * s * np.cos(phi), b * r * s * np.sin(phi), c * r * u], axis=-1)
    weight = np.einsum("i,j,k->ijk", wr, wu, np.ones(8)) * r**2
    return x.reshape(-1, 3), weight.ravel()


def cylinder_points(radius: float, length: float) -> tuple[np.ndarray, np.ndarray]:
    """The cylinder along z by r, phi, z."""
    (r, wr), (z, wz) = interval(0, radius), interval(-length / 2, length / 2)
    r, phi, z = np.meshgrid(r, ANGLES, z, indexing="ij")
    x = np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1)
    weight = np.einsum("i,j,k->ijk", wr, np.ones(8), wz) * r
    return x.reshape(-1, 3), weight.ravel()


def box_points(size: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    rules = [interval(-edge / 2, edge / 2) for edge in size]
    x = np.stack(np.meshgrid(*(points for points, _ in rules), indexing="ij"), axis=-1)
    weight = np.einsum("i,j,k->ijk", *(weights for _, weights in rules))
    return x.reshape(-1, 3), weight.ravel()


def turned(points: tuple[np.ndarray, np.ndarray], axis: tuple) -> tuple[np.ndarray, np.ndarray]:
    """The points turned so that z goes to `axis`."""
    x, weight = points
    across = np.cross([0, 0, 1], axis)
    turn = Rotation.from_rotvec(math.acos(axis[2]) * across / np.linalg.norm(across))
    return turn.apply(x), weight


CASES = [
    (Sphere(radius=0.3), ball_points(0.3, 0.3, 0.3)),
    (Ellipsoid(semi_axes=(0.2, 0.5, 0.9)), ball_points(0.2, 0.5, 0.9)),
    (Box(size=(0.1, 0.4, 0.9)), box_points((0.1, 0.4, 0.9))),
    (Disk(radius=0.7), cylinder_points(0.7, 1e-9)),
    (Disk(radius=0.7, axis_B=TILTED), turned(cylinder_points(0.7, 1e-9), TILTED)),
    (Cylinder(radius=0.2, length=0.5), cylinder_points(0.2, 0.5)),
    (Cylinder(radius=0.2, length=0.5, axis_B=TILTED), turned(cylinder_points(0.2, 0.5), TILTED)),
    (Rod(length=2.0, radius=0.1), cylinder_points(0.1, 2.0)),
    (Rod(length=2.0, radius=0.1, axis_B=TILTED), turned(cylinder_points(0.1, 2.0), TILTED)),
]


@pytest.mark.parametrize(("shape", "points"), CASES, ids=lambda v: getattr(v, "type", ""))
def test_inertia_is_the_integral_over_the_shape(
    shape: Shape, points: tuple[np.ndarray, np.ndarray]
) -> None:
    expected = tensor(*points)
    assert np.allclose(shape.unit_inertia, expected, rtol=0, atol=1e-14 * np.abs(expected).max())


@pytest.mark.parametrize(("shape", "points"), CASES, ids=lambda v: getattr(v, "type", ""))
def test_reach_bounds_the_shape_tightly(
    shape: Shape, points: tuple[np.ndarray, np.ndarray]
) -> None:
    """The 8-point rule comes within 2 % of the end of each interval."""
    farthest = np.linalg.norm(points[0], axis=1).max()
    assert 0.94 * shape.reach < farthest <= shape.reach


def test_thin_rod_is_a_segment_with_a_small_axial_moment() -> None:
    z, weight = interval(-0.75, 0.75)
    segment = tensor(np.outer(z, TILTED), weight)
    axis = np.array(TILTED)
    rod = Rod(length=1.5, axis_B=TILTED)
    axial = 0.5 * (THIN_ROD * 1.5) ** 2
    assert np.allclose(rod.unit_inertia, segment + axial * np.outer(axis, axis), atol=1e-15)
    assert rod.unit_inertia[0] @ axis == pytest.approx(axial * axis[0], rel=1e-9)


def test_axis_is_brought_to_length_one() -> None:
    assert Cylinder(radius=1, length=2, axis_B=(0, 3, 0)).axis_B == (0.0, 1.0, 0.0)


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        ("sphere", {"radius": 0}),
        ("sphere", {"radius": 1, "length": 1}),
        ("disk", {"radius": 1, "axis_B": [0, 0, 0]}),
        ("cylinder", {"radius": 1}),
        ("box", {"size": [1, 1, 0]}),
        ("box", {"size": 1}),
        ("rod", {"length": -1}),
        ("ellipsoid", {"semi_axes": [1, 1, float("inf")]}),
        ("sphere", {"radius": 1, "center_B": [0, 0]}),
    ],
)
def test_bad_dimensions(kind: str, values: dict) -> None:
    with pytest.raises(ValidationError):
        SHAPES[kind].model_validate({"type": kind, **values})


# Principal axes against tensors made from known ones.


MOMENTS = [
    [1.0, 2.0, 2.7],
    [3.0, 1.0, 2.5],
    [1.0, 1.0, 1.7],
    [1.0, 1.0, 1.0],
    [0.1, 0.1, 1e-4],
    [1e-6, 2e-6, 2.5e-6],
]


def six(tensor: np.ndarray) -> tuple[float, ...]:
    i = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    return tuple(float(tensor[k]) for k in i)


@pytest.mark.parametrize("moments", MOMENTS)
@pytest.mark.parametrize("seed", range(8))
def test_axes_and_moments(moments: list[float], seed: int) -> None:
    R = Rotation.random(random_state=seed).as_matrix()
    tensor = R @ np.diag(moments) @ R.T
    tensor = 0.5 * (tensor + tensor.T)
    found, q = principal_axes(six(tensor))
    assert_allclose(sorted(found), sorted(moments), atol=1e-15 * max(moments))
    P = Rotation.from_quat(q).as_matrix()
    assert_allclose(P @ np.diag(found) @ P.T, tensor, atol=1e-15 * max(moments))
    assert abs(np.linalg.norm(q) - 1.0) <= 4e-16


def test_equal_moments_are_equal_to_the_last_digit() -> None:
    R = Rotation.from_rotvec([0.3, 0.9, -0.5]).as_matrix()
    found, _ = principal_axes(six(R @ np.diag([1.0, 1.0, 1.7]) @ R.T))
    assert len(set(found)) == 2
