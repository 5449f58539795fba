"""Elimination of a matrix of 6 x 6 blocks, one row and column of blocks for each body.

Bodies that share no contact share no block: the body with the fewest others left to share one with
goes first (least degree), so that few blocks are filled.  There are no pivots.
"""

from __future__ import annotations

from rb_sim.maths.jit import inline

SIZE = 6


@inline
def first_of_fewest(linked, done):
    """The body that is not done and is linked with the fewest that are not."""
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


@inline
def neighbours(linked, done, b, found):
    """The bodies not done that b is linked with into `found`, and linked with each other, as they
    are once b is eliminated; returns how many."""
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


@inline
def factorise_block(H, p):
    """H_pp = L U in place; False where a pivot is none."""
    for k in range(p, p + SIZE):
        if not abs(H[k, k]) > 0.0:
            return False
        for i in range(k + 1, p + SIZE):
            H[i, k] /= H[k, k]
            for j in range(k + 1, p + SIZE):
                H[i, j] -= H[i, k] * H[k, j]
    return True


@inline
def by_upper(H, q, p):
    """H_qp U^-1 of the factors of H_pp, in place."""
    for i in range(q, q + SIZE):
        for k in range(p, p + SIZE):
            s = H[i, k]
            for j in range(p, k):
                s -= H[i, j] * H[j, k]
            H[i, k] = s / H[k, k]


@inline
def by_lower(H, p, s):
    """L^-1 H_ps, in place."""
    for i in range(p + 1, p + SIZE):
        for k in range(p, i):
            f = H[i, k]
            for j in range(s, s + SIZE):
                H[i, j] -= f * H[k, j]


@inline
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


@inline
def eliminate(H, g, linked, order, done, found):
    """Solve H x = g in place of g; False where a pivot is none.

    linked: 1 for bodies whose block of H is not zero, shape (N, N); it gets what is filled.
    order, done, found: room, N integers each.
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


@inline
def substitute_back(H, g, linked, order, done):
    """U x = g in place of g; done: 1 for all bodies."""
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
