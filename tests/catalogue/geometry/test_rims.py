# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Rims on a plane: which point is low, before, while and after a rim lies flat; how it moves."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim.catalogue.geometry.corners_and_rims import (
    IN_FLIGHT,
    SLAMS,
    UPRIGHT,
    Lean,
    RimOnPlane,
    rim_touching,
)
from rb_sim.catalogue.geometry.pairs import Touch
from rb_sim.catalogue.types import BodyState
from tests.moving import assert_rates, at, brought, difference, floats, flown, random_state, unit

SEEDS = range(4)
AXIS = (0.0, 0.0, 1.0)
RADIUS = 0.3
STILL = BodyState((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
LOW = (1.0, 0.0, 0.0)
"""The point that goes down first of a rim that turns about y."""


def rim(along: float = 1.0, across: float = 0.0, alone: float = 0.0) -> RimOnPlane:
    return RimOnPlane((0.0,) * 3, RADIUS, AXIS, along, across, alone, (0.0,) * 3, AXIS)


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

    def touch_at(B: Any, A: Any) -> Touch:
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
