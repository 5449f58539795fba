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

from rb_sim.base.rounding import COMPUTED_ROUNDING, WRITTEN_ROUNDING
from rb_sim.catalogue.geometry import pairs, solids
from rb_sim.catalogue.geometry.corners_and_rims import (
    ABSENT,
    IN_FLIGHT,
    SLAMS,
    UPRIGHT,
    Lean,
    PointOnSolid,
    RimOnCylinder,
    RimOnPlane,
    half_of,
    held_by_faces,
    highest,
    off_face,
    point_on_solid_touching,
    rim_on_cylinder_touching,
    rim_touching,
    slope_of,
)
from rb_sim.catalogue.geometry.pairs import ContactPoint
from rb_sim.catalogue.spec import BodyState
from rb_sim.numerics.vectors import ZERO
from tests.catalogue.geometry.test_curved import AT, AXIS, body_and_support
from tests.moving import assert_rates, at, brought, difference, floats, flown, random_state, unit

SEEDS = range(4)
AXIS_CORNERS = (0.0, 0.0, 1.0)
RADIUS = 0.3
STILL = BodyState((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
LOW = (1.0, 0.0, 0.0)
"""The point that goes down first of a rim that turns about y."""


def rim(along: float = 1.0, across: float = 0.0, alone: float = 0.0) -> RimOnPlane:
    return RimOnPlane(
        (0.0,) * 3, RADIUS, AXIS_CORNERS, along, across, alone, (0.0,) * 3, AXIS_CORNERS
    )


def turned(angle: float, rate: float, about: tuple[float, ...] = (0.0, 1.0, 0.0)) -> BodyState:
    """A body above the plane, turned about a level axis, at a rate about it [rad/s]."""
    q = Rotation.from_rotvec(angle * np.array(about)).as_quat()
    spin = floats(rate * np.array(about))
    return BodyState((0.0, 0.0, 0.5), floats(q), (0.0, 0.0, 0.0), spin)


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


@pytest.mark.parametrize(("along", "across"), [(1.0, 0.0), (0.5, 0.75**0.5), (-1.0, 0.0)])
def test_points_of_a_rim_lie_at_their_angle_from_the_low_one(along: float, across: float) -> None:
    """Turned by 0.2 rad about y, the point at x is low; the others follow about the axis."""
    touch, _ = rim_touching(rim(along, across), turned(0.2, 0.0), STILL, UPRIGHT)
    where = RADIUS * np.array([along, across, 0.0])
    assert_allclose(touch.point, at(turned(0.2, 0.0), where), atol=1e-15)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_rim_that_slams_keeps_its_point(side: float) -> None:
    """What was low on one side is high on the other, and stands still in the body; so it is of a
    point that was high before."""
    before = Lean(floats([side, 0.0, 0.0]), (0.01, 0.0, 0.0), side * SLAMS)
    for angle, sense in ((0.01, side), (-0.01, -side), (1e-12, side), (0.0, SLAMS)):
        spin = (0.3, -1.0, 0.7)
        B = turned(angle, 0.0)._replace(w_WB_B=spin)
        touch, lean = rim_touching(rim(), B, STILL, before)
        assert lean.low == before.low and abs(lean.sense) == SLAMS
        assert lean.sense == sense * SLAMS or angle == 0.0
        assert touch.gap == pytest.approx(0.5 - side * RADIUS * np.sin(angle), rel=1e-12)
        arm = np.array([side * RADIUS, 0.0, 0.0])
        to_world = Rotation.from_quat(B.q_WB)
        assert_allclose(touch.point_rate, to_world.apply(np.cross(spin, arm)), atol=1e-15)


def test_a_rim_alone_tells_that_it_went_through_flat() -> None:
    before = Lean(LOW, (0.01, 0.0, 0.0), SLAMS)
    for angle, sense in ((0.01, SLAMS), (-0.01, 0.0)):
        found = rim_touching(rim(alone=1.0), turned(angle, -1.0), STILL, before)[1]
        assert found.sense == sense


@pytest.mark.parametrize("spin", [(0.0, -3.0, 0.0), (0.0, 3.0, 0.0), (3.0, 0.0, 0.0)])
def test_the_low_point_of_a_rim_that_is_held_runs_round_it(spin: tuple[float, ...]) -> None:
    """However it came to lean the other way, if it does not slam."""
    _, before = rim_touching(rim(), turned(0.01, 0.0), STILL, UPRIGHT)
    B = turned(-0.01, 0.0)._replace(w_WB_B=floats(np.array(spin)))
    _, after = rim_touching(rim(), B, STILL, before)
    assert after.sense == 1.0
    assert_allclose(after.low, (-1.0, 0.0, 0.0), atol=1e-12)


@pytest.mark.parametrize("down", [1.0, -1.0])
def test_the_lean_points_to_where_a_rim_is_low(down: float) -> None:
    """Whichever way its axis points in the body."""
    pair = rim()._replace(axis_B=(0.0, 0.0, down))
    _, lean = rim_touching(pair, turned(0.2, 0.0), STILL, UPRIGHT)
    assert_allclose(lean.axis, (np.sin(0.2), 0.0, 0.0), atol=1e-15)
    assert_allclose(lean.low, LOW, atol=1e-15)


@pytest.mark.parametrize("size", [1e-13, 0.99e-10, 1.01e-10])
def test_a_low_point_next_to_flat(size: float) -> None:
    """Kept of a rim that lay flat, within FLAT; of one that leant it follows the pose, until
    rounding takes its direction."""
    for was, keeps in ((0.9e-10, size < 1e-10), (1.1e-10, False)):
        known = Lean((0.0, 1.0, 0.0), (0.0, was, 0.0), 1.0)
        _, lean = rim_touching(rim(), turned(size, 0.0), STILL, known)
        assert_allclose(lean.low, (0.0, 1.0, 0.0) if keeps else LOW, atol=1e-12)
    _, lean = rim_touching(rim(), turned(0.9e-14, 0.0), STILL, known)
    assert lean.low == known.low


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_rim_that_lies_flat_keeps_its_point(sense: float) -> None:
    """That of before, or any across its axis where nothing is known; its points stand still."""
    known = Lean(floats([0.6, 0.8, 0.0]), (0.1, 0.0, 0.0), sense)
    touch, lean = rim_touching(rim(), turned(0.0, 2.0), STILL, known)
    assert lean.low == known.low and lean.sense == sense
    assert_allclose(touch.point, [0.6 * RADIUS, 0.8 * RADIUS, 0.5], atol=1e-15)
    assert_allclose(touch.point_rate, np.cross([0.0, 2.0, 0.0], RADIUS * np.array([0.6, 0.8, 0.0])))
    _, lean = rim_touching(rim(), turned(0.0, 2.0), STILL, UPRIGHT)
    assert np.linalg.norm(lean.low) == pytest.approx(1.0) and lean.low[2] == 0.0


@pytest.mark.parametrize(("angle", "sense"), [(0.01, 1.0), (-0.01, -1.0)])
def test_a_rim_that_lay_flat_goes_on_with_its_point(angle: float, sense: float) -> None:
    _, flat = rim_touching(rim(), turned(0.0, 0.0), STILL, Lean(LOW, (0.1, 0.0, 0.0), 1.0))
    _, lean = rim_touching(rim(), turned(angle, 0.0), STILL, flat)
    assert lean.sense == sense
    assert_allclose(lean.low, LOW, atol=1e-12)


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


def test_some_have_two() -> None:
    senses = []
    for seed in range(12):
        B, A = states(seed)
        for side in (1.0, -1.0):
            senses.append(
                rim_on_cylinder_touching(rim_of_cylinders(side, 1.0), B, A, FLYING)[1].sense
            )
    assert 6 <= senses.count(IN_FLIGHT) < len(senses)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_each_keeps_to_its_half(side: float) -> None:
    """Held, the first stays where it was though the other becomes the nearer one."""
    for seed in range(0, 12, 2):
        B, A = states(seed)
        both = [
            rim_on_cylinder_touching(rim_of_cylinders(side, i), B, A, FLYING) for i in (0.0, 1.0)
        ]
        if both[1][1].sense == ABSENT:
            continue
        half = both[0][1].low[0]
        held = Lean((-half, 0.0, 0.0), ZERO, 1.0)
        swapped = [
            rim_on_cylinder_touching(rim_of_cylinders(side, i), B, A, held)[0] for i in (0.0, 1.0)
        ]
        assert_allclose(swapped[0].point, both[1][0].point, rtol=0.0, atol=1e-12)
        assert_allclose(swapped[1].point, both[0][0].point, rtol=0.0, atol=1e-12)


def heights(p: float, q: float, w: float, a: np.ndarray) -> np.ndarray:
    return p * np.cos(a) + q * np.sin(a) + w * np.cos(a) ** 2


CURVES = [
    tuple(x) for x in np.random.default_rng(9).uniform([-3, -1, 0], [1, 1, 1], (60, 3)).tolist()
]
EDGES = [(0.0, 2.5, 1.0), (0.0, -2.5, 1.0), (0.0, 0.5, 1.0), (-2.0, 0.0, 1.0), (-2.1, 0.1, 1.0)]
EDGES += [(-1.0, 0.01, 1.0), (-1.0, 0.9, 1.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]


@pytest.mark.parametrize("curve", CURVES + EDGES)
def test_the_highest_point_of_a_half_is_higher_than_all_near_it(curve: tuple[float, ...]) -> None:
    """Beside all angles of the half, one by one: where none is higher than its neighbours on both
    sides, the ends of the half not counted, there is none."""
    p, q, w = curve
    angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 20001)
    h = heights(p, q, w, angles)
    inner = np.flatnonzero((h[1:-1] > h[:-2]) & (h[1:-1] > h[2:])) + 1
    a, there = highest(p, q, w)
    if p == 0.0 and abs(q) >= 2.0 * w:
        assert there == 1.0 and a == np.copysign(0.5 * np.pi, q)
    elif len(inner):
        assert len(inner) == 1 and there == 1.0
        assert abs(a - angles[inner[0]]) < 2e-4
        assert abs(slope_of(p, q, w, a)) < 1e-14
    else:
        assert (a, there) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("p", "before", "flies", "there", "half"),
    [
        (0.3, 0.0, False, 1.0, 1.0),  # not known before: the nearer one
        (-0.3, 0.0, False, 1.0, -1.0),
        (0.0, 0.0, False, 1.0, 1.0),
        (-0.3, 1.0, False, 0.0, -1.0),  # there is no other
        (-0.3, 1.0, False, 1.0, 1.0),  # held where it was
        (-0.3, 1.0, True, 1.0, -1.0),  # in flight the nearer one
        (-0.99 * WRITTEN_ROUNDING * 0.5, 1.0, True, 1.0, 1.0),  # unless both are as near
        (-1.01 * WRITTEN_ROUNDING * 0.5, 1.0, True, 1.0, -1.0),
    ],
)
def test_which_half_has_the_first_point(
    p: float, before: float, flies: bool, there: float, half: float
) -> None:
    assert half_of(p, 0.5, before, flies, there) == half


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_in_flight_the_first_is_the_nearer_one_whatever_was_before(side: float) -> None:
    """Unless both are as near."""
    seen = 0
    for seed in range(0, 12, 2):
        B, A = states(seed)
        both = [
            rim_on_cylinder_touching(rim_of_cylinders(side, i), B, A, FLYING) for i in (0.0, 1.0)
        ]
        if both[1][1].sense == ABSENT or abs(both[0][0].gap - both[1][0].gap) < 1e-6:
            continue
        other = FLYING._replace(low=(-both[0][1].low[0], 0.0, 0.0))
        for i in (0, 1):
            found, lean = rim_on_cylinder_touching(rim_of_cylinders(side, float(i)), B, A, other)
            assert_allclose(found.point, both[i][0].point, rtol=0.0, atol=1e-12)
            assert lean.low[0] == both[0][1].low[0]
        seen += 1
    assert seen >= 2


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
