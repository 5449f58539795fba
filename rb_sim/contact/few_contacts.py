# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Impulses of a step with few contacts, by the dense solver: shares of a load are the least ones.

Two flat pads that fingers press against a block determine the sum of the pressures at the corners
of each pad, but not their centre: the joints of the fingers carry any offset.  A table that stands
on four legs determines the loads of three.  Of what slips in several directions the friction, and
so the motion, depends on it.  As under event-driven contact (`impacts`) the impulses taken are
those of minimum norm among those that give all normals, and what sticks, the same velocities.

With the joints eliminated the problem is w = A r + b of the impulses r of contacts (see
numerics.complementarity), which is also solved here where sweeps do not get there, as where normal
impulse and friction work against a joint.
"""

from __future__ import annotations

import math

import numpy as np

from rb_sim.base.rounding import COMPUTED_ROUNDING, SOLVED, SOLVED_IN_CONTACT
from rb_sim.contact.gauss_seidel import ROUGH, give_joints, is_plain, relax_joints, viscosity_of
from rb_sim.contact.problem import (
    BOUND,
    COMPLIANCE,
    CONTACT_ROWS,
    ENOUGH,
    FINE,
    add_impulse,
    arm_of,
    fill_column,
    fill_free,
    largest,
    laws_for,
    lay_out,
    problem_of,
    rate_of,
)
from rb_sim.numerics.complementarity import (
    EQUALITY,
    FRICTION,
    UNILATERAL,
    equations,
    fill_steps,
    relative,
    row_times,
    solution,
)
from rb_sim.numerics.kernels import integers, part, pointer
from rb_sim.numerics.linear_solves import copy_system, decomposed

MOST_CONTACTS, MOST_JOINTS = 20, 60
"""Contacts that take part, and rows of joints, up to which a step is solved densely: it costs the
cube of the contacts, and their square times that of the joints."""
DEPENDENT = 1e-8
"""Pivot of the rows that hold, relative to the largest, below which a row depends on others: above
what is left of joints (1e-9 of the scene's length), below what a mass ratio of a million makes."""
TURNS = 20
"""Of solving linear laws after which no least shares are found, and of viscous friction for the
normal impulses that it has led to."""


def are_few(graph):
    """Whether a graph is solved densely: contacts and joints are few, and it is not a heap, of
    bodies that touch each other with nothing besides."""
    contacts, joints, touch = graph.ends.shape[0], graph.joint_rows.shape[0], False
    for i in range(contacts):
        touch = touch or graph.ends[i, 1] >= 0
    factorised = graph.joint_factor.shape[0] == joints
    few = contacts <= MOST_CONTACTS and joints <= MOST_JOINTS and factorised
    return few and not (touch and is_plain(graph))


def fill_problem(graph, laws, ends, n, u, x, A, b, terms, r):
    """A of n rows with joints that follow, their impulses r, and b, without what friction without a
    corner gives; u: velocities that x has been pushed into; terms: sizes of the summands of b."""
    w, d, e = np.zeros_like(u), np.empty(graph.joint_rows.shape[0]), graph.joint_ends
    for m in range(n):
        k, unit = laws.used[m], laws.units[m]
        r[m] = x[k] / unit
        add_impulse(graph.rows, k, w, ends[k, 0], ends[k, 1], unit)
        for j in range(d.shape[0]):
            d[j] = -rate_of(graph.joint_rows, j, w, e[j, 0], e[j, 1])
        give_joints(graph, w, d)
        fill_column(graph.rows, ends, laws, n, m, w, A)
        for body in range(u.shape[0]):
            for j in range(6):
                w[body, j] = 0.0
    fill_free(graph.rows, ends, graph.targets, u, laws, n, b, terms)
    for o in range(n):
        for m in range(n):
            b[o] -= A[o, m] * r[m]
            terms[o] += abs(A[o, m] * r[m])
    for m in range(n):
        if laws.used[m] % CONTACT_ROWS == 0:
            A[m, m] += graph.rules[laws.used[m] // CONTACT_ROWS, COMPLIANCE]


def find_slack(graph, laws, m, r, slack):
    """Velocity against which the impulse 1 of each row works besides A, where friction has no
    corner, for the normal impulses r; such friction has no bound, or is none.  Returns whether
    there is any."""
    viscous = False
    for o in range(slack.shape[0]):
        slack[o] = 0.0
    for i in range(m):
        c = laws.moves[i, 0]
        if laws.moves[i, 1] == 0 and graph.rules[c, BOUND] < 0.0:
            first, second, normal = laws.bounds[i, 0], laws.bounds[i, 1], laws.bounds[i, 2]
            gives = viscosity_of(graph.rules, c, r[normal])
            laws.limits[i] = math.inf if gives > 0.0 else 0.0
            if gives > 0.0:
                slack[first], slack[second], viscous = 1.0 / gives, 1.0 / gives, True
    return viscous


def hold(p, slow, x, rules, b):
    """Copy rules and b of a problem, but let each unilateral row that does not open at the solution
    x hold both ways, and put each other one out of reach."""
    for k in range(p.n):
        rules[k], b[k] = p.rules[k], p.b[k]
        if p.rules[k] == UNILATERAL and row_times(p, k, x) <= slow:
            rules[k] = EQUALITY
        elif p.rules[k] == UNILATERAL:
            b[k] = math.inf


def find_least(p, held, rules, b, x, work):
    """Replace x by the least x that solves the laws, linear about x, until it stays the same, where
    what would pull no longer holds.  Returns the unknowns that are not determined; -1 if x does
    not stay.

    held: p with the rules and b of `hold`, or p itself, of which nothing is written then; work:
    n (2 n + 7) numbers.
    """
    n = p.n
    J, w, F, new, rest = (
        work, part(work, n * n), part(work, n * n + n), part(work, n * n + 2 * n),
        part(work, n * n + 3 * n),
    )  # fmt: skip
    for _ in range(TURNS):
        equations(held, x, w, F, J)
        for i in range(n):
            F[i] = -F[i]
            for j in range(n):
                F[i] += J[i * n + j] * x[j]
        copy_system(J, F, n, rest)
        rank = decomposed(rest, part(rest, n * n), n, n, DEPENDENT, part(rest, n * (n + 1)), new)
        most, moved, pulls = 0.0, 0.0, -1
        for k in range(n):
            most, moved = max(most, abs(new[k])), max(moved, abs(new[k] - x[k]))
            x[k] = new[k]
            pushes = p.rules[k] == UNILATERAL and rules[k] == EQUALITY
            if pushes and (pulls < 0 or x[k] - p.least[k] < x[pulls] - p.least[pulls]):
                pulls = k
        if pulls >= 0 and x[pulls] < p.least[pulls] - COMPUTED_ROUNDING * most:
            rules[pulls], b[pulls], x[pulls] = UNILATERAL, math.inf, p.least[pulls]
        elif not moved > SOLVED * most:
            return n - rank
    return -1


def misfit(p, x, work):
    """Residual of the laws at x, see `relative`."""
    n = p.n
    return relative(p, equations(p, x, work, part(work, n), part(work, 2 * n)), x)


def largest_change(p, x, other):
    """(the largest change of w between two solutions, relative to what x makes of one)."""
    most, made = 0.0, 0.0
    for k in range(p.n):
        given = row_times(p, k, x) - p.b[k]
        made = max(made, abs(given))
        most = max(most, abs(row_times(p, k, other) - p.b[k] - given))
    return most / made if most > SOLVED_IN_CONTACT * made else 0.0


def slips(p, slow, x):
    """Whether w of any friction row is more than slow."""
    for k in range(p.n):
        if p.rules[k] == FRICTION and abs(row_times(p, k, x)) > slow:
            return True
    return False


def find_open(p, held, slow, rules, b, x, other, work):
    """(the largest change of w if a contact that pushes in the least solution x did not, and the
    row of that contact; 0 and 0 where w is the same).  other: n numbers, the rest as in
    `find_least`."""
    figure, of = 0.0, 0
    for released in range(p.n):
        hold(p, slow, x, rules, b)
        if p.rules[released] != UNILATERAL or rules[released] != EQUALITY:
            continue
        for k in range(p.n):
            other[k] = x[k]
        rules[released], b[released], other[released] = UNILATERAL, math.inf, p.least[released]
        found = find_least(p, held, rules, b, other, work)
        if found >= 0 and not misfit(p, other, work) > FINE:
            change = largest_change(p, x, other)
            figure, of = (change, released) if change > figure else (figure, of)
    return figure, of


def take_least(p, slow, x, look):
    """Let the solution x of a problem be the least one; returns (unknowns that the laws do not
    determine, what `find_open` finds if asked to look).  slow: w that is none."""
    n, figure, of = p.n, 0.0, 0
    rules, b = np.empty(n, np.int64), np.empty(n)
    held = p._replace(rules=integers(rules), b=pointer(b))
    hold(p, slow, x, rules, b)
    numbers, work_of = np.empty(2 * n), np.empty(n * (2 * n + 7))
    least, other, work = pointer(numbers), part(pointer(numbers), n), pointer(work_of)
    for k in range(n):
        least[k] = x[k]
    free = find_least(p, held, rules, b, least, work)
    if free < 0 or misfit(p, least, work) > max(misfit(p, x, work), FINE):
        return 0, figure, of
    if look and free > 0 and slips(p, slow, least):
        figure, of = find_open(p, held, slow, rules, b, least, other, work)
    for k in range(n):
        x[k] = least[k]
    return free, figure, of


def solve_near(p, terms, x):
    """Replace x by the solution near it, or by any other if none is found there."""
    numbers = np.empty(p.n * (2 * p.n + 7))
    work = pointer(numbers)
    if find_least(p, p, p.rules, p.b, x, work) < 0 or misfit(p, x, work) > FINE:
        solution(p, terms, x)


def take_over(graph, u, x, joints, laws, ends, r):
    """Let the impulses of the rows laid out be r; u and those of the joints follow."""
    for m in range(r.shape[0]):
        k, taken = laws.used[m], r[m] * laws.units[m]
        add_impulse(graph.rows, k, u, ends[k, 0], ends[k, 1], taken - x[k])
        x[k] = taken
    relax_joints(graph, u, joints)


def solve_few(graph, u, x, joints, slow, length, look):
    """Solve a graph of which `are_few` is true from what sweeps have left, with the least shares
    where the laws leave them open.

    Where contacts of a body contradict each other, as corners that land together but for rounding,
    the laws are kept on the mean.  slow: velocity that is none; length: of the scene.  Returns
    (natural map of the laws over the largest impulse, how much shares change of a velocity relative
    to what impulses make of it, if asked to look, and the number of a contact that has such a
    share).
    """
    contacts = graph.ends.shape[0]
    laws = laws_for(CONTACT_ROWS * contacts, contacts)
    ends, first = np.empty((CONTACT_ROWS * contacts, 2), np.int64), np.zeros(contacts + 1, np.int64)
    for k in range(ends.shape[0]):
        first[k // CONTACT_ROWS] = k // CONTACT_ROWS * CONTACT_ROWS
        for j in range(2):
            ends[k, j] = graph.ends[k // CONTACT_ROWS, j]
    n, m = lay_out(graph.rows, graph.rules, first, arm_of(length), ROUGH, laws)
    if n == 0:
        return 0.0, 0.0, 0
    relax_joints(graph, u, joints)
    alone, A, work = np.empty((n, n)), np.empty((n, n)), np.empty(n * (n + 2))
    b, terms, step, slack = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    r, found = np.empty(n), np.empty(n)
    fill_problem(graph, laws, ends, n, u, x, alone, b, terms, r)
    figure, of, rest = 0.0, 0, 0.0
    for _ in range(TURNS):
        viscous = find_slack(graph, laws, m, r, slack)
        for i in range(n):
            found[i] = r[i]
            for j in range(n):
                A[i, j] = alone[i, j] + (slack[i] if i == j else 0.0)
        p = problem_of(laws, n, m, A, b, step)
        blur = fill_steps(n, p.A, pointer(terms), p.step)
        p = p._replace(blur=max(blur, slow * largest(step)))
        before = misfit(p, pointer(r), pointer(work))
        if before > ENOUGH:
            solve_near(p, pointer(terms), pointer(found))
        _, figure, of = take_least(p, slow, pointer(found), look)
        rest, moved, most = misfit(p, pointer(found), pointer(work)), 0.0, 0.0
        if rest > max(before, FINE):
            rest = before
            break
        for k in range(n):
            moved, most = max(moved, abs(r[k] - found[k])), max(most, abs(found[k]))
            r[k] = found[k]
        if not (viscous and moved > SOLVED * most):
            break
    take_over(graph, u, x, joints, laws, ends, r)
    return rest, figure, laws.used[of] // CONTACT_ROWS
