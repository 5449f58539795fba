# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bennett's linkage: four bars in space on four hinges whose axes are skew (Bennett 1903).

It moves, although its 20 lines hold 18 coordinates, where sin(twist) over length is the same for
all bars. Its place hangs on one angle in closed form; without loads its motion follows from the
energy by one integral.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

MOVING = 3
"""Bars that move; the fourth is the ground."""
SIXTH = {-3: -1 / 60, -2: 3 / 20, -1: -3 / 4, 1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
APART = 1e-3
"""[rad] between the places of which differences of sixth order make rates."""


def screw(angle: float, length: float, twist: float) -> np.ndarray:
    """From one hinge to the next (Denavit & Hartenberg), shape (4, 4)."""
    c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(twist), np.sin(twist)
    rows = [[c, -s * ca, s * sa, length * c], [s, c * ca, -c * sa, length * s], [0, sa, ca, 0]]
    return np.array([*rows, [0, 0, 0, 1]])


class Bennett:
    """A linkage with random lengths, twists, masses and place."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.twists = rng.uniform(0.4, 1.0), rng.uniform(1.2, 1.9)
        first = rng.uniform(0.4, 1.0)
        self.lengths = first, first * np.sin(self.twists[1]) / np.sin(self.twists[0])
        self.masses, self.moments = rng.uniform(0.5, 2, 3), rng.uniform(0.03, 0.05, (3, 3))
        self.start = rng.uniform(0, 6)
        self.ground = Rotation.random(random_state=seed).as_matrix()
        self.sign = 1.0
        if abs(self.hinges(self.start)[-1] - np.eye(4)).max() > 1e-9:
            self.sign = -1.0
        assert abs(self.hinges(self.start + 0.7)[-1] - np.eye(4)).max() < 1e-12  # it closes

    def hinges(self, angle: float) -> list[np.ndarray]:
        """Frames of the four hinges and of the first again; the first is turned by `angle`."""
        small, large = self.twists
        ratio = self.sign * np.sin(0.5 * (small + large)) / np.sin(0.5 * (large - small))
        second = 2.0 * np.arctan2(ratio * np.cos(0.5 * angle), np.sin(0.5 * angle))
        frames = [np.eye(4)]
        for k, turn in enumerate((angle, second, -angle, -second)):
            frames.append(frames[-1] @ screw(turn, self.lengths[k % 2], self.twists[k % 2]))
        return frames

    def places(self, angle: float) -> tuple[np.ndarray, np.ndarray]:
        """Middles (3, 3) and attitudes (3, 3, 3) of the bars."""
        at = self.hinges(angle)
        middles = [0.5 * (at[k] + at[k + 1])[:3, 3] for k in range(MOVING)]
        turned = [self.ground @ at[k + 1][:3, :3] for k in range(MOVING)]
        return np.array(middles) @ self.ground.T, np.array(turned)

    def rates(self, angle: float) -> tuple[np.ndarray, np.ndarray]:
        """Velocities of the middles, and spins in the bars' axes, at 1 rad/s of the angle."""
        near = {j: self.places(angle + j * APART) for j in SIXTH}
        moving = sum(w * near[j][0] for j, w in SIXTH.items()) / APART
        turning = sum(w * near[j][1] for j, w in SIXTH.items()) / APART
        spins = np.einsum("kji,kjl->kil", self.places(angle)[1], turning)
        return np.asarray(moving), np.stack([spins[:, 2, 1], spins[:, 0, 2], spins[:, 1, 0]], 1)

    def inertia(self, angle: float) -> float:
        """Twice the energy where the angle grows by 1 rad/s."""
        v, w = self.rates(angle)
        return float((self.masses[:, None] * v**2).sum() + (self.moments * w**2).sum())

    def scene(self, turning: float, **run: Any) -> dict[str, Any]:
        """Set going so that the angle grows by `turning` [rad/s]."""
        (middles, turned), (v, w) = self.places(self.start), self.rates(self.start)
        bodies: dict[str, Any] = {}
        for k in range(MOVING):
            bodies[f"bar{k}"] = {
                "mass": float(self.masses[k]),
                "inertia": self.moments[k].tolist(),
                "position": middles[k].tolist(),
                "orientation": Rotation.from_matrix(turned[k]).as_quat().tolist(),
                "linear_velocity": (turning * v[k]).tolist(),
                "angular_velocity": (turning * w[k]).tolist(),
            }
        joints = {}
        for k, frame in enumerate(self.hinges(self.start)[:4]):
            bar = min(k, 2)
            point = turned[bar].T @ (self.ground @ frame[:3, 3] - middles[bar])
            axis = turned[bar].T @ self.ground @ frame[:3, 2]
            hinge = {"type": "fixed_axis", "body": f"bar{bar}", "bearing_distance": 0.3}
            hinge |= {"point_B": point.tolist(), "axis_B": axis.tolist()}
            joints[f"hinge{k}"] = hinge | ({"parent": f"bar{k - 1}"} if k in (1, 2) else {})
        return {"bodies": bodies, "constraints": joints, "simulation": run}

    def middles(self, rate: float, t: np.ndarray) -> np.ndarray:
        """Where the middles are at t (from 0 on), shape (n, 3, 3), by the energy integral."""
        twice = self.inertia(self.start) * rate**2
        found = solve_ivp(
            lambda _, x: [np.sqrt(twice / self.inertia(x[0]))],
            (0.0, t[-1]),
            [self.start],
            t_eval=t,
            rtol=1e-12,
            atol=1e-12,
            method="DOP853",
        )
        return np.array([self.places(x)[0] for x in found.y[0]])
