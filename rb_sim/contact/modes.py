# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Modes of contacts: which ones stay closed, slip, stick, roll or spin.

They follow from the laws between forces and accelerations (LL 38; Moreau 1988), solved for all
contacts together: a closed contact pushes or opens, friction is bounded at rest and opposes the
slip that begins.
"""

from __future__ import annotations

import math

import numpy as np

from rb_sim.catalogue.geometry.corners_and_rims import ABSENT
from rb_sim.contact.assembly import (
    ACCELERATION,
    CANDIDATE,
    NOT_FINITE,
    PRESSED,
    SOLVED,
    assemble,
    lay_out_forces,
    solve_in,
    write_all_rows,
)
from rb_sim.contact.event_workspace import (
    slip_speed,
    spin_tolerance_of,
    touches,
    turning,
    velocity_tolerance_of,
)
from rb_sim.contact.problem import fill_delassus, problem_of
from rb_sim.mechanics.contact.contact_bodies import (
    BILATERAL,
    CLOSED,
    COMPLIANT,
    CREEPS,
    GAP,
    GAP_RATE,
    KINETIC,
    LEAN_SIGN,
    LIFT_OFF,
    NORMAL,
    NORMAL_SIGN,
    ROLL,
    ROLL_BEGINS,
    ROLL_DIRECTION,
    ROLLING_ARM,
    SHARES,
    SLIDE,
    SLIP,
    SLIP_BEGINS,
    SLIP_DIRECTION,
    SPIN,
    SPIN_BEGINS,
    SPIN_SIGN,
    SPINNING_ARM,
    SPRING,
    STATIC,
    first_row_of,
    keep,
)
from rb_sim.mechanics.contact.contact_kinematics import NONE, SLIDING, STUCK
from rb_sim.mechanics.system import project
from rb_sim.mechanics.systems.many_bodies import vec
from rb_sim.mechanics.systems.multibody import write_rows
from rb_sim.numerics.complementarity import row_times
from rb_sim.numerics.kernels import part, pointer
from rb_sim.numerics.linear_solves import triangular
from rb_sim.numerics.rank import JUDGED_BY_CONTACT, LEAST_SINGULAR
from rb_sim.numerics.vectors import add, norm, perpendicular, scale

# Whether the reactions of the active rows are unique.


FEW = 20
"""Maximum number of rows for which pivots prove that they are independent."""


def lay_out_held(system, workspace):
    """Write rows and laws of joints and closed contacts in their modes; returns (rows, bounds)."""
    table = system.contact_table
    for c in range(table.shape[0]):
        part = PRESSED if table[c, COMPLIANT] == 1.0 else CANDIDATE
        workspace.taking_part[c] = part if table[c, CLOSED] != 0.0 else 0
        for way in range(3):
            workspace.moved[c, way] = 0
    return lay_out_forces(system, workspace)


def may_share(system, workspace):
    """Whether the reactions may be not unique; it resets SHARES.

    The smallest pivot of n columns is at most 2^n sqrt(n) times the smallest singular value (Golub
    and Van Loan, Matrix Computations, 5.5.7).
    """
    for k in range(system.vectors.shape[1]):
        system.vectors[SHARES, k] = 0.0
    n, _ = lay_out_held(system, workspace)
    if n == first_row_of(system, 0):
        return False
    if n > FEW:
        return True
    A, work, w = np.empty((n, n)), np.zeros(2 * n), np.zeros_like(workspace.free_accelerations)
    fill_delassus(workspace.all_rows, workspace.all_pushes, system.row_table, workspace, n, w, A)
    R = pointer(A)
    rank = triangular(R, n, pointer(work), part(pointer(work), n), LEAST_SINGULAR)
    smallest = abs(R[n * n - 1]) if rank == n else 0.0
    return not smallest > JUDGED_BY_CONTACT * n * 2.0**n * abs(R[0])


MODE_ROUNDS = 8
"""Maximum number of rounds in which contacts begin to move."""
BEGINS = 1e-10
"""Acceleration, relative to the largest, above which a contact opens or begins to slip or roll."""
WHOLE, JAMMED_ONES, TOO_LARGE = 0, 1, 2
"""Result of the choice: modes found; no force prevents a slipping contact from penetrating
(Painleve's paradox); numbers are not finite."""


def open_contact(table, c):
    """Set all modes of contact c to those of an open one."""
    table[c, CLOSED] = NONE
    table[c, SLIDE] = NONE
    table[c, ROLL] = NONE
    table[c, SPIN] = NONE
    table[c, CREEPS] = 0.0


def sort_contacts(system, workspace, code):
    """Write the contacts that may close, and the compressed compliant ones, into
    `workspace.taking_part`, and open all others; returns their number. code: (contact, kind) of the
    event that led here, -1: none."""
    table, velocity_tolerance, count = system.contact_table, velocity_tolerance_of(system), 0
    for c in range(table.shape[0]):
        both, part = table[c, BILATERAL] == 1.0, 0
        if table[c, COMPLIANT] == 1.0:
            there = table[c, LEAN_SIGN] != ABSENT
            if there and table[c, GAP] < 0.0 and table[c, SPRING] > 0.0:
                part = PRESSED
        elif both or (
            abs(table[c, GAP_RATE]) <= velocity_tolerance
            and touches(system, c)
            and workspace.opened[c] == 0
            and not (c == code[0] and code[1] == LIFT_OFF)
        ):
            part = CANDIDATE
        workspace.taking_part[c] = part
        if part == 0:
            open_contact(table, c)
        else:
            table[c, CLOSED] = 1.0
            count += 1
    return count


def first_guess(system, c, lifts_off):
    """Set the initial modes of contact c: sliding if it moves, else stuck."""
    table, velocity_tolerance = system.contact_table, velocity_tolerance_of(system)
    if table[c, NORMAL_SIGN] == 0.0:
        table[c, NORMAL_SIGN] = 1.0
    if table[c, BILATERAL] == 1.0 and lifts_off:
        table[c, NORMAL_SIGN] = -table[c, NORMAL_SIGN]
    speed = slip_speed(system, c)
    slides = table[c, STATIC] == 0.0 or speed > velocity_tolerance or table[c, CREEPS] > 0.0
    table[c, SLIDE] = SLIDING if slides else STUCK
    if speed > velocity_tolerance and table[c, CREEPS] == 0.0:
        keep(table, c, SLIP_DIRECTION, scale(1.0 / speed, vec(table, c, SLIP)))
    across, about = turning(system, c)
    fast, slow = norm(across), spin_tolerance_of(system)
    table[c, ROLL] = NONE
    if table[c, ROLLING_ARM] > 0.0:
        table[c, ROLL] = SLIDING if fast > slow else STUCK
    table[c, SPIN] = NONE
    if table[c, SPINNING_ARM] > 0.0:
        table[c, SPIN] = SLIDING if abs(about) > slow else STUCK
    if table[c, ROLL] == SLIDING:
        keep(table, c, ROLL_DIRECTION, scale(1.0 / fast, across))
    if table[c, SPIN] == SLIDING:
        table[c, SPIN_SIGN] = math.copysign(1.0, about)


def size_of(w, workspace, i):
    """|w| of the rows of bound i."""
    first, second = workspace.bounds[i, 0], workspace.bounds[i, 1]
    return math.hypot(w[first], w[second]) if second >= 0 else abs(w[first])


def begin_to_move(system, workspace, i, x, w, size):
    """Set the mode of bound i: stuck, or sliding in the direction in which it begins."""
    table, c, way = system.contact_table, workspace.moves[i, 0], workspace.moves[i, 1]
    first, second = workspace.bounds[i, 0], workspace.bounds[i, 1]
    rate = size_of(w, workspace, i)
    begins = rate > BEGINS * size
    if not begins and workspace.moved[c, way] == 0:
        table[c, SLIDE + way] = STUCK
        return
    workspace.moved[c, way] = 1
    table[c, SLIDE + way] = SLIDING
    force, y, z = size_of(x, workspace, i), 0.0, 0.0
    if begins:
        y, z = w[first] / rate, w[second] / rate if second >= 0 else 0.0
    elif force > 0.0:
        y, z = -x[first] / force, -x[second] / force if second >= 0 else 0.0
    if way == 2:
        table[c, SPIN_SIGN] = math.copysign(1.0, y)
        return
    t1, t2 = perpendicular(vec(table, c, NORMAL))
    keep(table, c, SLIP_DIRECTION if way == 0 else ROLL_DIRECTION, add(scale(y, t1), scale(z, t2)))


def read_modes(system, workspace, n, m, x, w):
    """Set the modes from forces x and accelerations w of n rows, in the units of Laws.units."""
    table, size, most = system.contact_table, 0.0, 0.0
    for i in range(n):
        size = max(size, abs(w[i]))
    for i in range(workspace.free_accelerations.shape[0]):
        for j in range(6):
            most = max(most, abs(workspace.free_accelerations[i, j]))
    size += most
    for c in range(table.shape[0]):
        if workspace.taking_part[c] != CANDIDATE:
            continue
        i, both = workspace.place_of[first_row_of(system, c)], table[c, BILATERAL] == 1.0
        if not both and w[i] > BEGINS * size:
            open_contact(table, c)
        if both and table[c, SLIDE] != SLIDING:
            table[c, NORMAL_SIGN] = -1.0 if x[i] < 0.0 else 1.0
    for i in range(m):
        if table[workspace.moves[i, 0], CLOSED] != 0.0:
            begin_to_move(system, workspace, i, x, w, size)


def count_moved(workspace):
    """Number of motions (slip, roll, spin) that have begun."""
    count = 0
    for c in range(workspace.moved.shape[0]):
        for way in range(3):
            count += workspace.moved[c, way]
    return count


def find_forces(system, workspace, t, y):
    """Solve for forces and accelerations, and write the modes into the table of contacts; returns
    SOLVED, UNSOLVED or NOT_FINITE."""
    for _ in range(MODE_ROUNDS):
        write_all_rows(system, t, y, workspace)
        n, m = lay_out_forces(system, workspace)
        A, b, terms = np.empty((n, n)), np.empty(n), np.empty(n)
        x, w = np.empty(n), np.empty(n)
        loads = workspace.free_accelerations
        assemble(system, workspace, ACCELERATION, n, loads, 1.0, A, b, terms)
        status = solve_in(workspace, n, m, A, b, terms, x)
        if status != SOLVED:
            return status
        p = problem_of(workspace, n, m, A, b, terms)
        for i in range(n):
            w[i] = row_times(p, i, pointer(x))
        before = count_moved(workspace)
        read_modes(system, workspace, n, m, x, w)
        if count_moved(workspace) == before:
            return SOLVED
        for c in range(system.contact_table.shape[0]):  # moving contacts have kinetic friction
            if workspace.taking_part[c] != 0:
                system.contact_table[c, CLOSED] = 1.0
                first_guess(system, c, False)
    return SOLVED


def choose(system, workspace, t, y, code):
    """Choose the modes of all contacts, and project y onto their manifold.

    code: (contact, kind) of the event that led here, whose mode has ended; (-1, -1): none.
    `workspace.opened`: further contacts that must not close. `workspace.parted` becomes 1 for
    contacts that opened while they slipped. Returns WHOLE, JAMMED_ONES or TOO_LARGE.
    """
    table = system.contact_table
    count = sort_contacts(system, workspace, code)
    for c in range(table.shape[0]):
        for way in range(3):
            workspace.moved[c, way] = 0
        if workspace.taking_part[c] != 0:
            first_guess(system, c, c == code[0] and code[1] == LIFT_OFF)
            if c == code[0]:
                workspace.moved[c, 0] = 1 if code[1] == SLIP_BEGINS else 0
                workspace.moved[c, 1] = 1 if code[1] == ROLL_BEGINS else 0
                workspace.moved[c, 2] = 1 if code[1] == SPIN_BEGINS else 0
    if count > 0:
        status = find_forces(system, workspace, t, y)
        if status == NOT_FINITE:
            return TOO_LARGE
        if status != SOLVED:
            return JAMMED_ONES
    write_rows(system, t, y)  # those of contacts that the modes open now, which are zero
    project(system, t, y)
    write_all_rows(system, t, y, workspace)
    velocity_tolerance = velocity_tolerance_of(system)
    for c in range(table.shape[0]):
        lifts = workspace.taking_part[c] == CANDIDATE and table[c, CLOSED] == 0.0
        slips = slip_speed(system, c) > velocity_tolerance and 0.0 < table[c, KINETIC] < math.inf
        workspace.parted[c] = 1 if lifts and slips else 0
    return WHOLE
