# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Programs over planes and second-order cones whose answer is known in closed form."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.numerics.cone_program import (
    FAR,
    Cones,
    Objective,
    linear,
    minimise,
    moderate,
    widest,
)


def cones(k: int, planes: Any = (), rounds: Any = ()) -> Cones:
    """planes: (h, row) of h + row . y >= 0; rounds: (h (3,), G (3, k))."""
    return Cones(
        np.array([h for h, _ in planes], dtype=float),
        np.array([row for _, row in planes], dtype=float).reshape(len(planes), k),
        np.array([h for h, _ in rounds], dtype=float).reshape(len(rounds), 3),
        np.array([G for _, G in rounds], dtype=float).reshape(len(rounds), 3, k),
    )


def nearest(p: np.ndarray) -> Objective:
    """1/2 |y - p|^2, but for a constant."""
    return Objective(np.eye(len(p)), -p)


def solved(objective: Objective, over: Cones, start: Any) -> np.ndarray:
    """The minimiser, to round-off."""
    found = minimise(objective, over, np.array(start, dtype=float))
    assert found.bounded and found.gap == 0.0
    return found.y


def on_cone(p: np.ndarray) -> np.ndarray:
    """The projection of p onto head >= |tail|."""
    head, size = p[0], float(np.linalg.norm(p[1:]))
    if size <= head:
        return p
    if size <= -head:
        return np.zeros(3)
    return 0.5 * (head + size) * np.array([1.0, *(p[1:] / size)])


POINTS = {
    "inside": [2.0, 0.6, -0.3],
    "beside": [0.4, 1.5, -2.0],
    "below": [-0.5, 0.3, 0.9],
    "in the polar cone": [-3.0, 0.5, 1.0],
}


@pytest.mark.parametrize("place", POINTS)
def test_projection_onto_a_cone(place: str) -> None:
    p = np.array(POINTS[place])
    over = cones(3, rounds=[(np.zeros(3), np.eye(3))])
    assert_allclose(solved(nearest(p), over, [1.0, 0.1, 0.2]), on_cone(p), atol=1e-12)


def test_projection_onto_several_cones_elsewhere() -> None:
    """Each on three unknowns of its own, turned and shifted; a plane cuts what is behind it."""
    rng = np.random.default_rng(4)
    p, expected, rounds, start = rng.normal(size=10) * 2.0, np.zeros(10), [], np.zeros(10)
    for j in range(3):
        k = slice(3 * j, 3 * j + 3)
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        shift, G = rng.normal(size=3), np.zeros((3, 10))
        G[:, k] = turn
        rounds.append((shift, G))
        expected[k] = turn.T @ (on_cone(turn @ p[k] + shift) - shift)
        start[k] = turn.T @ (np.array([1.0, 0.1, 0.0]) - shift)
    p[9], expected[9], start[9] = -4.0, -1.5, 3.0
    over = cones(10, [(1.5, np.eye(10)[9])], rounds)
    assert_allclose(solved(nearest(p), over, start), expected, atol=1e-12)


def test_projection_onto_a_box() -> None:
    p, low, high = np.array([3.0, -0.2, -7.0]), np.array([-1.0, -2.0, -3.0]), np.array([1.5, 1, 2])
    planes = [(-a, row) for a, row in zip(low, np.eye(3), strict=True)]
    planes += [(b, -row) for b, row in zip(high, np.eye(3), strict=True)]
    found = solved(nearest(p), cones(3, planes), np.zeros(3))
    assert_allclose(found, np.clip(p, low, high), atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_the_lowest_point_of_a_ball_and_of_a_polytope(seed: int) -> None:
    rng = np.random.default_rng(seed)
    c, centre, radius = rng.normal(size=2), rng.normal(size=2), 0.7
    ball = cones(2, rounds=[([radius, *(-centre)], [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])])
    lowest = centre - radius * c / np.linalg.norm(c)
    assert_allclose(solved(linear(c), ball, centre), lowest, atol=1e-12)
    rows = rng.normal(size=(9, 3))
    rows = np.vstack([rows, -rows.sum(axis=0)])  # none of whose combinations lets y go far
    h, c = rng.uniform(0.5, 2.0, 10), rng.normal(size=3)
    corners = []
    for three in combinations(range(10), 3):
        at = np.linalg.solve(rows[list(three)], -h[list(three)])
        if (h + rows @ at >= -1e-12).all():
            corners.append(at)
    expected = min(corners, key=lambda at: float(c @ at))
    found = solved(linear(c), cones(3, list(zip(h, rows, strict=True))), np.zeros(3))
    assert_allclose(found, expected, atol=1e-10)


def test_what_falls_without_end_is_reported() -> None:
    """Down a wedge; on its other side the corner is the answer, also a million away."""
    planes = [(0.0, [1.0, 1.0]), (0.0, [1.0, -1.0])]
    down = minimise(linear(np.array([-1.0, 0.2])), cones(2, planes), np.array([1.0, 0.0]))
    assert not down.bounded
    for far in (0.0, 1e6):
        shifted = [(-far, row) for _, row in planes]
        found = solved(linear(np.array([1.0, 0.2])), cones(2, shifted), [far + 1.0, 0.0])
        assert_allclose(found, [far, 0.0], atol=1e-9 * (1.0 + far))


def test_where_bounds_touch_without_a_push_the_path_tells_its_gap() -> None:
    """The least of 1/2 |y|^2 with y_1 >= 0: no multiplier, no slack; still the answer is close."""
    found = minimise(nearest(np.zeros(2)), cones(2, [(0.0, [1.0, 0.0])]), np.array([1.0, 1.0]))
    assert found.bounded and found.gap <= 1e-11
    assert 0.5 * float(found.y @ found.y) <= found.gap


def test_the_widest_margin() -> None:
    """The middle of a slab and of the circle in a triangle, halfway up a cone; a unit at most."""
    slab = cones(2, [(0.3, [1.0, 0.0]), (0.1, [-1.0, 0.0])])
    found = widest(slab)
    assert found.bounded and found.y[0] == pytest.approx(-0.1, abs=1e-9)
    triangle = cones(2, [(0.0, [1.0, 0.0]), (0.0, [0.0, 1.0]), (1.2, [-0.6, -0.8])])
    radius = 1.5 * 2.0 / (1.5 + 2.0 + 2.5)  # legs 2 and 1.5, hypotenuse 2.5
    assert_allclose(widest(triangle).y, [radius, radius], atol=1e-9)
    capped = cones(3, [(1.0, [-1.0, 0.0, 0.0])], [(np.zeros(3), np.eye(3))])
    assert_allclose(widest(capped).y, [0.5, 0.0, 0.0], atol=1e-9)
    workspace = cones(1, [(10.0, [1.0]), (10.0, [-1.0])])
    assert workspace.slack(widest(workspace).y).min() >= 1.0 - 1e-9
    nowhere = cones(1, [(-1.0, [1.0]), (-0.4, [-1.0])])
    assert nowhere.slack(widest(nowhere).y).min() == pytest.approx(-0.7, abs=1e-9)


def test_what_is_far_out_comes_back_with_half_of_its_margin_or_one_unit() -> None:
    wall = cones(2, [(-50.0, [1.0, 0.0])])
    assert_allclose(moderate(wall, np.array([100.0, 30.0])).y, [51.0, 0.0], atol=1e-9)
    assert_allclose(moderate(wall, np.array([50.8, 30.0])).y, [50.4, 0.0], atol=1e-9)
    roof = cones(3, rounds=[([-50.0, 0.0, 0.0], np.eye(3))])
    assert_allclose(moderate(roof, np.array([51.4, 1.0, 0.0])).y, [50.2, 0.0, 0.0], atol=1e-9)
    near = np.array([0.6 * FAR, 0.8 * FAR])
    assert moderate(cones(2, [(1.0, [1.0, 0.0])]), near).y is near
