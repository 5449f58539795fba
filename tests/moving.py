# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Random moving bodies, and derivatives along their motion by differences."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from rb_sim.catalogue.spec import BodyState

STEP = 1e-4
"""Of the fourth-order differences: truncation and rounding both stay below 1e-8."""


def difference(values: Any) -> np.ndarray:
    """Derivative at 0 of a function of t, by central differences of order 4."""
    f = {k: np.asarray(values(k * STEP), dtype=float) for k in (-2, -1, 1, 2)}
    return (8.0 * (f[1] - f[-1]) - (f[2] - f[-2])) / (12.0 * STEP)


def floats(a: Any) -> tuple[float, ...]:
    return tuple(float(x) for x in a)


def unit(rng: np.random.Generator, n: int = 3) -> tuple[float, ...]:
    a = rng.normal(size=n)
    return floats(a / np.linalg.norm(a))


def random_state(rng: np.random.Generator) -> Any:
    p, v, w = (floats(rng.normal(size=3)) for _ in range(3))
    return BodyState(p, unit(rng, 4), v, w)


def flown(S: Any, t: float) -> Any:
    """The state after t at constant velocity (world) and constant spin (body axes)."""
    turn = Rotation.from_quat(S.q_WB) * Rotation.from_rotvec(t * np.array(S.w_WB_B))
    p = np.array(S.p_WC) + t * np.array(S.v_WC)
    return S._replace(p_WC=floats(p), q_WB=floats(turn.as_quat()))


def at(S: Any, r: Any) -> np.ndarray:
    """World position of the point r of a body."""
    return np.array(S.p_WC) + Rotation.from_quat(S.q_WB).apply(r)


def brought(S: Any, r: Any, place: np.ndarray) -> Any:
    """The body shifted so that its point r is at this place."""
    return S._replace(p_WC=floats(np.array(S.p_WC) + place - at(S, r)))


def velocity(S: Any, point: Any) -> np.ndarray:
    """Velocity of the material point of a body that is at `point`."""
    spin = Rotation.from_quat(S.q_WB).apply(S.w_WB_B)
    return np.array(S.v_WC) + np.cross(spin, np.array(point) - np.array(S.p_WC))


def moved(S: Any, turn: Rotation, shift: np.ndarray) -> Any:
    """The same body in a world that is turned and shifted."""
    q = (turn * Rotation.from_quat(S.q_WB)).as_quat()
    p, v = turn.apply(S.p_WC) + shift, turn.apply(S.v_WC)
    return BodyState(floats(p), floats(q), floats(v), S.w_WB_B)


def assert_rates(touch_at: Any, B: Any, A: Any) -> None:
    """Of normal and point, and d(gap)/dt = n . (v_B(P) - v_A(P)); touch_at(B, A): the
    ContactPoint."""

    def later(t: float) -> Any:
        return touch_at(flown(B, t), flown(A, t))

    touch = later(0.0)
    size = 1.0 + sum(float(np.linalg.norm(x)) for x in (*B[2:], *A[2:]))
    close = {"rtol": 0.0, "atol": 1e-8 * size**2}
    n = np.array(touch.normal)
    rising = n @ (velocity(B, touch.point) - velocity(A, touch.point))
    np.testing.assert_allclose(rising, difference(lambda t: later(t).gap), **close)
    np.testing.assert_allclose(touch.normal_rate, difference(lambda t: later(t).normal), **close)
    np.testing.assert_allclose(touch.point_rate, difference(lambda t: later(t).point), **close)
    assert abs(n @ n - 1.0) <= 1e-14
    assert abs(n @ np.array(touch.normal_rate)) <= 1e-13 * size
