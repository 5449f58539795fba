# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Pairs whose contact point has to be sought: against finite differences, and against a ball."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim.catalogue.geometry.curved import SurfaceOnCylinder, SurfaceOnSphere
from rb_sim.catalogue.geometry.pairs import BallOnCylinder, BallOnSphere, touching
from rb_sim.catalogue.geometry.smooth_surfaces import EllipsoidSurface, RimSurface, SphereSurface
from rb_sim.catalogue.spec import BodyState
from tests.interpreted import interpreted
from tests.moving import assert_rates, at, brought, random_state

AXIS = (0.6, 0.0, 0.8)
AT = (0.1, 0.0, 0.05)
ELLIPSOID = EllipsoidSurface((0.05, -0.02, 0.03), (0.5, 0.3, 0.2))
RIM = RimSurface((0.02, 0.01, 0.03), 0.4, (0.0, 0.0, 1.0))
OUTSIDE, INSIDE = 1.6, 1.6
"""Distances of the body's centre from the support's, outside a radius of 1 and inside one of 2."""

PAIRS = {
    "ellipsoid outside a sphere": SurfaceOnSphere(ELLIPSOID, AT, 1.0, 1.0),
    "ellipsoid in a bowl": SurfaceOnSphere(ELLIPSOID, AT, 2.0, -1.0),
    "rim in a bowl": SurfaceOnSphere(RIM, AT, 2.0, -1.0),
    "ellipsoid outside a cylinder": SurfaceOnCylinder(ELLIPSOID, AT, AXIS, 1.0, 1.0),
    "ellipsoid in a pipe": SurfaceOnCylinder(ELLIPSOID, AT, AXIS, 2.0, -1.0),
    "rim in a pipe": SurfaceOnCylinder(RIM, AT, AXIS, 2.0, -1.0),
}


def body_and_support(seed: int, distance: float) -> tuple[BodyState, BodyState]:
    """A body at this distance from the middle AT of a support, across its axis."""
    rng = np.random.default_rng(seed)
    A, B = random_state(rng), random_state(rng)
    across = np.cross(AXIS, rng.normal(size=3))
    across *= distance / np.linalg.norm(across)
    return brought(B, (0.0, 0.0, 0.0), at(A, np.array(AT) + across)), A


@pytest.mark.parametrize("name", PAIRS)
@pytest.mark.parametrize("seed", range(12))
def test_rates(name: str, seed: int) -> None:
    B, A = body_and_support(seed, OUTSIDE)
    assert_rates(lambda B, A: touching(PAIRS[name], B, A), B, A)


@pytest.mark.parametrize("seed", range(12))
def test_a_ball_by_search_is_a_ball(seed: int) -> None:
    """A spherical surface sought by Newton's method is the ball that has a formula."""
    centre, a = (0.05, 0.0, 0.02), 0.3
    B, A = body_and_support(seed, OUTSIDE)
    ball = SphereSurface(centre, a)
    for sought, known in (
        (SurfaceOnSphere(ball, AT, 1.0, 1.0), BallOnSphere(centre, a, AT, 1.0, 1.0)),
        (SurfaceOnSphere(ball, AT, 2.0, -1.0), BallOnSphere(centre, a, AT, 2.0, -1.0)),
        (
            SurfaceOnCylinder(ball, AT, AXIS, 2.0, -1.0),
            BallOnCylinder(centre, a, AT, AXIS, 2.0, -1.0),
        ),
    ):
        for found, expected in zip(touching(sought, B, A), touching(known, B, A), strict=True):
            np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("name", ["ellipsoid outside a sphere", "ellipsoid in a bowl"])
def test_the_point_is_the_nearest(name: str) -> None:
    """No point of the ellipsoid is nearer to the sphere's surface."""
    pair: Any = PAIRS[name]
    B, A = body_and_support(3, OUTSIDE)
    angles = np.linspace(0.0, math.pi, 400), np.linspace(0.0, 2.0 * math.pi, 800)
    theta, phi = (grid.ravel() for grid in np.meshgrid(*angles))
    unit = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
    surface = np.array(ELLIPSOID.centre_C) + unit.T * np.array(ELLIPSOID.semi_axes)
    world = np.array(B.p_WC) + Rotation.from_quat(B.q_WB).apply(surface)
    centre = np.array(A.p_WC) + Rotation.from_quat(A.q_WB).apply(AT)
    distance = np.linalg.norm(world - centre, axis=1)
    least = (pair.side * (distance - pair.curved)).min()
    assert least - 1e-4 <= touching(pair, B, A).gap <= least + 1e-12


# The lowest point of a rim that lies flat, or nearly; of other surfaces: test_pairs.


CENTRE = (0.02, -0.01, 0.03)
AXIS_SHAPES = (0.48, -0.6, 0.64)
GAMMA = (0.6, 0.48, 0.64)
GAMMA_DOT = tuple(np.cross(GAMMA, (0.7, -1.1, 0.4)).tolist())


def lying(gamma: tuple[float, ...]) -> tuple[np.ndarray, ...]:
    """Support and rate of a rim that may lie flat, then those of one that may not."""
    from rb_sim.catalogue.geometry import smooth_surfaces as c

    both = c.LyingRimSurface(CENTRE, 0.3, AXIS_SHAPES), c.RimSurface(CENTRE, 0.3, AXIS_SHAPES)
    of = [(c.support(rim, gamma), c.support_rate(rim, gamma, GAMMA_DOT)) for rim in both]
    return tuple(np.array(values) for pair in of for values in pair)


@pytest.mark.parametrize("lean", [1.0, 0.1, 1e-6, 1e-9])
def test_a_rim_that_may_lie_flat_is_a_rim_as_long_as_it_leans(lean: float) -> None:
    flat = np.array(AXIS_SHAPES) / np.linalg.norm(AXIS_SHAPES)
    gamma = flat + lean * (np.array(GAMMA) - flat)
    point, rate, expected, its_rate = interpreted(lying, tuple(gamma.tolist()))
    assert_allclose(point, expected, atol=1e-15)
    assert_allclose(rate, its_rate, rtol=1e-12)
