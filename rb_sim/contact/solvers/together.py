"""Both solvers in turns: Gauss-Seidel comes near from anywhere, Newton's method ends it."""

from __future__ import annotations

from rb_sim.contact.kernels import inner
from rb_sim.contact.solvers.gauss_seidel import LINES, gauss_seidel, is_plain, push
from rb_sim.contact.solvers.newton import delassus, newton, pushing

SPELL = 60
"""Sweeps before each call of Newton's method."""
MOST = 160
"""Contacts that push, above which no dense matrix is formed."""
ROUNDS = 6
"""Of Newton's method in one call."""


@inner
def take_over(graph, u, x, chosen, r):
    """Replace the impulses of the chosen contacts by r; u changes with them."""
    for m in range(chosen.shape[0]):
        i = chosen[m]
        for p in range(3):
            k = LINES * i + p
            push(graph.rows, k, u, graph.ends[i, 0], graph.ends[i, 1], r[3 * m + p] - x[k])
            x[k] = r[3 * m + p]


@inner
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
