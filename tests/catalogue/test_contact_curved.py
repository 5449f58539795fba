"""Pairs whose contact point has to be sought: against finite differences, and against a ball."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rb_sim.catalogue.contact.curved import (
    BoxOnSphere,
    RodOnSphere,
    SurfaceOnCylinder,
    SurfaceOnSphere,
)
from rb_sim.catalogue.contact.pairs import BallOnCylinder, BallOnSphere, Touch, touching
from rb_sim.catalogue.contact_shapes import EllipsoidSurface, RimSurface, SphereSurface
from rb_sim.catalogue.types import BodyState
from tests.contact_runs import contact_run

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
    "box on a sphere": BoxOnSphere((0.05, 0.0, 0.02), (0.3, 0.2, 0.4), AT, 1.0),
    "rod on a sphere": RodOnSphere((0.05, 0.0, 0.02), AXIS, 0.4, AT, 1.0),
}


def moving(rng: np.random.Generator, position: np.ndarray) -> BodyState:
    """A body there, turned and moving at random."""
    q = Rotation.random(random_state=int(rng.integers(2**31))).as_quat()
    v, w = rng.normal(size=3), rng.normal(size=3)
    return BodyState(*(tuple(map(float, x)) for x in (position, q, v, w)))  # type: ignore[arg-type]


def later(S: BodyState, h: float) -> BodyState:
    """The same body after h, at constant velocities."""
    q = Rotation.from_quat(S.q_WB) * Rotation.from_rotvec(h * np.array(S.w_WB_B))
    p = np.array(S.p_WC) + h * np.array(S.v_WC)
    return S._replace(p_WC=tuple(map(float, p)), q_WB=tuple(map(float, q.as_quat())))  # type: ignore[arg-type]


def body_and_support(seed: int, distance: float) -> tuple[BodyState, BodyState]:
    """A body at this distance from the middle AT of a support, across its axis."""
    rng = np.random.default_rng(seed)
    A = moving(rng, rng.normal(size=3))
    turn = Rotation.from_quat(A.q_WB)
    across = np.cross(AXIS, rng.normal(size=3))
    across *= distance / np.linalg.norm(across)
    return moving(rng, np.array(A.p_WC) + turn.apply(np.array(AT) + across)), A


@pytest.mark.parametrize("name", PAIRS)
@pytest.mark.parametrize("seed", range(12))
def test_rates(name: str, seed: int) -> None:
    """Rates of normal and point, and n . (v_B - v_A) as that of the gap, by differences."""
    pair, h = PAIRS[name], 1e-5
    B, A = body_and_support(seed, OUTSIDE)
    now = touching(pair, B, A)
    before: Touch = touching(pair, later(B, -h), later(A, -h))
    after: Touch = touching(pair, later(B, h), later(A, h))

    def rate(field: str) -> np.ndarray:
        return (np.array(getattr(after, field)) - np.array(getattr(before, field))) / (2.0 * h)

    np.testing.assert_allclose(now.normal_rate, rate("normal"), atol=2e-7)
    np.testing.assert_allclose(now.point_rate, rate("point"), atol=2e-7)
    speed = material(B, now.point) - material(A, now.point)
    assert abs(float(np.dot(now.normal, speed)) - rate("gap")) <= 2e-7
    assert abs(math.hypot(*now.normal) - 1.0) <= 1e-14


def material(S: BodyState, p: Any) -> np.ndarray:
    """Velocity of the body's material point at p, world."""
    spin = Rotation.from_quat(S.q_WB).apply(S.w_WB_B)
    return np.array(S.v_WC) + np.cross(spin, np.array(p) - np.array(S.p_WC))


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


def test_plank_on_a_sphere_rocks() -> None:
    """A rough plank of half thickness h on a sphere: w^2 = g (R - h)/(h^2 + k^2), k^2 = I/m."""
    R, h, length, tilt = 1.0, 0.025, 0.4, 1e-4
    inertia = (length**2 + (2 * h) ** 2) / 12.0
    c, s = math.cos(tilt), math.sin(tilt)
    # rolled by the angle tilt: the contact has moved by R tilt along the plank
    along, up = np.array([c, 0.0, -s]), np.array([s, 0.0, c])
    body = {
        "mass": 1.0,
        "shape": {"type": "box", "size": [length, length, 2 * h]},
        "position": ((R + h) * up - R * tilt * along).tolist(),
        "orientation": {"axis": [0.0, 1.0, 0.0], "angle": tilt},
    }
    top = {"type": "contact", "body": "plank", "surface": {"type": "sphere", "radius": R}}
    scene = {
        "bodies": {"plank": body},
        "constraints": {"top": top | {"friction": {"type": "rough"}}},
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
    }
    rate = math.sqrt(9.81 * (R - h) / (h**2 + inertia))
    t = np.linspace(0.0, 2.0 * math.pi / rate, 9)
    run = contact_run(scene, t.tolist(), tolerance=1e-13)
    turned = 2.0 * run.trajectory.orientation["plank"][:, 1]
    np.testing.assert_allclose(turned, tilt * np.cos(rate * t), atol=1e-6 * tilt)
    assert [e.kind for e in run.events if e.t > 0.0] == []
