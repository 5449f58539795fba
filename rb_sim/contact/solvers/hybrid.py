"""Both solvers in turns: Gauss-Seidel comes near from anywhere, Newton's method ends it."""

from __future__ import annotations

import numpy as np

from rb_sim.contact.solvers.gauss_seidel import (
    ease_blocks,
    eliminates,
    fill_block,
    gauss_seidel,
    is_plain,
    sweep,
)
from rb_sim.contact.solvers.graph import LINES, push
from rb_sim.contact.solvers.newton import delassus, newton, pushing
from rb_sim.contact.solvers.proximal_newton import own_map
from rb_sim.numerics.kernels import inline

SPELL = 60
"""Sweeps before each call of Newton's method."""
MOST = 160
"""Contacts that push, above which no dense matrix is formed."""
ROUNDS = 6
"""Of Newton's method in one call."""
NEAR_SPELLS, NEAR_SPELL = 5, 5
"""Spells of sweeps of a moving heap that are worth their time before Newton's method in the
velocities of its bodies, and sweeps in one."""


@inline
def take_over(graph, u, x, chosen, r):
    """Replace the impulses of the chosen contacts by r; u changes with them."""
    for m in range(chosen.shape[0]):
        i = chosen[m]
        for p in range(3):
            k = LINES * i + p
            push(graph.rows, k, u, graph.ends[i, 0], graph.ends[i, 1], r[3 * m + p] - x[k])
            x[k] = r[3 * m + p]


@inline
def solve_exactly(graph, u, x, joints, size, settled, sweeps):
    """As `gauss_seidel`, with Newton's method between spells of at most `sweeps` sweeps in all."""
    plain, spell, made, rest = is_plain(graph), SPELL, 0, 1.0
    while rest > settled and made < sweeps:
        if made > 0 and plain:
            chosen = pushing(graph, x)
            if chosen.shape[0] <= MOST:
                W, q, mu, r = delassus(graph, u, x, chosen)
                r, _ = newton(W, q, mu, r, ROUNDS, settled)
                take_over(graph, u, x, chosen, r)
        spell = min(2 * spell if made > 0 else SPELL, sweeps - made)
        rest, more = gauss_seidel(graph, u, x, joints, size, settled, spell)
        made += more
    return rest, made


@inline
def sweep_against_joints(graph, u, x, joints, size, enough, sweeps):
    """As `gauss_seidel`; where that does not get there, as where push and friction work against a
    joint, again with joints that follow each contact at once: taken if they do get there."""
    rest, made = gauss_seidel(graph, u, x, joints, size, enough, sweeps)
    if not (rest > enough and eliminates(graph)):
        return rest, made
    v, r, s, n = u.copy(), x.copy(), joints.copy(), graph.ends.shape[0]
    ease_blocks(graph, u.shape[0])
    found, more = sweep(graph, v, r, s, size, enough, sweeps, True)
    for i in range(n):
        fill_block(graph, i)
    if not found > enough:
        rest = found
        for i in range(u.shape[0]):
            for j in range(6):
                u[i, j] = v[i, j]
        for k in range(x.shape[0]):
            x[k] = r[k]
        for k in range(joints.shape[0]):
            joints[k] = s[k]
    return rest, made + more


@inline
def sweep_near(graph, u, x, enough):
    """Spells of sweeps until x is as near to the laws as `enough`, given up when the last one tells
    that NEAR_SPELLS of them would not do.

    Returns (natural map of the laws over the largest impulse, sweeps made).
    """
    A, D = np.empty((graph.ends.shape[0], 3)), np.empty((graph.ends.shape[0], 9))
    given, made, expected = own_map(graph, u, x, A, D), 0, 0.0
    for left in range(NEAR_SPELLS - 1, -1, -1):
        if not given > enough or expected > enough:
            break
        last = given
        _, more = gauss_seidel(graph, u, x, np.empty(0), 1.0, 0.0, NEAR_SPELL)
        given, made = own_map(graph, u, x, A, D), made + more
        expected = given * (given / last) ** left
    return given, made
