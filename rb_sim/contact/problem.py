# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The contact problem at one instant: rows of contacts and joints, their laws, their targets.

    w = A r + b,   A = J M^-1 W^T,   b = J u - target

of the rows that take part, at each of its levels:

    level          w                   u without reactions    target                r
    impact         velocities after    u before               rate                  impulses
    acceleration   accelerations       a of the loads         -bias                 forces
    short step     mean accelerations  a + u / h              rate / h - bias       impulses over h
    time step      velocities after    u before + h a         from gaps, rebounds   impulses

A contact has six rows: along its normal and two tangents, then, if it resists rotation, about both
tangents and the normal. The columns of a row are force on B (3, world), torque on B (3, body axes),
the same on A, then I^-1 torque of both and 1/m of both. Rows of joints have the same form. W equals
J except for the normal rows of slipping contacts, whose force is along n + T/N; in impacts friction
has bounds of its own. Heaps are solved as a graph whose contacts are coupled by the velocities of
the bodies; a few contacts by dense matrices.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeVar, get_type_hints

import numpy as np

from rb_sim.integrate.layout import INTEGER
from rb_sim.mechanics.contact.contact_bodies import keep
from rb_sim.mechanics.systems.many_bodies import INVERSE, MASS, six, vec
from rb_sim.numerics.complementarity import (
    BOUND_WIDTH,
    EQUALITY,
    FIRST,
    FRICTION,
    SECOND,
    UNILATERAL,
    Equations,
    natural_map,
    size_of,
    unit_of,
)
from rb_sim.numerics.complementarity import NORMAL as OF_NORMAL
from rb_sim.numerics.kernels import integers, pointer
from rb_sim.numerics.vectors import symmetric_times

# Workspaces: tuples of tables, whose fields are Annotated with the kind of their numbers and their
# lengths, which are numbers or names.

Tables = TypeVar("Tables", bound=tuple)


def tables_of(kind: type[Tables]) -> dict[str, tuple[Any, ...]]:
    """(kind of numbers, lengths) of each table."""
    hints = get_type_hints(kind, include_extras=True)
    return {name: hint.__metadata__ for name, hint in hints.items()}


def zeros_of(kind: type[Tables], **lengths: int) -> Tables:
    """The tables, full of zeros, with these lengths."""
    tables = []
    for number, *shape in tables_of(kind).values():
        sizes = [lengths.get(length, length) for length in shape]
        tables.append(np.zeros(sizes, np.int64 if number == INTEGER else np.float64))
    return kind(*tables)


# Loops over arrays, since compiled functions have no expressions of whole arrays.


def copy(to, of):
    """Copy a vector to `to`; returns `to`."""
    for i in range(of.shape[0]):
        to[i] = of[i]
    return to


def copy_rows(to, of):
    """Copy a matrix to `to`."""
    for i in range(of.shape[0]):
        for j in range(of.shape[1]):
            to[i, j] = of[i, j]


def finite(y):
    """Whether no entry of a vector is NaN or infinite."""
    total = 0.0
    for i in range(y.shape[0]):
        total += 0.0 * y[i]
    return total == 0.0


def largest(x):
    """Largest absolute value of a vector; NaN if it has one."""
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
"""Number of rows of a contact."""
ENOUGH = 1e-7
"""Change of an impulse, or natural map, relative to the largest impulse, at which a step is solved:
far below the error of the step itself."""
FINE = 1e-4
"""Natural map of the laws, relative to the largest impulse, that is allowed in a moving heap and if
contacts contradict each other; it is reported as GAVE."""
BOUND, COMPLIANCE, VISCOUS_PER_NORMAL, VISCOUS, PULLS, LEAST, ROLLS, SPINS, PART, RULES = range(10)
"""Columns of Graph.rules: coefficient of friction (-1: viscous), velocity of the support per
impulse, viscous impulse per slip (per N, and independent of it), whether N may be negative, least
normal impulse, arms of rolling and spinning resistance, and the participation of the contact."""
ROUGH = 1e8
"""Largest coefficient of friction that is used."""
HOLDS = -2.0
"""Value of BOUND for a contact that does not slip, with unbounded friction."""
FREE, GIVEN, APART = 0.0, 1.0, 2.0
"""Participation of a contact: with an unknown normal impulse; with a given one, where BOUND, ROLLS
and SPINS are the bounds themselves; not at all."""
BLOCK = 6
"""Number of elements of the symmetric block of a contact."""


class Graph(NamedTuple):
    """n contacts and m rows of joints between bodies with velocities u, shape (N, 6)."""

    ends: np.ndarray
    """bodies of each contact, -1 for the world, shape (n, 2)."""
    rows: np.ndarray
    """rows of the contacts, shape (CONTACT_ROWS n, WIDTH)."""
    targets: np.ndarray
    """required values of rows u + compliance times impulse [m/s], shape (CONTACT_ROWS n,)."""
    rules: np.ndarray
    """shape (n, RULES)."""
    blocks: np.ndarray
    """block of A of each contact (nn, n1, n2, 11, 12, 22), shape (n, BLOCK)."""
    joint_ends: np.ndarray
    """bodies of each row, and whether it is dependent and gets no impulse, shape (m, 3)."""
    joint_rows: np.ndarray
    """shape (m, WIDTH)."""
    joint_targets: np.ndarray
    """shape (m,)."""
    joint_factor: np.ndarray
    """workspace: factors of the block of the joints, shape (m, m); (0, 0) for too many rows."""
    spare: np.ndarray
    """workspace, shape (2, m)."""


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


def mean_rate(rows, k, before, after, b, a):
    """Mean of the rates of row k at two velocities: work of an impulse along it, per impulse."""
    return 0.5 * (rate_of(rows, k, before, b, a) + rate_of(rows, k, after, b, a))


def respond(rows, k, bodies, b, a):
    """Write the change of velocities per impulse of row k, whose forces and torques are given."""
    keep(rows, k, TURN_B, symmetric_times(six(bodies, b, INVERSE), vec(rows, k, TORQUE_B)))
    rows[k, LIGHT_B], rows[k, LIGHT_A] = 1.0 / bodies[b, MASS], 0.0
    if a >= 0:
        keep(rows, k, TURN_A, symmetric_times(six(bodies, a, INVERSE), vec(rows, k, TORQUE_A)))
        rows[k, LIGHT_A] = 1.0 / bodies[a, MASS]


# The dense problem: its rows, their laws, and its matrix.


class Laws(NamedTuple):
    """The rows of a dense problem and their laws; the workspace of events has the same fields."""

    used: np.ndarray
    """participating rows, (n,)."""
    place_of: np.ndarray
    """index of each row among those, (rows,)."""
    units: np.ndarray
    """unit of each participating row, (n,): rotations and torques are measured at an arm [m], so
    that torques are comparable with forces in least impulses; powers of 2, which are exact."""
    rules: np.ndarray
    """(n,)."""
    least: np.ndarray
    """(n,)."""
    bounds: np.ndarray
    """(3 C, BOUND_WIDTH)."""
    limits: np.ndarray
    """(3 C,)."""
    moves: np.ndarray
    """contact and kind (slip, roll, spin) of each bound, (3 C, 2)."""


def laws_for(rows, contacts):
    """Tables for these numbers of rows and contacts."""
    return Laws(
        np.empty(rows, np.int64), np.empty(rows, np.int64), np.empty(rows),
        np.empty(rows, np.int64), np.empty(rows),
        np.empty((3 * contacts, BOUND_WIDTH), np.int64), np.empty(3 * contacts),
        np.empty((3 * contacts, 2), np.int64),
    )  # fmt: skip


def add_row(laws, n, k, rule):
    """Add row k as number n with this rule; returns the new number of rows."""
    laws.used[n], laws.place_of[k], laws.units[n] = k, n, 1.0
    laws.rules[n], laws.least[n] = rule, 0.0
    return n + 1


def lay_out(rows, rules, first, arm, rough, laws):
    """Write the participating rows of joints (all rows before those of contacts) and contacts, with
    their laws; returns (number of rows, number of bounds).

    first: first row of each contact; rough: largest bound of friction that is used; arm: see
    Laws.units.
    """
    n, m = 0, 0
    for k in range(first[0]):
        n = add_row(laws, n, k, EQUALITY)
    for i in range(rules.shape[0]):
        if rules[i, PART] == APART:
            continue
        k, normal = first[i], -1
        if rules[i, PART] == FREE:
            normal = n
            n = add_row(laws, n, k, EQUALITY if rules[i, PULLS] != 0.0 else UNILATERAL)
            laws.least[normal] = rules[i, LEAST]
        for way in range(3):
            turns = (rules[i, ROLLS] if way == 1 else rules[i, SPINS]) / arm
            bound, own, j = rules[i, BOUND] if way == 0 else turns, n, k + 1 + 2 * way
            if bound == 0.0:
                continue
            n = add_row(laws, n, j, EQUALITY if bound == HOLDS else FRICTION)
            if way < 2:
                n = add_row(laws, n, j + 1, EQUALITY if bound == HOLDS else FRICTION)
            if bound != HOLDS:
                laws.bounds[m, FIRST], laws.bounds[m, OF_NORMAL] = own, normal
                laws.bounds[m, SECOND] = own + 1 if way < 2 else -1
                laws.limits[m] = min(bound, rough)
                laws.moves[m, 0], laws.moves[m, 1] = i, way
                m += 1
    for i in range(n):
        k = laws.used[i]
        force = abs(rows[k, 0]) + abs(rows[k, 1]) + abs(rows[k, 2])
        laws.units[i] = 1.0 if force > 0.0 else arm
    return n, m


def arm_of(length):
    """The arm of Laws.units in a scene of this length [m]."""
    return unit_of(1.0 / (length * length))


def fill_column(rows, ends, laws, n, m, w, A):
    """Write column m of A: velocities w, by a unit impulse of row m, along each row."""
    for o in range(n):
        k = laws.used[o]
        b, a, s, more = ends[k, 0], ends[k, 1], 0.0, 0.0
        for j in range(6):
            s += rows[k, j] * w[b, j]
        if a >= 0:
            for j in range(6):
                more += rows[k, 6 + j] * w[a, j]
        A[o, m] = laws.units[o] * (s + more)


def fill_delassus(rows, pushes, ends, laws, n, w, A):
    """Write A of n rows, including those of joints; w: (N, 6) zeros."""
    for m in range(n):
        k = laws.used[m]
        b, a = ends[k, 0], ends[k, 1]
        add_impulse(pushes, k, w, b, a, laws.units[m])
        fill_column(rows, ends, laws, n, m, w, A)
        for j in range(6):
            w[b, j] = 0.0
            if a >= 0:
                w[a, j] = 0.0


def size_of_terms(rows, k, u, b, a):
    """Sum of the absolute terms of `rate_of`."""
    s = 0.0
    for j in range(6):
        s += abs(rows[k, j] * u[b, j])
    if a >= 0:
        for j in range(6):
            s += abs(rows[k, 6 + j] * u[a, j])
    return s


def fill_free(rows, ends, targets, u, laws, n, b, terms):
    """Write b of n rows at the velocities u without reactions, and its absolute terms."""
    for i in range(n):
        k, unit = laws.used[i], laws.units[i]
        body, parent = ends[k, 0], ends[k, 1]
        b[i] = unit * (rate_of(rows, k, u, body, parent) - targets[k])
        terms[i] = unit * (size_of_terms(rows, k, u, body, parent) + abs(targets[k]))


def problem_of(laws, n, m, A, b, step):
    """The problem of n rows and m bounds; step: workspace of the solver."""
    return Equations(
        n, m, pointer(A), pointer(b), pointer(step), integers(laws.rules), pointer(laws.least),
        integers(laws.bounds), pointer(laws.limits), 0.0,
    )  # fmt: skip


# The residual of a graph, by the natural map of the dense problem.


class Residual(NamedTuple):
    """The n rows of a graph's contacts, their m bounds, and workspace for the residual."""

    n: int
    m: int
    laws: Laws
    ends: np.ndarray
    """bodies of each row of a contact, (rows, 2)."""
    step: np.ndarray
    """scale of each row, see Equations, (n,)."""
    w: np.ndarray
    """rate of each row beyond its target, (n,)."""
    r: np.ndarray
    """impulse of each row, (n,)."""
    F: np.ndarray
    """natural map, (n,)."""


def lay_out_graph(graph, length):
    """The rows of the contacts of a graph with their laws; length: of the scene."""
    contacts = graph.ends.shape[0]
    laws = laws_for(CONTACT_ROWS * contacts, contacts)
    ends, first = np.empty((CONTACT_ROWS * contacts, 2), np.int64), np.zeros(contacts + 1, np.int64)
    for k in range(ends.shape[0]):
        first[k // CONTACT_ROWS] = k // CONTACT_ROWS * CONTACT_ROWS
        for j in range(2):
            ends[k, j] = graph.ends[k // CONTACT_ROWS, j]
    n, m = lay_out(graph.rows, graph.rules, first, arm_of(length), ROUGH, laws)
    return Residual(n, m, laws, ends, np.empty(n), np.empty(n), np.empty(n), np.empty(n))


def block_size(blocks, i):
    """Largest diagonal element of the block of contact i."""
    return max(blocks[i, 0], max(blocks[i, 3], blocks[i, 5]))


RIGID = 1e200
"""Stiffness and grip of the exact laws."""


def residual_of(graph, made, u, x, c, stiff, grip):
    """Natural map of the laws at the velocities u and impulses x, relative to the impulses.

    c, stiff, grip: centres, normal and tangential stiffness of a proximal step, relative to the
    block of each contact; x, RIGID, RIGID: the exact laws.
    """
    for o in range(made.n):
        k, unit = made.laws.used[o], made.laws.units[o]
        i = k // CONTACT_ROWS
        size = block_size(graph.blocks, i)
        v = rate_of(graph.rows, k, u, made.ends[k, 0], made.ends[k, 1]) - graph.targets[k]
        if k % CONTACT_ROWS == 0:
            v += graph.rules[i, COMPLIANCE] * x[k] + size / stiff * (x[k] - c[k])
        else:
            v += size / grip * (x[k] - c[k])
        made.w[o], made.r[o], made.step[o] = unit * v, x[k] / unit, 1.0 / (unit * unit * size)
    p = problem_of(made.laws, made.n, made.m, made.w, made.w, made.step)  # without A and b
    error = natural_map(p, pointer(made.r), pointer(made.w), pointer(made.F))
    impulses = size_of(made.n, made.r)
    return error / impulses if impulses > 0.0 else error
