"""Shares of a load that the laws leave open, where joints carry the difference: the least ones.

Two flat pads that fingers press against a block determine the sum of the pressures at the corners
of each pad, but not their centre: the joints of the fingers carry any offset.  Of a block that slips
the friction, and so the motion, depends on it.  As under event-driven contact (`impacts`) the
impulses taken are those of minimum norm among those that give all normals, and what sticks, the same
velocities.  With the joints eliminated these velocities are G x of the impulses x of contacts that
bear; a contact that slips has one unknown, its push with the friction that goes with it.
"""

from __future__ import annotations

import math

import numpy as np

from rb_sim.contact.solvers.gauss_seidel import give_joints, relax_joints
from rb_sim.contact.solvers.graph import (
    BOUND,
    GIVE,
    LINES,
    PULLS,
    ROLLS,
    SPINS,
    VISCOUS_PER_PUSH,
    largest,
    push,
    rate_of,
)
from rb_sim.contact.solvers.hybrid import sweep_against_joints
from rb_sim.numerics.kernels import inline

MOST_UNKNOWNS = 60
"""Unknown impulses up to which their least shares are found: it costs their cube."""
DEPENDENT = 1e-8
"""What is left of a line of G, relative to its length, that depends on others: above what is left
of joints (1e-9 of the scene's length), below what a mass ratio of a million makes."""
ROUNDS, SWEEPS = 8, 50
"""Of finding least shares and sweeping until friction follows; sweeps in each."""
LEAST = 1e-9
"""Change of an impulse, relative to the largest, at which shares are the least."""
AT_BOUND = 1e-9
"""Part of the bound of friction by which a contact that sticks is inside it."""


@inline
def shares_load(graph, u, x, i, slow):
    """Whether contact i is rigid and bears or could: its push is an unknown."""
    rules, k = graph.rules, LINES * i
    if rules[i, PULLS] != 0.0 or rules[i, GIVE] != 0.0:
        return False
    if rules[i, ROLLS] > 0.0 or rules[i, SPINS] > 0.0:
        return False
    rate = rate_of(graph.rows, k, u, graph.ends[i, 0], graph.ends[i, 1])
    return x[k] > 0.0 or rate - graph.targets[k] <= slow


@inline
def friction_of(graph, u, x, i, slow):
    """(whether contact i sticks, friction along both tangents that goes with a push of 1)."""
    k, b, a = LINES * i, graph.ends[i, 0], graph.ends[i, 1]
    mu, push_of = graph.rules[i, BOUND], x[k]
    if mu == 0.0:
        return False, 0.0, 0.0
    s1 = rate_of(graph.rows, k + 1, u, b, a) - graph.targets[k + 1]
    s2 = rate_of(graph.rows, k + 2, u, b, a) - graph.targets[k + 2]
    if mu < 0.0:
        per_push = graph.rules[i, VISCOUS_PER_PUSH]
        return False, -per_push * s1, -per_push * s2
    across = math.sqrt(x[k + 1] * x[k + 1] + x[k + 2] * x[k + 2])
    if push_of > 0.0 and across >= (1.0 - AT_BOUND) * mu * push_of:
        return False, x[k + 1] / push_of, x[k + 2] / push_of
    slip = math.sqrt(s1 * s1 + s2 * s2)
    if push_of > 0.0 or slip <= slow:
        return True, 0.0, 0.0
    return False, -mu * s1 / slip, -mu * s2 / slip


@inline
def list_unknowns(graph, u, x, slow, lines, along):
    """Write the line of each unknown impulse, and the impulses along the normal and both tangents
    that go with 1 of it; how many there are, or -1 if they are too many."""
    n = 0
    for i in range(graph.ends.shape[0]):
        if not shares_load(graph, u, x, i, slow):
            continue
        sticks, first, second = friction_of(graph, u, x, i, slow)
        count = 3 if sticks else 1
        if n + count > MOST_UNKNOWNS:
            return -1
        for p in range(count):
            lines[n] = LINES * i + p
            for j in range(3):
                along[n, j] = 1.0 if j == p else 0.0
            if not sticks:
                along[n, 1], along[n, 2] = first, second
            n += 1
    return n


@inline
def push_unknown(graph, u, line, along, m, size):
    """Push `size` of unknown m into u."""
    i = line // LINES
    for j in range(3):
        if along[m, j] != 0.0:
            b, a = graph.ends[i, 0], graph.ends[i, 1]
            push(graph.rows, LINES * i + j, u, b, a, size * along[m, j])


@inline
def fill_lines(graph, lines, along, n, bodies, G):
    """G: change of the rates of the lines by 1 of each unknown, with joints that follow; each line
    at length 1."""
    w, d, ends = np.zeros((bodies, 6)), np.empty(graph.joint_rows.shape[0]), graph.joint_ends
    for m in range(n):
        for i in range(bodies):
            for j in range(6):
                w[i, j] = 0.0
        push_unknown(graph, w, lines[m], along, m, 1.0)
        for k in range(d.shape[0]):
            d[k] = -rate_of(graph.joint_rows, k, w, ends[k, 0], ends[k, 1])
        give_joints(graph, w, d)
        for r in range(n):
            i = lines[r] // LINES
            G[r, m] = rate_of(graph.rows, lines[r], w, graph.ends[i, 0], graph.ends[i, 1])
    for r in range(n):
        s = 0.0
        for m in range(n):
            s += G[r, m] * G[r, m]
        for m in range(n):
            G[r, m] = G[r, m] / math.sqrt(s) if s > 0.0 else 0.0


@inline
def least_with(G, n, fixed, x, Q, least):
    """Into least the x of minimum norm with the same G x, those that are fixed as they are; the
    number of free ones that lines do not determine."""
    free, rank = 0, 0
    for m in range(n):
        least[m] = x[m] if fixed[m] else 0.0
        free += 0 if fixed[m] else 1
    for r in range(n):
        for m in range(n):
            Q[r, m] = 0.0 if fixed[m] else G[r, m]
    for _ in range(n):  # Gram and Schmidt, the line of which most is left first
        best, most = -1, DEPENDENT * DEPENDENT
        for r in range(rank, n):
            s = 0.0
            for m in range(n):
                s += Q[r, m] * Q[r, m]
            if s > most:
                best, most = r, s
        if best < 0:
            break
        size = math.sqrt(most)
        for m in range(n):
            q = Q[best, m] / size
            Q[best, m], Q[rank, m] = Q[rank, m], q
        share = 0.0
        for m in range(n):
            share += Q[rank, m] * x[m]
        for m in range(n):
            least[m] += share * Q[rank, m]
        for r in range(rank + 1, n):
            s = 0.0
            for m in range(n):
                s += Q[r, m] * Q[rank, m]
            for m in range(n):
                Q[r, m] -= s * Q[rank, m]
        rank += 1
    return free - rank


@inline
def step_within(graph, lines, n, x, least):
    """(part of the way from x to `least` on which all contacts push and stick, unknown of the
    contact that ends it, or -1)."""
    way, ends_it = 1.0, -1
    for m in range(n):
        if lines[m] % LINES != 0:
            continue
        change = least[m] - x[m]
        if x[m] + way * change < 0.0:
            way, ends_it = max(0.0, -x[m] / change), m
        if m + 1 >= n or lines[m + 1] != lines[m] + 1:  # it slips
            continue
        mu, y, z = graph.rules[lines[m] // LINES, BOUND], x[m + 1], x[m + 2]
        d, e = least[m + 1] - y, least[m + 2] - z
        push_of = mu * (x[m] + way * change)
        y, z = y + way * d, z + way * e
        if y * y + z * z > push_of * push_of:
            limit = way_to_bound(mu, (x[m], x[m + 1], x[m + 2]), (change, d, e))
            if limit < way:
                way, ends_it = limit, m
    return way, ends_it


@inline
def way_to_bound(mu, at, change):
    """Part of a change of an impulse in the cone of friction that is left in it."""
    a = change[1] ** 2 + change[2] ** 2 - (mu * change[0]) ** 2
    b = at[1] * change[1] + at[2] * change[2] - mu * mu * at[0] * change[0]
    c = min(0.0, at[1] ** 2 + at[2] ** 2 - (mu * at[0]) ** 2)
    root = math.sqrt(max(0.0, b * b - a * c))
    if b + root <= 0.0:
        return 1.0
    return -c / (b + root)


@inline
def even_out(graph, u, x, joints, slow):
    """Let the shares that are open be the least ones; the largest change over the largest impulse.

    Where a contact would pull, or slip, on the way there it keeps what it then has.
    """
    lines, along = np.empty(MOST_UNKNOWNS, np.int64), np.empty((MOST_UNKNOWNS, 3))
    n = list_unknowns(graph, u, x, slow, lines, along)
    if n < 2:
        return 0.0
    G, Q, fixed = np.empty((n, n)), np.empty((n, n)), np.zeros(n, np.int64)
    now, start, least = np.empty(n), np.empty(n), np.empty(n)
    fill_lines(graph, lines, along, n, u.shape[0], G)
    for m in range(n):
        now[m] = x[lines[m]]
        start[m] = now[m]
    for _ in range(n):
        if least_with(G, n, fixed, now, Q, least) == 0:
            break
        way, ends_it = step_within(graph, lines, n, now, least)
        for m in range(n):
            now[m] += way * (least[m] - now[m])
        if ends_it < 0:
            break
        for m in range(n):
            if lines[m] // LINES == lines[ends_it] // LINES:
                fixed[m] = 1
    most, moved = largest(x), 0.0
    for m in range(n):
        moved = max(moved, abs(now[m] - start[m]))
    if not moved > LEAST * most:
        return 0.0
    for m in range(n):
        change = now[m] - start[m]
        push_unknown(graph, u, lines[m], along, m, change)
        for j in range(3):
            x[lines[m] - lines[m] % LINES + j] += change * along[m, j]
    relax_joints(graph, u, joints)
    return moved / most


@inline
def take_least_shares(graph, u, x, joints, size, slow, rest, enough):
    """Let shares that laws leave open be the least ones, with friction that follows; after a
    solution has been found, whose last change was `rest`.

    Returns (largest change of the last sweep over the largest impulse, sweeps made).
    """
    made = 0
    for _ in range(ROUNDS):
        if not even_out(graph, u, x, joints, slow) > 0.0:
            break
        rest, more = sweep_against_joints(graph, u, x, joints, size, enough, SWEEPS)
        made += more
    return rest, made
