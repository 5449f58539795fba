# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Gap, normal and point of every kind of pair, and how they move; supports that move by themselves.

Geometry is compared with a search over the two surfaces, rates with differences.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from rb_sim.catalogue.geometry import pairs
from rb_sim.catalogue.geometry.smooth_surfaces import EllipsoidSurface, RimSurface, SphereSurface
from rb_sim.catalogue.spec import BodyState
from tests.moving import (
    assert_rates,
    at,
    brought,
    difference,
    floats,
    random_state,
    unit,
    velocity,
)

SEEDS = st.integers(0, 2**32 - 1)
FEW = settings(max_examples=8, deadline=None, derandomize=True)

SMOOTH = ("ball on plane", "ellipsoid on plane", "rim on plane")
ROUND = ("sphere outside", "sphere inside", "cylinder inside", "cylinder outside")
KINDS = ("point on plane", *SMOOTH, *ROUND, "point on sphere")


def example(name: str, rng: np.random.Generator) -> tuple[Any, Any, Any]:
    """A random pair of this kind with states of body and support, away from its singularities."""
    B, A = random_state(rng), random_state(rng)
    r_B, r_A = floats(rng.normal(size=3)), floats(rng.normal(size=3))
    if name == "point on plane":
        return pairs.PointOnPlane(r_B, r_A, unit(rng)), B, A
    if name in SMOOTH:
        surface = {
            "ball on plane": SphereSurface(r_B, 0.3),
            "ellipsoid on plane": EllipsoidSurface(r_B, (0.3, 0.2, 0.4)),
            "rim on plane": RimSurface(r_B, 0.3, unit(rng)),
        }[name]
        return pairs.SurfaceOnPlane(surface, r_A, unit(rng)), B, A
    radius = 0.0 if name == "point on sphere" else 0.1
    side = -1.0 if name.endswith("inside") else 1.0
    axis, away = np.array(unit(rng)), np.array(unit(rng))
    if "cylinder" in name:
        away = away - (away @ axis) * axis
        away = away / np.linalg.norm(away) + rng.normal() * axis
        pair = pairs.BallOnCylinder(r_B, radius, r_A, floats(axis), 0.7, side)
    else:
        pair = pairs.BallOnSphere(r_B, radius, r_A, 0.7, side)
    place = at(A, np.array(r_A) + (1.3 if side > 0.0 else 0.4) * away)
    return pair, brought(B, r_B, place), A


def ball(rng_free: np.ndarray) -> np.ndarray:
    """A unit vector from any vector but zero."""
    return rng_free / np.linalg.norm(rng_free)


def searched(name: str, pair: Any, B: Any, A: Any) -> tuple[float, np.ndarray, np.ndarray]:
    """(gap, normal, P) by a search over the surfaces."""
    if name == "point on plane":
        n = Rotation.from_quat(A.q_WB).apply(pair.n_A)
        p = at(B, pair.r_B)
        return float(n @ (p - at(A, pair.r_A))), n, p
    if name in SMOOTH:
        n = Rotation.from_quat(A.q_WB).apply(pair.n_A)
        s = pair.surface

        def on(x: np.ndarray) -> np.ndarray:
            if isinstance(s, RimSurface):
                k = np.array(s.axis_B)
                x = x - (x @ k) * k
                return at(B, np.array(s.centre_C) + s.radius * ball(x))
            axes = getattr(s, "semi_axes", (getattr(s, "radius", 0.0),) * 3)
            return at(B, np.array(s.centre_C) + np.array(axes) * ball(x))

        starts = [np.array(v) for v in np.vstack([np.eye(3), -np.eye(3)])]
        tries = [
            minimize(lambda x: n @ on(x), v + 0.1, tol=1e-15, options={"gtol": 1e-10})
            for v in starts
        ]
        best = min(tries, key=lambda found: found.fun)
        return float(best.fun - n @ at(A, pair.r_A)), n, on(best.x)
    turn, c = Rotation.from_quat(A.q_WB), at(B, pair.r_B)
    local = turn.inv().apply(c - at(A, pair.r_A))
    if "cylinder" in name:
        axis = np.array(pair.axis_A)
        local = local - np.linalg.lstsq(axis[:, None], local, rcond=None)[0] * axis
    gap = pair.side * (np.linalg.norm(local) - pair.curved)
    n = pair.side * turn.apply(ball(local))
    return float(gap) - pair.radius, n, c - pair.radius * n


@pytest.mark.parametrize("name", KINDS)
@FEW
@given(SEEDS)
def test_nearest_points(name: str, seed: int) -> None:
    pair, B, A = example(name, np.random.default_rng(seed))
    touch = pairs.touching(pair, B, A)
    gap, normal, point = searched(name, pair, B, A)
    assert_allclose(touch.gap, gap, atol=1e-12)
    assert_allclose(touch.normal, normal, atol=1e-12)
    loose = 1e-12 if name not in SMOOTH else 1e-7  # a minimum is found to the root of rounding
    assert_allclose(touch.point, point, atol=loose)


@pytest.mark.parametrize("name", KINDS)
@FEW
@given(SEEDS)
def test_rates_agree_with_differences(name: str, seed: int) -> None:
    pair, B, A = example(name, np.random.default_rng(seed))
    assert_rates(lambda B, A: pairs.touching(pair, B, A), B, A)


MOTIONS = {
    "turntable": pairs.Turntable((0.3, -0.2, 0.5), (0.4, -1.1, 0.7)),
    "turntable at rest": pairs.Turntable((0.3, -0.2, 0.5), (0.0, 0.0, 0.0)),
    "shaken": pairs.Shaken((0.1, 0.2, -0.3), 5.0, 0.7),
}


@pytest.mark.parametrize("name", MOTIONS)
@pytest.mark.parametrize("t", [0.0, 0.37, 12.5])
def test_carriers(name: str, t: float) -> None:
    """Velocity, spin and accelerations are derivatives of the support's place."""
    motion = MOTIONS[name]
    still = BodyState((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

    def support(s: float) -> Any:
        return pairs.carrier(motion, t + s, still)

    S, a, alpha, driven = support(0.0)
    r = np.array([0.2, 0.9, -0.4])
    assert driven == 1.0
    assert_allclose(S.v_WC, difference(lambda s: support(s)[0].p_WC), atol=1e-9)
    assert_allclose(velocity(S, at(S, r)), difference(lambda s: at(support(s)[0], r)), atol=1e-9)
    assert_allclose(a, difference(lambda s: support(s)[0].v_WC), atol=1e-8)
    assert_allclose(
        alpha,
        difference(lambda s: Rotation.from_quat(support(s)[0].q_WB).apply(S.w_WB_B)),
        atol=1e-9,
    )


@pytest.mark.parametrize("kind", ["sphere", "cylinder"])
def test_in_the_very_middle(kind: str) -> None:
    """All directions are alike there; the gap is known all the same."""
    S = random_state(np.random.default_rng(2))
    r = (0.3, -0.2, 0.1)
    if kind == "sphere":
        pair: Any = pairs.BallOnSphere(r, 0.1, r, 0.7, -1.0)
    else:
        pair = pairs.BallOnCylinder(r, 0.1, r, (0.6, 0.0, 0.8), 0.7, -1.0)
    touch = pairs.touching(pair, S, S)
    assert_allclose(touch.gap, 0.6)
    assert_allclose(np.linalg.norm(touch.normal), 1.0)
    assert np.isfinite([*touch.normal_rate, *touch.point_rate]).all()
