# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The contact problem w = A r + b at one instant: A = J M^-1 W^T of the rows that hold.

    level          w                        b                                  r
    VELOCITY       velocities after         J u - rate                         impulses
    ACCELERATION   accelerations            J a_free + bias                    forces
    STEP           mean accelerations       J a_free + bias + (J u - rate)/h   impulses over h

r and w obey the laws that the rows were laid out with (see numerics.complementarity).  W is J but
for the normals of slipping contacts, which push along n + T/N; impacts bound friction by itself.
u and accelerations are (v_WC, w_WB_B) of all bodies, one after another; a row has 6 columns of its
body and 6 of its parent.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rb_sim.catalogue.constraints.rows import BIAS, RATE
from rb_sim.contact.event_workspace import spin_tolerance_of, velocity_tolerance_of
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
    first_row_of,
)
from rb_sim.mechanics.contact.contact_kinematics import SLIDING, STUCK
from rb_sim.mechanics.samples import Array
from rb_sim.mechanics.systems.many_bodies import BODY, INVERSE, MASS, PARENT, RESPONSE, WIDTH, six
from rb_sim.mechanics.systems.multibody import write_rows
from rb_sim.numerics.complementarity import (
    CONTRADICTION,
    EQUALITY,
    FIRST,
    FRICTION,
    SECOND,
    UNILATERAL,
    Equations,
    solution,
    unit_of,
)
from rb_sim.numerics.complementarity import NORMAL as OF_NORMAL
from rb_sim.numerics.kernels import integers, pointer
from rb_sim.numerics.vectors import symmetric_times


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


def accelerated(system, i, a, k):
    """M_i^-1 of the six numbers of body i in row k of a."""
    s, j = 1.0 / system.bodies[i, MASS], 6 * i
    turn = symmetric_times(six(system.bodies, i, INVERSE), (a[k, j + 3], a[k, j + 4], a[k, j + 5]))
    return s * a[k, j], s * a[k, j + 1], s * a[k, j + 2], turn[0], turn[1], turn[2]


def along(J, k, i, a):
    """Row k of J times six numbers of body i."""
    s = 0.0
    for j in range(6):
        s += J[k, 6 * i + j] * a[j]
    return s


def fill_in_loops(system, J, W, used, n, A):
    """`fill_delassus` as loops compile it: only rows that share a body are multiplied."""
    row_table = system.row_table
    for q in range(n):
        j = used[q]
        b, a = row_table[j, BODY], row_table[j, PARENT]
        of_body = accelerated(system, b, W, j)
        of_parent = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        if a >= 0:
            of_parent = accelerated(system, a, W, j)
        for p in range(n):
            i, s = used[p], 0.0
            if row_table[i, BODY] == b or row_table[i, PARENT] == b:
                s += along(J, i, b, of_body)
            if a >= 0 and (row_table[i, BODY] == a or row_table[i, PARENT] == a):
                s += along(J, i, a, of_parent)
            A[p, q] = s


def fill_delassus(system, J, W, used, n, A):
    """A of the first n rows of `used`, into its first n rows and columns."""
    some = used[:n]
    A[:n, :n] = J[some] @ inverse_mass(system) @ W[some].T


fill_delassus.compiled_as = fill_in_loops  # type: ignore[attr-defined]


def row_times(system, J, k, u):
    """Row k times u."""
    b, a = system.row_table[k, BODY], system.row_table[k, PARENT]
    s = 0.0
    for j in range(6):
        s += J[k, 6 * b + j] * u[6 * b + j]
    if a >= 0:
        for j in range(6):
            s += J[k, 6 * a + j] * u[6 * a + j]
    return s


def size_of_terms(system, J, k, u):
    """|row k| times |u|: the size of what `row_times` sums."""
    b, a = system.row_table[k, BODY], system.row_table[k, PARENT]
    s = 0.0
    for j in range(6):
        s += abs(J[k, 6 * b + j] * u[6 * b + j])
    if a >= 0:
        for j in range(6):
            s += abs(J[k, 6 * a + j] * u[6 * a + j])
    return s


def momentum_of(system, J, x, p):
    """p = J^T x, of all rows."""
    for j in range(p.shape[0]):
        p[j] = 0.0
    for k in range(x.shape[0]):
        if x[k] != 0.0:
            b, a = system.row_table[k, BODY], system.row_table[k, PARENT]
            for j in range(6):
                p[6 * b + j] += J[k, 6 * b + j] * x[k]
            if a >= 0:
                for j in range(6):
                    p[6 * a + j] += J[k, 6 * a + j] * x[k]


def inverse_mass_times(system, p, du):
    """du = M^-1 p."""
    for i in range(system.bodies.shape[0]):
        j, s = 6 * i, 1.0 / system.bodies[i, MASS]
        turn = symmetric_times(six(system.bodies, i, INVERSE), (p[j + 3], p[j + 4], p[j + 5]))
        for k in range(3):
            du[j + k] = s * p[j + k]
            du[j + 3 + k] = turn[k]


def read_velocities(system, y, u):
    """u of the coordinates y."""
    for i in range(system.bodies.shape[0]):
        for j in range(6):
            u[6 * i + j] = y[WIDTH * i + 7 + j]


# The rows of constraints and contacts as dense matrices on the velocities of all bodies.


def write_all_rows(system, t, y, workspace):
    """The rows at (t, y) into the workspace: the Jacobian with every contact closed and stuck, the
    force directions and loads in the modes that the table of contacts has."""
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
        spread_row(system, system.rows, k, workspace.J)
        workspace.row_bias[k], workspace.row_rate[k] = system.rows[k, BIAS], system.rows[k, RATE]
    for c in range(table.shape[0]):
        for j in range(4):
            table[c, CLOSED + j] = modes[c, j]
    unconstrained(system, t, y)
    for k in range(n):
        spread_row(system, system.force_rows, k, workspace.W)
        size = 0.0
        for j in range(12):
            size += abs(system.force_rows[k, j])
        if size == 0.0:
            for j in range(workspace.W.shape[1]):
                workspace.W[k, j] = workspace.J[k, j]
    for i in range(system.bodies.shape[0]):
        for j in range(6):
            workspace.free_accelerations[6 * i + j] = system.bodies[i, RESPONSE + j]


def spread_row(system, columns, k, out):
    """Row k of 12 columns (body, parent) as a row of 6N."""
    b, a = system.row_table[k, BODY], system.row_table[k, PARENT]
    for j in range(out.shape[1]):
        out[k, j] = 0.0
    for j in range(6):
        out[k, 6 * b + j] += columns[k, j]
    if a >= 0:
        for j in range(6):
            out[k, 6 * a + j] += columns[k, 6 + j]


def velocities(system: ContactBodies, y: Array) -> Array:
    """u = (v_WC, w_WB_B) of all bodies, (6N,)."""
    u = np.empty(6 * system.bodies.shape[0])
    read_velocities(system, y, u)
    return u


def set_velocities(system: ContactBodies, y: Array, u: Array) -> None:
    """Write the velocities u of all bodies, shape (6 N,), into the coordinates y."""
    for i in range(system.bodies.shape[0]):
        y[WIDTH * i + 7 : WIDTH * i + 13] = u[6 * i : 6 * i + 6]


def spread(system: ContactBodies, columns: Array) -> Array:
    """Rows of 12 columns (body, parent) as rows of 6N."""
    n = len(columns)
    out = np.empty((n, 6 * system.bodies.shape[0]))
    for k in range(n):
        spread_row(system, columns, k, out)
    return out


# The problem between rows and laws, in the workspace: which rows take part, what each is bound
# to, and its solution (see numerics.complementarity).


SOLVED, UNSOLVED, NOT_FINITE = 0, 1, 2
"""What becomes of a problem: a solution, none that Newton's iteration finds, or numbers that are
none."""


def add_row(workspace, n, k, rule):
    """Let row k take part as the n-th, with the rule; returns how many there are now."""
    workspace.used[n], workspace.place_of[k] = k, n
    workspace.rules[n], workspace.least[n] = rule, 0.0
    return n + 1


def add_bound(workspace, m, places, limit, move):
    """Let the rows at places (first, second or -1, normal) have the m-th bound, for the move
    (contact, way); returns how many there are now."""
    workspace.bounds[m, FIRST], workspace.bounds[m, SECOND], workspace.bounds[m, OF_NORMAL] = places
    workspace.limits[m] = limit
    workspace.moves[m, 0], workspace.moves[m, 1] = move
    return m + 1


NO_ROW = -1
"""Instead of a rule: the row takes no part."""


def add_contact(workspace, n, k, normal, ways):
    """Let the rows of a contact take part, the first of which is k: by the rule of its normal row,
    and of its slip, its rolling and its spin; returns how many rows there are now."""
    rules = (normal, ways[0], ways[0], ways[1], ways[1], ways[2])
    for j in range(6):
        if rules[j] != NO_ROW:
            n = add_row(workspace, n, k + j, rules[j])
    return n


def add_bounds(workspace, m, c, k, ways, limits):
    """Bound the friction rows of contact c that take part by these parts of its normal force;
    returns how many bounds there are now."""
    at, first, second = workspace.place_of, (k + 1, k + 3, k + 5), (k + 2, k + 4, k + 5)
    for way in range(3):
        if ways[way] == FRICTION:
            other = at[second[way]] if way < 2 else -1
            m = add_bound(workspace, m, (at[first[way]], other, at[k]), limits[way], (c, way))
    return m


def ways_at_rest(table, c):
    """Of each way of a contact FRICTION where it rests, else NO_ROW."""
    return (
        FRICTION if table[c, SLIDE] == STUCK else NO_ROW,
        FRICTION if table[c, ROLL] == STUCK else NO_ROW,
        FRICTION if table[c, SPIN] == STUCK else NO_ROW,
    )


def problem_of(workspace, n, m, A, b, step):
    """The problem of n rows and m bounds; step: work space of the solver."""
    return Equations(
        n, m, pointer(A), pointer(b), pointer(step), integers(workspace.rules),
        pointer(workspace.least), integers(workspace.bounds), pointer(workspace.limits), 0.0,
    )  # fmt: skip


def solve_in(workspace, n, m, A, b, terms, x):
    """Into x the solution of n rows and m bounds; returns what has become of it."""
    residual = solution(problem_of(workspace, n, m, A, b, x), pointer(terms), pointer(x))
    if residual != residual:
        return NOT_FINITE
    return SOLVED if residual <= CONTRADICTION else UNSOLVED


def measure_moments(system, workspace, n, m, A, b, terms, units):
    """Measure moments, and turning, at an arm of the scene's length, in A, b, terms and the limits
    of n rows and m bounds, so that least impulses weigh them beside forces.

    units: of each row, in SI; powers of 2, which are exact.
    """
    arm = unit_of(1.0 / (system.length * system.length))
    for i in range(n):
        k = workspace.used[i]
        first, force = 6 * system.row_table[k, BODY], 0.0
        for j in range(3):
            force += abs(workspace.J[k, first + j])
        units[i] = 1.0 if force > 0.0 else arm
    for i in range(n):
        b[i], terms[i] = units[i] * b[i], units[i] * terms[i]
        for j in range(n):
            A[i, j] *= units[i] * units[j]
    for i in range(m):
        own = units[workspace.bounds[i, FIRST]]
        workspace.limits[i] *= units[workspace.bounds[i, OF_NORMAL]] / own


CANDIDATE, PRESSED = 1, 2
"""How a contact takes part: it may push, or a compliant support pushes it by a given force."""
EASED = 1e-8
"""Fraction by which all friction bounds are lowered once one is reached: contacts that share a
load, such as the two ends of an edge, then begin to slip together and in the same direction."""


def easing(workspace):
    """What all bounds at rest are multiplied by."""
    for c in range(workspace.moved.shape[0]):
        for way in range(3):
            if workspace.moved[c, way] == 1:
                return 1.0 - EASED
    return 1.0


def lay_out_forces(system, workspace):
    """The rows that hold, and their laws; the last rows are the given forces of pressed contacts,
    each with a value of its own. Returns (rows, bounds)."""
    table, n, m, ease = system.contact_table, 0, 0, easing(workspace)
    for k in range(first_row_of(system, 0)):
        n = add_row(workspace, n, k, EQUALITY)
    for c in range(table.shape[0]):
        if workspace.taking_part[c] == 0:
            continue
        normal = EQUALITY if table[c, BILATERAL] == 1.0 else UNILATERAL
        normal = normal if workspace.taking_part[c] == CANDIDATE else NO_ROW
        n = add_contact(workspace, n, first_row_of(system, c), normal, ways_at_rest(table, c))
    for c in range(table.shape[0]):
        if workspace.taking_part[c] == 0:
            continue
        k = first_row_of(system, c)
        if workspace.taking_part[c] == PRESSED:
            n = add_row(workspace, n, k, EQUALITY)
        # the kinetic bound once it has left its rest
        slip = table[c, KINETIC] if workspace.moved[c, 0] == 1 else table[c, STATIC]
        limits = ease * slip, ease * table[c, ROLLING_ARM], ease * table[c, SPINNING_ARM]
        m = add_bounds(workspace, m, c, k, ways_at_rest(table, c), limits)
    return n, m


def given_forces(workspace):
    """How many of the last rows are given forces."""
    count = 0
    for c in range(workspace.taking_part.shape[0]):
        count += 1 if workspace.taking_part[c] == PRESSED else 0
    return count


VELOCITY, ACCELERATION, STEP = range(3)
"""Levels of the problem."""


class Velocities(NamedTuple):
    """At the instant of a problem."""

    u: Any
    """of the bodies, (6 N,)."""
    v: Any
    """along all rows, J u - rate, (n,)."""


def along_rows(system, workspace, u, v):
    """v = J u - rate, of all rows."""
    for k in range(v.shape[0]):
        v[k] = row_times(system, workspace.J, k, u) - workspace.row_rate[k]


def assemble(system, workspace, level, n, now, duration, A, b, terms):
    """A, b and the sizes of the terms of b, of the n rows laid out; now: Velocities, which
    accelerations do not need; duration: of a step [s]."""
    rows_of_joints = n - given_forces(workspace)
    for i in range(rows_of_joints, n):
        for j in range(n):
            A[i, j], A[j, i] = 0.0, 0.0
        A[i, i] = 1.0
    if level == VELOCITY:
        fill_delassus(system, workspace.J, workspace.J, workspace.used, rows_of_joints, A)
    else:
        fill_delassus(system, workspace.J, workspace.W, workspace.used, rows_of_joints, A)
    for i in range(rows_of_joints):
        k, loads = workspace.used[i], workspace.free_accelerations
        b[i], terms[i] = 0.0, 0.0
        if level != VELOCITY:
            b[i] = row_times(system, workspace.J, k, loads) + workspace.row_bias[k]
            terms[i] = size_of_terms(system, workspace.J, k, loads) + abs(workspace.row_bias[k])
        if level != ACCELERATION:
            b[i] += now.v[k] / duration
            size = size_of_terms(system, workspace.J, k, now.u) + abs(workspace.row_rate[k])
            terms[i] += size / duration
    i = rows_of_joints
    for c in range(system.contact_table.shape[0]):
        if workspace.taking_part[c] == PRESSED:
            b[i], terms[i] = -system.contact_table[c, SPRING], system.contact_table[c, SPRING]
            i += 1


def velocity_after(A, b, i, x):
    """w = A x + b of the i-th row."""
    w = b[i]
    for j in range(x.shape[0]):
        w += A[i, j] * x[j]
    return w


def find_moving(system, workspace, m, w, duration):
    """What has a velocity at the end of so long a time has left its rest, w being accelerations;
    returns whether any of it had not yet."""
    new = False
    for i in range(m):
        c, way = workspace.moves[i, 0], workspace.moves[i, 1]
        first, second = workspace.bounds[i, 0], workspace.bounds[i, 1]
        size = w[first] ** 2 + (w[second] ** 2 if second >= 0 else 0.0)
        velocity_tolerance = (
            velocity_tolerance_of(system) if way == 0 else spin_tolerance_of(system)
        )
        if duration * size**0.5 > velocity_tolerance:
            new = new or workspace.moved[c, way] == 0
            system.contact_table[c, SLIDE + way] = SLIDING
    return new


def answer_over(system, workspace, y, duration):
    """The impulses of all rows over a short time into the workspace, all contacts that take part
    closed and at rest in the table, y the state before; those that move at its end slide in the
    table then. Returns what becomes of it."""
    now = Velocities(np.empty_like(workspace.free_accelerations), np.empty_like(workspace.row_rate))
    read_velocities(system, y, now.u)
    along_rows(system, workspace, now.u, now.v)
    modes = np.empty((system.contact_table.shape[0], 3))
    for c in range(modes.shape[0]):
        for way in range(3):
            modes[c, way] = system.contact_table[c, SLIDE + way]
    for _ in range(1 + 3 * modes.shape[0]):
        for c in range(modes.shape[0]):
            for way in range(3):
                system.contact_table[c, SLIDE + way] = modes[c, way]
        n, m = lay_out_forces(system, workspace)
        A, b, terms = np.empty((n, n)), np.empty(n), np.empty(n)
        x, w = np.empty(n), np.empty(n)
        assemble(system, workspace, STEP, n, now, duration, A, b, terms)
        status = solve_in(workspace, n, m, A, b, terms, x)
        if status != SOLVED:
            return status
        for i in range(n):
            w[i] = velocity_after(A, b, i, x)
        if not find_moving(system, workspace, m, w, duration):
            break
        for i in range(m):
            c, way = workspace.moves[i, 0], workspace.moves[i, 1]
            if system.contact_table[c, SLIDE + way] == SLIDING:
                workspace.moved[c, way] = 1
    for k in range(workspace.impulses.shape[0]):
        workspace.impulses[k] = 0.0
    for i in range(n - given_forces(workspace)):
        workspace.impulses[workspace.used[i]] = duration * x[i]
    return SOLVED
