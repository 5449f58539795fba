# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Impulses of a step with few contacts by the dense solver; impulses that are not unique are least.

The laws do not always determine the impulses. If two fingers with flat pads press a block, only the
sum of the forces at the corners of each pad is determined, since the joints of the fingers carry
any offset; of the loads on four table legs only three are. If contacts slip in several directions,
friction and motion depend on the choice. The impulses of minimum norm are taken among those with
the same normal velocities, and the same velocities of sticking contacts; impacts of event-driven
contact use the same function.

With the joints eliminated the problem is w = A r + b with the impulses r of contacts (see
numerics/complementarity). It is also solved here if sweeps do not converge, e.g. if normal impulse
and friction act against a joint.
"""

from __future__ import annotations

import math

import numpy as np

from rb_sim.base.rounding import COMPUTED_ROUNDING, SOLVED, SOLVED_IN_CONTACT
from rb_sim.contact.gauss_seidel import give_joints, is_plain, relax_joints, viscosity_of
from rb_sim.contact.problem import (
    BOUND,
    COMPLIANCE,
    CONTACT_ROWS,
    ENOUGH,
    FINE,
    add_impulse,
    fill_column,
    fill_free,
    largest,
    lay_out_graph,
    problem_of,
    rate_of,
)
from rb_sim.numerics.complementarity import (
    EQUALITY,
    FRICTION,
    UNILATERAL,
    equations,
    fill_steps,
    natural_map,
    relative,
    row_times,
    solution,
)
from rb_sim.numerics.kernels import integers, part, pointer
from rb_sim.numerics.linear_solves import copy_system, decomposed

MOST_CONTACTS, MOST_JOINTS = 20, 60
"""Maximum numbers of active contacts and joint rows for the dense solver: it costs the cube of the
number of contacts, and its square times that of the joint rows."""
DEPENDENT = 1e-8
"""Relative pivot below which a row is dependent: above the error of joints (1e-9 of the scene's
length), below the effect of a mass ratio of a million."""
TURNS = 20
"""Maximum number of iterations of the linear laws, and of viscous friction and normal impulses."""


def are_few(graph):
    """Whether a graph is solved densely: it has few contacts and joints, and is no heap of bodies
    with plain contacts between them."""
    contacts, joints, touch = graph.ends.shape[0], graph.joint_rows.shape[0], False
    for i in range(contacts):
        touch = touch or graph.ends[i, 1] >= 0
    factorised = graph.joint_factor.shape[0] == joints
    few = contacts <= MOST_CONTACTS and joints <= MOST_JOINTS and factorised
    return few and not (touch and is_plain(graph))


def fill_problem(graph, laws, ends, n, u, x, A, b, terms, r):
    """Write A of n rows with the joints eliminated, their impulses r, and b, without viscous
    friction. u: velocities, which include the impulses x; terms: absolute terms of b."""
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
    """Write the diagonal terms of viscous friction (slip per impulse) at the normal impulses r, and
    its bounds (infinite or 0); returns whether there is any."""
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
    """Copy rules and b of a problem; unilateral rows that are closed at the solution x become
    equalities, and open ones get b = inf."""
    for k in range(p.n):
        rules[k], b[k] = p.rules[k], p.b[k]
        if p.rules[k] == UNILATERAL and row_times(p, k, x) <= slow:
            rules[k] = EQUALITY
        elif p.rules[k] == UNILATERAL:
            b[k] = math.inf


def find_least(p, held, rules, b, x, work):
    """Replace x by the least solution of the laws linearised about x, until it no longer changes;
    rows that would pull are opened. Returns the number of undetermined unknowns, or -1 without
    convergence.

    held: p with the rules and b of `hold`, or p itself, which is then not written; work: n (2 n +
    7) numbers.
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
    """Residual of the laws at x, see complementarity.relative; work: 2 n numbers."""
    for k in range(p.n):
        work[k] = row_times(p, k, x)
    return relative(p, natural_map(p, x, work, part(work, p.n)), x)


def largest_change(p, x, other):
    """Largest difference of w between two solutions, relative to the largest A x."""
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
    """(largest change of w if a closed contact of the least solution x were open, row of that
    contact); (0, 0) if w does not change. other: n numbers; the rest as in `find_least`."""
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
    """Replace a solution x by the least one; returns (number of undetermined unknowns, result of
    `find_open` if `look`). slow: w that counts as zero."""
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
    """Replace x by a solution near it, or by any other one if there is none."""
    numbers = np.empty(p.n * (2 * p.n + 7))
    work = pointer(numbers)
    if find_least(p, p, p.rules, p.b, x, work) < 0 or misfit(p, x, work) > FINE:
        solution(p, terms, x)


def take_over(graph, u, x, joints, laws, ends, r):
    """Set the impulses of the rows laid out to r; update u and the impulses of the joints."""
    for m in range(r.shape[0]):
        k, taken = laws.used[m], r[m] * laws.units[m]
        add_impulse(graph.rows, k, u, ends[k, 0], ends[k, 1], taken - x[k])
        x[k] = taken
    relax_joints(graph, u, joints)


def solve_few(graph, u, x, joints, slow, length, look):
    """Solve a graph with `are_few` from the result of sweeps, with the least impulses.

    If contacts of a body contradict each other, such as corners that land together except for
    rounding, the laws are kept in the mean. slow: velocity that counts as zero; length: of the
    scene. Returns (natural map of the laws relative to the largest impulse, relative change of a
    velocity by other solutions if `look`, and a contact of these).
    """
    made = lay_out_graph(graph, length)
    n, m, laws, ends, r = made.n, made.m, made.laws, made.ends, made.r
    if n == 0:
        return 0.0, 0.0, 0
    relax_joints(graph, u, joints)
    alone, A, work = np.empty((n, n)), np.empty((n, n)), np.empty(2 * n)
    b, terms, step, slack = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    found = np.empty(n)
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
