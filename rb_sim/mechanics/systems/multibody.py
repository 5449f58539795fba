# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""N bodies with any constraints in maximal coordinates: multipliers, corrections and samples.

Traced laws (`multibody_laws`), the start (`initial_projection`) and contacts call these kernels, on
symbols or on numbers.
"""

from __future__ import annotations

import numpy as np

from rb_sim.catalogue.constraints.rows import COUNT, ERROR, HOLONOMIC, RATE, ROW_WIDTH
from rb_sim.catalogue.spec import Inertial
from rb_sim.mechanics.systems.many_bodies import (
    ANGLE,
    BODY,
    BODY_WIDTH,
    INERTIA,
    INVERSE,
    LOAD,
    MASS,
    MULTIPLIERS,
    PARENT,
    RESPONSE,
    ROW_TABLE_COLUMNS,
    WIDTH,
    MultiBody,
    anchor_all,
    angles,
    arm_of,
    energetics,
    fill_all,
    six,
    state_of,
    vec,
)
from rb_sim.numerics.kernels import dispatch
from rb_sim.numerics.vectors import (
    add,
    cross,
    dot,
    gyroscopic,
    maximum,
    quaternion_rate,
    quaternion_unit,
    rotate,
    scale,
    sub,
    symmetric_times,
)

# M du/dt = f + G^T lambda with G du/dt = -bias gives accelerations AND reactions from one solve,
# A lambda = -(bias + G M^-1 f), A = G M^-1 G^T (LL 38.2, 38.6).


def inverse_mass_times(system, i, k, column):
    """M_i^-1 J^T of row k for body i, whose columns start at `column`: (linear, angular)."""
    force = scale(1.0 / system.bodies[i, MASS], vec(system.rows, k, column))
    inverse = six(system.bodies, i, INVERSE)
    return force, symmetric_times(inverse, vec(system.rows, k, column + 3))


def coupling(rows, i, column, force, turn):
    """Row i, columns from `column` on, times the motion (force, turn) of one body."""
    return dot(vec(rows, i, column), force) + dot(vec(rows, i, column + 3), turn)


def rise_of(system, j, b, a, of_body, of_parent):
    """Change of row j by accelerations (linear, angular) of body b and its parent a (-1: world)."""
    rows, row_table, s = system.rows, system.row_table, 0.0
    if row_table[j, BODY] == b:
        s += coupling(rows, j, 0, of_body[0], of_body[1])
    if row_table[j, PARENT] == b:
        s += coupling(rows, j, 6, of_body[0], of_body[1])
    if a >= 0:
        if row_table[j, BODY] == a:
            s += coupling(rows, j, 0, of_parent[0], of_parent[1])
        if row_table[j, PARENT] == a:
            s += coupling(rows, j, 6, of_parent[0], of_parent[1])
    return s


def add_response(bodies, i, force, turn, s):
    """Add s times (force, turn) to the response of body i."""
    for j in range(3):
        bodies[i, RESPONSE + j] += s * force[j]
        bodies[i, RESPONSE + 3 + j] += s * turn[j]


def clear_response(system):
    """Set the response of all bodies to zero."""
    for i in range(system.bodies.shape[0]):
        for j in range(6):
            system.bodies[i, RESPONSE + j] = 0.0


def add_multiplier(system, k, x):
    """response += M^-1 J^T x for row k."""
    b, a = system.row_table[k, BODY], system.row_table[k, PARENT]
    force, turn = inverse_mass_times(system, b, k, 0)
    add_response(system.bodies, b, force, turn, x)
    if a >= 0:
        force, turn = inverse_mass_times(system, a, k, 6)
        add_response(system.bodies, a, force, turn, x)


def add_multipliers(system):
    """response += M^-1 G^T lambda."""
    for k in range(system.row_table.shape[0]):
        add_multiplier(system, k, system.vectors[MULTIPLIERS, k])


def row_times_response(system, k):
    """G response of row k."""
    bodies, b, a = system.bodies, system.row_table[k, BODY], system.row_table[k, PARENT]
    s = coupling(system.rows, k, 0, vec(bodies, b, RESPONSE), vec(bodies, b, RESPONSE + 3))
    if a >= 0:
        s += coupling(system.rows, k, 6, vec(bodies, a, RESPONSE), vec(bodies, a, RESPONSE + 3))
    return s


def row_velocity(system, y, k):
    """G u of row k."""
    B, A = state_of(y, system.row_table[k, BODY]), state_of(y, system.row_table[k, PARENT])
    s = coupling(system.rows, k, 0, B.v_WC, B.w_WB_B)
    if system.row_table[k, PARENT] >= 0:
        s += coupling(system.rows, k, 6, A.v_WC, A.w_WB_B)
    return s


@dispatch
def write_rows(system, t, y):
    """Write the rows of all constraints at (t, y)."""


def clear_loads(system):
    """Set the loads of all bodies to zero."""
    for i in range(system.bodies.shape[0]):
        for j in range(6):
            system.bodies[i, LOAD + j] = 0.0


def free_accelerations(system, y):
    """response = accelerations (world, body axes) under the loads alone."""
    bodies = system.bodies
    for i in range(bodies.shape[0]):
        w = state_of(y, i).w_WB_B
        a = scale(1.0 / bodies[i, MASS], vec(bodies, i, LOAD))
        turn = gyroscopic(six(bodies, i, INERTIA), w)
        alpha = symmetric_times(six(bodies, i, INVERSE), sub(vec(bodies, i, LOAD + 3), turn))
        for j in range(3):
            bodies[i, RESPONSE + j] = a[j]
            bodies[i, RESPONSE + 3 + j] = alpha[j]


@write_rows.register(MultiBody)
def write_constraint_rows(system, t, y):
    """Write the rows of each constraint by its `fill`, in order."""
    fill_all(system.constraints, t, system, y)


def move_by_response(system, y):
    """Displace and rotate every body by response, taken as a small displacement."""
    for i in range(system.bodies.shape[0]):
        B, k = state_of(y, i), WIDTH * i
        turn = quaternion_rate(B.q_WB, vec(system.bodies, i, RESPONSE + 3))
        for j in range(3):
            y[k + j] += system.bodies[i, RESPONSE + j]
        q = quaternion_unit(
            (B.q_WB[0] + turn[0], B.q_WB[1] + turn[1], B.q_WB[2] + turn[2], B.q_WB[3] + turn[3])
        )
        for j in range(4):
            y[k + 3 + j] = q[j]


def put_rates(system, y, dy):
    """dy/dt of all bodies, with accelerations from response."""
    for i in range(system.bodies.shape[0]):
        B, k = state_of(y, i), WIDTH * i
        turn = quaternion_rate(B.q_WB, B.w_WB_B)
        for j in range(3):
            dy[k + j] = B.v_WC[j]
        for j in range(4):
            dy[k + 3 + j] = turn[j]
        for j in range(6):
            dy[k + 7 + j] = system.bodies[i, RESPONSE + j]


def put_reactions(system, y, out, first):
    """Write the reactions from the multipliers: force, torque about the anchor, anchor; world
    axes."""
    rows, members = system.rows, system.members
    anchor_all(system.constraints, system, y)
    at = first
    for o in range(members.shape[0]):
        main = members[o, 0]
        B = state_of(y, system.row_table[system.first_row[main], BODY])
        force, torque_B = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for part in range(members.shape[1] - 1):
            if members[o, 1 + part] != 0:
                for k in range(system.first_row[part], system.first_row[part + 1]):
                    x = system.vectors[MULTIPLIERS, k]
                    force = add(force, scale(x, vec(rows, k, 0)))
                    torque_B = add(torque_B, scale(x, vec(rows, k, 3)))
        point = vec(system.anchors, main, 0)
        torque = add(rotate(B.q_WB, torque_B), cross(sub(B.p_WC, point), force))
        for j in range(3):
            out[at + j] = force[j]
            out[at + 3 + j] = torque[j]
            out[at + 6 + j] = point[j]
        at += 9
    return at


def violation_of(system, y, k):
    """|g| / length or |G u - b| / speed of row k; angles are multiplied by their arm."""
    arm = arm_of(system, k)
    gap = abs(system.rows[k, ERROR]) * system.rows[k, HOLONOMIC] * arm
    slip = abs(row_velocity(system, y, k) - system.rows[k, RATE]) * arm
    return maximum(gap / system.length, slip / system.speed)


def worst_gap(system, holonomic):
    """Largest error of the holonomic rows as written [m]; angles are multiplied by their arm."""
    worst = 0.0
    for k, held in enumerate(holonomic):
        if held:
            worst = maximum(worst, abs(system.rows[k, ERROR]) * arm_of(system, k))
    return worst


def residual_of(system, y):
    """Largest violation of all rows."""
    worst = 0.0
    for k in range(system.row_table.shape[0]):
        worst = maximum(worst, violation_of(system, y, k))
    return worst


def put_momenta(system, y, out, at):
    """Write momentum and angular momentum about the world origin into out; returns the kinetic
    energy."""
    kinetic = 0.0
    momentum, angular = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(system.bodies.shape[0]):
        B = state_of(y, i)
        p = scale(system.bodies[i, MASS], B.v_WC)
        spin = symmetric_times(six(system.bodies, i, INERTIA), B.w_WB_B)
        kinetic += 0.5 * (dot(p, B.v_WC) + dot(spin, B.w_WB_B))
        momentum = add(momentum, p)
        angular = add(angular, add(cross(B.p_WC, p), rotate(B.q_WB, spin)))
    for j in range(3):
        out[at + j] = momentum[j]
        out[at + 3 + j] = angular[j]
    return kinetic


def put_balances(system, t, y, out, at, reaction_power):
    """Write energies, power, momenta and the residual."""
    kinetic = put_momenta(system, y, out, at + 3)
    u, power = energetics(system.effects, t, system, y)
    out[at], out[at + 1], out[at + 2] = kinetic, u, power + reaction_power
    out[at + 9] = residual_of(system, y)


def power_of_reactions(system):
    """Power of the multipliers on rows that prescribe a velocity [W]."""
    power = 0.0
    for k in range(system.row_table.shape[0]):
        power += system.vectors[MULTIPLIERS, k] * system.rows[k, RATE]
    return power


def multibody(
    bodies: list[Inertial],
    effects: tuple,
    constraints: tuple,
    outputs: list[tuple[list[int], int]],
    length: float,
    speed: float,
) -> MultiBody:
    """The system of these bodies; outputs lists (parts, anchor part) of each reaction."""
    counts = [COUNT[type(c.row)] for c in constraints]
    n, parts = sum(counts), len(constraints)
    members = np.zeros((len(outputs), 1 + parts), np.int64)
    for o, (counted, main) in enumerate(outputs):
        members[o, 0] = main
        members[o, [1 + part for part in counted]] = 1
    row_table = np.zeros((n, ROW_TABLE_COLUMNS), np.int64)
    row_table[:, BODY] = np.repeat(np.array([c.body for c in constraints], np.int64), counts)
    row_table[:, PARENT] = np.repeat(np.array([c.parent for c in constraints], np.int64), counts)
    row_table[:, ANGLE] = angles([c.row for c in constraints])
    return MultiBody(
        bodies=body_table(bodies),
        row_table=row_table,
        rows=np.zeros((n, ROW_WIDTH)),
        vectors=np.zeros((2, n)),
        first_row=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        members=members,
        anchors=np.zeros((parts, 3)),
        length=length,
        speed=speed,
        effects=effects,
        constraints=constraints,
    )


def body_table(bodies: list[Inertial]) -> np.ndarray:
    """Table of the constants of the bodies, with workspace, (N, BODY_WIDTH)."""
    table = np.zeros((len(bodies), BODY_WIDTH))
    for i, body in enumerate(bodies):
        table[i, MASS] = body.mass
        table[i, INERTIA : INERTIA + 6] = body.inertia
        table[i, INVERSE : INVERSE + 6] = inverse_symmetric(body.inertia)
    return table


def inverse_symmetric(s: tuple[float, ...]) -> tuple[float, ...]:
    """Inverse of (xx, yy, zz, xy, xz, yz) in the same order."""
    m = np.array([[s[0], s[3], s[4]], [s[3], s[1], s[5]], [s[4], s[5], s[2]]])
    v = np.linalg.inv(m)
    return tuple(float(x) for x in (v[0, 0], v[1, 1], v[2, 2], v[0, 1], v[0, 2], v[1, 2]))
