# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The contact problem at an event: its rows, and A and b at each of its levels.

u and accelerations are (v_WC, w_WB_B) of all bodies, (N, 6).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from rb_sim.catalogue.constraints.rows import BIAS, RATE
from rb_sim.contact.event_workspace import velocity_tolerance_of
from rb_sim.contact.problem import (
    APART,
    BOUND,
    FREE,
    GIVEN,
    PART,
    PULLS,
    ROLLS,
    SPINS,
    add_impulse,
    arm_of,
    fill_delassus,
    fill_free,
    lay_out,
    mean_rate,
    problem_of,
    rate_of,
    respond,
    size_of_terms,
)
from rb_sim.mechanics.contact.accelerations import unconstrained
from rb_sim.mechanics.contact.contact_bodies import (
    BILATERAL,
    CLOSED,
    KINETIC,
    ROLL,
    ROLLING_ARM,
    SLIDE,
    SPIN,
    SPINNING_ARM,
    SPRING,
    STATIC,
    ContactBodies,
)
from rb_sim.mechanics.contact.contact_kinematics import SLIDING, STUCK
from rb_sim.mechanics.samples import Array
from rb_sim.mechanics.systems.many_bodies import BODY, INVERSE, MASS, PARENT, RESPONSE, WIDTH
from rb_sim.mechanics.systems.multibody import write_rows
from rb_sim.numerics.complementarity import CONTRADICTION, row_times, solution
from rb_sim.numerics.kernels import pointer


def inverse_mass(system: ContactBodies) -> Array:
    """M^-1, (6N, 6N)."""
    n = system.bodies.shape[0]
    out = np.zeros((6 * n, 6 * n))
    for i in range(n):
        xx, yy, zz, xy, xz, yz = system.bodies[i, INVERSE : INVERSE + 6]
        out[6 * i : 6 * i + 3, 6 * i : 6 * i + 3] = np.eye(3) / system.bodies[i, MASS]
        out[6 * i + 3 : 6 * i + 6, 6 * i + 3 : 6 * i + 6] = [
            [xx, xy, xz],
            [xy, yy, yz],
            [xz, yz, zz],
        ]
    return out


def push(system, workspace, x, u, after):
    """Write u + M^-1 J^T x of all rows to `after`; returns the work of x [J], and the sum of its
    absolute terms."""
    rows, ends, work, size = workspace.all_rows, system.row_table, 0.0, 1e-300
    for i in range(u.shape[0]):
        for j in range(6):
            after[i, j] = u[i, j]
    for k in range(x.shape[0]):
        if x[k] != 0.0:
            add_impulse(rows, k, after, ends[k, BODY], ends[k, PARENT], x[k])
    for k in range(x.shape[0]):
        if x[k] != 0.0:
            b, a = ends[k, BODY], ends[k, PARENT]
            work += x[k] * mean_rate(rows, k, u, after, b, a)
            size += abs(x[k]) * size_of_terms(rows, k, u, b, a)
    return work, size


def read_velocities(system, y, u):
    """Write the velocities of the coordinates y to u."""
    for i in range(system.bodies.shape[0]):
        for j in range(6):
            u[i, j] = y[WIDTH * i + 7 + j]


def write_all_rows(system, t, y, workspace):
    """Write the rows at (t, y) into the workspace with every contact closed and stuck; and force
    directions and accelerations by the loads, in the modes of the table of contacts."""
    table, n = system.contact_table, system.row_table.shape[0]
    modes = np.empty((table.shape[0], 4))
    for c in range(table.shape[0]):
        for j in range(4):
            modes[c, j] = table[c, CLOSED + j]
        table[c, CLOSED] = 1.0
        table[c, SLIDE] = STUCK
        table[c, ROLL] = STUCK
        table[c, SPIN] = STUCK
    write_rows(system, t, y)
    for k in range(n):
        take_row(system, system.rows, k, workspace.all_rows)
        workspace.row_bias[k], workspace.row_rate[k] = system.rows[k, BIAS], system.rows[k, RATE]
    for c in range(table.shape[0]):
        for j in range(4):
            table[c, CLOSED + j] = modes[c, j]
    unconstrained(system, t, y)
    for k in range(n):
        size = 0.0
        for j in range(12):
            size += abs(system.force_rows[k, j])
        if size == 0.0:
            take_row(system, workspace.all_rows, k, workspace.all_pushes)
        else:
            take_row(system, system.force_rows, k, workspace.all_pushes)
    for i in range(system.bodies.shape[0]):
        for j in range(6):
            workspace.free_accelerations[i, j] = system.bodies[i, RESPONSE + j]


def take_row(system, columns, k, out):
    """Write row k of 12 columns (body, parent) as a row of the problem."""
    for j in range(12):
        out[k, j] = columns[k, j]
    respond(out, k, system.bodies, system.row_table[k, BODY], system.row_table[k, PARENT])


def velocities(system: ContactBodies, y: Array) -> Array:
    """u = (v_WC, w_WB_B) of all bodies, (N, 6)."""
    u = np.empty((system.bodies.shape[0], 6))
    read_velocities(system, y, u)
    return u


def set_velocities(system: ContactBodies, y: Array, u: Array) -> None:
    """Write the velocities u of all bodies, (N, 6), into the coordinates y."""
    for i in range(system.bodies.shape[0]):
        y[WIDTH * i + 7 : WIDTH * i + 13] = u[i]


def spread(system: ContactBodies, rows: Array) -> Array:
    """Rows of the problem, whose first 12 columns are body and parent, as rows of 6N columns."""
    n, bodies = len(rows), system.bodies.shape[0]
    out = np.zeros((n, bodies + 1, 6))  # the last body is the world
    out[np.arange(n), system.row_table[:n, BODY]] = rows[:, :6]
    out[np.arange(n), system.row_table[:n, PARENT]] += rows[:, 6:12]
    return out[:, :bodies].reshape(n, 6 * bodies)


SOLVED, UNSOLVED, NOT_FINITE = 0, 1, 2
"""Result of a problem: solved, no solution found, or numbers that are not finite."""


def solve_in(workspace, n, m, A, b, terms, x):
    """Write the solution of n rows and m bounds to x; returns SOLVED, UNSOLVED or NOT_FINITE."""
    residual = solution(problem_of(workspace, n, m, A, b, x), pointer(terms), pointer(x))
    if residual != residual:
        return NOT_FINITE
    return SOLVED if residual <= CONTRADICTION else UNSOLVED


CANDIDATE, PRESSED = 1, 2
"""Participation of a contact: rigid, or on a compliant support with a given normal force."""
LEAST_BOUND = 1e-300
"""Smallest bound of friction of a sticking contact, so that its slip has a direction."""


def lay_out_forces(system, workspace):
    """Write the active rows and their laws: slipping contacts have friction in the normal row,
    compliant ones a given normal force. Returns (rows, bounds)."""
    table, rules = system.contact_table, workspace.contact_rules
    for c in range(table.shape[0]):
        pressed = workspace.taking_part[c] == PRESSED
        normal = table[c, SPRING] if pressed else 1.0
        slip = table[c, KINETIC] if workspace.moved[c, 0] == 1 else table[c, STATIC]
        rules[c, PART] = GIVEN if pressed else (FREE if workspace.taking_part[c] == 1 else APART)
        rules[c, PULLS] = table[c, BILATERAL]
        rules[c, BOUND] = max(normal * slip, LEAST_BOUND) if table[c, SLIDE] == STUCK else 0.0
        rules[c, ROLLS] = normal * table[c, ROLLING_ARM] if table[c, ROLL] == STUCK else 0.0
        rules[c, SPINS] = normal * table[c, SPINNING_ARM] if table[c, SPIN] == STUCK else 0.0
    return lay_out_in(system, workspace)


def lay_out_in(system, workspace):
    """As `problem.lay_out`, by the rules of the workspace."""
    return lay_out(
        workspace.all_rows,
        workspace.contact_rules,
        system.first_row[system.joints :],
        arm_of(system.length),
        math.inf,
        workspace,
    )


VELOCITY, ACCELERATION, STEP = range(3)
"""Levels of the problem."""


class Velocities(NamedTuple):
    """Velocities at an instant."""

    u: Any
    """of the bodies, (N, 6)."""
    v: Any
    """along all rows, J u - rate, (n,)."""


def along_rows(system, workspace, u, v):
    """Write v = J u - rate of all rows."""
    ends = system.row_table
    for k in range(v.shape[0]):
        v[k] = (
            rate_of(workspace.all_rows, k, u, ends[k, BODY], ends[k, PARENT])
            - workspace.row_rate[k]
        )


def assemble(system, workspace, level, n, u, duration, A, b, terms):
    """Write A, b and the absolute terms of b for the n rows laid out. u: velocities (not used for
    accelerations); duration: of a step [s]."""
    rows, ends, a = workspace.all_rows, system.row_table, workspace.free_accelerations
    w, free, targets = np.zeros_like(a), np.empty_like(a), np.empty_like(workspace.row_rate)
    loads = 0.0 if level == VELOCITY else 1.0
    before = 0.0 if level == ACCELERATION else 1.0 / duration
    for i in range(a.shape[0]):
        for j in range(6):
            free[i, j] = loads * a[i, j] + before * u[i, j]
    for k in range(targets.shape[0]):
        targets[k] = before * workspace.row_rate[k] - loads * workspace.row_bias[k]
    if level == VELOCITY:
        fill_delassus(rows, rows, ends, workspace, n, w, A)
    else:
        fill_delassus(rows, workspace.all_pushes, ends, workspace, n, w, A)
    fill_free(rows, ends, targets, free, workspace, n, b, terms)


def find_moving(system, workspace, p, m, x, duration):
    """Let contacts slide that move at the end of the duration [s] by the accelerations w; returns
    whether there are new ones."""
    new = False
    for i in range(m):
        c, way = workspace.moves[i, 0], workspace.moves[i, 1]
        one, other = workspace.bounds[i, 0], workspace.bounds[i, 1]
        size = row_times(p, one, x) ** 2 + (row_times(p, other, x) ** 2 if other >= 0 else 0.0)
        if duration * size**0.5 > velocity_tolerance_of(system):
            new = new or workspace.moved[c, way] == 0
            system.contact_table[c, SLIDE + way] = SLIDING
    return new


def answer_over(system, workspace, y, duration):
    """Write the impulses of all rows over a short time from y into the workspace. The participating
    contacts must be closed and at rest in the table; afterwards those that move at the end slide.
    Returns SOLVED, UNSOLVED or NOT_FINITE."""
    u = np.empty_like(workspace.free_accelerations)
    read_velocities(system, y, u)
    modes = np.empty((system.contact_table.shape[0], 3))
    for c in range(modes.shape[0]):
        for way in range(3):
            modes[c, way] = system.contact_table[c, SLIDE + way]
    for _ in range(1 + 3 * modes.shape[0]):
        for c in range(modes.shape[0]):
            for way in range(3):
                system.contact_table[c, SLIDE + way] = modes[c, way]
        n, m = lay_out_forces(system, workspace)
        A, b, terms, x = np.empty((n, n)), np.empty(n), np.empty(n), np.empty(n)
        assemble(system, workspace, STEP, n, u, duration, A, b, terms)
        status = solve_in(workspace, n, m, A, b, terms, x)
        if status != SOLVED:
            return status
        p = problem_of(workspace, n, m, A, b, terms)
        if not find_moving(system, workspace, p, m, pointer(x), duration):
            break
        for i in range(m):
            c, way = workspace.moves[i, 0], workspace.moves[i, 1]
            if system.contact_table[c, SLIDE + way] == SLIDING:
                workspace.moved[c, way] = 1
    take_impulses(workspace, n, x, duration)
    return SOLVED


def take_impulses(workspace, n, x, duration):
    """Write the impulses of all rows into the workspace: those of the n participating rows are x
    times the duration [s]."""
    for k in range(workspace.impulses.shape[0]):
        workspace.impulses[k] = 0.0
    for i in range(n):
        workspace.impulses[workspace.used[i]] = duration * (workspace.units[i] * x[i])
