# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Nearest points of solids: next to each face, edge and corner, and inside, in both roles.

A point q of a convex solid is the nearest to x, at the distance d along the unit vector u, if and
only if q = x - d u lies in the solid and nothing of the solid reaches farther along u than q.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import minimize, nnls
from scipy.spatial.transform import Rotation

from rb_sim.catalogue.geometry import solids
from rb_sim.catalogue.geometry.hull import hull_of
from rb_sim.catalogue.geometry.pairs import BallOnSolid, SolidOnSphere, touching
from tests.interpreted import interpreted
from tests.moving import assert_rates, at, brought, random_state

SEEDS = range(3)
CENTRE = (0.3, -0.2, 0.1)
HALF = (0.3, 0.2, 0.4)
AXIS = (0.48, -0.6, 0.64)
ACROSS = ((0.8, 0.0, -0.6), (0.36, 0.8, 0.48))
"""With the axis a right-handed frame."""
RADIUS, LENGTH = 0.4, 0.6

GRID = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=3)))
"""Corners of a cube with the middles of its edges and faces, and its centre."""
BOX = np.array(CENTRE) + GRID * HALF
PLATE = np.array(CENTRE) + GRID[:, :2] @ (np.array(ACROSS) * [[0.3], [0.2]])
LINE = np.array(CENTRE) + np.linspace(-0.5, 0.5, 5)[:, None] * LENGTH * np.array(AXIS)
ROUND = np.random.default_rng(7).normal(size=(64, 3))
ROUND *= 0.5 / np.linalg.norm(ROUND, axis=1)[:, None]
ROUND[24:] *= np.linspace(0.0, 0.8, 40)[:, None]
"""24 on a sphere, and 40 in it."""

SOLIDS: dict[str, Any] = {
    "box": solids.Box(CENTRE, HALF),
    "cylinder": solids.Cylinder(CENTRE, RADIUS, 0.5 * LENGTH, AXIS),
    "disk": solids.Cylinder(CENTRE, RADIUS, 0.0, AXIS),
    "rod": solids.Rod(tuple(LINE[0].tolist()), AXIS, LENGTH),
    "points of a box": hull_of(BOX.tolist()),
    "points of a plate": hull_of(PLATE.tolist()),
    "points of a line": hull_of(LINE.tolist()),
    "points all over": hull_of(ROUND.tolist()),
}
POINTS = {
    "box": BOX, "rod": LINE, "points of a box": BOX, "points of a plate": PLATE,
    "points of a line": LINE, "points all over": ROUND,
}  # fmt: skip
"""Points whose hull the solid is."""


def on_box(sides: tuple[int, int, int], rng: np.random.Generator) -> np.ndarray:
    """A point beyond as many faces of the box as `sides` has ones; inside beyond none."""
    beyond = rng.permutation(np.array(sides)) * rng.choice([-1.0, 1.0], size=3)
    within = rng.uniform(-0.7, 0.7, size=3) * HALF
    out = beyond * (np.array(HALF) + rng.uniform(0.05, 0.3, size=3))
    return np.array(CENTRE) + np.where(beyond == 0.0, within, out)


def turned(wide: float, along: float, rng: np.random.Generator) -> np.ndarray:
    """A point at this distance from the axis, and so far along it, somewhere around."""
    phi = rng.uniform(0.0, 2.0 * np.pi)
    out = np.cos(phi) * np.array(ACROSS[0]) + np.sin(phi) * np.array(ACROSS[1])
    return np.array(CENTRE) + wide * out + along * np.array(AXIS)


def in_frame(x: float, y: float, z: float) -> np.ndarray:
    return np.array(CENTRE) + x * np.array(ACROSS[0]) + y * np.array(ACROSS[1]) + z * np.array(AXIS)


def anywhere(rng: np.random.Generator) -> np.ndarray:
    away = rng.normal(size=3)
    return rng.uniform(0.6, 1.2) * away / np.linalg.norm(away)


ON_BOX = {
    "face": lambda rng: on_box((1, 0, 0), rng),
    "edge": lambda rng: on_box((1, 1, 0), rng),
    "corner": lambda rng: on_box((1, 1, 1), rng),
    "inside": lambda rng: on_box((0, 0, 0), rng),
    "middle of a face": lambda rng: np.array(CENTRE) + [0.0, 0.0, 0.7],
}
ON_LINE = {
    "middle": lambda rng: turned(rng.uniform(0.1, 0.5), rng.uniform(-0.25, 0.25), rng),
    "end": lambda rng: turned(rng.uniform(0.1, 0.5), 0.5, rng),
    "straight beyond": lambda rng: turned(0.0, -0.6, rng),
}
PLACES: dict[str, dict[str, Any]] = {
    "box": ON_BOX,
    "points of a box": ON_BOX,
    "rod": ON_LINE,
    "points of a line": ON_LINE,
    "cylinder": {
        "side": lambda rng: turned(rng.uniform(0.5, 0.9), rng.uniform(-0.25, 0.25), rng),
        "cap": lambda rng: turned(rng.uniform(0.05, 0.3), rng.choice([-0.7, 0.6]), rng),
        "axis": lambda rng: turned(0.0, rng.choice([-0.7, 0.6]), rng),
        "rim": lambda rng: turned(rng.uniform(0.5, 0.9), rng.choice([-0.7, 0.6]), rng),
        "inside, side": lambda rng: turned(0.35, rng.uniform(-0.2, 0.2), rng),
        "inside, cap": lambda rng: turned(rng.uniform(0.0, 0.2), rng.choice([-0.25, 0.2]), rng),
    },
    "disk": {
        "face": lambda rng: turned(rng.uniform(0.05, 0.3), rng.choice([-0.5, 0.4]), rng),
        "axis": lambda rng: turned(0.0, rng.choice([-0.5, 0.4]), rng),
        "rim": lambda rng: turned(rng.uniform(0.5, 0.9), rng.choice([-0.5, 0.4]), rng),
        "its plane": lambda rng: turned(rng.uniform(0.5, 0.9), 0.0, rng),
    },
    "points of a plate": {
        "face": lambda rng: in_frame(rng.uniform(-0.2, 0.2), 0.1, rng.choice([-0.4, 0.3])),
        "middle of a face": lambda rng: in_frame(0.0, 0.0, 0.5),
        "edge": lambda rng: in_frame(rng.uniform(-0.2, 0.2), -0.4, rng.choice([-0.4, 0.3])),
        "middle of an edge": lambda rng: in_frame(0.0, 0.5, 0.2),
        "corner": lambda rng: in_frame(0.5, rng.choice([-0.4, 0.3]), 0.3),
        "its plane, edge": lambda rng: in_frame(-0.6, rng.uniform(-0.1, 0.1), 0.0),
        "its plane, corner": lambda rng: in_frame(-0.6, 0.5, 0.0),
    },
    "points all over": {
        "anywhere": anywhere,
        "corner": lambda rng: 1.4 * ROUND[rng.integers(24)] + rng.uniform(-0.02, 0.02, size=3),
    },
}
CASES = [(name, place) for name, places in PLACES.items() for place in places]


def found(name: str, x: np.ndarray) -> tuple[float, np.ndarray]:
    distance, u, _ = solids.nearest(SOLIDS[name], tuple(x.tolist()), (0.0, 0.0, 0.0))
    return distance, np.array(u)


def reaches(name: str, u: np.ndarray) -> float:
    """How far the solid extends along u from the centre of mass."""
    if name in POINTS:
        return float((POINTS[name] @ u).max())
    solid, along = SOLIDS[name], float(np.dot(AXIS, u))
    across = float(np.linalg.norm(u - along * np.array(AXIS)))
    return float(u @ np.array(CENTRE) + solid.half * abs(along) + RADIUS * across)


def contains(name: str, q: np.ndarray) -> bool:
    if name in POINTS:
        p = POINTS[name]
        A = np.vstack([p.T, np.ones(len(p))])
        weights, rest = nnls(A, [*q, 1.0])
        return bool(rest <= 1e-14)
    far = q - np.array(CENTRE)
    along = float(far @ AXIS)
    across = np.linalg.norm(far - along * np.array(AXIS))
    return bool(abs(along) <= SOLIDS[name].half + 1e-15 and across <= RADIUS + 1e-15)


def searched(name: str, x: np.ndarray) -> float:
    """Distance of x from the solid by minimisation."""
    if name in POINTS:
        # least |w - e| of the cone over the hull has the direction of its point nearest to x
        p = POINTS[name] - x
        weights, _ = nnls(np.vstack([p.T, np.ones(len(p))]), [0.0, 0.0, 0.0, 1.0])
        return float(np.linalg.norm(p.T @ weights) / weights.sum())
    far = np.stack([*ACROSS, AXIS]) @ (x - np.array(CENTRE))

    def square(y: np.ndarray) -> float:
        away = far - [y[0] * np.cos(y[1]), y[0] * np.sin(y[1]), y[2]]
        return float(away @ away)

    half = SOLIDS[name].half
    start = [0.5 * RADIUS, np.arctan2(far[1], far[0]) + 0.5, 0.3 * half]
    bounds = [(0.0, RADIUS), (None, None), (-half, half)]
    exact = {"ftol": 0.0, "gtol": 1e-12}
    best = minimize(square, start, bounds=bounds, method="L-BFGS-B", jac="3-point", options=exact)
    return float(np.sqrt(best.fun))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("name", "place"), CASES)
def test_nearest_point(name: str, place: str, seed: int) -> None:
    x = PLACES[name][place](np.random.default_rng(seed))
    distance, u = found(name, x)
    q = x - distance * u
    assert abs(u @ u - 1.0) <= 1e-15
    assert contains(name, q)
    assert_allclose(reaches(name, u), u @ q, rtol=0.0, atol=1e-15)
    if distance > 0.0:
        assert not contains(name, x)
        assert_allclose(distance, searched(name, x), rtol=0.0, atol=1e-12)
    else:  # no face is nearer
        around = np.random.default_rng(seed).normal(size=(2000, 3))
        for v in around / np.linalg.norm(around, axis=1)[:, None]:
            assert reaches(name, v) - v @ x >= -distance - 1e-15


ROLES = {
    "ball on it": lambda solid: (BallOnSolid((0.2, 0.1, -0.3), 0.1, solid), False),
    "it on a sphere": lambda solid: (SolidOnSphere(solid, (0.2, 0.1, -0.3), 0.5), True),
}


def example(name: str, place: str, role: str, seed: int) -> tuple[Any, Any, Any]:
    """A pair with states of body and support, so that the ball's centre is at this place."""
    rng = np.random.default_rng(seed)
    pair, is_body = ROLES[role](SOLIDS[name])
    x = PLACES[name][place](rng)
    owner, ball = random_state(rng), random_state(rng)
    ball = brought(ball, (0.2, 0.1, -0.3), at(owner, x))
    return (pair, owner, ball) if is_body else (pair, ball, owner)


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("name", "place"), CASES)
def test_rates(name: str, place: str, seed: int, role: str) -> None:
    pair, B, A = example(name, place, role, seed)
    assert_rates(lambda B, A: touching(pair, B, A), B, A)


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize(("name", "place"), CASES)
def test_point_and_normal(name: str, place: str, role: str) -> None:
    """P lies on the surface of B, gap further along -n on that of A; n is the gap's gradient."""
    pair, B, A = example(name, place, role, 3)
    touch = touching(pair, B, A)
    solid, ball, radius = (B, A, 0.5) if role == "it on a sphere" else (A, B, 0.1)
    on_B = np.array(touch.point)
    on_A = on_B - touch.gap * np.array(touch.normal)
    on_solid, on_ball = (on_B, on_A) if solid is B else (on_A, on_B)
    assert_allclose(np.linalg.norm(on_ball - at(ball, (0.2, 0.1, -0.3))), radius, atol=1e-15)
    q = Rotation.from_quat(solid.q_WB).inv().apply(on_solid - np.array(solid.p_WC))
    assert contains(name, q + 1e-15 * (np.array(CENTRE) - q))
    for e in np.eye(3):
        gaps = [
            touching(pair, brought(B, (0.0,) * 3, np.array(B.p_WC) + s * 1e-5 * e), A).gap
            for s in (-1.0, 1.0)
        ]
        assert_allclose((gaps[1] - gaps[0]) / 2e-5, touch.normal @ e, atol=1e-9)


# the same body in two ways


@pytest.mark.parametrize(
    ("points", "body"), [("points of a box", "box"), ("points of a line", "rod")]
)
@pytest.mark.parametrize("seed", SEEDS)
def test_hull_is_the_body(points: str, body: str, seed: int) -> None:
    for place in PLACES[body]:
        pair, B, A = example(points, place, "it on a sphere", seed)
        known, _, _ = example(body, place, "it on a sphere", seed)
        for a, b in zip(touching(pair, B, A), touching(known, B, A), strict=True):
            assert_allclose(a, b, atol=1e-12 * (1.0 + np.abs(b).max()))


# Where two boxes touch, against the distance of their surfaces by another way.


HALF_A, HALF_B = (0.05, 0.08, 0.03), (0.04, 0.06, 0.07)


def found_of_boxes(q_A, c_A, q_B, c_B, reach):
    from rb_sim.catalogue.geometry.solids import box_points

    return box_points(q_A, c_A, HALF_A, q_B, c_B, HALF_B, reach)


def distance(q_A, c_A, q_B, c_B) -> float:
    """Of two boxes, by a quadratic program in the coordinates of a point in each."""
    R_A, R_B = Rotation.from_quat(q_A).as_matrix(), Rotation.from_quat(q_B).as_matrix()

    def square(z):
        d = R_A @ z[:3] + c_A - R_B @ z[3:] - c_B
        return d @ d, 2.0 * np.concatenate([R_A.T @ d, -R_B.T @ d])

    bounds = [(-h, h) for h in (*HALF_A, *HALF_B)]
    best = minimize(square, np.zeros(6), jac=True, bounds=bounds, tol=1e-16)
    return float(np.sqrt(best.fun))


def touching_boxes(seed: int) -> tuple:
    """Two turned boxes that touch: the second is moved along a line until they do."""
    rng = np.random.default_rng(seed)
    q_A, q_B = (tuple(Rotation.random(random_state=rng).as_quat()) for _ in range(2))
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    low, high = 0.0, 1.0
    for _ in range(60):
        mid = 0.5 * (low + high)
        if distance(q_A, np.zeros(3), q_B, mid * way) > 1e-7:
            high = mid
        else:
            low = mid
    return q_A, q_B, tuple(high * way)


@pytest.mark.parametrize("seed", range(8))
def test_boxes_that_touch(seed: int) -> None:
    """One point or more with no gap, on both surfaces, and the normal leads from the first to the
    second; a face is preferred to an edge that is farther by 1e-3 of the size at most."""
    q_A, q_B, c_B = touching_boxes(seed)
    points, n = interpreted(found_of_boxes, q_A, (0.0, 0.0, 0.0), q_B, c_B, 1e-3)
    assert len(points) >= 1
    best = points[np.argmin(points[:, 3])]
    assert abs(best[3]) <= 4e-5
    in_A = Rotation.from_quat(q_A).inv().apply(best[:3] - best[3] * n)
    in_B = Rotation.from_quat(q_B).inv().apply(best[:3] - np.array(c_B))
    for inside, half in ((in_A, HALF_A), (in_B, HALF_B)):
        over = np.abs(inside) - half
        assert over.max() == pytest.approx(0.0, abs=5e-5)
    assert n @ np.array(c_B) > 0.0
    for shift, some in ((1e-2, 0), (-1e-4, 1)):
        far = tuple(np.array(c_B) + shift * n)
        assert (
            min(len(interpreted(found_of_boxes, q_A, (0.0, 0.0, 0.0), q_B, far, 1e-3)[0]), 1)
            == some
        )
