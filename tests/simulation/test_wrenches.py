# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Accelerations of a trajectory against closed forms, and against differences of its velocities."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim import RbSimError, Simulation, Trajectory, load_scene
from tests.simulation.test_trajectory import TIED

SPACING = 1e-3
"""[s] of the samples of which differences of fourth order are taken."""


def run(scene: Any, at: list[float], coordinates: str = "auto") -> Trajectory:
    return Simulation(load_scene(scene), coordinates=coordinates).run(at=at, checks=False)


@pytest.mark.parametrize("coordinates", ["auto", "maximal"])
def test_heavy_top(coordinates):
    """About the tip I_O dw/dt = r x m g - w x I_O w, and C goes round it."""
    top = run("heavy_top", [0.0, 0.1, 0.5], coordinates)
    w, r = top.angular_velocity["top"], np.array([0.0, 1.0, 0.0])
    I_O = np.diag([0.234375 + 15.0, 0.46875, 0.234375 + 15.0])
    g = np.array([unrotated(q, [0.0, 0.0, -9.81]) for q in top.orientation["top"]])
    expected = np.linalg.solve(I_O, (np.cross(r, 15.0 * g) - np.cross(w, w @ I_O)).T).T
    found = top.angular_acceleration["top"]
    np.testing.assert_allclose(found, expected, atol=1e-10 * np.abs(expected).max())
    a_C = np.cross(expected, r) + np.cross(w, np.cross(w, r))
    own = [
        unrotated(q, a)
        for q, a in zip(top.orientation["top"], top.linear_acceleration["top"], strict=True)
    ]
    np.testing.assert_allclose(own, a_C, atol=1e-10 * np.abs(a_C).max())


def unrotated(q: Any, vector: Any) -> np.ndarray:
    """World components in body axes."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(q).inv().apply(vector)


def test_rolling_sphere():
    """LL 38, problem 1: m dV_x/dt = 5/7 (F_x + K_y/a), m dV_y/dt = 5/7 (F_y - K_x/a)."""
    ball = run("rolling_sphere", [0.0, 1.0])
    expected = np.array([1.0 - 0.01 / 0.1, 0.5 - 0.02 / 0.1, 0.0]) * 5.0 / 7.0 / 2.0
    np.testing.assert_allclose(ball.linear_acceleration["ball"], [expected] * 2, atol=1e-13)
    spin = 0.03 / (0.4 * 2.0 * 0.01)
    about = [-expected[1] / 0.1, expected[0] / 0.1, spin]
    np.testing.assert_allclose(ball.angular_acceleration["ball"][0], about, atol=1e-12)


def test_pendulum():
    """I_O phi'' = -m g l sin phi, and the same from a scene with other coordinates."""
    rod = run("pendulum", [0.0, 0.4])
    turn = 2.0 * np.arctan2(rod.orientation["rod"][:, 1], rod.orientation["rod"][:, 3])
    expected = -9.81 * 0.5 / (1.0 / 12.0 + 0.25) * np.sin(turn)
    np.testing.assert_allclose(rod.angular_acceleration["rod"][:, 1], expected, rtol=1e-12)
    np.testing.assert_allclose(rod.angular_acceleration["rod"][:, [0, 2]], 0.0, atol=1e-10)


SWINGING = TIED | {
    "bodies": TIED["bodies"] | {"c": {"mass": 0.5, "inertia": [0.02, 0.03, 0.04]}},
    "constraints": TIED["constraints"]
    | {"rod": {"type": "fixed_point", "body": "c", "parent": "a", "point_B": [0.1, 0.2, 0.3]}},
    "simulation": {
        "duration": 1.0, "rate": 10, "method": "dopri853", "tolerance": 1e-12,
        "project_initial": True,
    },
}  # fmt: skip
"""Bodies on each other: effects and reactions act on parents, too."""


def assert_rates(moving: Trajectory, close: float) -> None:
    """The accelerations at the middle of five samples are the differences of the velocities."""

    def rate(v: np.ndarray) -> np.ndarray:
        return (8.0 * (v[3] - v[1]) - (v[4] - v[0])) / (12.0 * SPACING)

    for name in moving.layout.bodies:
        expected = rate(moving.linear_velocity[name])
        np.testing.assert_allclose(moving.linear_acceleration[name][2], expected, atol=close)
        expected = rate(moving.angular_velocity[name])
        np.testing.assert_allclose(moving.angular_acceleration[name][2], expected, atol=close)


def test_bodies_on_each_other_against_differences():
    moving = run(SWINGING, [0.3 + SPACING * i for i in range(-2, 3)])
    assert np.abs(moving.linear_acceleration["c"]).max() > 1.0
    assert_rates(moving, 1e-7)


def _ball_on_block() -> Trajectory:
    return run("ball_on_block", [0.2 + SPACING * i for i in range(-2, 3)])


def _incline() -> Trajectory:
    return run("incline_block", [0.1])


def test_a_contact_between_bodies():
    """A ball that rolls on a block on a rail: the contact pushes the block back."""
    assert_rates(_ball_on_block(), 1e-6)


def test_a_contact_of_several_points():
    """A block slides up an incline: -g (sin a + mu cos a) along it, the corners counted once."""
    block, angle = _incline(), 0.4
    up = -9.81 * (np.sin(angle) + 0.5 * np.cos(angle))
    expected = [-up * np.cos(angle), 0.0, up * np.sin(angle)]  # the block moves towards -x
    np.testing.assert_allclose(block.linear_acceleration["block"][0], expected, atol=1e-9)
    np.testing.assert_allclose(block.angular_acceleration["block"][0], 0.0, atol=1e-7)


def test_what_has_no_accelerations():
    top = run("heavy_top", [0.0])
    with pytest.raises(RbSimError, match="accelerations: the scene of these samples is not known"):
        _ = Trajectory(top.block, top.layout).linear_acceleration
    scene = load_scene(TIED | {"simulation": TIED["simulation"] | {"method": "time_stepping"}})
    with pytest.raises(RbSimError, match="reactions that are means over its steps; must be ano"):
        _ = Trajectory(top.block, top.layout, scene).angular_acceleration


def test_tables_have_them_where_asked_for(tmp_path):
    top = run("heavy_top", [0.0, 0.1])
    top.to_npz(tmp_path / "plain.npz")
    assert not any("acceleration" in name for name in np.load(tmp_path / "plain.npz"))
    assert not any("acceleration" in name for name in top.to_pandas())
    top.to_npz(tmp_path / "run.npz", accelerations=True)
    stored, frame = np.load(tmp_path / "run.npz"), top.to_pandas(accelerations=True)
    for quantity in ("linear_acceleration", "angular_acceleration"):
        values = getattr(top, quantity)["top"]
        np.testing.assert_array_equal(stored[f"{quantity}.top"], values)
        np.testing.assert_array_equal(frame[f"{quantity}.top.y"], values[:, 1])
    assert frame.attrs["units"]["angular_acceleration.top.x"] == "rad/s^2"
