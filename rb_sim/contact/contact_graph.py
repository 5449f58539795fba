# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A friction problem as a graph: contacts and joints between bodies, whose velocities couple them.

Each contact has six rows in `rows`: along its normal and two tangents, then, where it resists
turning, about both tangents and the normal.  A row's columns are force on B (3, world), torque on
B (3, body axes), the same on A, then I^-1 torque of both and 1/m of both.  Rows of joints are
written alike.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

# Arrays in kernels as loops: what is compiled knows no expressions of whole arrays.


def copy(to, of):
    """The numbers of a vector, in `to`."""
    for i in range(of.shape[0]):
        to[i] = of[i]


def copy_rows(to, of):
    """The numbers of a matrix, in `to`."""
    for i in range(of.shape[0]):
        for j in range(of.shape[1]):
            to[i, j] = of[i, j]


def largest(x):
    """The largest absolute value of a vector; NaN if one is."""
    most = 0.0
    for i in range(x.shape[0]):
        size = abs(x[i])
        if size > most or size != size:
            most = size
    return most


FORCE_B, TORQUE_B, FORCE_A, TORQUE_A, TURN_B, TURN_A, LIGHT_B, LIGHT_A, WIDTH = (
    0, 3, 6, 9, 12, 15, 18, 19, 20,
)  # fmt: skip
"""Columns of Graph.rows."""
CONTACT_ROWS = 6
"""Of each contact."""
ENOUGH = 1e-7
"""Change of an impulse, or residual of the natural map, relative to the largest impulse, at
which a step counts as solved: far below the error of the step itself."""
FINE = 1e-4
"""Natural map of the laws, relative to the largest impulse, that a step may leave where contacts
contradict each other, and at which sweeps of a moving heap need no Newton's method and contacts
need not grip firmer in it: it is reported as GAVE alone."""
BOUND, COMPLIANCE, VISCOUS_PER_NORMAL, VISCOUS, PULLS, ROLLS, SPINS, RULES = range(8)
"""Columns of Graph.rules: coefficient of friction (of a law without corner: -1), velocity that the
support gives per impulse, impulse of that law per slip (per N and without), whether N may pull,
arms of rolling and spinning resistance."""
BLOCK = 6


class Graph(NamedTuple):
    """n contacts and m rows of joints between bodies with velocities u, shape (N, 6)."""

    ends: np.ndarray
    """bodies of each contact, -1 for the world, shape (n, 2)."""
    rows: np.ndarray
    """rows of the contacts, shape (CONTACT_ROWS n, WIDTH)."""
    targets: np.ndarray
    """what rows u (and give times impulse) has to become [m/s], shape (CONTACT_ROWS n,)."""
    rules: np.ndarray
    """shape (n, RULES)."""
    blocks: np.ndarray
    """own block of W of each contact (nn, n1, n2, 11, 12, 22), shape (n, BLOCK)."""
    joint_ends: np.ndarray
    """bodies of each row, and whether it depends on others and gets no impulse, shape (m, 3)."""
    joint_rows: np.ndarray
    """shape (m, WIDTH)."""
    joint_targets: np.ndarray
    """shape (m,)."""
    joint_factor: np.ndarray
    """work: factors of their own block of W, shape (m, m); (0, 0) for rows too many for that."""
    spare: np.ndarray
    """work, shape (2, m)."""


def rate_of(rows, k, u, b, a):
    """Rate of row k at the velocities u."""
    s = 0.0
    for j in range(6):
        s += rows[k, j] * u[b, j]
    if a >= 0:
        for j in range(6):
            s += rows[k, 6 + j] * u[a, j]
    return s


def add_impulse(rows, k, u, b, a, x):
    """u += M^-1 J^T x of row k."""
    light = rows[k, LIGHT_B] * x
    for j in range(3):
        u[b, j] += light * rows[k, j]
        u[b, 3 + j] += x * rows[k, TURN_B + j]
    if a >= 0:
        light = rows[k, LIGHT_A] * x
        for j in range(3):
            u[a, j] += light * rows[k, 6 + j]
            u[a, 3 + j] += x * rows[k, TURN_A + j]


def coupled(rows, i, k, a):
    """Element of the Delassus matrix of two rows of one contact."""
    s = 0.0
    for j in range(3):
        s += rows[i, j] * rows[k, LIGHT_B] * rows[k, j]
        s += rows[i, TORQUE_B + j] * rows[k, TURN_B + j]
    if a >= 0:
        for j in range(3):
            s += rows[i, 6 + j] * rows[k, LIGHT_A] * rows[k, 6 + j]
            s += rows[i, TORQUE_A + j] * rows[k, TURN_A + j]
    return s
