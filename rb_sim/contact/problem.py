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

A contact has six rows: along its normal and two tangents, then, where it resists turning, about
both tangents and the normal.  A row's columns are force on B (3, world), torque on B (3, body
axes), the same on A, then I^-1 torque of both and 1/m of both.  Rows of joints are written alike.
W is J but for the normals of slipping contacts, which push along n + T/N; impacts bound friction by
itself.  Heaps are solved as a graph, whose bodies' velocities couple its contacts; few contacts by
dense matrices.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

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
    unit_of,
)
from rb_sim.numerics.complementarity import NORMAL as OF_NORMAL
from rb_sim.numerics.kernels import integers, pointer
from rb_sim.numerics.vectors import symmetric_times

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
BOUND, COMPLIANCE, VISCOUS_PER_NORMAL, VISCOUS, PULLS, LEAST, ROLLS, SPINS, PART, RULES = range(10)
"""Columns of Graph.rules: coefficient of friction (of a law without corner: -1), velocity that the
support gives per impulse, impulse of that law per slip (per N and without), whether N may pull,
least normal impulse, arms of rolling and spinning resistance, and how the contact takes part."""
HOLDS = -2.0
"""Instead of a coefficient of friction: the contact does not slip, whatever that takes."""
FREE, GIVEN, APART = 0.0, 1.0, 2.0
"""How a contact takes part: with a normal impulse that is sought; with one that is given, where
BOUND, ROLLS and SPINS are the bounds themselves; not at all."""
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


def mean_rate(rows, k, before, after, b, a):
    """Mean of the rates of row k at two velocities: an impulse along it does so much work each."""
    return 0.5 * (rate_of(rows, k, before, b, a) + rate_of(rows, k, after, b, a))


def respond(rows, k, bodies, b, a):
    """Write what row k, of which force and torque stand there, makes of velocities per impulse."""
    keep(rows, k, TURN_B, symmetric_times(six(bodies, b, INVERSE), vec(rows, k, TORQUE_B)))
    rows[k, LIGHT_B], rows[k, LIGHT_A] = 1.0 / bodies[b, MASS], 0.0
    if a >= 0:
        keep(rows, k, TURN_A, symmetric_times(six(bodies, a, INVERSE), vec(rows, k, TORQUE_A)))
        rows[k, LIGHT_A] = 1.0 / bodies[a, MASS]


# The dense problem: which rows take part, what each is bound to, and the matrix between them.


class Laws(NamedTuple):
    """What the rows of a dense problem are bound to; tables for as many as may take part.

    The workspace of events has these fields among others."""

    used: np.ndarray
    """rows that take part, (n,)."""
    place_of: np.ndarray
    """of each row among those, (rows,)."""
    units: np.ndarray
    """of each row that takes part: turning, and moments, are measured at an arm [m], so that least
    impulses weigh moments beside forces; powers of 2, which are exact, (n,)."""
    rules: np.ndarray
    """(n,)."""
    least: np.ndarray
    """(n,)."""
    bounds: np.ndarray
    """(3 C, BOUND_WIDTH)."""
    limits: np.ndarray
    """(3 C,)."""
    moves: np.ndarray
    """contact, and way (slip, roll, spin), of each bound, (3 C, 2)."""


def laws_for(rows, contacts):
    """Tables for so many rows of so many contacts."""
    return Laws(
        np.empty(rows, np.int64), np.empty(rows, np.int64), np.empty(rows),
        np.empty(rows, np.int64), np.empty(rows),
        np.empty((3 * contacts, BOUND_WIDTH), np.int64), np.empty(3 * contacts),
        np.empty((3 * contacts, 2), np.int64),
    )  # fmt: skip


def add_row(laws, n, k, rule):
    """Let row k take part as the n-th, with the rule; returns how many there are now."""
    laws.used[n], laws.place_of[k], laws.units[n] = k, n, 1.0
    laws.rules[n], laws.least[n] = rule, 0.0
    return n + 1


def lay_out(rows, rules, first, arm, rough, laws):
    """Let the rows take part that joints, all rows before the first of contacts, and contacts have
    by their rules; returns (how many rows, how many bounds).

    first: first row of each contact; rough: bound of friction above which none slips; arm: see
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
    """The arm at which turning is measured in a scene of this length [m]."""
    return unit_of(1.0 / (length * length))


def fill_column(rows, ends, laws, n, m, w, A):
    """Column m of A: what the velocities w, made by a unit of the m-th row, are along each row."""
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
    """A of n rows that stand for themselves, joints among them; w: (N, 6) zeros."""
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
    """The size of what `rate_of` sums."""
    s = 0.0
    for j in range(6):
        s += abs(rows[k, j] * u[b, j])
    if a >= 0:
        for j in range(6):
            s += abs(rows[k, 6 + j] * u[a, j])
    return s


def fill_free(rows, ends, targets, u, laws, n, b, terms):
    """b of n rows at the velocities u without reactions, and the sizes of its terms."""
    for i in range(n):
        k, unit = laws.used[i], laws.units[i]
        body, parent = ends[k, 0], ends[k, 1]
        b[i] = unit * (rate_of(rows, k, u, body, parent) - targets[k])
        terms[i] = unit * (size_of_terms(rows, k, u, body, parent) + abs(targets[k]))


def problem_of(laws, n, m, A, b, step):
    """The problem of n rows and m bounds; step: work space of the solver."""
    return Equations(
        n, m, pointer(A), pointer(b), pointer(step), integers(laws.rules), pointer(laws.least),
        integers(laws.bounds), pointer(laws.limits), 0.0,
    )  # fmt: skip
