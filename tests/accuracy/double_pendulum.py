# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A planar double pendulum apart from rb_sim: Lagrange's equations in two angles, long doubles.

Two equal rods of length 1 m, mass 1 kg and inertia `ABOUT_CENTRE` about their centres, hinged to
the world and to each other, released from rest in one horizontal line. Angles are counted from
there, downwards.  The method of Gragg, Bulirsch and Stoer (Hairer, Norsett, Wanner I, section
II.9); errors begin near 1e-19, a thousandth of those of doubles, and grow by e in a second.
"""

from __future__ import annotations

import numpy as np

Long = np.longdouble
ABOUT_CENTRE = 0.083
GRAVITY = 9.81
STEPS_PER_SECOND = 64
COLUMNS = 10
"""Of the extrapolation: order 20."""


def rate(y: np.ndarray) -> np.ndarray:
    """d/dt of (angle 1, angle 2, rate 1, rate 2)."""
    a, b, u, v = y
    inertia, gravity, half = Long(ABOUT_CENTRE), Long(GRAVITY), Long(0.5)
    c, s = np.cos(a - b), np.sin(a - b)
    m11, m12, m22 = inertia + half**2 + 1, half * c, inertia + half**2
    r1 = 3 * half * gravity * np.cos(a) - half * s * v * v
    r2 = half * gravity * np.cos(b) + half * s * u * u
    det = m11 * m22 - m12 * m12
    return np.array([u, v, (m22 * r1 - m12 * r2) / det, (m11 * r2 - m12 * r1) / det])


def midpoint(y: np.ndarray, h: Long, n: int) -> np.ndarray:
    """Gragg's midpoint rule with n substeps, whose error is even in h / n."""
    h = h / n
    before, now = y, y + h * rate(y)
    for _ in range(n - 1):
        before, now = now, before + 2 * h * rate(now)
    after = before + 2 * h * rate(now)
    return (before + 2 * now + after) / 4


def step(y: np.ndarray, h: Long) -> np.ndarray:
    """One step, extrapolated to substeps of no length."""
    row: list[np.ndarray] = []
    for j in range(COLUMNS):
        last, row = row, [midpoint(y, h, 2 * (j + 1))]
        for k in range(1, j + 1):
            factor = (Long(j + 1) / (j + 1 - k)) ** 2 - 1
            row.append(row[-1] + (row[-1] - last[k - 1]) / factor)
    return row[-1]


def solution(end: int) -> np.ndarray:
    """Angles and rates at every step from 0 to `end` [s], shape (64 end + 1, 4), as doubles."""
    y = np.zeros(4, dtype=Long)
    rows = [y]
    for _ in range(end * STEPS_PER_SECOND):
        y = step(y, 1 / Long(STEPS_PER_SECOND))
        rows.append(y)
    return np.array(rows, dtype=float)
