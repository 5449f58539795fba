# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Accelerations and multipliers of bodies with contacts, some of which slip.

The force of a slipping contact is not along the row that it enforces, so that the matrix G M^-1 W^T
is not symmetric.
"""

from __future__ import annotations

from rb_sim.base.rounding import SUM_ROUNDING
from rb_sim.catalogue.constraints.rows import BIAS
from rb_sim.integrate.layout import PackedSystem, address
from rb_sim.mechanics.contact.constraint_tables import load_effects, write_all_rows
from rb_sim.mechanics.contact.contact_bodies import (
    ACTIVE,
    AMONG_ROWS,
    AT_SLIP,
    CLOSED,
    COMPLIANT,
    CREEPS,
    DEPENDENT,
    DIRECT,
    DIRECT_TORQUE,
    EVENT_FUNCTIONS_BEFORE,
    EVENT_RATES_BEFORE,
    FREE,
    MOST_RANK,
    NORMAL_FORCE,
    NOWHERE,
    PIVOT,
    POINT,
    RANK,
    REDUNDANT,
    SHARES,
    SLIDE,
    SLIP,
    SLIP_DIRECTION,
    STATIC,
    ContactBodies,
    first_row_of,
    keep,
)
from rb_sim.mechanics.contact.contact_kinematics import SLIDING, torque_of, velocity_at
from rb_sim.mechanics.systems.many_bodies import (
    BODY,
    LOAD,
    MULTIPLIERS,
    ORDER,
    PARENT,
    RESPONSE,
    RIGHT,
    add_load,
    state_of,
    vec,
)
from rb_sim.mechanics.systems.multibody import (
    add_response,
    clear_loads,
    coupling,
    free_accelerations,
    rise_of,
    row_times_response,
)
from rb_sim.mechanics.systems.multibody import inverse_mass_times as inverse_mass_row
from rb_sim.numerics.kernels import call_law, dispatch, pointer
from rb_sim.numerics.linear_solves import least_norm, solve_unsymmetric
from rb_sim.numerics.rank import RANK_TOLERANCE
from rb_sim.numerics.vectors import dot, neg, norm, rotate, scale, sub

# Compliant contacts that creep: slips so slow that errors hide their direction.
#
# The corners of a body that rocks on a compliant support slip ever more slowly as the rocking
# decays, and never stop at a definite instant. Below the speed `creep` Coulomb's law is therefore
# smoothed, so that friction has a direction at any speed: T = -mu N s / (s^8 + creep^8)^(1/8).
# Above LEAVES times that speed Coulomb's law applies again; there the two differ by 1e-9.


LEAVES = 10.0
"""Slip relative to `creep` above which a creeping contact follows Coulomb's law again."""
SOON, RESTS, SLOWER = 2.0, 0.9, 0.5
"""SOON, RESTS: slip relative to `creep` below which a contact may stick, as it begins to creep and
after it has been faster again. SLOWER: factor of the slip at a failed attempt, for the next one."""
BEGUN, NEVER = 1e-3, 1e-300
"""BEGUN: slip relative to `creep` up to which a slip has just begun. NEVER: slip [m/s] below which
such a contact may stick, so small that it does not."""


def slides_with_friction(table, c):
    """Whether contact c slips with Coulomb friction."""
    return table[c, CLOSED] == 1.0 and table[c, SLIDE] == SLIDING and table[c, STATIC] > 0.0


def slides_on_compliant(table, c):
    """Whether contact c slips with Coulomb friction on a compliant support."""
    return slides_with_friction(table, c) and table[c, COMPLIANT] == 1.0


def note_creep(system, c):
    """Set whether contact c creeps in the next step; call after its directions have been set."""
    table, creep = system.contact_table, system.creep
    slip = norm(vec(table, c, SLIP))
    if not slides_on_compliant(table, c) or slip > LEAVES * creep or creep == 0.0:
        table[c, CREEPS] = 0.0
        return
    if slip > creep:
        if table[c, CREEPS] == 0.0:
            return
        table[c, CREEPS] = RESTS * creep
    elif table[c, CREEPS] == 0.0:
        table[c, CREEPS] = SOON * creep if slip > BEGUN * creep else NEVER
    keep(table, c, SLIP_DIRECTION, (0.0, 0.0, 0.0))
    table[c, EVENT_FUNCTIONS_BEFORE + AT_SLIP], table[c, EVENT_RATES_BEFORE + AT_SLIP] = FREE, 0.0


def fastest_creep(system):
    """(fastest slip of all creeping contacts, least slip below which one may stick, first creeping
    contact or -1)."""
    table, most, bound, first = system.contact_table, 0.0, FREE, -1
    for c in range(table.shape[0]):
        if table[c, CREEPS] > 0.0 and slides_on_compliant(table, c):
            first = c if first < 0 else first
            most = max(most, norm(vec(table, c, SLIP)))
            bound = min(bound, table[c, CREEPS])
    return most, bound, first


def add_direct(system, y):
    """Add the contact forces that are independent of N to the loads."""
    table = system.contact_table
    for c in range(table.shape[0]):
        if table[c, CLOSED] == 0.0:
            continue
        k = first_row_of(system, c)
        f, m, p = vec(table, c, DIRECT), vec(table, c, DIRECT_TORQUE), vec(table, c, POINT)
        b, a = system.row_table[k, BODY], system.row_table[k, PARENT]
        B = state_of(y, b)
        add_load(system.bodies, b, f, torque_of(B, sub(p, B.p_WC), f, m))
        if a >= 0:
            A = state_of(y, a)
            add_load(system.bodies, a, neg(f), neg(torque_of(A, sub(p, A.p_WC), f, m)))


def response_of(system, i, j, column):
    """M_i^-1 times the force of row j on body i, whose columns start at `column`."""
    force = scale(1.0 / system.bodies[i, 0], vec(system.force_rows, j, column))
    s = system.bodies
    k = vec(system.force_rows, j, column + 3)
    turn = (
        s[i, 7] * k[0] + s[i, 10] * k[1] + s[i, 11] * k[2],
        s[i, 10] * k[0] + s[i, 8] * k[1] + s[i, 12] * k[2],
        s[i, 11] * k[0] + s[i, 12] * k[1] + s[i, 9] * k[2],
    )
    return force, turn


def find_holding(system, dependent):
    """Write the active rows, those that are not zero, into ACTIVE; returns their number.

    dependent: kinds of dependence (AMONG_ROWS, ...) whose rows are left out.
    """
    holding = 0
    for k in range(system.row_table.shape[0]):
        if system.row_table[k, DEPENDENT] & dependent != 0:
            continue
        size = 0.0
        for j in range(12):
            size += abs(system.rows[k, j])
        if size > 0.0:
            system.row_table[holding, ACTIVE] = k
            holding += 1
    return holding


def fill_slipping_matrix(system, holding):
    """A = G M^-1 W^T of the active rows."""
    row_table = system.row_table
    for n in range(holding):
        j = row_table[n, ACTIVE]
        b, a = row_table[j, BODY], row_table[j, PARENT]
        fb, kb = response_of(system, b, j, 0)
        fa, ka = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        if a >= 0:
            fa, ka = response_of(system, a, j, 6)
        for m in range(holding):
            i = row_table[m, ACTIVE]
            system.delassus[0, m, n] = rise_of(system, i, b, a, (fb, kb), (fa, ka))


def spread_multipliers(system, holding):
    """Move the multipliers of the active rows to their places among all rows; the others are 0."""
    x = system.vectors[MULTIPLIERS]
    for k in range(holding, x.shape[0]):
        x[k] = 0.0
    for m in range(holding - 1, -1, -1):
        value = x[m]
        x[m] = 0.0
        x[system.row_table[m, ACTIVE]] = value


def joints_share(system, joints, at, column):
    """Part of the acceleration at contact row `at` (an index of active rows) per unit of force that
    the joints prevent: A_cJ A_JJ^-1 x, with x a column of A or, if column < 0, the row itself."""
    A, spare = system.delassus[0], system.delassus[1]
    b, x = spare[joints], spare[joints + 1]
    for j in range(joints):
        b[j] = A[j, column] if column >= 0 else A[at, j]
    solve_unsymmetric(A, b, x, spare, system.row_table[:, ORDER], joints)
    share = 0.0
    for j in range(joints):
        share += A[at, j] * x[j]
    return share


def pivots(system, holding):
    """Write N of every contact, and PIVOT of those that slip, into the table of contacts.

    The pivot of a contact is the acceleration of its two points away from each other per unit of
    force, with the joints; PIVOT is the pivot with friction over that without.
    """
    table, joints = system.contact_table, 0
    while joints < holding and system.row_table[joints, ACTIVE] < first_row_of(system, 0):
        joints += 1
    at = joints
    for c in range(table.shape[0]):
        k = first_row_of(system, c)
        table[c, PIVOT] = 1.0
        if table[c, CLOSED] == 0.0 or table[c, COMPLIANT] == 1.0:
            continue
        table[c, NORMAL_FORCE] = system.vectors[MULTIPLIERS, k]
        if table[c, SLIDE] != SLIDING or table[c, STATIC] == 0.0:
            continue
        while at < holding and system.row_table[at, ACTIVE] < k:
            at += 1
        b, a = system.row_table[k, BODY], system.row_table[k, PARENT]
        force, turn = inverse_mass_row(system, b, k, 0)
        alone = coupling(system.rows, k, 0, force, turn)
        if a >= 0:
            force, turn = inverse_mass_row(system, a, k, 6)
            alone += coupling(system.rows, k, 6, force, turn)
        ideal, effective = alone, system.delassus[0, at, at]
        if joints > 0:
            ideal -= joints_share(system, joints, at, -1)
            effective -= joints_share(system, joints, at, at)
        if ideal > RANK_TOLERANCE * alone:  # else the joints alone fix the contact point
            table[c, PIVOT] = effective / ideal


def note_sizes(system):
    """Overwrite the loads with the absolute accelerations by the loads alone."""
    for i in range(system.bodies.shape[0]):
        for j in range(6):
            system.bodies[i, LOAD + j] = abs(system.bodies[i, RESPONSE + j])


def add_term(bodies, i, force, turn, x):
    """response += x (force, turn), and add the absolute terms to those in LOAD."""
    add_response(bodies, i, force, turn, x)
    for j in range(3):
        bodies[i, LOAD + j] += abs(x * force[j])
        bodies[i, LOAD + 3 + j] += abs(x * turn[j])


def drop_rounding(system):
    """Set accelerations to zero that are only rounding of their terms, so that a body at rest does
    not creep."""
    bodies = system.bodies
    for i in range(bodies.shape[0]):
        for first in (0, 3):
            terms = norm(vec(bodies, i, LOAD + first))
            for j in range(first, first + 3):
                if abs(bodies[i, RESPONSE + j]) <= SUM_ROUNDING * terms:
                    bodies[i, RESPONSE + j] = 0.0


@dispatch
def unconstrained(system, t, y):
    """Write the rows, and response = accelerations by loads and direct contact forces."""


@unconstrained.register(ContactBodies)
def unconstrained_here(system, t, y):
    """Interpreted: computed at this place, with the rows of all contacts."""
    unconstrained_in(system, t, y, True)


def unconstrained_in(system, t, y, everywhere):
    """As `unconstrained`; everywhere: as in `write_all_rows`."""
    clear_loads(system)
    load_effects(system, t, y)
    write_all_rows(system, t, y, everywhere)
    add_direct(system, y)
    free_accelerations(system, y)


OF_JOINTS = 1.0 / 1024.0
"""Weight of the reactions of joints in the norm that is minimised if reactions are not unique: a
power of 2, small, since otherwise a pad on a guide would press at one edge to reduce the guide's
torque."""


def least_reactions(system, rank, holding):
    """The reactions x with A x = b that are nearest to the SHARES; joints have weight OF_JOINTS."""
    A, right, shares = system.delassus[0], system.vectors[RIGHT], system.vectors[SHARES]
    x, row_table, first = system.vectors[MULTIPLIERS], system.row_table, first_row_of(system, 0)
    for m in range(holding):
        for n in range(holding):
            right[m] -= A[m, n] * shares[row_table[n, ACTIVE]]
            if row_table[n, ACTIVE] < first:
                A[m, n] /= OF_JOINTS
    least_norm(A, right, x, rank, holding)
    for m in range(holding):
        if row_table[m, ACTIVE] < first:
            x[m] /= OF_JOINTS
        x[m] += shares[row_table[m, ACTIVE]]


@unconstrained.register(PackedSystem)
def unconstrained_by_address(system, t, y):
    """Compiled: the function whose address the system holds."""
    call_law(system.free_by_address, t, pointer(y), address(system), pointer(system.workspace))


@dispatch
def contact_accelerations(system, t, y):
    """Write multipliers, contact forces and response = accelerations; returns (rank, number of
    active rows).

    If reactions are not unique, they are those nearest to the SHARES.
    """


@contact_accelerations.register(PackedSystem)
def accelerations_by_address(system, t, y):
    """Compiled: the function whose address the system holds, everywhere."""
    return moving_by_address(system, t, y, True)


@contact_accelerations.register(ContactBodies)
def accelerations_here(system, t, y):
    """Interpreted: computed at this place, everywhere."""
    return accelerations_in(system, t, y, True)


@dispatch
def moving(system, t, y, everywhere):
    """As `contact_accelerations`; everywhere: as in `write_all_rows`, and with all dependent rows,
    which requires a state on the manifold."""


@moving.register(PackedSystem)
def moving_by_address(system, t, y, everywhere):
    """Compiled: the function whose address the system holds; its results are in the workspace."""
    found = pointer(system.workspace)
    found[0] = 1.0 if everywhere else 0.0
    call_law(system.accelerate_by_address, t, pointer(y), address(system), found)
    return found[0], found[1]


@moving.register(ContactBodies)
def accelerations_in(system, t, y, everywhere):
    """Solve G M^-1 W^T x = -(bias + G M^-1 f) for the active rows (LL 38.2).

    G: rows; W: force directions, which differ from the rows in a slipping contact. Without full
    rank, the multipliers nearest to the SHARES.
    """
    unconstrained_in(system, t, y, everywhere)
    n = system.row_table.shape[0]
    holding = find_holding(system, NOWHERE if everywhere else AMONG_ROWS)
    fill_slipping_matrix(system, holding)
    right, multipliers = system.vectors[RIGHT], system.vectors[MULTIPLIERS]
    for m in range(holding):
        k = system.row_table[m, ACTIVE]
        right[m] = -(system.rows[k, BIAS] + row_times_response(system, k))
    row_table = system.row_table
    rank = solve_unsymmetric(
        system.delassus[0],
        right,
        multipliers,
        system.delassus[1],
        row_table[:, ORDER],
        holding,
    )
    rank = min(rank, row_table[0, MOST_RANK])
    row_table[0, RANK] = rank
    if rank < holding:
        row_table[0, REDUNDANT] = 1
        least_reactions(system, rank, holding)
    spread_multipliers(system, holding)
    note_sizes(system)
    for k in range(n):
        x, b, a = multipliers[k], system.row_table[k, BODY], system.row_table[k, PARENT]
        if x != 0.0:
            force, turn = response_of(system, b, k, 0)
            add_term(system.bodies, b, force, turn, x)
            if a >= 0:
                force, turn = response_of(system, a, k, 6)
                add_term(system.bodies, a, force, turn, x)
    drop_rounding(system)
    pivots(system, holding)
    return rank, holding


def power_of_contacts(system, y):
    """Power of all contacts on the bodies [W]: friction, dampers, driven supports."""
    power = 0.0
    for c in range(system.contact_table.shape[0]):
        if system.contact_table[c, CLOSED] == 0.0:
            continue
        k = first_row_of(system, c)
        last = first_row_of(system, c + 1)
        b, a = system.row_table[k, BODY], system.row_table[k, PARENT]
        B, A = state_of(y, b), state_of(y, a)
        for i in range(k, last):
            x = system.vectors[MULTIPLIERS, i]
            s = coupling(system.force_rows, i, 0, B.v_WC, B.w_WB_B)
            if a >= 0:
                s += coupling(system.force_rows, i, 6, A.v_WC, A.w_WB_B)
            power += x * s
        f, m, p = (
            vec(system.contact_table, c, DIRECT),
            vec(system.contact_table, c, DIRECT_TORQUE),
            vec(system.contact_table, c, POINT),
        )
        speed, turn = velocity_at(B, sub(p, B.p_WC)), rotate(B.q_WB, B.w_WB_B)
        if a >= 0:
            speed = sub(speed, velocity_at(A, sub(p, A.p_WC)))
            turn = sub(turn, rotate(A.q_WB, A.w_WB_B))
        power += dot(f, speed) + dot(m, turn)
    return power
