# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Where a ball that spins begins to roll because its normal turns, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from tests.contact.scenes import G, ball, scene, touch
from tests.contact_runs import contact_run

FAR, R = 0.5, 0.1
"""Of the ball's middle from that of the support; its radius [m]."""
SPIN, SPEED, ARM = 15.0, 0.5, 0.01
"""About the normal [rad/s], at the top [m/s], of the resistance [m]."""


def rolls_at() -> float:
    """A smooth ball slides down a sphere, n = (sin a, 0, cos a); to turn its spin with n takes the
    torque I spin v / FAR, and there is ARM N, N = m (g cos a - v^2 / FAR)."""
    inertia = 0.4 * R**2

    def speed(a: float) -> float:
        return float(np.sqrt(SPEED**2 + 2.0 * G * FAR * (1.0 - np.cos(a))))

    def left(a: float) -> float:
        push = G * np.cos(a) - speed(a) ** 2 / FAR
        return float(ARM * push - inertia * SPIN * speed(a) / FAR)

    angle = brentq(left, 0.0, 0.8, xtol=1e-15)
    return quad(lambda a: FAR / speed(a), 0.0, angle, epsabs=1e-14)[0]


@pytest.mark.parametrize("spin", [SPIN, -SPIN])
def test_a_spin_that_the_normal_takes_along_is_no_rolling(spin: float) -> None:
    """The event function of rolling had the spin in it, whose direction turns with the normal: it
    chattered (a random scene: 415 events where there are 18)."""
    moving = {"linear_velocity": [SPEED, 0.0, 0.0], "angular_velocity": [0.0, 0.0, spin]}
    sphere = {"type": "sphere", "radius": FAR - R, "center": [0.0, 0.0, -FAR]}
    contact = touch(surface=sphere, rolling_resistance=ARM)
    run = contact_run(scene(ball([0.0, 0.0, 0.0], R, **moving), contact), np.linspace(0, 0.3, 31))
    assert [event.kind for event in run.events] == ["closes", "stops rolling", "rolls"]
    assert abs(run.times("rolls")[0] - rolls_at()) < 1e-10
    assert run.balance() < 1e-9


def test_rolling_ends_once_while_the_ball_spins() -> None:
    """In a bowl: what is left of a rolling that has ended is taken away."""
    moving = {"linear_velocity": [0.3, 0.1, 0.0], "angular_velocity": [3.0, -2.0, SPIN]}
    bowl = {"type": "sphere", "radius": 1.0, "center": [0, 0, 1.0], "side": "inside"}
    contact = touch(surface=bowl, rolling_resistance=0.02)
    thrown = ball([0.0, 0.0, R], R, **moving)
    run = contact_run(scene(thrown, contact), np.linspace(0.0, 0.5, 51))
    assert [e.kind for e in run.events] == ["closes", "rolls", "stops rolling"]
    r = run.trajectory
    after = r.t > run.times("stops rolling")[0]
    normal = r.position["body"] - [0.0, 0.0, 1.0]
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    assert run.balance() < 1e-9 and after.sum() > 10
    turn = Rotation.from_quat(r.orientation["body"]).apply(r.angular_velocity["body"])
    across = turn - np.sum(turn * normal, axis=1)[:, None] * normal
    assert np.abs(across[after]).max() < 1e-9
