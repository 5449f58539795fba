# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Corners and ends on faces of solids: the plane or cylinder of a face, beyond its edge as well."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.catalogue.geometry import pairs, solids
from rb_sim.catalogue.geometry.corners_and_rims import (
    ABSENT,
    IN_FLIGHT,
    Lean,
    PointOnSolid,
    held_by_faces,
    off_face,
    point_on_solid_touching,
)
from rb_sim.numerics.vectors import ZERO
from tests.moving import assert_rates, at, brought, floats, random_state

HALF, RADIUS, LENGTH = (0.3, 0.2, 0.4), 0.3, 0.5
CENTRE = (0.1, -0.2, 0.05)
BOX = solids.Box(CENTRE, HALF)
CYLINDER = solids.Cylinder(CENTRE, RADIUS, 0.5 * LENGTH, (0.0, 0.6, 0.8))
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
        return x + CENTRE, n, (abs(along) - 1.0) * half[j] / half.max()
    e, across = np.array(solid.axis), np.array((1.0, 0.0, 0.0))
    size = max(RADIUS, 0.5 * LENGTH)
    if face[0] != 0.0:
        n = face[0] * e
        x = (0.5 * LENGTH + off) * n + along * RADIUS * across
        return x + CENTRE, n, (abs(along) - 1.0) * RADIUS / size
    x = (RADIUS + off) * across + along * 0.5 * LENGTH * e
    return x + CENTRE, across, (abs(along) - 1.0) * 0.5 * LENGTH / size


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


@pytest.mark.parametrize("name", ["left", "round"])
def test_beyond_an_edge_in_flight_the_edge_is_nearest(name: str) -> None:
    """At (3, 4) cm from the edge, so that it is 5 cm away; no face holds what touches there."""
    solid, _ = FACES[name]
    edge = HALF[1] if solid is BOX else 0.5 * LENGTH
    found, lean, _ = touch(name, 1.0 + 0.03 / edge, 0.04, Lean(FACES[name][1], ZERO, IN_AIR))  # type: ignore[arg-type]
    assert_allclose(found.gap, 0.05, rtol=1e-12)
    assert lean.low == (0.0, 0.0, 0.0)
    pressed = touch(name, 1.0 + 0.03 / edge, 0.04, Lean(ZERO, ZERO, HELD))
    assert_allclose(pressed[0].gap, 0.05, rtol=1e-12)
    assert pressed[1].sense == HELD


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


def test_only_points_are_held_by_faces() -> None:
    plane = pairs.PointOnPlane(ZERO, ZERO, (0.0, 0.0, 1.0))
    ball, point = pairs.BallOnSolid(ZERO, 0.1, BOX), pairs.BallOnSolid(ZERO, 0.0, BOX)
    found = held_by_faces([plane, ball, point])
    assert found[:2] == [plane, ball]
    assert [type(pair) for pair in found] == [pairs.PointOnPlane, pairs.BallOnSolid, PointOnSolid]


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("i", [0, 1, 2])
def test_what_is_rounding_goes_by_the_longest_edge(size: float, i: int) -> None:
    """And by the longer of the radius and half the length of a cylinder."""
    half = np.full(3, 0.01 * size)
    half[i] = size
    box = solids.Box(ZERO, floats(half))  # type: ignore[arg-type]
    long = solids.Cylinder(ZERO, 0.01 * size, size, (0.0, 0.0, 1.0))
    wide = solids.Cylinder(ZERO, size, 0.01 * size, (0.0, 0.0, 1.0))
    j = (i + 1) % 3
    for solid, face, at_edge, out in (
        (box, np.eye(3)[i], half, np.eye(3)[j]),
        (long, np.array([0, 1, 0]), np.array([0.01 * size, 0, size]), np.eye(3)[2]),
        (wide, np.array([1, 0, 0]), np.array([size, 0, 0.01 * size]), np.eye(3)[0]),
    ):
        for beyond in (0.5, 2.0):
            x = at_edge + beyond * COMPUTED_ROUNDING * size * out
            over = off_face(solid, floats(face), floats(x), ZERO)[3]
            assert (over > COMPUTED_ROUNDING) == (beyond > 1.0)


@pytest.mark.parametrize("name", FACES)
def test_what_errors_of_a_step_lift_off_its_face_is_held(name: str) -> None:
    found, lean, _ = touch(name, 0.3, 1e-6, Lean(FACES[name][1], ZERO, HELD))  # type: ignore[arg-type]
    assert lean.sense == HELD
    assert_allclose(found.gap, 1e-6, rtol=1e-8)


def test_without_a_word_of_before_a_point_flies() -> None:
    """As carriers and starts ask for it."""
    rng = np.random.default_rng(3)
    B, A = random_state(rng), random_state(rng)
    pair = PointOnSolid((0.1, 0.2, 0.3), 0.0, BOX)
    B = brought(B, pair.r_B, at(A, place_on("left", 1.0 + 0.03 / HALF[1], 0.04)[0]))
    assert_allclose(pairs.touching(pair, B, A).gap, 0.05, rtol=1e-12)
