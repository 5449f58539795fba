# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Small linear systems: least squares of any rank, symmetric semidefinite, unsymmetric."""

from __future__ import annotations

import numpy as np

from rb_sim.numerics.kernels import part, pointer
from rb_sim.numerics.rank import LEAST_SINGULAR, RANK_TOLERANCE

# The x of minimum norm among those with the least |A x - b|, for small square matrices of any rank,
# by a complete orthogonal decomposition A P = Q (T 0; 0 0) Z^T (Golub and Van Loan, Matrix
# Computations, section 5.5) with Householder reflections I - 2 v v^T / |v|^2; a tenth of the cost
# of a singular value decomposition.
#
# Matrices are vectors of their rows, one after another.


def column_size(R, n, k, j):
    """Norm of column j from row k on."""
    s = 0.0
    for i in range(k, n):
        s += R[i * n + j] * R[i * n + j]
    return s**0.5


def reflect_columns(R, n, k, c):
    """Householder reflection that zeroes column k of R below row k, applied to the later columns
    and c.

    The entries of column k below row k are invalid afterwards.
    """
    if column_size(R, n, k + 1, k) == 0.0:
        return
    size = column_size(R, n, k, k)
    if R[k * n + k] > 0.0:
        size = -size
    head = R[k * n + k] - size
    R[k * n + k] = head  # the column is v now, |v|^2 = -2 size head
    for j in range(k + 1, n):
        s = 0.0
        for i in range(k, n):
            s += R[i * n + k] * R[i * n + j]
        s /= size * head
        for i in range(k, n):
            R[i * n + j] += s * R[i * n + k]
    s = 0.0
    for i in range(k, n):
        s += R[i * n + k] * c[i]
    s /= size * head
    for i in range(k, n):
        c[i] += s * R[i * n + k]
    R[k * n + k] = size


def triangular(R, n, c, order, least):
    """Triangular factor R of A P = Q R in place of A, Q^T c in place of c, P in order; returns the
    rank.

    The rank counts pivot columns longer than `least` times the longest one.
    """
    largest = 0.0
    for j in range(n):
        order[j] = j
    for k in range(n):
        best, most = k, -1.0
        for j in range(k, n):
            size = column_size(R, n, k, j)
            if size > most:
                best, most = j, size
        largest = max(largest, most)
        if not most > least * largest:
            return k
        if best != k:
            order[k], order[best] = order[best], order[k]
            for i in range(n):
                R[i * n + k], R[i * n + best] = R[i * n + best], R[i * n + k]
        reflect_columns(R, n, k, c)
    return n


def reflect_row(R, n, rank, k, v):
    """Householder reflection that zeroes row k of R from column `rank` on, applied to the rows
    above.

    v[k]: first component of the reflection's direction, the others stay in the row; returns |v|^2 /
    2.
    """
    size = 0.0
    for j in range(rank, n):
        size += R[k * n + j] * R[k * n + j]
    if size == 0.0:
        v[k] = 0.0
        return 1.0
    size += R[k * n + k] * R[k * n + k]
    size = -(size**0.5) if R[k * n + k] > 0.0 else size**0.5
    head = R[k * n + k] - size
    for i in range(k):
        s = head * R[i * n + k]
        for j in range(rank, n):
            s += R[k * n + j] * R[i * n + j]
        s /= size * head
        R[i * n + k] += s * head
        for j in range(rank, n):
            R[i * n + j] += s * R[k * n + j]
    R[k * n + k] = size
    v[k] = head
    return -size * head


def least_squares(A, b, n, x, work):
    """Write the solution into x; A and b must be finite; work: n (n + 4) numbers."""
    copy_system(A, b, n, work)
    decomposed(work, part(work, n * n), n, n, LEAST_SINGULAR, part(work, n * (n + 1)), x)


def of_rank(A, b, n, rank, x, work):
    """As `least_squares`, for a matrix of known rank; NaN if A or b is not finite."""
    total = 0.0
    for i in range(n):
        total += b[i]
    for i in range(n * n):
        total += A[i]
    if not total - total == 0.0:
        for i in range(n):
            x[i] = total - total
        return
    copy_system(A, b, n, work)
    decomposed(work, part(work, n * n), n, rank, 0.0, part(work, n * (n + 1)), x)


def copy_system(A, b, n, work):
    """Copy A, then b, into the workspace."""
    for i in range(n * n):
        work[i] = A[i]
    for i in range(n):
        work[n * n + i] = b[i]


def decomposed(R, c, n, most, least, work, x):
    """As `least_squares`, overwriting R = A and c = b; most: largest rank; least: see
    `triangular`.  Returns the rank."""
    order, v, halves = work, part(work, n), part(work, 2 * n)
    rank = min(triangular(R, n, c, order, least), most)
    for k in range(rank - 1, -1, -1):
        halves[k] = reflect_row(R, n, rank, k, v) if rank < n else 0.0
    for i in range(rank - 1, -1, -1):
        for j in range(i + 1, rank):
            c[i] -= R[i * n + j] * c[j]
        c[i] /= R[i * n + i]
    for i in range(rank, n):
        c[i] = 0.0
    if rank < n:
        for k in range(rank):
            s = v[k] * c[k]
            for j in range(rank, n):
                s += R[k * n + j] * c[j]
            s /= halves[k]
            c[k] -= s * v[k]
            for j in range(rank, n):
                c[j] -= s * R[k * n + j]
    for j in range(n):
        x[int(order[j])] = c[j]
    return rank


# Linear systems A x = b with a symmetric positive semidefinite A, as from constraints.


def solve_semidefinite(A, b, x, L, order, n):
    """A solution x of A x = b, by pivoted Cholesky on the scaled matrix; returns the rank of A.

    A: (n, n), b, x: (n,); L: (n, n) and order: (n,) are workspace. Dependent rows get x = 0; for a
    consistent b the product A x is unique nevertheless. Nothing is allocated.
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


# Small linear systems A x = b with an unsymmetric matrix, possibly rank deficient, as from
# friction: the reaction of a slipping contact is not along its constraint row.


def solve_unsymmetric(A, b, x, L, columns, n):
    """A solution of A x = b, by elimination with complete pivoting; returns the rank of A.

    A: (n, n), b, x: (n,); L: (n, n), columns: (n,) are workspace. Rows and columns that vanish are
    omitted (x = 0 there). Reflections would cost as much, but mix small numbers of one row with
    large ones of another: a slip that begins would lose its direction.
    """
    for i in range(n):
        columns[i] = i
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


def least_norm(A, b, x, rank, n):
    """The minimum-norm solution of A x = b for A of the given rank; NaN if A or b is not finite.

    Only the first n rows and columns are used.
    """
    workspace = np.empty(n * (2 * n + 4))
    square, work = pointer(workspace), part(pointer(workspace), n * n)
    for i in range(n):
        for j in range(n):
            square[i * n + j] = A[i, j]
    of_rank(square, b, n, rank, x, work)
