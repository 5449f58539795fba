# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Projected Gauss-Seidel on the contact graph: each contact in turn is solved exactly.

The velocities u of the bodies carry the coupling (Catto 2005), so that a sweep costs a fixed number
of operations per contact and no Delassus matrix is formed. The problem of one contact with friction
is solved exactly (Jourdan, Alart, Jean 1998), and so are all joints together. Sweeps alternate
forwards and backwards and start from the impulses of the previous step.
"""

from __future__ import annotations

import math

import numpy as np

from rb_sim.contact.problem import (
    BOUND,
    COMPLIANCE,
    CONTACT_ROWS,
    FORCE_A,
    LEAST,
    LIGHT_A,
    LIGHT_B,
    PULLS,
    ROLLS,
    ROUGH,
    SPINS,
    TURN_A,
    TURN_B,
    VISCOUS,
    VISCOUS_PER_NORMAL,
    add_impulse,
    coupled,
    largest,
    rate_of,
)
from rb_sim.numerics.rank import RANK_TOLERANCE

# The exact reaction of one contact by the laws of Signorini and Coulomb.
#
# With the block W of the Delassus matrix of the contact (normal, first and second tangent) and its
# velocity q without the reaction, u = W r + q, there are three cases (Bonnefon and Daviet 2011):
#
#     it opens    r = 0,  u_n >= 0
#     it sticks   u = 0,  |r_T| <= mu r_n
#     it slips    u_n = 0,  r_T = -u_T / lambda with lambda > 0,  |r_T| = mu r_n
#
# A slip requires the solution of one equation for lambda, by Newton's method inside a bracket.


ROUNDS = 100
"""Maximum number of Newton steps or bisections for lambda; bisection alone ends within them."""
EXACT = 1e-15
"""Largest distance of a reaction from its bound, relative to the reaction."""


def held_back(a, b, c, p, q, stiff):
    """-(S + stiff)^-1 (p, q) of the symmetric S = (a b; b c)."""
    a, c = a + stiff, c + stiff
    area = a * c - b * b
    return (b * q - c * p) / area, (b * p - a * q) / area


def on_bound(a, b, c, p, q, m0, m1, m2):
    """(x, y) = -(S + lambda)^-1 (p, q) with lambda >= 0 and |(x, y)| = m0 + m1 x + m2 y.

    Requires m0 > 0, and a vector beyond its bound for lambda = 0.
    """
    size = math.sqrt(p * p + q * q)
    if m1 == 0.0 and m2 == 0.0 and b == 0.0 and a == c:
        return -m0 * p / size, -m0 * q / size
    low, high = 0.0, size / m0
    for _ in range(ROUNDS):
        x, y = held_back(a, b, c, p, q, high)
        if math.sqrt(x * x + y * y) <= m0 + m1 * x + m2 * y:
            break
        low, high = high, 4.0 * high
    stiff = 0.5 * (low + high)
    x, y = held_back(a, b, c, p, q, stiff)
    for _ in range(ROUNDS):
        length = math.sqrt(x * x + y * y)
        over = length - (m0 + m1 * x + m2 * y)
        if abs(over) <= EXACT * length:
            break
        if over > 0.0:
            low = stiff
        else:
            high = stiff
        dx, dy = held_back(a, b, c, x, y, stiff)
        slope = (x * dx + y * dy) / length - (m1 * dx + m2 * dy) if length > 0.0 else 0.0
        stiff = stiff - over / slope if slope < 0.0 else high
        if not low < stiff < high:
            stiff = 0.5 * (low + high)
        if high - low <= EXACT * high:
            break
        x, y = held_back(a, b, c, p, q, stiff)
    return x, y


def within_circle(a, b, c, p, q, most):
    """(x, y) with S (x, y) + (p, q) = 0 if its size is at most `most`; else of that size, opposite
    to S (x, y) + (p, q)."""
    if not most > 0.0:
        return 0.0, 0.0
    x, y = held_back(a, b, c, p, q, 0.0)
    if x * x + y * y <= most * most:
        return x, y
    return on_bound(a, b, c, p, q, most, 0.0, 0.0)


def one_contact(w, q, mu, least):
    """The reaction (r_n, r_1, r_2) of a contact.

    w: its block (nn, n1, n2, 11, 12, 22), positive definite; q: velocity without the reaction;
    least: r_n, with which it opens.
    """
    if q[0] >= 0.0 and least == 0.0:
        return 0.0, 0.0, 0.0
    if least > 0.0:
        p1, p2, most = q[1] + w[1] * least, q[2] + w[2] * least, min(mu, ROUGH) * least
        x, y = within_circle(w[3], w[4], w[5], p1, p2, most)
        if q[0] + w[0] * least + w[1] * x + w[2] * y >= 0.0:
            return least, x, y
    m1, m2 = w[1] / w[0], w[2] / w[0]
    a, b, c = w[3] - w[1] * m1, w[4] - w[1] * m2, w[5] - w[2] * m2
    p1, p2 = q[1] - m1 * q[0], q[2] - m2 * q[0]
    if mu == 0.0:
        return -q[0] / w[0], 0.0, 0.0
    x, y = held_back(a, b, c, p1, p2, 0.0)
    normal = -q[0] / w[0] - m1 * x - m2 * y
    mu = min(mu, ROUGH)
    if normal >= 0.0 and x * x + y * y <= mu * mu * normal * normal:
        return normal, x, y
    x, y = on_bound(a, b, c, p1, p2, -mu * q[0] / w[0], -mu * m1, -mu * m2)
    return math.sqrt(x * x + y * y) / mu, x, y


# All joints together: their impulses for given impulses of the contacts.
#
# Joints that are solved in turn need hundreds of sweeps along a chain. Their block of the Delassus
# matrix is therefore factorised once per step, L D L^T in the order of the rows. Dependent rows get
# no impulse.


MOST_TOGETHER = 240
"""Largest number of joint rows whose block is factorised, at a cost of its cube."""
BODY, PARENT, LEFT_OUT = 0, 1, 2
"""Columns of Graph.joint_ends."""


def factor_joints(graph, bodies):
    """Write graph.joint_factor: L below its diagonal, 1 / D on it, or 0 for a dependent row."""
    rows, ends, F, diagonal = graph.joint_rows, graph.joint_ends, graph.joint_factor, graph.spare[0]
    w = np.zeros((bodies, 6))
    for k in range(F.shape[0]):
        add_impulse(rows, k, w, ends[k, BODY], ends[k, PARENT], 1.0)
        for i in range(k, F.shape[0]):
            F[i, k] = rate_of(rows, i, w, ends[i, BODY], ends[i, PARENT])
        for j in range(6):
            w[ends[k, BODY], j] = 0.0
            if ends[k, PARENT] >= 0:
                w[ends[k, PARENT], j] = 0.0
        diagonal[k] = F[k, k]
    for k in range(F.shape[0]):
        lost = ends[k, LEFT_OUT] != 0 or not F[k, k] > RANK_TOLERANCE * diagonal[k]
        inverse = 0.0 if lost else 1.0 / F[k, k]
        for i in range(k + 1, F.shape[0]):
            factor = F[i, k] * inverse
            if factor != 0.0:
                for j in range(k + 1, i + 1):
                    F[i, j] -= factor * F[j, k]
        for i in range(k + 1, F.shape[0]):
            F[i, k] *= inverse
        F[k, k] = inverse


def give_joints(graph, u, d):
    """Write the impulses of the joints that increase their rates by d to d; add them to u."""
    rows, ends, F = graph.joint_rows, graph.joint_ends, graph.joint_factor
    m = F.shape[0]
    for k in range(m):
        for i in range(k + 1, m):
            d[i] -= F[i, k] * d[k]
    for k in range(m - 1, -1, -1):
        d[k] *= F[k, k]
        for i in range(k + 1, m):
            d[k] -= F[i, k] * d[i]
    for k in range(m):
        add_impulse(rows, k, u, ends[k, BODY], ends[k, PARENT], d[k])


def relax_joints(graph, u, x):
    """Solve all joints together with given contact impulses; returns the largest change [N s]."""
    rows, ends, d, most = graph.joint_rows, graph.joint_ends, graph.spare[1], 0.0
    m = graph.joint_factor.shape[0]
    if m < rows.shape[0]:
        return sweep_joints(graph, u, x)
    for k in range(m):
        d[k] = graph.joint_targets[k] - rate_of(rows, k, u, ends[k, BODY], ends[k, PARENT])
    give_joints(graph, u, d)
    for k in range(m):
        x[k] += d[k]
        most = max(most, abs(d[k]))
    return most


def sweep_joints(graph, u, x):
    """Solve each row of the joints in turn; returns the largest change [N s]."""
    rows, ends, most = graph.joint_rows, graph.joint_ends, 0.0
    for k in range(rows.shape[0]):
        b, a = ends[k, BODY], ends[k, PARENT]
        own = coupled(rows, k, k, a)
        if own > 0.0:
            change = (graph.joint_targets[k] - rate_of(rows, k, u, b, a)) / own
            x[k] += change
            add_impulse(rows, k, u, b, a, change)
            most = max(most, abs(change))
    return most


def fill_block(graph, c):
    """Write the block of contact c of the Delassus matrix, with its compliance."""
    k, a, block = CONTACT_ROWS * c, graph.ends[c, 1], graph.blocks
    block[c, 0] = coupled(graph.rows, k, k, a) + graph.rules[c, COMPLIANCE]
    block[c, 1] = coupled(graph.rows, k, k + 1, a)
    block[c, 2] = coupled(graph.rows, k, k + 2, a)
    block[c, 3] = coupled(graph.rows, k + 1, k + 1, a)
    block[c, 4] = coupled(graph.rows, k + 1, k + 2, a)
    block[c, 5] = coupled(graph.rows, k + 2, k + 2, a)


def changed_to(graph, u, x, k, b, a, value):
    """Set the impulse of row k; returns the absolute change."""
    change = value - x[k]
    if change != 0.0:
        x[k] = value
        add_impulse(graph.rows, k, u, b, a, change)
    return abs(change)


def pair_of_rows(graph, u, x, k, b, a, most, give):
    """Solve two rows whose impulses have at most the norm `most`; returns the largest change.

    give: compliance of both rows.
    """
    rows = graph.rows
    A, B = coupled(rows, k, k, a) + give, coupled(rows, k, k + 1, a)
    C = coupled(rows, k + 1, k + 1, a) + give
    p = rate_of(rows, k, u, b, a) - graph.targets[k] + give * x[k] - A * x[k] - B * x[k + 1]
    q = rate_of(rows, k + 1, u, b, a) - graph.targets[k + 1] + give * x[k + 1]
    q -= B * x[k] + C * x[k + 1]
    if A * C - B * B <= 1e-14 * A * C or A + C == 0.0:  # one of them has no effect
        return 0.0
    v, w = within_circle(A, B, C, p, q, most)
    change = changed_to(graph, u, x, k, b, a, v)
    return max(change, changed_to(graph, u, x, k + 1, b, a, w))


def add_contact_impulse(rows, k, u, b, a, d0, d1, d2):
    """u += M^-1 J^T d of the rows k, k + 1 and k + 2, which share their bodies."""
    light = rows[k, LIGHT_B]
    for j in range(3):
        u[b, j] += light * (d0 * rows[k, j] + d1 * rows[k + 1, j] + d2 * rows[k + 2, j])
        m = TURN_B + j
        u[b, 3 + j] += d0 * rows[k, m] + d1 * rows[k + 1, m] + d2 * rows[k + 2, m]
    if a >= 0:
        light = rows[k, LIGHT_A]
        for j in range(3):
            m = FORCE_A + j
            u[a, j] += light * (d0 * rows[k, m] + d1 * rows[k + 1, m] + d2 * rows[k + 2, m])
            m = TURN_A + j
            u[a, 3 + j] += d0 * rows[k, m] + d1 * rows[k + 1, m] + d2 * rows[k + 2, m]


def relax_cone(ends, rows, targets, rules, blocks, u, x, c):
    """Solve normal force and Coulomb friction of contact c together; returns the largest change.

    It takes the arrays one by one, since a tuple of them would cost more than the arithmetic.
    """
    k, b, a = CONTACT_ROWS * c, ends[c, 0], ends[c, 1]
    r0, r1, r2 = x[k], x[k + 1], x[k + 2]
    q0, q1, q2 = rules[c, COMPLIANCE] * r0 - targets[k], -targets[k + 1], -targets[k + 2]
    for j in range(6):
        v = u[b, j]
        q0, q1, q2 = q0 + rows[k, j] * v, q1 + rows[k + 1, j] * v, q2 + rows[k + 2, j] * v
    if a >= 0:
        for j in range(6):
            v, m = u[a, j], 6 + j
            q0, q1, q2 = q0 + rows[k, m] * v, q1 + rows[k + 1, m] * v, q2 + rows[k + 2, m] * v
    w = (blocks[c, 0], blocks[c, 1], blocks[c, 2], blocks[c, 3], blocks[c, 4], blocks[c, 5])
    q0 -= w[0] * r0 + w[1] * r1 + w[2] * r2
    if rules[c, BOUND] == 0.0:
        n, y, z = max(rules[c, LEAST], -q0 / w[0]), r1, r2
    else:
        q1 -= w[1] * r0 + w[3] * r1 + w[4] * r2
        q2 -= w[2] * r0 + w[4] * r1 + w[5] * r2
        n, y, z = one_contact(w, (q0, q1, q2), rules[c, BOUND], rules[c, LEAST])
    d0, d1, d2 = n - r0, y - r1, z - r2
    change = max(abs(d0), max(abs(d1), abs(d2)))
    if change > 0.0:
        x[k], x[k + 1], x[k + 2] = n, y, z
        add_contact_impulse(rows, k, u, b, a, d0, d1, d2)
    return change


def viscosity_of(rules, c, normal):
    """Impulse per slip velocity of the viscous friction of contact c at a normal impulse."""
    return rules[c, VISCOUS_PER_NORMAL] * abs(normal) + rules[c, VISCOUS]


def relax_in_turn(graph, u, x, c, k, b, a):
    """Solve the normal force, then the friction, if N may be negative or friction is viscous."""
    rules = graph.rules
    missing = graph.targets[k] - rate_of(graph.rows, k, u, b, a) - rules[c, COMPLIANCE] * x[k]
    value = x[k] + missing / graph.blocks[c, 0]
    if rules[c, PULLS] == 0.0:
        value = max(rules[c, LEAST], value)
    change = changed_to(graph, u, x, k, b, a, value)
    if rules[c, BOUND] > 0.0:
        most = rules[c, BOUND] * abs(x[k]) if x[k] != 0.0 else 0.0
        return max(change, pair_of_rows(graph, u, x, k + 1, b, a, most, 0.0))
    viscous = viscosity_of(rules, c, x[k])
    if rules[c, BOUND] < 0.0 and viscous > 0.0:
        change = max(change, pair_of_rows(graph, u, x, k + 1, b, a, 1e300, 1.0 / viscous))
    elif rules[c, BOUND] < 0.0:
        change = max(change, changed_to(graph, u, x, k + 1, b, a, 0.0))
        change = max(change, changed_to(graph, u, x, k + 2, b, a, 0.0))
    return change


def relax(graph, u, x, c, size):
    """Solve contact c with given impulses of the others; returns the largest change [N s]."""
    rules = graph.rules
    if rules[c, PULLS] == 1.0 or rules[c, BOUND] < 0.0:
        change = relax_in_turn(graph, u, x, c, CONTACT_ROWS * c, graph.ends[c, 0], graph.ends[c, 1])
    else:
        change = relax_cone(graph.ends, graph.rows, graph.targets, rules, graph.blocks, u, x, c)
    if rules[c, ROLLS] > 0.0 or rules[c, SPINS] > 0.0:
        change = max(change, relax_turning(graph, u, x, c, size))
    return change


def relax_turning(graph, u, x, c, size):
    """Solve the torques against rolling and spinning of contact c; returns the largest change
    [N s]."""
    k, b, a = CONTACT_ROWS * c, graph.ends[c, 0], graph.ends[c, 1]
    rules, change = graph.rules, 0.0
    if rules[c, ROLLS] > 0.0:
        most = rules[c, ROLLS] * abs(x[k])
        change = max(change, pair_of_rows(graph, u, x, k + 3, b, a, most, 0.0) / size)
    if rules[c, SPINS] > 0.0:
        own, most = coupled(graph.rows, k + 5, k + 5, a), rules[c, SPINS] * abs(x[k])
        if own > 0.0:
            value = x[k + 5] - (rate_of(graph.rows, k + 5, u, b, a) - graph.targets[k + 5]) / own
            value = min(most, max(-most, value))
            change = max(change, changed_to(graph, u, x, k + 5, b, a, value) / size)
    return change


def is_plain(graph):
    """Whether the graph has only unilateral contacts with Coulomb friction."""
    plain = graph.joint_rows.shape[0] == 0
    for c in range(graph.ends.shape[0]):
        rules = graph.rules
        more = rules[c, PULLS] != 0.0 or rules[c, ROLLS] > 0.0 or rules[c, SPINS] > 0.0
        more = more or rules[c, LEAST] > 0.0
        plain = plain and not more and rules[c, BOUND] >= 0.0
    return plain


def gauss_seidel(graph, u, x, joints, size, tolerance, sweeps):
    """Sweep until no impulse changes by more than `tolerance` of the largest, or `sweeps` times.

    u: velocities, which include the impulses x and `joints`; all three change in place. size:
    length of the scene, which converts angular impulses to impulses [m]. Returns (largest change in
    the last sweep relative to the largest impulse, number of sweeps).
    """
    n, rest, made, plain = graph.ends.shape[0], 0.0, 0, is_plain(graph)
    ends, rows, targets = graph.ends, graph.rows, graph.targets
    rules, blocks = graph.rules, graph.blocks
    for made in range(1, sweeps + 1):
        change = relax_joints(graph, u, joints)
        for i in range(n):
            c = i if made % 2 == 1 else n - 1 - i
            if plain:
                change = max(change, relax_cone(ends, rows, targets, rules, blocks, u, x, c))
            else:
                change = max(change, relax(graph, u, x, c, size))
        most = max(largest(x), largest(joints))
        rest = change / most if most > 0.0 else 0.0
        if not rest > tolerance:
            break
    return rest, made
