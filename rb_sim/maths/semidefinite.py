"""Linear systems A x = b with a symmetric positive semidefinite A, as constraints make them."""

from __future__ import annotations

import numpy as np

from rb_sim.maths.jit import inline
from rb_sim.maths.rank import RANK_TOLERANCE


@inline
def solve_semidefinite(A, b, x, L, order, n):
    """Some solution x of A x = b and the rank of A, by pivoted Cholesky on the scaled matrix.

    A: (n, n), b, x: (n,); L: (n, n) and order: (n,) are work space.  Rows that depend on others
    get x = 0; for a consistent b the product A x is unique all the same.  Nothing is allocated.
    """
    for i in range(n):
        order[i] = i
        for j in range(n):
            d = A[i, i] * A[j, j]
            L[i, j] = A[i, j] / d**0.5 if d > 0.0 else 0.0
    rank = n
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if L[i, i] > L[best, best]:
                best = i
        if not L[best, best] > RANK_TOLERANCE:
            rank = k
            break
        if best != k:
            order[k], order[best] = order[best], order[k]
            for j in range(n):
                L[k, j], L[best, j] = L[best, j], L[k, j]
            for j in range(n):
                L[j, k], L[j, best] = L[j, best], L[j, k]
        root = L[k, k] ** 0.5
        L[k, k] = root
        for i in range(k + 1, n):
            L[i, k] /= root
        for j in range(k + 1, n):
            for i in range(j, n):
                L[i, j] -= L[i, k] * L[j, k]
                L[j, i] = L[i, j]
    for i in range(rank):
        s = b[order[i]] / A[order[i], order[i]] ** 0.5
        for j in range(i):
            s -= L[i, j] * x[order[j]]
        x[order[i]] = s / L[i, i]
    for i in range(rank - 1, -1, -1):
        s = x[order[i]]
        for j in range(i + 1, rank):
            s -= L[j, i] * x[order[j]]
        x[order[i]] = s / L[i, i]
    for i in range(rank):
        x[order[i]] /= A[order[i], order[i]] ** 0.5
    for i in range(rank, n):
        x[order[i]] = 0.0
    return rank


@inline
def minimum_norm(A, x, rank):
    """The solution of least |x| among those with the same A x, for A of the given rank."""
    values, vectors = np.linalg.eigh(A)
    n = x.shape[0]
    kept = np.zeros(n)
    for k in range(n - rank, n):
        v = vectors[:, k]
        share = 0.0
        for i in range(n):
            share += v[i] * x[i]
        for i in range(n):
            kept[i] += share * v[i]
    for i in range(n):
        x[i] = kept[i]
