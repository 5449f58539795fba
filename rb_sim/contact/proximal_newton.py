# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Newton's method in the velocities of the bodies, for heaps that sweeps do not solve.

Each contact law is made slightly compliant about the present impulses c (a proximal step;
Rockafellar 1976):

    v_n + (r_n - c_n) / s >= 0,  r_n >= 0,  product 0;  Coulomb's law between r_T and
    v_T + (r_T - c_T) / g

with the stiffness s = STIFF and the grip g, both relative to the contact's block of the Delassus
matrix. With many redundant contacts the impulses are not unique, and wedged heaps may have no
solution nearby: Newton's method then switches between sticking and sliding without end. With a grip
of SOFT or less it converges in a few rounds. The grip is then increased until the laws are kept
well enough, or as long as there is a solution. The compliance has no effect once the impulses no
longer change, so that bodies at rest do not creep. With the active set of the natural map (Alart
and Curnier 1991) the laws are linear, r = A - D v. Eliminated from the balance of momentum,

    (M + J^T D J) (u+ - u) = J^T (A - D v - r),

this has six unknowns per body, whatever the number of its contact points.
"""

from __future__ import annotations

import math

import numpy as np

from rb_sim.contact.gauss_seidel import add_contact_impulse, gauss_seidel, is_plain
from rb_sim.contact.problem import (
    BOUND,
    COMPLIANCE,
    CONTACT_ROWS,
    ENOUGH,
    RIGID,
    ROUGH,
    block_size,
    copy,
    copy_rows,
    lay_out_graph,
    rate_of,
    residual_of,
)
from rb_sim.mechanics.systems.many_bodies import INERTIA, MASS

# Elimination of a matrix of 6 x 6 blocks, with a row and a column of blocks for each body.
#
# Only bodies in contact with each other share a block. The body with the fewest remaining
# neighbours is eliminated first (minimum degree), so that few blocks are filled. No pivoting.


SIZE = 6


def first_of_fewest(linked, done):
    """The remaining body with the fewest remaining neighbours."""
    best, fewest = -1, linked.shape[0] + 1
    for b in range(linked.shape[0]):
        if done[b] == 1:
            continue
        links = 0
        for a in range(linked.shape[0]):
            if linked[b, a] == 1 and done[a] == 0:
                links += 1
        if links < fewest:
            best, fewest = b, links
    return best


def neighbours(linked, done, b, found):
    """Write the remaining neighbours of b to `found`, and link them with each other, as elimination
    of b does; returns their number."""
    n = 0
    for a in range(linked.shape[0]):
        if linked[b, a] == 1 and done[a] == 0:
            found[n] = a
            n += 1
    for i in range(n):
        for j in range(n):
            if i != j:
                linked[found[i], found[j]] = 1
    return n


def factorise_block(H, p):
    """H_pp = L U in place; returns False if a pivot is zero."""
    for k in range(p, p + SIZE):
        if not abs(H[k, k]) > 0.0:
            return False
        for i in range(k + 1, p + SIZE):
            H[i, k] /= H[k, k]
            for j in range(k + 1, p + SIZE):
                H[i, j] -= H[i, k] * H[k, j]
    return True


def by_upper(H, q, p):
    """H_qp U^-1 of the factors of H_pp, in place."""
    for i in range(q, q + SIZE):
        for k in range(p, p + SIZE):
            s = H[i, k]
            for j in range(p, k):
                s -= H[i, j] * H[j, k]
            H[i, k] = s / H[k, k]


def by_lower(H, p, s):
    """L^-1 H_ps, in place."""
    for i in range(p + 1, p + SIZE):
        for k in range(p, i):
            f = H[i, k]
            for j in range(s, s + SIZE):
                H[i, j] -= f * H[k, j]


def take_product(H, q, p, s):
    """H_qs -= H_qp H_ps, a row of H_qs at a time in registers."""
    for i in range(q, q + SIZE):
        h0, h1, h2 = H[i, s], H[i, s + 1], H[i, s + 2]
        h3, h4, h5 = H[i, s + 3], H[i, s + 4], H[i, s + 5]
        for k in range(p, p + SIZE):
            f = H[i, k]
            h0, h1, h2 = h0 - f * H[k, s], h1 - f * H[k, s + 1], h2 - f * H[k, s + 2]
            h3, h4, h5 = h3 - f * H[k, s + 3], h4 - f * H[k, s + 4], h5 - f * H[k, s + 5]
        H[i, s], H[i, s + 1], H[i, s + 2] = h0, h1, h2
        H[i, s + 3], H[i, s + 4], H[i, s + 5] = h3, h4, h5


def eliminate(H, g, linked, order, done, found):
    """Solve H x = g in place of g; returns False if a pivot is zero.

    linked: 1 for pairs of bodies whose block of H is not zero, (N, N); filled blocks are added.
    order, done, found: workspace, N integers each.
    """
    N = linked.shape[0]
    for b in range(N):
        done[b] = 0
    for turn in range(N):
        b = first_of_fewest(linked, done)
        order[turn], done[b] = b, 1
        n, p = neighbours(linked, done, b, found), SIZE * b
        if not factorise_block(H, p):
            return False
        for i in range(p + 1, p + SIZE):
            for k in range(p, i):
                g[i] -= H[i, k] * g[k]
        for m in range(n):
            by_lower(H, p, SIZE * found[m])
        for m in range(n):
            q = SIZE * found[m]
            by_upper(H, q, p)
            for o in range(n):
                take_product(H, q, p, SIZE * found[o])
            for i in range(q, q + SIZE):
                for k in range(p, p + SIZE):
                    g[i] -= H[i, k] * g[k]
    substitute_back(H, g, linked, order, done)
    return True


def substitute_back(H, g, linked, order, done):
    """Solve U x = g in place of g; done: 1 for all bodies."""
    N = linked.shape[0]
    for turn in range(N - 1, -1, -1):
        b = order[turn]
        p, done[b] = SIZE * b, 0
        for i in range(p + SIZE - 1, p - 1, -1):
            s = g[i]
            for j in range(i + 1, p + SIZE):
                s -= H[i, j] * g[j]
            for a in range(N):
                if linked[b, a] == 1 and done[a] == 0 and a != b:
                    for j in range(SIZE * a, SIZE * a + SIZE):
                        s -= H[i, j] * g[j]
            g[i] = s / H[i, i]


STIFF = 1e5
"""Normal stiffness of a proximal step relative to the contact's block, and the largest grip."""
SOFT, FIRMER = 1000.0, 10.0
"""The first grip, and the factor of its increase, or of its decrease without a solution."""
ROUNDS, STAGES, SWEEPS = 8, 12, 10
"""Maximum number of Newton rounds with one grip, of grips, and of sweeps before a smaller grip."""
FINER, HARDLY = 1e-2, 0.5
"""A proximal step is solved if its natural map is below ENOUGH. It is then refined to FINER times
the tolerance of the laws, or until a round reduces it by less than the factor HARDLY (rounding)."""
LOOSE = 1e-2
"""Natural map of the laws, relative to the largest impulse, above which a grip without a solution
is approached in smaller steps."""


def linear_laws(graph, made, x, c, grip, A, D):
    """Write A and D of r = A - D v for the active set at the impulses x, after `residual_of`; c:
    centres of the proximal step."""
    rules, blocks = graph.rules, graph.blocks
    for i in range(graph.ends.shape[0]):
        k, mu, size = CONTACT_ROWS * i, min(rules[i, BOUND], ROUGH), block_size(blocks, i)
        soft, slack, at = size / STIFF, size / grip, made.laws.place_of[CONTACT_ROWS * i]
        for j in range(3):
            A[i, j] = 0.0
        for j in range(9):
            D[i, j] = 0.0
        normal = x[k] - made.w[at] / size
        if normal <= 0.0:
            continue
        D[i, 0] = 1.0 / (soft + rules[i, COMPLIANCE])
        A[i, 0] = c[k] * soft * D[i, 0]
        if mu == 0.0:
            continue
        v1, v2 = made.w[at + 1], made.w[at + 2]
        y, z = x[k + 1] - v1 / size, x[k + 2] - v2 / size
        across = math.sqrt(y * y + z * z)
        if across <= mu * normal:  # sticks
            A[i, 1], A[i, 2] = c[k + 1], c[k + 2]
            D[i, 4] = D[i, 8] = 1.0 / slack
            continue
        p, q, bound = y / across, z / across, mu * normal
        A[i, 1], A[i, 2] = mu * p * A[i, 0], mu * q * A[i, 0]
        D[i, 3], D[i, 6] = mu * p * D[i, 0], mu * q * D[i, 0]
        slope = max(-(p * v1 + q * v2) / max(bound, 1e-300), 0.0)
        turning = 1.0 / (slope + slack)
        centre = slack * (p * c[k + 2] - q * c[k + 1]) * turning
        A[i, 1] -= q * centre
        A[i, 2] += p * centre
        D[i, 4] += q * q * turning
        D[i, 5] -= q * p * turning
        D[i, 7] -= q * p * turning
        D[i, 8] += p * p * turning


def fill_matrix(ends, rows, bodies, D, H, linked):
    """Write H = M + J^T D J; linked: 1 for pairs of bodies with an active contact."""
    for i in range(H.shape[0]):
        for j in range(H.shape[1]):
            H[i, j] = 0.0
    for b in range(bodies.shape[0]):
        o = 6 * b
        for j in range(3):
            H[o + j, o + j] = bodies[b, MASS]
            H[o + 3 + j, o + 3 + j] = bodies[b, INERTIA + j]
        H[o + 3, o + 4] = H[o + 4, o + 3] = bodies[b, INERTIA + 3]
        H[o + 3, o + 5] = H[o + 5, o + 3] = bodies[b, INERTIA + 4]
        H[o + 4, o + 5] = H[o + 5, o + 4] = bodies[b, INERTIA + 5]
        for a in range(bodies.shape[0]):
            linked[b, a] = 0
    T = np.empty((3, 12))
    for i in range(ends.shape[0]):
        if D[i, 0] == 0.0:
            continue
        k = CONTACT_ROWS * i
        if ends[i, 1] >= 0:
            linked[ends[i, 0], ends[i, 1]] = linked[ends[i, 1], ends[i, 0]] = 1
        for p in range(3):
            d0, d1, d2 = D[i, 3 * p], D[i, 3 * p + 1], D[i, 3 * p + 2]
            for j in range(12):
                T[p, j] = d0 * rows[k, j] + d1 * rows[k + 1, j] + d2 * rows[k + 2, j]
        for first in range(2):
            for second in range(2):
                b, a = ends[i, first], ends[i, second]
                if b < 0 or a < 0:
                    continue
                for m in range(6):
                    f0, f1 = rows[k, 6 * first + m], rows[k + 1, 6 * first + m]
                    f2, o = rows[k + 2, 6 * first + m], 6 * second
                    for j in range(6):
                        T_j = f0 * T[0, o + j] + f1 * T[1, o + j] + f2 * T[2, o + j]
                        H[6 * b + m, 6 * a + j] += T_j


def by_active_set(rows, targets, A, D, u, i, b, a):
    """The impulses A - D v of contact i at the velocities u."""
    k = CONTACT_ROWS * i
    v0 = rate_of(rows, k, u, b, a) - targets[k]
    v1 = rate_of(rows, k + 1, u, b, a) - targets[k + 1]
    v2 = rate_of(rows, k + 2, u, b, a) - targets[k + 2]
    return (
        A[i, 0] - D[i, 0] * v0 - D[i, 1] * v1 - D[i, 2] * v2,
        A[i, 1] - D[i, 3] * v0 - D[i, 4] * v1 - D[i, 5] * v2,
        A[i, 2] - D[i, 6] * v0 - D[i, 7] * v1 - D[i, 8] * v2,
    )


def add_misfit(ends, rows, targets, A, D, u, x, g):
    """g += J^T (A - D v - r)."""
    for i in range(ends.shape[0]):
        k, b, a = CONTACT_ROWS * i, ends[i, 0], ends[i, 1]
        f = by_active_set(rows, targets, A, D, u, i, b, a)
        d0, d1, d2 = f[0] - x[k], f[1] - x[k + 1], f[2] - x[k + 2]
        for j in range(6):
            g[6 * b + j] += d0 * rows[k, j] + d1 * rows[k + 1, j] + d2 * rows[k + 2, j]
        if a >= 0:
            for j in range(6):
                m = 6 + j
                g[6 * a + j] += d0 * rows[k, m] + d1 * rows[k + 1, m] + d2 * rows[k + 2, m]


def take_impulses(ends, rows, targets, A, D, u, x, moved):
    """x = A - D v at the velocities u + moved; u follows from x."""
    for b in range(u.shape[0]):
        for j in range(6):
            moved[b, j] += u[b, j]
    for i in range(ends.shape[0]):
        k, b, a = CONTACT_ROWS * i, ends[i, 0], ends[i, 1]
        f = by_active_set(rows, targets, A, D, moved, i, b, a)
        add_contact_impulse(rows, k, u, b, a, f[0] - x[k], f[1] - x[k + 1], f[2] - x[k + 2])
        x[k], x[k + 1], x[k + 2] = f[0], f[1], f[2]


def linearised(graph, made, u, x, c, grip, A, D):
    """Write the linear laws of a proximal step at (u, x); returns its natural map."""
    e = residual_of(graph, made, u, x, c, STIFF, grip)
    linear_laws(graph, made, x, c, grip, A, D)
    return e


def proximal_step(graph, bodies, made, u, x, c, grip, solved, enough, workspace):
    """Newton's method on one proximal step about c, from (u, x), until it is solved or the exact
    laws are kept to `enough`.

    Returns (its natural map relative to the impulses, that of the exact laws, rounds).
    """
    ends, rows, targets = graph.ends, graph.rows, graph.targets
    A, D, H, g, linked, order, done, found = workspace
    e = linearised(graph, made, u, x, c, grip, A, D)
    given = residual_of(graph, made, u, x, x, RIGID, RIGID) if not e > solved else 1e300
    last, rounds = 1e300, 0
    while e > solved and given > enough and rounds < ROUNDS and not ENOUGH > e > HARDLY * last:
        last = e
        fill_matrix(ends, rows, bodies, D, H, linked)
        for k in range(g.shape[0]):
            g[k] = 0.0
        add_misfit(ends, rows, targets, A, D, u, x, g)
        if not eliminate(H, g, linked, order, done, found):
            return 1e300, 1e300, rounds
        take_impulses(ends, rows, targets, A, D, u, x, g.reshape((-1, 6)))
        given = residual_of(graph, made, u, x, x, RIGID, RIGID)
        e = linearised(graph, made, u, x, c, grip, A, D)
        rounds += 1
    return e, given, rounds


def put_into_cones(graph, u, x):
    """Project the impulses of all contacts onto their friction cones, and update u: Newton's method
    leaves those of turning slips slightly outside."""
    for i in range(graph.ends.shape[0]):
        k, normal = CONTACT_ROWS * i, max(0.0, x[CONTACT_ROWS * i])
        across = math.sqrt(x[k + 1] * x[k + 1] + x[k + 2] * x[k + 2])
        bound = min(graph.rules[i, BOUND], ROUGH) * normal
        if x[k] < 0.0 or across > bound:
            share = bound / across - 1.0 if across > bound else 0.0
            d0, d1, d2 = normal - x[k], share * x[k + 1], share * x[k + 2]
            add_contact_impulse(graph.rows, k, u, graph.ends[i, 0], graph.ends[i, 1], d0, d1, d2)
            x[k], x[k + 1], x[k + 2] = normal, x[k + 1] + d1, x[k + 2] + d2


def proximal_newton(graph, bodies, u, x, enough):
    """Solve a graph with plain Coulomb friction (see is_plain), from the impulses x of some sweeps.

    x and u (velocities, which include x) change in place. enough: natural map of the exact laws,
    relative to the largest impulse, at which it ends. Returns (0 if that is reached, else the
    natural map with the largest grip that has a solution; that of the exact laws; rounds).
    """
    n, N = graph.ends.shape[0], bodies.shape[0]
    A, D = np.empty((n, 3)), np.empty((n, 9))
    linked, order = np.empty((N, N), np.int64), np.empty(N, np.int64)
    H, g, done, found = np.empty((6 * N, 6 * N)), np.empty(6 * N), order.copy(), order.copy()
    workspace = A, D, H, g, linked, order, done, found
    c, best_x, best_u = x.copy(), x.copy(), u.copy()
    least, given, rounds, grip, factor = 1e300, 1e300, 0, SOFT, FIRMER
    made = lay_out_graph(graph, 1.0)
    solved = min(ENOUGH, FINER * enough)
    for _ in range(STAGES):
        e, own, more = proximal_step(graph, bodies, made, u, x, c, grip, solved, enough, workspace)
        rounds += more
        if not own > enough or not e > ENOUGH:
            if own < given:
                least, given = e if own > enough else 0.0, own
                copy(best_x, x)
                copy_rows(best_u, u)
            if not given > enough:
                break
            if grip >= STIFF:  # remove the remaining compliance by new centres
                copy(c, x)
            grip = min(factor * grip, STIFF)
            continue
        copy(x, best_x)
        copy_rows(u, best_u)
        if least == 1e300:  # no solution yet: a smaller grip, after some sweeps
            grip /= FIRMER
            _, more = gauss_seidel(graph, u, x, np.empty(0), 1.0, 0.0, SWEEPS)
            rounds += more
            copy(c, x)
            copy(best_x, x)
            copy_rows(best_u, u)
        elif not given > LOOSE:
            break
        else:  # back by half, on a logarithmic scale
            factor = math.sqrt(factor)
            grip /= factor
    copy(x, best_x)
    copy_rows(u, best_u)
    put_into_cones(graph, u, x)
    given = residual_of(graph, made, u, x, x, RIGID, RIGID)
    least = given if least == 1e300 or given > LOOSE else least
    return least, given, rounds


NEAR_SPELLS, NEAR_SPELL = 5, 5
"""Maximum number of groups of sweeps of a moving heap before Newton's method, and sweeps in one."""
SPELL = 60
"""Number of sweeps before the first call of Newton's method in a heap at rest; it doubles before
each further call."""


def solve_exactly(graph, bodies, u, x, joints, size, tolerance, sweeps):
    """As `gauss_seidel`, with Newton's method between groups of sweeps, `sweeps` in all: sweeps
    converge from any start, Newton's method fast near the solution."""
    plain, spell, made, rest = is_plain(graph), SPELL, 0, 1.0
    while rest > tolerance and made < sweeps:
        if made > 0 and plain:
            proximal_newton(graph, bodies, u, x, 0.0)
        spell = min(2 * spell if made > 0 else SPELL, sweeps - made)
        rest, more = gauss_seidel(graph, u, x, joints, size, tolerance, spell)
        made += more
    return rest, made


def sweep_near(graph, u, x, enough):
    """Sweep until the natural map is at most `enough`, or until its rate of convergence shows that
    NEAR_SPELLS groups would not suffice.

    Returns (natural map of the laws relative to the largest impulse, number of sweeps).
    """
    rows = lay_out_graph(graph, 1.0)
    given, made, expected = residual_of(graph, rows, u, x, x, RIGID, RIGID), 0, 0.0
    for left in range(NEAR_SPELLS - 1, -1, -1):
        if not given > enough or expected > enough:
            break
        last = given
        _, more = gauss_seidel(graph, u, x, np.empty(0), 1.0, 0.0, NEAR_SPELL)
        given, made = residual_of(graph, rows, u, x, x, RIGID, RIGID), made + more
        expected = given * (given / last) ** left
    return given, made
