# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Shares of a load that the laws leave open: the least ones.

Two flat pads that fingers press against a block determine the sum of the pressures at the corners
of each pad, but not their centre: the joints of the fingers carry any offset.  A table that stands
on four legs determines the loads of three.  Of what slips in several directions the friction, and
so the motion, depends on it.  As under event-driven contact (`impacts`) the
impulses taken are those of minimum norm among those that give all normals, and what sticks, the
same velocities.  With the joints eliminated these are W r + q of the impulses r of contacts.

Normal impulses of minimum norm and friction within the bound of these impulses are found in turns,
which keeps the shares (Haslinger 1983); sweeps over contacts, each with its own impulse, would
change them."""

from __future__ import annotations

import math

import numpy as np

from rb_sim.base.rounding import SOLVED, SOLVED_IN_CONTACT
from rb_sim.contact.contact_graph import (
    BOUND,
    COMPLIANCE,
    CONTACT_ROWS,
    ENOUGH,
    PULLS,
    ROLLS,
    SPINS,
    VISCOUS,
    VISCOUS_PER_NORMAL,
    add_impulse,
    largest,
    rate_of,
)
from rb_sim.contact.gauss_seidel import (
    PROXIMAL,
    give_joints,
    relax_joints,
    sweep_against_joints,
    take_motion,
    within_circle,
)
from rb_sim.numerics.kernels import inline

MOST_CONTACTS = 20
"""Contacts that bear up to which their least shares are found: it costs their cube."""
DEPENDENT = 1e-8
"""Remainder of a row of W after elimination, relative to its length, below which the row depends
on others: larger than the errors of joints (1e-9 of the length of the scene), smaller than the
effect of a mass ratio of a million."""
ROUNDS, TURNS, FRICTION_SWEEPS, SWEEPS = 4, 20, 100, 50
"""Of finding least shares and checking them by sweeps; turns of normal impulses and friction in
each; sweeps of friction in a turn; sweeps of the check."""
FAR = 1e3
"""Times the largest impulse that other shares are not followed beyond."""


@inline
def shares_load(graph, u, x, i, slow):
    """Whether contact i is rigid and bears or could: its normal impulse is an unknown."""
    rules, k = graph.rules, CONTACT_ROWS * i
    if rules[i, PULLS] != 0.0 or rules[i, COMPLIANCE] != 0.0:
        return False
    if rules[i, ROLLS] > 0.0 or rules[i, SPINS] > 0.0:
        return False
    rate = rate_of(graph.rows, k, u, graph.ends[i, 0], graph.ends[i, 1])
    return x[k] > 0.0 or rate - graph.targets[k] <= slow


@inline
def sharing(graph, u, x, slow):
    """Numbers of the contacts that share loads; none if they are too many."""
    found = 0
    chosen = np.zeros(graph.ends.shape[0], np.int64)
    for i in range(graph.ends.shape[0]):
        if shares_load(graph, u, x, i, slow):
            chosen[found] = i
            found += 1
    return chosen[: found if found <= MOST_CONTACTS else 0]


@inline
def eliminated(graph, u, x, chosen):
    """(W, r, v) of the chosen contacts: their Delassus matrix with joints that follow, impulses and
    velocities."""
    n, ends, joints = chosen.shape[0], graph.ends, graph.joint_rows.shape[0]
    W, r, v = np.empty((3 * n, 3 * n)), np.empty(3 * n), np.empty(3 * n)
    w, d, e = np.empty((u.shape[0], 6)), np.empty(joints), graph.joint_ends
    for m in range(3 * n):
        i, k = chosen[m // 3], CONTACT_ROWS * chosen[m // 3] + m % 3
        r[m] = x[k]
        v[m] = rate_of(graph.rows, k, u, ends[i, 0], ends[i, 1]) - graph.targets[k]
        for body in range(u.shape[0]):
            for j in range(6):
                w[body, j] = 0.0
        add_impulse(graph.rows, k, w, ends[i, 0], ends[i, 1], 1.0)
        for j in range(joints):
            d[j] = -rate_of(graph.joint_rows, j, w, e[j, 0], e[j, 1])
        give_joints(graph, w, d)
        for o in range(3 * n):
            i, k = chosen[o // 3], CONTACT_ROWS * chosen[o // 3] + o % 3
            W[o, m] = rate_of(graph.rows, k, w, ends[i, 0], ends[i, 1])
    return W, r, v


@inline
def friction_of(graph, i, W, r, v, k, slow):
    """(whether contact i sticks, friction along both tangents that goes with a normal impulse of
    1)."""
    mu = graph.rules[i, BOUND]
    if mu == 0.0:
        return False, 0.0, 0.0
    if mu < 0.0:
        per_normal = graph.rules[i, VISCOUS_PER_NORMAL]
        return False, -per_normal * v[k + 1], -per_normal * v[k + 2]
    slip = math.sqrt(v[k + 1] * v[k + 1] + v[k + 2] * v[k + 2])
    if slip <= slow + SOLVED_IN_CONTACT * (W[k + 1, k + 1] + W[k + 2, k + 2]) * r[k]:
        return True, 0.0, 0.0
    if r[k] > 0.0:
        return False, r[k + 1] / r[k], r[k + 2] / r[k]
    return False, -mu * v[k + 1] / slip, -mu * v[k + 2] / slip


@inline
def list_unknowns(graph, chosen, W, r, v, slow, rows, along):
    """Write the row of each unknown impulse, and the impulses along its contact's normal and both
    tangents that go with 1 of it; how many there are.  A contact that slips has one: its normal
    impulse, with the friction that goes with it."""
    n = 0
    for m in range(chosen.shape[0]):
        sticks, first, second = friction_of(graph, chosen[m], W, r, v, 3 * m, slow)
        for p in range(3 if sticks else 1):
            rows[n] = 3 * m + p
            for j in range(3):
                along[n, j] = 1.0 if j == p else 0.0
            if not sticks:
                along[n, 1], along[n, 2] = first, second
            n += 1
    return n


@inline
def fill_equations(W, r, v, rows, along, n, G, g):
    """G x = g: the unknowns with which the rows have no velocity; each row at length 1."""
    for o in range(n):
        s, g[o] = 0.0, -v[rows[o]]
        for m in range(n):
            first, G[o, m] = rows[m] - rows[m] % 3, 0.0
            for j in range(3):
                G[o, m] += W[rows[o], first + j] * along[m, j]
            g[o] += G[o, m] * r[rows[m]]
            s += G[o, m] * G[o, m]
        size = math.sqrt(s) if s > 0.0 else 1.0
        for m in range(n):
            G[o, m] /= size
        g[o] /= size


@inline
def least_with(G, g, n, fixed, x, Q, c, least):
    """Into least the x of minimum norm with G x = g, those that are fixed as they are; the number
    of free ones that the rows do not determine."""
    free, rank = 0, 0
    for m in range(n):
        least[m] = x[m] if fixed[m] else 0.0
        free += 0 if fixed[m] else 1
    for o in range(n):
        c[o] = g[o]
        for m in range(n):
            c[o] -= G[o, m] * least[m]
            Q[o, m] = 0.0 if fixed[m] else G[o, m]
    for _ in range(n):  # Gram and Schmidt, the row of which most is left first
        best, most = -1, DEPENDENT * DEPENDENT
        for o in range(rank, n):
            s = 0.0
            for m in range(n):
                s += Q[o, m] * Q[o, m]
            if s > most:
                best, most = o, s
        if best < 0:
            break
        size = math.sqrt(most)
        share = c[best] / size
        c[best] = c[rank]
        for m in range(n):
            q = Q[best, m] / size
            Q[best, m], Q[rank, m] = Q[rank, m], q
            least[m] += share * q
        for o in range(rank + 1, n):
            s = 0.0
            for m in range(n):
                s += Q[o, m] * Q[rank, m]
            c[o] -= s * share
            for m in range(n):
                Q[o, m] -= s * Q[rank, m]
        rank += 1
    return free - rank


@inline
def way_to_bound(mu, at, change):
    """Part of a change of an impulse in the cone of friction that is left in it."""
    a = change[1] ** 2 + change[2] ** 2 - (mu * change[0]) ** 2
    b = at[1] * change[1] + at[2] * change[2] - mu * mu * at[0] * change[0]
    c = min(0.0, at[1] ** 2 + at[2] ** 2 - (mu * at[0]) ** 2)
    root = math.sqrt(max(0.0, b * b - a * c))
    if b < 0.0:
        return (root - b) / a if a > 0.0 else 1.0
    return -c / (b + root) if b + root > 0.0 else 1.0


@inline
def step_within(graph, chosen, rows, n, x, least):
    """(part of the way from x to `least` on which all contacts push and stick, unknown of the
    contact that ends it, or -1)."""
    way, ends_it = 1.0, -1
    for m in range(n):
        if rows[m] % 3 != 0:
            continue
        limit, change = 1.0, least[m] - x[m]
        if x[m] + change < 0.0:
            limit = x[m] / -change
        if m + 1 < n and rows[m + 1] == rows[m] + 1:  # it sticks
            at, d = (x[m], x[m + 1], x[m + 2]), (change, least[m + 1] - x[m + 1], 0.0)
            d = (d[0], d[1], least[m + 2] - x[m + 2])
            limit = min(limit, way_to_bound(graph.rules[chosen[rows[m] // 3], BOUND], at, d))
        if limit < way:
            way, ends_it = limit, m
    return way, ends_it


@inline
def find_open(graph, chosen, W, r, rows, along, n, Q, rank, x, spare):
    """(largest change of a velocity that shares leave open, within the laws and relative to what
    impulses change of one, and the number of a contact whose normal impulse does it).

    Q: orthonormal rows that determine impulses, of `least_with`; spare: work, shape (n,).
    """
    most, found, largest_given = 0.0, 0, 0.0
    for o in range(r.shape[0]):
        given = 0.0
        for k in range(r.shape[0]):
            given += W[o, k] * r[k]
        largest_given = max(largest_given, abs(given))
    for j in range(n):
        for sign in range(-1, 2, 2):
            if rows[j] % 3 != 0:
                continue
            for m in range(n):
                way = 1.0 if m == j else 0.0
                for o in range(rank):
                    way -= Q[o, j] * Q[o, m]
                spare[m] = x[m] + (sign * FAR * largest(r) * way if abs(way) > DEPENDENT else 0.0)
            reach, _ = step_within(graph, chosen, rows, n, x, spare)
            for o in range(r.shape[0]):
                turned = 0.0
                for m in range(n):
                    first = rows[m] - rows[m] % 3
                    for k in range(3):
                        turned += W[o, first + k] * along[m, k] * (spare[m] - x[m])
                if reach * abs(turned) > most:
                    most, found = reach * abs(turned), chosen[rows[j] // 3]
    return (most / largest_given if most > SOLVED_IN_CONTACT * largest_given else 0.0), found


@inline
def even_out(graph, chosen, W, r, v, slow, first_time, look):
    """Let r be the least impulses with which no row has a velocity, and v follow: (largest change
    of one, what `find_open` finds if asked to look).  first_time: change nothing where all are
    determined.

    Where a contact would pull, or slip, on the way there it keeps what it then has.
    """
    rows, along = np.empty(r.shape[0], np.int64), np.empty((r.shape[0], 3))
    n, moved = list_unknowns(graph, chosen, W, r, v, slow, rows, along), 0.0
    G, Q, fixed = np.empty((n, n)), np.empty((n, n)), np.zeros(n, np.int64)
    now, least, g, c = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    figure, of = 0.0, 0
    fill_equations(W, r, v, rows, along, n, G, g)
    for m in range(n):
        now[m] = r[rows[m]]
    for turn in range(n):
        free = least_with(G, g, n, fixed, now, Q, c, least)
        if first_time and free == 0:
            break
        if look and turn == 0:
            figure, of = find_open(graph, chosen, W, r, rows, along, n, Q, n - free, now, c)
        way, ends_it = step_within(graph, chosen, rows, n, now, least)
        for m in range(n):
            now[m] += way * (least[m] - now[m])
        if ends_it < 0:
            break
        for m in range(n):
            if rows[m] // 3 == rows[ends_it] // 3:
                fixed[m] = 1
    for m in range(n):
        change, first = now[m] - r[rows[m]], rows[m] - rows[m] % 3
        moved = max(moved, abs(change))
        for j in range(3):
            change_of(W, r, v, first + j, change * along[m, j])
    return moved, figure, of


@inline
def change_of(W, r, v, k, change):
    """Add a change to impulse k, and what it gives to the velocities."""
    if change != 0.0:
        r[k] += change
        for o in range(v.shape[0]):
            v[o] += W[o, k] * change


@inline
def settle_friction(graph, chosen, W, r, v, settled):
    """Let friction obey its law for the normal impulses as they are."""
    for made in range(FRICTION_SWEEPS):
        change = 0.0
        for turn in range(chosen.shape[0]):
            m = turn if made % 2 == 0 else chosen.shape[0] - 1 - turn
            i, k = chosen[m], 3 * m + 1
            most, give = graph.rules[i, BOUND] * r[k - 1], 0.0
            if most < 0.0:
                viscous = graph.rules[i, VISCOUS_PER_NORMAL] * r[k - 1] + graph.rules[i, VISCOUS]
                most, give = 1e300, 1.0 / viscous if viscous > 0.0 else 0.0
            eased = PROXIMAL * (W[k, k] + W[k + 1, k + 1])
            if not eased > 0.0 or (most == 1e300 and give == 0.0):
                continue
            a, b, c = W[k, k] + eased + give, W[k, k + 1], W[k + 1, k + 1] + eased + give
            p = v[k] + give * r[k] - a * r[k] - b * r[k + 1]
            q = v[k + 1] + give * r[k + 1] - b * r[k] - c * r[k + 1]
            x, y = within_circle(a, b, c, p, q, most) if most > 0.0 else (0.0, 0.0)
            change = max(change, max(abs(x - r[k]), abs(y - r[k + 1])))
            dx, dy = x - r[k], y - r[k + 1]
            change_of(W, r, v, k, dx)
            change_of(W, r, v, k + 1, dy)
        if not change > settled:
            break


@inline
def take_over(graph, u, x, chosen, r):
    """Replace the impulses of the chosen contacts by r; u changes with them."""
    for m in range(chosen.shape[0]):
        i = chosen[m]
        for p in range(3):
            k = CONTACT_ROWS * i + p
            add_impulse(graph.rows, k, u, graph.ends[i, 0], graph.ends[i, 1], r[3 * m + p] - x[k])
            x[k] = r[3 * m + p]


@inline
def take_least_shares(graph, u, x, joints, size, slow, rest, look):
    """Let shares that laws leave open be the least ones, with friction that follows; after a
    solution has been found, whose last change was `rest`.

    Returns (largest change of the last sweep over the largest impulse, sweeps made, what
    `find_open` finds if asked to look).
    """
    made, figure, of = 0, 0.0, 0
    before, old_u, old_x, old_joints = rest, u.copy(), x.copy(), joints.copy()
    for count in range(ROUNDS):
        chosen, most = sharing(graph, u, x, slow), largest(x)
        if chosen.shape[0] < 2:
            break
        W, r, v = eliminated(graph, u, x, chosen)
        moved, open_now, at = even_out(graph, chosen, W, r, v, slow, True, look and count == 0)
        figure, of = (open_now, at) if count == 0 else (figure, of)
        if not moved > ENOUGH * most:
            break
        for _ in range(TURNS):
            settle_friction(graph, chosen, W, r, v, SOLVED * most)
            moved, _, _ = even_out(graph, chosen, W, r, v, slow, False, False)
            if not moved > SOLVED * most:
                break
        take_over(graph, u, x, chosen, r)
        relax_joints(graph, u, joints)
        rest, more = sweep_against_joints(graph, u, x, joints, size, ENOUGH, SWEEPS)
        made += more
    if rest > ENOUGH and rest > before:  # sweeps do not settle there: the solution found stands
        rest = before
        take_motion(u, x, joints, old_u, old_x, old_joints)
    return rest, made, figure, of
