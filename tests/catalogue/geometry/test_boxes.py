# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Where two boxes touch, against the distance of their surfaces by another way."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from tests.interpreted import interpreted

HALF_A, HALF_B = (0.05, 0.08, 0.03), (0.04, 0.06, 0.07)


def found(q_A, c_A, q_B, c_B, reach):
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
    points, n = interpreted(found, q_A, (0.0, 0.0, 0.0), q_B, c_B, 1e-3)
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
        assert min(len(interpreted(found, q_A, (0.0, 0.0, 0.0), q_B, far, 1e-3)[0]), 1) == some


def test_faces_that_lie_on_each_other() -> None:
    """Shifted squares: the corners of what both cover; turned ones: an octagon."""
    upright = (0.0, 0.0, 0.0, 1.0)
    points, n = interpreted(found, upright, (0.0, 0.0, 0.0), upright, (0.02, 0.05, 0.1), 1e-3)
    corners = sorted(map(tuple, np.round(points[:, :3], 8)))
    assert corners == [(-0.02, -0.01, 0.03), (-0.02, 0.08, 0.03), (0.05, -0.01, 0.03),
                       (0.05, 0.08, 0.03)]  # fmt: skip
    assert_allclose(points[:, 3], 0.0, atol=1e-16)
    assert_allclose(n, [0.0, 0.0, 1.0])
    turned = tuple(Rotation.from_euler("z", 50.0, degrees=True).as_quat())
    points, _ = interpreted(found, upright, (0.0, 0.0, 0.0), turned, (0.0, 0.0, 0.1), 1e-3)
    assert 4 <= len(points) <= 8
    assert (np.abs(points[:, :2]) <= np.array(HALF_A[:2]) + 1e-9).all()


@pytest.mark.parametrize("angle", [1.0, 1.4, 1.8])
@pytest.mark.parametrize("gap", [-1e-4, 5e-4])
def test_edges_that_cross_at_an_angle(angle: float, gap: float) -> None:
    """Both boxes stand on an edge, turned by 45 degrees about it; seen from above the upper edge of
    the first and the lower one of the second make the angle. They meet above the middles."""
    on_edge = Rotation.from_rotvec([0.25 * np.pi, 0.0, 0.0])
    q_B = (Rotation.from_rotvec([0.0, 0.0, angle]) * on_edge).as_quat()
    top, below = ((half[1] + half[2]) * 0.5**0.5 for half in (HALF_A, HALF_B))
    # the edge stands beside the middle where the sides beside it are not equal
    beside = [(half[2] - half[1]) * 0.5**0.5 for half in (HALF_A, HALF_B)]
    across = np.array([-np.sin(angle), np.cos(angle)])
    c_B = np.array([0.0, 0.0, top + below + gap])
    points, n = interpreted(
        found, tuple(on_edge.as_quat()), (0.0,) * 3, tuple(q_B), tuple(c_B), 1e-3
    )
    assert_allclose(n, [0.0, 0.0, 1.0], atol=1e-12)
    assert len(points) == 1
    x, y, z, found_gap = points[0]
    assert found_gap == pytest.approx(gap, abs=1e-15)
    assert z == pytest.approx(top + gap, abs=1e-15)
    assert abs(y) == pytest.approx(abs(beside[0]), abs=1e-15)
    assert abs(across @ [x, y]) == pytest.approx(abs(beside[1]), abs=1e-15)
