"""The joints of a friction problem, all together: their impulses for the contacts as they are.

One after the other, as contacts are taken, joints need hundreds of sweeps along a chain.  Their own
block of the Delassus matrix is factorised once a step, L D L^T in the order of the lines; a line
that depends on others gets no impulse.  Where sweeps in turn with the contacts do not get there,
few joints follow each contact at once.
"""

from __future__ import annotations

import numpy as np

from rb_sim.contact.solvers.graph import LINES, coupled, push, rate_of
from rb_sim.maths.jit import inline
from rb_sim.maths.rank import RANK_TOLERANCE

MOST_TOGETHER = 240
"""Lines of joints up to which their block is factorised: it costs their cube."""
MOST_ELIMINATED = 60
"""Lines of joints up to which they follow each contact at once: a sweep costs their square a
contact, but contacts that push against joints, as of what a guide leads, need few of them."""
PROXIMAL = 0.001
"""Of the diagonal of a contact's own block, which is added to that with joints that follow."""
BODY, PARENT, LEFT_OUT = 0, 1, 2
"""Columns of Graph.joint_ends."""


@inline
def factor_joints(graph, bodies):
    """Fill graph.joint_factor: L below its diagonal, 1 / D on it, 0 there for no impulse."""
    rows, ends, F, diagonal = graph.joint_rows, graph.joint_ends, graph.joint_factor, graph.spare[0]
    w = np.zeros((bodies, 6))
    for k in range(F.shape[0]):
        push(rows, k, w, ends[k, BODY], ends[k, PARENT], 1.0)
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


@inline
def eliminates(graph):
    """Whether joints may follow each contact at once, instead of in turn with all contacts."""
    m = graph.joint_rows.shape[0]
    return 0 < m <= MOST_ELIMINATED and graph.joint_factor.shape[0] == m


@inline
def ease_blocks(graph, bodies):
    """Let the own block of each contact be that with joints which follow,
    W_cc - W_cj W_jj^-1 W_jc, and PROXIMAL of its diagonal, which leaves no direction that is held
    without an entry; after `factor_joints`."""
    rows, ends, d, w = graph.rows, graph.ends, graph.spare[1], np.zeros((bodies, 6))
    for c in range(ends.shape[0]):
        k, b, a, at = LINES * c, ends[c, 0], ends[c, 1], 0
        for p in range(3):
            own = coupled(rows, k + p, k + p, a)
            push(rows, k + p, w, b, a, 1.0)
            for j in range(graph.joint_rows.shape[0]):
                e = graph.joint_ends
                d[j] = -rate_of(graph.joint_rows, j, w, e[j, BODY], e[j, PARENT])
            give_joints(graph, w, d)
            for q in range(p, 3):
                less = rate_of(rows, k + q, w, b, a) - coupled(rows, k + p, k + q, a)
                graph.blocks[c, at] += less + (PROXIMAL * own if p == q else 0.0)
                at += 1
            for i in range(bodies):
                for j in range(6):
                    w[i, j] = 0.0


@inline
def give_joints(graph, u, d):
    """Give the joints the impulses by which their rates become d higher, into d and u."""
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
        push(rows, k, u, ends[k, BODY], ends[k, PARENT], d[k])


@inline
def relax_joints(graph, u, x):
    """Let all joints hold at once, with the contacts as they are; the largest change [N s]."""
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


@inline
def sweep_joints(graph, u, x):
    """Let each line of the joints hold in turn; the largest change [N s]."""
    rows, ends, most = graph.joint_rows, graph.joint_ends, 0.0
    for k in range(rows.shape[0]):
        b, a = ends[k, BODY], ends[k, PARENT]
        own = coupled(rows, k, k, a)
        if own > 0.0:
            change = (graph.joint_targets[k] - rate_of(rows, k, u, b, a)) / own
            x[k] += change
            push(rows, k, u, b, a, change)
            most = max(most, abs(change))
    return most
