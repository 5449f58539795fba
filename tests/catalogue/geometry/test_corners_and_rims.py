# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Corners and rims on planes, cylinders and solids: which point touches, and how it moves."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.catalogue.geometry import solids
from rb_sim.catalogue.geometry.corners_and_rims import (
    ABSENT,
    IN_FLIGHT,
    UPRIGHT,
    Lean,
    PointOnSolid,
    RimOnCylinder,
    RimOnPlane,
    point_on_solid_touching,
    rim_on_cylinder_touching,
    rim_touching,
)
from rb_sim.catalogue.geometry.pairs import ContactPoint
from rb_sim.catalogue.spec import BodyState
from rb_sim.numerics.vectors import ZERO
from tests.catalogue.geometry.test_curved import AT, AXIS, body_and_support
from tests.moving import assert_rates, at, brought, difference, floats, flown, random_state, unit

SEEDS = range(4)
RADIUS = 0.3


def anywhere(seed: int, alone: float) -> tuple[RimOnPlane, BodyState, BodyState]:
    """A rim beside the middle of a body, and a plane, both in random states."""
    rng = np.random.default_rng(seed)
    centre, on = floats(rng.normal(size=3)), floats(rng.normal(size=3))
    part = float(rng.uniform(0.0, 2.0 * np.pi)) if not alone else 0.0
    pair = RimOnPlane(
        centre, RADIUS, unit(rng), float(np.cos(part)), float(np.sin(part)), alone, on, unit(rng)
    )
    return pair, brought(random_state(rng), centre, rng.normal(size=3)), random_state(rng)


@pytest.mark.parametrize("sense", [1.0, IN_FLIGHT])
@pytest.mark.parametrize("seed", SEEDS)
def test_the_low_point_is_the_lowest_of_the_circle(seed: int, sense: float) -> None:
    """By a search over the circle; in flight however the rim leant before."""
    pair, B, A = anywhere(seed, alone=1.0)
    n = Rotation.from_quat(A.q_WB).apply(pair.n_A)
    e = np.linalg.svd(np.array([pair.axis_B]))[2][1:]
    round_about = np.linspace(0.0, 2.0 * np.pi, 4001)[:, None]
    circle = RADIUS * (np.cos(round_about) * e[0] + np.sin(round_about) * e[1])
    points = np.array([at(B, np.array(pair.centre_C) + x) for x in circle])
    heights = (points - at(A, pair.r_A)) @ n
    _, known = rim_touching(pair, B, A, UPRIGHT)
    before = Lean(known.low, floats(-np.array(known.axis)), sense) if sense > 1.0 else UPRIGHT
    touch, lean = rim_touching(pair, B, A, before)
    assert lean.sense == sense
    assert touch.gap == pytest.approx(heights.min(), abs=1e-6)
    assert_allclose(touch.point, points[heights.argmin()], atol=2e-3 * RADIUS)
    tilt = np.linalg.norm(np.cross(Rotation.from_quat(B.q_WB).apply(pair.axis_B), n))
    assert np.linalg.norm(lean.axis) == pytest.approx(tilt, rel=1e-12)
    assert np.array(lean.axis) @ n == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("sense", [1.0, -1.0, IN_FLIGHT])
@pytest.mark.parametrize("alone", [0.0, 1.0])
@pytest.mark.parametrize("seed", SEEDS)
def test_rates(seed: int, alone: float, sense: float) -> None:
    """Of the low point, of others as they go round with it, with what was known before."""
    pair, B, A = anywhere(seed, alone)
    _, lean = rim_touching(pair, B, A, UPRIGHT)
    low = floats((1.0 if sense > 0.0 else -1.0) * np.array(lean.low))
    before = Lean(low, lean.axis, sense)

    def touch_at(B: Any, A: Any) -> ContactPoint:
        return rim_touching(pair, B, A, before)[0]

    if alone:
        assert_rates(touch_at, B, A)
    touch, moved = touch_at(B, A), difference(lambda t: touch_at(flown(B, t), flown(A, t)).point)
    assert_allclose(touch.point_rate, moved, atol=1e-6)


# The two points of a rim on a cylinder, against its points one by one and finite differences.


CENTRE, RADIUS_CYLINDERS = (0.02, 0.01, 0.03), 0.4
FLYING = Lean(ZERO, ZERO, IN_FLIGHT)


def rim_of_cylinders(side: float, second: float) -> RimOnCylinder:
    curved = 1.0 if side > 0.0 else 2.0
    return RimOnCylinder(CENTRE, RADIUS_CYLINDERS, (0.0, 0.0, 1.0), AT, AXIS, curved, side, second)


def states(seed: int) -> Any:
    """Body and support; every other rim is nearly flat across from the axis, where it has two."""
    B, A = body_and_support(seed, 1.6)
    if seed % 2 == 0:
        away = at(B, CENTRE) - at(A, AT)
        e = Rotation.from_quat(A.q_WB).apply(AXIS)
        n = away - (away @ e) * e
        rng = np.random.default_rng(seed)
        turn = Rotation.align_vectors([n / np.linalg.norm(n)], [[0.0, 0.0, 1.0]])[0]
        turn = Rotation.from_rotvec(0.03 * rng.normal(size=3)) * turn
        B = B._replace(q_WB=tuple(turn.as_quat().tolist()))
        B = brought(B, CENTRE, at(A, AT) + n)
    return B, A


def gaps_around(B: Any, A: Any, side: float) -> np.ndarray:
    a = np.linspace(0.0, 2.0 * np.pi, 20000, endpoint=False)
    on = np.array(CENTRE) + RADIUS_CYLINDERS * np.stack([np.cos(a), np.sin(a), 0.0 * a], axis=1)
    points = np.array(B.p_WC) + Rotation.from_quat(B.q_WB).apply(on)
    e = Rotation.from_quat(A.q_WB).apply(AXIS)
    distance = np.linalg.norm(np.cross(points - at(A, AT), e), axis=1)
    return side * (distance - rim_of_cylinders(side, 0.0).curved)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("seed", range(12))
def test_points_are_the_nearest(seed: int, side: float) -> None:
    B, A = states(seed)
    gaps = gaps_around(B, A, side)
    near = np.sort(gaps[(gaps < np.roll(gaps, 1)) & (gaps <= np.roll(gaps, -1))])
    found = [rim_on_cylinder_touching(rim_of_cylinders(side, i), B, A, FLYING) for i in (0.0, 1.0)]
    there = [touch.gap for touch, lean in found if lean.sense != ABSENT]
    assert_allclose(there, near, rtol=0.0, atol=1e-7)
    for i, (touch, lean) in enumerate(found):
        held = Lean((found[0][1].low[0], 0.0, 0.0), ZERO, 1.0)
        assert_allclose(
            np.linalg.norm(np.array(touch.point) - at(B, CENTRE)), RADIUS_CYLINDERS, atol=1e-12
        )
        if lean.sense != ABSENT:
            touch_at = partial(
                rim_on_cylinder_touching, rim_of_cylinders(side, float(i)), before=held
            )
            assert_rates(lambda B, A, at=touch_at: at(B, A)[0], B, A)


# Corners and ends on faces of solids: the plane or cylinder of a face, beyond its edge as well.


HALF, RADIUS_SOLIDS, LENGTH = (0.3, 0.2, 0.4), 0.3, 0.5
CENTRE_SOLIDS = (0.1, -0.2, 0.05)
BOX = solids.Box(CENTRE_SOLIDS, HALF)
CYLINDER = solids.Cylinder(CENTRE_SOLIDS, RADIUS_SOLIDS, 0.5 * LENGTH, (0.0, 0.6, 0.8))
FACES: dict[str, tuple[Any, tuple[float, ...]]] = {
    "left": (BOX, (-1.0, 0.0, 0.0)),
    "front": (BOX, (0.0, 1.0, 0.0)),
    "bottom": (BOX, (0.0, 0.0, -1.0)),
    "end": (CYLINDER, (1.0, 0.0, 0.0)),
    "other end": (CYLINDER, (-1.0, 0.0, 0.0)),
    "round": (CYLINDER, (0.0, 1.0, 0.0)),
}
IN_AIR, HELD = IN_FLIGHT, 1.0


def place_on(name: str, along: float, off: float) -> tuple[np.ndarray, np.ndarray, float]:
    """(place in the solid's axes, normal of its face, way beyond its edge over the size): `along`
    of the way from the middle of the face to its edge, and `off` it."""
    solid, face = FACES[name]
    if solid is BOX:
        n = np.array(face)
        i = int(np.argmax(np.abs(n)))
        j, half = (i + 1) % 3, np.array(HALF)
        x = n * (half + off)
        x[j] = along * half[j]
        return x + CENTRE_SOLIDS, n, (abs(along) - 1.0) * half[j] / half.max()
    e, across = np.array(solid.axis), np.array((1.0, 0.0, 0.0))
    size = max(RADIUS_SOLIDS, 0.5 * LENGTH)
    if face[0] != 0.0:
        n = face[0] * e
        x = (0.5 * LENGTH + off) * n + along * RADIUS_SOLIDS * across
        return x + CENTRE_SOLIDS, n, (abs(along) - 1.0) * RADIUS_SOLIDS / size
    x = (RADIUS_SOLIDS + off) * across + along * 0.5 * LENGTH * e
    return x + CENTRE_SOLIDS, across, (abs(along) - 1.0) * 0.5 * LENGTH / size


def touch(name: str, along: float, off: float, before: Lean, seed: int = 3) -> Any:
    """(Touch, Lean, normal in the world) of a point there, with random states of both bodies."""
    rng = np.random.default_rng(seed)
    B, A = random_state(rng), random_state(rng)
    r_B = floats(rng.normal(size=3))
    x, n, _ = place_on(name, along, off)
    pair = PointOnSolid(r_B, 0.0, FACES[name][0])
    found, lean = point_on_solid_touching(pair, brought(B, r_B, at(A, x)), A, before)
    return found, lean, Rotation.from_quat(A.q_WB).apply(n)


@pytest.mark.parametrize("name", FACES)
@pytest.mark.parametrize("off", [0.01, -0.003])
def test_in_flight_a_point_is_over_the_face_that_is_nearest(name: str, off: float) -> None:
    found, lean, n = touch(name, 0.5, off, Lean(ZERO, ZERO, IN_AIR))
    assert_allclose(found.gap, off, atol=1e-14)
    assert_allclose(found.normal, n, atol=1e-14)
    assert lean.low == FACES[name][1] and lean.sense == IN_AIR


@pytest.mark.parametrize("name", FACES)
@pytest.mark.parametrize("along", [0.3, 1.0 - 1e-9, 1.0 + 1e-9, 1.2, -0.3, -1.0 - 1e-9])
def test_a_face_goes_on_beyond_its_edge(name: str, along: float) -> None:
    """With the same normal, and without a point that it holds from the edge on."""
    found, lean, n = touch(name, along, 1e-13, Lean(FACES[name][1], ZERO, HELD))  # type: ignore[arg-type]
    assert_allclose(found.gap, 1e-13, atol=1e-15)
    assert_allclose(found.normal, n, atol=1e-14)
    assert lean.sense == (ABSENT if place_on(name, along, 0.0)[2] > COMPUTED_ROUNDING else HELD)


@pytest.mark.parametrize("name", FACES)
def test_corners_on_an_edge_but_for_rounding_are_held(name: str) -> None:
    for along in (1.0, 1.0 + 1e-14, 1.0 - 1e-14):
        lean = touch(name, along, 0.0, Lean(FACES[name][1], ZERO, HELD))[1]  # type: ignore[arg-type]
        assert lean.sense == HELD


@pytest.mark.parametrize("name", FACES)
@pytest.mark.parametrize("along", [0.4, 1.3])
@pytest.mark.parametrize("sense", [HELD, IN_AIR])
def test_rates_agree_with_differences(name: str, along: float, sense: float) -> None:
    rng = np.random.default_rng(8)
    B, A = random_state(rng), random_state(rng)
    r_B = floats(rng.normal(size=3))
    pair = PointOnSolid(r_B, 0.0, FACES[name][0])
    before = Lean(FACES[name][1], ZERO, sense)  # type: ignore[arg-type]
    B = brought(B, r_B, at(A, place_on(name, along, 0.02)[0]))
    assert_rates(lambda B, A: point_on_solid_touching(pair, B, A, before)[0], B, A)
