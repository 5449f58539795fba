# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The two points of a rim on a cylinder, against its points one by one and finite differences."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim.base.rounding import WRITTEN_ROUNDING
from rb_sim.catalogue.geometry.corners_and_rims import (
    ABSENT,
    IN_FLIGHT,
    Lean,
    RimOnCylinder,
    half_of,
    highest,
    rim_on_cylinder_touching,
    slope_of,
)
from rb_sim.numerics.vectors import ZERO
from tests.catalogue.geometry.test_curved import AT, AXIS, body_and_support
from tests.moving import assert_rates, at, brought

CENTRE, RADIUS = (0.02, 0.01, 0.03), 0.4
FLYING = Lean(ZERO, ZERO, IN_FLIGHT)


def rim(side: float, second: float) -> RimOnCylinder:
    curved = 1.0 if side > 0.0 else 2.0
    return RimOnCylinder(CENTRE, RADIUS, (0.0, 0.0, 1.0), AT, AXIS, curved, side, second)


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
    on = np.array(CENTRE) + RADIUS * np.stack([np.cos(a), np.sin(a), 0.0 * a], axis=1)
    points = np.array(B.p_WC) + Rotation.from_quat(B.q_WB).apply(on)
    e = Rotation.from_quat(A.q_WB).apply(AXIS)
    distance = np.linalg.norm(np.cross(points - at(A, AT), e), axis=1)
    return side * (distance - rim(side, 0.0).curved)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("seed", range(12))
def test_points_are_the_nearest(seed: int, side: float) -> None:
    B, A = states(seed)
    gaps = gaps_around(B, A, side)
    near = np.sort(gaps[(gaps < np.roll(gaps, 1)) & (gaps <= np.roll(gaps, -1))])
    found = [rim_on_cylinder_touching(rim(side, i), B, A, FLYING) for i in (0.0, 1.0)]
    there = [touch.gap for touch, lean in found if lean.sense != ABSENT]
    assert_allclose(there, near, rtol=0.0, atol=1e-7)
    for i, (touch, lean) in enumerate(found):
        held = Lean((found[0][1].low[0], 0.0, 0.0), ZERO, 1.0)
        assert_allclose(np.linalg.norm(np.array(touch.point) - at(B, CENTRE)), RADIUS, atol=1e-12)
        if lean.sense != ABSENT:
            touch_at = partial(rim_on_cylinder_touching, rim(side, float(i)), before=held)
            assert_rates(lambda B, A, at=touch_at: at(B, A)[0], B, A)


def test_some_have_two() -> None:
    senses = []
    for seed in range(12):
        B, A = states(seed)
        for side in (1.0, -1.0):
            senses.append(rim_on_cylinder_touching(rim(side, 1.0), B, A, FLYING)[1].sense)
    assert 6 <= senses.count(IN_FLIGHT) < len(senses)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_each_keeps_to_its_half(side: float) -> None:
    """Held, the first stays where it was though the other becomes the nearer one."""
    for seed in range(0, 12, 2):
        B, A = states(seed)
        both = [rim_on_cylinder_touching(rim(side, i), B, A, FLYING) for i in (0.0, 1.0)]
        if both[1][1].sense == ABSENT:
            continue
        half = both[0][1].low[0]
        held = Lean((-half, 0.0, 0.0), ZERO, 1.0)
        swapped = [rim_on_cylinder_touching(rim(side, i), B, A, held)[0] for i in (0.0, 1.0)]
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
        both = [rim_on_cylinder_touching(rim(side, i), B, A, FLYING) for i in (0.0, 1.0)]
        if both[1][1].sense == ABSENT or abs(both[0][0].gap - both[1][0].gap) < 1e-6:
            continue
        other = FLYING._replace(low=(-both[0][1].low[0], 0.0, 0.0))
        for i in (0, 1):
            found, lean = rim_on_cylinder_touching(rim(side, float(i)), B, A, other)
            assert_allclose(found.point, both[i][0].point, rtol=0.0, atol=1e-12)
            assert lean.low[0] == both[0][1].low[0]
        seen += 1
    assert seen >= 2
