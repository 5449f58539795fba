# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Rates, samples and projection onto the manifold of bodies in contact."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rb_sim.catalogue.constraints.rows import ERROR, HOLONOMIC, RATE
from rb_sim.integrate.attempt import LOST, correct_positions, position_error, return_to_positions
from rb_sim.integrate.layout import PackedSystem, address
from rb_sim.mechanics.contact.accelerations import (
    contact_accelerations,
    find_holding,
    moving,
    power_of_contacts,
)
from rb_sim.mechanics.contact.constraint_tables import energies, write_all_rows, write_anchors
from rb_sim.mechanics.contact.contact_bodies import (
    ACTIVE,
    AMONG_POSITIONS,
    AMONG_ROWS,
    CLOSED,
    COMPLIANT,
    DIRECT,
    DIRECT_TORQUE,
    GAP,
    POINT,
    SLIDE,
    ContactBodies,
    first_row_of,
)
from rb_sim.mechanics.contact.contact_kinematics import STUCK
from rb_sim.mechanics.system import project, sample
from rb_sim.mechanics.systems.many_bodies import (
    BODY,
    MULTIPLIERS,
    ORDER,
    PARENT,
    RESPONSE,
    RIGHT,
    WIDTH,
    arm_of,
    state_of,
    vec,
)
from rb_sim.mechanics.systems.multibody import (
    add_multiplier,
    clear_response,
    inverse_mass_times,
    move_by_response,
    put_momenta,
    put_rates,
    residual_of,
    rise_of,
    row_velocity,
)
from rb_sim.numerics.kernels import call_law, pointer
from rb_sim.numerics.linear_solves import solve_semidefinite
from rb_sim.numerics.vectors import add, cross, rotate, scale, sub

# Projection onto the manifold, with the active rows alone: most contacts are open most of the time,
# and their rows, which are zero, would cost as much as others.


def fill_symmetric(system, holding, holonomic_only):
    """A = G M^-1 G^T of the active rows; with holonomic_only the other rows are those of the
    identity."""
    rows, row_table = system.rows, system.row_table
    for m in range(holding):
        i = row_table[m, ACTIVE]
        b, a = row_table[i, BODY], row_table[i, PARENT]
        fb, kb = inverse_mass_times(system, b, i, 0)
        fa, ka = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        if a >= 0:
            fa, ka = inverse_mass_times(system, a, i, 6)
        for n in range(m + 1):
            j = row_table[n, ACTIVE]
            s = rise_of(system, j, b, a, (fb, kb), (fa, ka))
            if holonomic_only and (rows[i, HOLONOMIC] == 0.0 or rows[j, HOLONOMIC] == 0.0):
                s = 1.0 if i == j else 0.0
            system.delassus[0, m, n] = s
            system.delassus[0, n, m] = s


def response_of_rows(system, holding, holonomic_only):
    """response = M^-1 G^T x, with A x = RIGHT."""
    fill_symmetric(system, holding, holonomic_only)
    x, row_table = system.vectors[MULTIPLIERS], system.row_table
    solve_semidefinite(
        system.delassus[0],
        system.vectors[RIGHT],
        x,
        system.delassus[1],
        row_table[:, ORDER],
        holding,
    )
    clear_response(system)
    for m in range(holding):
        k = row_table[m, ACTIVE]
        if holonomic_only:
            x[m] *= system.rows[k, HOLONOMIC]
        add_multiplier(system, k, x[m])


class HoldingRows(NamedTuple):
    """The active rows of a system."""

    system: Any


@position_error.register(HoldingRows)
def error_of_holding(way, t, y):
    """Largest error of the active holonomic rows [m], and the number of active rows."""
    system, worst = way.system, 0.0
    write_all_rows(system, t, y, False)
    holding = find_holding(system, AMONG_POSITIONS)
    for m in range(holding):
        k = system.row_table[m, ACTIVE]
        system.vectors[RIGHT, m] = -system.rows[k, ERROR] * system.rows[k, HOLONOMIC]
        worst = max(worst, abs(system.vectors[RIGHT, m]) * arm_of(system, k))
    return worst, holding


@correct_positions.register(HoldingRows)
def correct_holding(way, t, y, holding):
    """Displace the bodies along the active rows by the errors of these."""
    response_of_rows(way.system, holding, True)
    move_by_response(way.system, y)


def bring_positions(system, t, y):
    """Project y onto g(q) = 0, in place; returns the last error [m]. The rows are then those of
    y."""
    worst, written = return_to_positions(HoldingRows(system), t, y, system.length, 0.0)
    if not written:
        write_all_rows(system, t, y, False)
    return worst


def bring_to_manifold(system, t, y):
    """Project y onto the manifold, in place: unit quaternions, then positions, then velocities.

    y becomes NaN if the projection fails, e.g. after a far too large step.
    """
    clear_response(system)
    move_by_response(system, y)
    if not bring_positions(system, t, y) <= LOST * system.length:
        y[0] = np.nan
    holding = find_holding(system, AMONG_ROWS)
    for m in range(holding):
        k = system.row_table[m, ACTIVE]
        system.vectors[RIGHT, m] = system.rows[k, RATE] - row_velocity(system, y, k)
    response_of_rows(system, holding, False)
    for i in range(system.bodies.shape[0]):
        for j in range(6):
            y[WIDTH * i + 7 + j] += system.bodies[i, RESPONSE + j]
    return y


def contact_rate(system, t, y, dy):
    """Write velocities and accelerations of the bodies, then the power of the contacts [W]."""
    moving(system, t, y, False)
    put_rates(system, y, dy)
    dy[WIDTH * system.bodies.shape[0]] = power_of_contacts(system, y)


@project.register(ContactBodies)
def contact_project(system, t, y):
    """Interpreted: see `bring_to_manifold`."""
    return bring_to_manifold(system, t, y)


@project.register(PackedSystem)
def project_by_address(system, t, y):
    """Compiled: the function whose address the system holds."""
    call_law(system.project_by_address, t, pointer(y), address(system), pointer(system.workspace))
    return y


def reported_state(table, c):
    """Logged state of contact c: 0 open, 1 slip, 2 stick or roll."""
    if table[c, CLOSED] == 0.0:
        return 0.0
    if table[c, SLIDE] == STUCK:
        return 2.0
    return 1.0


def put_contact_reactions(system, y, out, first):
    """Write the reactions of constraints and contacts: force, torque about the anchor, anchor;
    world axes. Returns the index after them.

    members[o, 0] is the part whose anchor is used, or -1 - body for the centre of mass.
    """
    members, joints = system.members, system.joints
    write_anchors(system, y)
    for c in range(system.contact_table.shape[0]):
        for j in range(3):
            system.anchors[joints + c, j] = system.contact_table[c, POINT + j]
    at = first
    for o in range(members.shape[0]):
        main = members[o, 0]
        b = system.row_table[system.first_row[main], BODY] if main >= 0 else -1 - main
        B = state_of(y, b)
        force, torque = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for part in range(members.shape[1] - 1):
            if members[o, 1 + part] != 0:
                torque_B = (0.0, 0.0, 0.0)
                for k in range(system.first_row[part], system.first_row[part + 1]):
                    x = system.vectors[MULTIPLIERS, k]
                    force = add(force, scale(x, vec(system.force_rows, k, 0)))
                    torque_B = add(torque_B, scale(x, vec(system.force_rows, k, 3)))
                torque = add(torque, rotate(B.q_WB, torque_B))
                if part >= joints:
                    f, p = (
                        vec(system.contact_table, part - joints, DIRECT),
                        vec(system.anchors, part, 0),
                    )
                    force = add(force, f)
                    m = vec(system.contact_table, part - joints, DIRECT_TORQUE)
                    torque = add(torque, add(m, cross(sub(p, B.p_WC), f)))
        point = vec(system.anchors, main, 0) if main >= 0 else B.p_WC
        torque = add(torque, cross(sub(B.p_WC, point), force))
        for j in range(3):
            out[at + j] = force[j]
            out[at + 3 + j] = torque[j]
            out[at + 6 + j] = point[j]
        at += 9
    return at


def overlap(system):
    """Deepest overlap of a rigid contact that is open, relative to the scene's length."""
    table, deepest = system.contact_table, 0.0
    for c in range(table.shape[0]):
        if table[c, CLOSED] == 0.0 and table[c, COMPLIANT] == 0.0:
            deepest = max(deepest, -table[c, GAP] / system.length)
    return deepest


@sample.register(ContactBodies, PackedSystem)
def contact_sample(system, t, y, out):
    """Coordinates, reactions of joints and contacts, balances, and the state of each contact."""
    bodies = system.bodies.shape[0]
    for i in range(WIDTH * bodies):
        out[i] = y[i]
    contact_accelerations(system, t, y)
    at = put_contact_reactions(system, y, out, WIDTH * bodies)
    reaction_power = power_of_contacts(system, y)
    for k in range(first_row_of(system, 0)):
        reaction_power += system.vectors[MULTIPLIERS, k] * system.rows[k, RATE]
    kinetic = put_momenta(system, y, out, at + 3)
    u, power = energies(system, t, y)
    out[at], out[at + 1], out[at + 2] = kinetic, u, power + reaction_power
    out[at + 9] = max(residual_of(system, y), overlap(system))
    out[at + 10] = y[WIDTH * bodies]
    for c in range(system.contact_table.shape[0]):
        out[at + 11 + c] = reported_state(system.contact_table, c)
