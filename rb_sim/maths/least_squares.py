"""The x of least norm among those with the least |A x - b|, for small square matrices of any rank.

A complete orthogonal decomposition A P = Q (T 0; 0 0) Z^T (Golub and Van Loan, Matrix Computations,
section 5.5) by Householder's reflections I - 2 v v^T / |v|^2; it costs a tenth of one into singular
values.  Matrices are vectors of their rows, one after the other.
"""

from __future__ import annotations

from rb_sim.loops.compiled import part
from rb_sim.maths.jit import inline
from rb_sim.maths.rank import LEAST_SINGULAR


@inline
def column_size(R, n, k, j):
    """Size of column j from row k on."""
    s = 0.0
    for i in range(k, n):
        s += R[i * n + j] * R[i * n + j]
    return s**0.5


@inline
def reflect_columns(R, n, k, c):
    """Take column k of R, from row k on, to its first element, and with it the columns behind it
    and c; what is below it does not count any more."""
    if column_size(R, n, k + 1, k) == 0.0:
        return
    size = column_size(R, n, k, k)
    if R[k * n + k] > 0.0:
        size = -size
    head = R[k * n + k] - size
    R[k * n + k] = head  # now the column is v, |v|^2 = -2 size head
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


@inline
def triangular(R, n, c, order):
    """R becomes the triangle of A P = Q R, c becomes Q^T c, order tells P; returns the rank."""
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
        if not most > LEAST_SINGULAR * largest:
            return k
        if best != k:
            order[k], order[best] = order[best], order[k]
            for i in range(n):
                R[i * n + k], R[i * n + best] = R[i * n + best], R[i * n + k]
        reflect_columns(R, n, k, c)
    return n


@inline
def reflect_row(R, n, rank, k, v):
    """Take row k of R, behind its element k and from column `rank` on, into that element, and with
    it the rows above; v: the first element of the reflection's direction, the rest is in the row;
    returns |v|^2 / 2."""
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


@inline
def least_squares(A, b, n, x, work):
    """Into x the solution; A and b are finite; work: n (n + 4) numbers."""
    for i in range(n * n):
        work[i] = A[i]
    first = n * n
    for i in range(n):
        work[first + i] = b[i]
    decomposed(work, part(work, first), n, part(work, first + n), x)


@inline
def decomposed(R, c, n, work, x):
    """As `least_squares`, in place of A = R and b = c."""
    order, v, halves = work, part(work, n), part(work, 2 * n)
    rank = triangular(R, n, c, order)
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
