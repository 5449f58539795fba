"""Small linear systems A x = b whose matrix is neither symmetric nor of full rank.

Friction makes them: the reaction of a slipping contact is not along the line that it enforces.
"""

from __future__ import annotations

import numpy as np

from rb_sim.compiler.lapack import singular_vectors, work_of_singular_vectors
from rb_sim.loops.compiled import part, pointer
from rb_sim.maths.jit import inline
from rb_sim.maths.rank import RANK_TOLERANCE


@inline
def solve_unsymmetric(A, b, x, L, order, columns, n):
    """Some solution of A x = b and the rank of A, by elimination with complete pivoting.

    A: (n, n), b, x: (n,); L: (n, n), order, columns: (n,) are work space.  Rows and columns that
    vanish are left out (x = 0 there).
    """
    for i in range(n):
        order[i], columns[i] = i, i
        size = 0.0
        for j in range(n):
            size = max(size, abs(A[i, j]))
        for j in range(n):
            L[i, j] = A[i, j] / size if size > 0.0 else 0.0
        x[i] = b[i] / size if size > 0.0 else 0.0
    rank = n
    for k in range(n):
        row, column, best = k, k, 0.0
        for i in range(k, n):
            for j in range(k, n):
                if abs(L[i, j]) > best:
                    row, column, best = i, j, abs(L[i, j])
        if not best > RANK_TOLERANCE:
            rank = k
            break
        if row != k:
            order[k], order[row] = order[row], order[k]
            x[k], x[row] = x[row], x[k]
            for j in range(n):
                L[k, j], L[row, j] = L[row, j], L[k, j]
        if column != k:
            columns[k], columns[column] = columns[column], columns[k]
            for i in range(n):
                L[i, k], L[i, column] = L[i, column], L[i, k]
        for i in range(k + 1, n):
            factor = L[i, k] / L[k, k]
            if factor != 0.0:
                for j in range(k + 1, n):
                    L[i, j] -= factor * L[k, j]
                x[i] -= factor * x[k]
    for i in range(rank - 1, -1, -1):
        s = x[i]
        for j in range(i + 1, rank):
            s -= L[i, j] * x[j]
        x[i] = s / L[i, i]
    for i in range(rank, n):
        x[i] = 0.0
    for i in range(n):
        L[0, columns[i]] = x[i]
    for i in range(n):
        x[i] = L[0, i]
    return rank


@inline
def least_norm(A, b, x, rank, n):
    """The solution of A x = b of least |x|, A of the given rank; NaN where they are not finite.

    Only the first n rows and columns count.
    """
    total = 0.0
    for i in range(n):
        total += b[i]
        for j in range(n):
            total += A[i, j]
    if not total - total == 0.0:
        for i in range(n):
            x[i] = total - total
        return
    room = np.empty(n * (3 * n + 1) + work_of_singular_vectors(n))
    a, right, left = pointer(room), part(pointer(room), n * n), part(pointer(room), 2 * n * n)
    s, work = part(pointer(room), 3 * n * n), part(pointer(room), n * (3 * n + 1))
    for i in range(n):
        for j in range(n):
            a[i * n + j] = A[i, j]
    singular_vectors(n, a, right, s, left, work)
    for i in range(n):
        x[i] = 0.0
    for k in range(rank):
        share = 0.0
        for i in range(n):
            share += left[k * n + i] * b[i]
        for i in range(n):
            x[i] += right[k * n + i] * share / s[k]
