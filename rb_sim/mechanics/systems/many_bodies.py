# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""State of N bodies in maximal coordinates, and loops over their effects and constraints.

The loops are unrolled at compile time over the kinds that the scene names; kernels of other kinds
are not compiled.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rb_sim.catalogue.constraints.rows import ANGLES, COUNT, anchor, fill
from rb_sim.catalogue.spec import WORLD, BodyState, Inertial, potential, wrench
from rb_sim.mechanics.inputs import CLEARED
from rb_sim.numerics.vectors import add, cross, dot, rotate, scale, sub, unrotate

WIDTH = 13
"""Coordinates of one body: p_WC (3), q_WB (4), v_WC (3), w_WB_B (3)."""
MASS, INERTIA, INVERSE, RESPONSE, LOAD, BODY_WIDTH = 0, 1, 7, 13, 19, 25
"""Columns of MultiBody.bodies."""
BODY, PARENT, ORDER, ANGLE, ROW_TABLE_COLUMNS = 0, 1, 2, 3, 4
"""Columns of MultiBody.row_table; ANGLE is 1 if a row's error is an angle, else 0."""
RIGHT, MULTIPLIERS = 0, 1
"""Rows of MultiBody.vectors."""


class MultiBody(NamedTuple):
    """N bodies with n constraint rows; y has WIDTH coordinates per body.

    Few, wide arrays: every array that a kernel passes on costs compile time.
    """

    bodies: np.ndarray
    """mass, inertia about C (xx, yy, zz, xy, xz, yz), its inverse; then workspace: response = M^-1
    (f + G^T lambda) and load = active [force (world), torque (body)]; shape (N, 25)."""
    row_table: np.ndarray
    """body and parent (-1: world) of each row, workspace, and whether its error is an angle;
    integers, shape (n, ROW_TABLE_COLUMNS)."""
    rows: np.ndarray
    """Jacobian, bias, error, rate, holonomic (see catalogue.constraints.rows), shape (n, 16)."""
    vectors: np.ndarray
    """right side (in contact) and multipliers, shape (2, n)."""
    first_row: np.ndarray
    """first row of each part of a constraint, the total at the end; integers (parts + 1,)."""
    members: np.ndarray
    """for each reaction the part that gives its reference point, then 1 for each part in it; (K, 1
    + parts)."""
    anchors: np.ndarray
    """workspace: anchor of each part, world [m], shape (parts, 3)."""
    length: float
    """characteristic length of the scene [m]."""
    speed: float
    """characteristic speed of the scene [m/s]."""
    effects: tuple
    constraints: tuple
    spins: tuple = ()
    """polhodes of torque-free bodies (see `FreeSpin` in free)."""
    chosen: Any = ()
    """in laws, for redundant rows in loops: {row: 1, or 0 if it gets no multiplier now}."""


def without_work_space(system):
    """The system with a zero workspace."""
    bodies, row_table = system.bodies.copy(), system.row_table.copy()
    bodies[:, RESPONSE:] = 0.0
    row_table[:, ORDER] = 0
    workspace = {
        name: np.zeros_like(getattr(system, name)) for name in ("rows", "vectors", "anchors")
    }
    return system._replace(bodies=bodies, row_table=row_table, **workspace)


CLEARED[MultiBody] = without_work_space


def state_of(y, i):
    """State of body i; that of the world for -1."""
    if i < 0:
        return WORLD
    k = WIDTH * i
    return BodyState(
        (y[k], y[k + 1], y[k + 2]),
        (y[k + 3], y[k + 4], y[k + 5], y[k + 6]),
        (y[k + 7], y[k + 8], y[k + 9]),
        (y[k + 10], y[k + 11], y[k + 12]),
    )


def vec(a, i, k):
    """Three numbers of row i of a table from column k on, as a tuple."""
    return (a[i, k], a[i, k + 1], a[i, k + 2])


def six(a, i, k):
    """Six numbers of row i of a table from column k on, as a tuple."""
    return (a[i, k], a[i, k + 1], a[i, k + 2], a[i, k + 3], a[i, k + 4], a[i, k + 5])


def inertial_of(system, i):
    """Mass and inertia of body i for effects; its origin is C."""
    return Inertial(system.bodies[i, MASS], six(system.bodies, i, INERTIA), (0.0, 0.0, 0.0))


def add_load(bodies, i, force, torque):
    """Add a force at C (world axes) and a torque (body axes) to the loads of body i."""
    for j in range(3):
        bodies[i, LOAD + j] += force[j]
        bodies[i, LOAD + 3 + j] += torque[j]


def apply_one(placed, t, system, y):
    """Add the wrench of one effect to the load of its body, and the opposite to its parent."""
    B, A = state_of(y, placed.body), state_of(y, placed.parent)
    f, k = wrench(placed.row, t, inertial_of(system, placed.body), B, A)
    add_load(system.bodies, placed.body, f, k)
    if placed.parent >= 0:
        moment = add(rotate(B.q_WB, k), cross(sub(B.p_WC, A.p_WC), f))
        back = scale(-1.0, unrotate(A.q_WB, moment))
        add_load(system.bodies, placed.parent, scale(-1.0, f), back)


def apply_effects(effects, t, system, y):
    """Add the wrenches of all effects to the loads of their bodies."""
    for placed in effects:
        apply_one(placed, t, system, y)


def fill_all(constraints, t, system, y):
    """Write the rows of all constraints."""
    for part, placed in enumerate(constraints):
        B, A = state_of(y, placed.body), state_of(y, placed.parent)
        fill(placed.row, t, B, A, system.rows, system.first_row[part])


def anchor_all(constraints, system, y):
    """Write the points of application of all reactions, world [m]."""
    for part, placed in enumerate(constraints):
        point = anchor(placed.row, state_of(y, placed.body), state_of(y, placed.parent))
        for j in range(3):
            system.anchors[part, j] = point[j]


def power_one(placed, t, system, y):
    """Power of an effect [W], on the body and on its parent."""
    B, A = state_of(y, placed.body), state_of(y, placed.parent)
    f, k = wrench(placed.row, t, inertial_of(system, placed.body), B, A)
    power = dot(f, B.v_WC) + dot(k, B.w_WB_B)
    if placed.parent >= 0:
        moment = add(rotate(B.q_WB, k), cross(sub(B.p_WC, A.p_WC), f))
        power -= dot(f, A.v_WC) + dot(moment, rotate(A.q_WB, A.w_WB_B))
    return power


def potential_one(placed, t, system, y):
    """Potential energy of an effect [J]."""
    B, A = state_of(y, placed.body), state_of(y, placed.parent)
    return potential(placed.row, t, inertial_of(system, placed.body), B, A)


def energetics(effects, t, system, y):
    """(potential energy, power of the effects that have none)."""
    u, p = 0.0, 0.0
    for placed in effects:
        if type(placed.row) in potential.kernels:
            u += potential_one(placed, t, system, y)
        else:
            p += power_one(placed, t, system, y)
    return u, p


def arms(rows: Sequence[Any], length: Any) -> list[Any]:
    """Factor of each row that turns its error into a length: 1, or `length` [m] for an angle."""
    return [length if angle else 1.0 for angle in angles(rows)]


def angles(rows: Sequence[Any]) -> list[int]:
    """For each row 1 if its error is an angle, else 0."""
    return [int(type(row) in ANGLES) for row in rows for _ in range(COUNT[type(row)])]


def arm_of(system, k):
    """The factor of `arms` for row k."""
    if system.row_table[k, ANGLE] != 0:
        arm = system.length
    else:
        arm = 1.0
    return arm
