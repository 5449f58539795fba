# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Guide curves: through their points, smooth, and as accurate as their degree says."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.catalogue.curves import SPLINE_DEGREE
from tests.interpreted import interpreted


def helix(s: np.ndarray) -> np.ndarray:
    return np.stack([np.cos(s), np.sin(s), 0.2 * s], axis=-1)


def evaluated(points: Any, closed: bool, at: Any) -> tuple[np.ndarray, Any]:
    """(c, c', c'') at fractions of the parameter's range, and the shape of the coefficients."""
    from rb_sim.catalogue.curves import curve_point, spline_through

    curve = spline_through(np.array(points), closed)
    ends = curve.pieces.breaks[[0, -1]]
    s = ends[0] + np.asarray(at) * (ends[1] - ends[0])
    return np.array([curve_point(curve, float(x)) for x in s]), curve.pieces.coefficients.shape


def nearest(points: Any, closed: bool, s: float) -> float:
    """Parameter of the curve's own point at s."""
    from rb_sim.catalogue.curves import curve_nearest, curve_point, spline_through

    curve = spline_through(np.array(points), closed)
    return curve_nearest(curve, tuple(float(x) for x in curve_point(curve, s)[0]))


def curvature(d1: np.ndarray, d2: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.cross(d1, d2), axis=1) / np.linalg.norm(d1, axis=1) ** 3


@pytest.mark.parametrize("n", [4, 5, 6, 7, 8, 9, 30])
@pytest.mark.parametrize("closed", [False, True])
def test_passes_through_its_points(n: int, closed: bool) -> None:
    s = np.linspace(0.0, 2.0 * math.pi, n + closed)[:n]
    points = helix(s) * [1.0, 1.0, 0.0 if closed else 1.0]
    chain = np.vstack([points, points[:1]]) if closed else points
    chord = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(chain, axis=0), axis=1))])
    values, shape = interpreted(evaluated, points, closed, chord / chord[-1])
    assert_allclose(values[:, 0], chain, atol=1e-12)
    most = min(SPLINE_DEGREE, len(chain) - 1)
    assert shape[2] - 1 == (most if most % 2 else most - 1)


def test_a_closed_curve_may_repeat_its_first_point_or_not() -> None:
    """Also where its last point but one lies above the first, or the second one above the last."""
    for points in (
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.2], [-1.0, 0.1, 0.0], [0.0, -1.0, 0.3]],
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.2], [-1.0, 0.1, 0.0], [1.0, 0.0, 0.3], [1.0, 0.1, 0.2]],
    ):
        at = [0.0, 0.3, 0.77, 1.0]
        once, _ = interpreted(evaluated, points, True, at)
        again, _ = interpreted(evaluated, [*points, points[0]], True, at)
        assert_allclose(once, again, rtol=0.0, atol=0.0)
        assert_allclose(once[0], once[-1], atol=1e-12)


def test_curvature_is_sixth_order() -> None:
    """Of a helix: r / (r^2 + p^2) everywhere; halving the spacing divides the error by 64."""
    at = np.linspace(0.3, 0.7, 201)
    errors = []
    for n in (24, 48):
        values, _ = interpreted(evaluated, helix(np.linspace(0.0, 9.0, n)), False, at)
        errors.append(np.abs(curvature(values[:, 1], values[:, 2]) - 1.0 / 1.04).max())
    assert errors[1] < 1e-6
    assert errors[0] / errors[1] > 40.0


def test_closed_curve_is_smooth_where_it_closes() -> None:
    s = np.linspace(0.0, 2.0 * math.pi, 40, endpoint=False)
    points = np.stack([np.cos(s), np.sin(s), 0.3 * np.sin(2.0 * s)], axis=-1)
    values, _ = interpreted(evaluated, points, True, [0.0, 1.0 - 1e-13, 1.0, 1.0 + 1e-13])
    assert_allclose(values, np.broadcast_to(values[0], values.shape), atol=1e-10)


@pytest.mark.parametrize("s", [0.01, 1.3, 4.0])
def test_nearest_point_of_a_point_on_the_curve(s: float) -> None:
    points = helix(np.linspace(0.0, 6.0, 50))
    assert_allclose(interpreted(nearest, points, False, s), s, atol=1e-12)


def line_and_circle() -> list[tuple[np.ndarray, np.ndarray]]:
    """(parameters asked for, those of points beside the curve there), of a line and of a circle."""
    from rb_sim.catalogue.curves import CircleCurve, LineCurve, curve_nearest, curve_point

    e1, e2 = (0.0, 0.6, 0.8), (1.0, 0.0, 0.0)
    aside = np.cross(e1, e2)
    asked = np.array([-2.0, -0.3, 0.0, 1.7, 3.0])
    found = []
    for curve in (LineCurve((0.3, -1.0, 0.4), e1), CircleCurve((0.3, -1.0, 0.4), e1, e2, 0.7)):
        points = [np.array(curve_point(curve, s)[0]) + 0.2 * aside for s in asked]
        found.append((asked, np.array([curve_nearest(curve, tuple(p)) for p in points])))
    return found


def test_nearest_points_of_a_line_and_of_a_circle() -> None:
    for asked, found in interpreted(line_and_circle):
        assert_allclose(found, asked, atol=1e-14)
