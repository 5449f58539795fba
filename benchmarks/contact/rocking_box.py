# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A box that rocks on a floor that gives way, by an independent program:
`python -m benchmarks.contact.rocking_box`.

Newton's and Euler's equations with springs and dampers at the corners, and Coulomb's friction with
its corner rounded at a slow speed, by SciPy's Radau.  A minute; the numbers are those of
tests/contact/events/test_rest.py, and are off by about as much as the speed of rounding.
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy.integrate import solve_ivp

SIZE, MASS, STIFFNESS, DAMPING, MU, G = np.array([0.2, 0.15, 0.1]), 1.0, 5e3, 20.0, 0.4, 9.81
AXIS, ANGLE, START = np.array([0.6, 0.8, 0.0]), 0.03, (0.05, 0.02, 0.0)
HEIGHT = 0.05 * np.cos(ANGLE) + 0.125 * np.sin(ANGLE) + 1e-4
CORNERS = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (-0.5, 0.5)])


def rotation(q: np.ndarray) -> np.ndarray:
    """Body to world, of the quaternion [x, y, z, w]."""
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def rate(y: np.ndarray, rounded: float) -> np.ndarray:
    """d/dt of place, quaternion, velocity (world) and spin (body axes)."""
    q, v, spin = y[3:7], y[7:10], y[10:13]
    R = rotation(q)
    arms = CORNERS * SIZE @ R.T
    speeds, depths = v + np.cross(R @ spin, arms), -(y[2] + arms[:, 2])
    pushes = np.where(depths > 0.0, STIFFNESS * depths - DAMPING * speeds[:, 2], 0.0).clip(0.0)
    slips = speeds[:, :2]
    rubs = slips / np.sqrt((slips**2).sum(axis=1) + rounded**2)[:, None]
    forces = np.column_stack([-MU * pushes[:, None] * rubs, pushes])
    squares = SIZE**2
    moments = MASS / 12.0 * (squares.sum() - squares)
    torque = R.T @ np.cross(arms, forces).sum(axis=0) - np.cross(spin, moments * spin)
    turn = np.array([*(q[3] * spin + np.cross(q[:3], spin)), -q[:3] @ spin])
    linear = forces.sum(axis=0) / MASS + [0.0, 0.0, -G]
    return np.concatenate([v, 0.5 * turn, linear, torque / moments])


def main() -> None:
    parser = argparse.ArgumentParser(description="A box that rocks, by an independent program.")
    parser.add_argument("--time", type=float, default=0.12, help="[s]")
    parser.add_argument("--rounded", type=float, default=1e-8, help="speed of rounding [m/s]")
    options = parser.parse_args()
    turned = [*(np.sin(0.5 * ANGLE) * AXIS), np.cos(0.5 * ANGLE)]
    start = [0.0, 0.0, HEIGHT, *turned, *START, 0.0, 0.0, 0.0]
    found = solve_ivp(
        lambda _, y: rate(y, options.rounded),
        (0.0, options.time), start, "Radau", rtol=1e-9, atol=1e-12,
    ).y[:, -1]  # fmt: skip
    names = ("position", "orientation", "linear_velocity", "angular_velocity")
    for name, part in zip(names, np.split(found, [3, 7, 10]), strict=True):
        print(name, [float(f"{x:.12g}") for x in part])


if __name__ == "__main__":
    main()
