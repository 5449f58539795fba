"""Newton's method on the active set, to the last digits where Gauss-Seidel would need long.

Each contact is taken as open, sticking or slipping as the natural map has it (Alart and Curnier
1991), which leaves linear equations:

    open   r = 0
    stick  u = 0
    slip   u_n = 0,  d . r_T = mu r_n,  e . (u_T + lambda r_T) = 0

with d along r_T, e across it and lambda = -d . u_T / |r_T| as they were.  Where contacts are
redundant the equations have many solutions; steps along the proximal point r' = r + (A + eps D)^-1
(b - A r) leave what they do not determine as it was.  The method is local: a caller keeps the
better of what it had and what comes back.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rb_sim.contact.solvers.graph import (
    BOUND,
    GIVE,
    LIGHT_B,
    LINES,
    TURN_B,
    copy,
    largest,
    rate_of,
    times,
)
from rb_sim.contact.solvers.one_contact import ROUGH
from rb_sim.numerics.kernels import entry, inline

# The friction problem of several contacts at once, and how far from its solution a reaction is.
#
#     u = W r + q,    K* contains u + mu |u_T| n,    K contains r,    one orthogonal to the other
#
# contact by contact: W is the Delassus matrix, q the velocity without reactions (restitution and
# gaps as a bias on its normal components), K the friction cone |r_T| <= mu r_n, K* its dual.  The
# term mu |u_T| is De Saxce's: with it the law is Coulomb's, without it the problem is convex and
# contacts that slip would open.  Components: normal, first and second tangent of each contact.


class FrictionProblem(NamedTuple):
    """A problem of n contacts."""

    W: np.ndarray
    """Delassus matrix [1/kg], shape (3n, 3n), symmetric and positive semidefinite."""
    q: np.ndarray
    """velocity without reactions [m/s], shape (3n,)."""
    mu: np.ndarray
    """coefficients of friction, shape (n,)."""


@entry
def onto_cone(x, y, z, mu):
    """The point of |(y, z)| <= mu x nearest to (x, y, z)."""
    size = math.sqrt(y * y + z * z)
    if size <= mu * x:
        return x, y, z
    if mu * size <= -x:
        return 0.0, 0.0, 0.0
    near = (x + mu * size) / (1.0 + mu * mu)
    return near, mu * near * y / size, mu * near * z / size


@entry
def natural_map(W, q, mu, r):
    """r_i - P_K(r_i - (u_i + mu |u_T| n) / w_i) of every contact, w_i the largest of its own block.

    Zero at a solution, and of the size of the error near one [N s]; shape (3n,).
    """
    u, out = np.empty(r.shape[0]), np.empty(r.shape[0])
    times(W, r, u)
    for i in range(mu.shape[0]):
        k = 3 * i
        for p in range(k, k + 3):
            u[p] += q[p]
        size = max(W[k, k], W[k + 1, k + 1], W[k + 2, k + 2])
        slip = math.sqrt(u[k + 1] ** 2 + u[k + 2] ** 2)
        x = r[k] - (u[k] + mu[i] * slip) / size
        y, z = r[k + 1] - u[k + 1] / size, r[k + 2] - u[k + 2] / size
        x, y, z = onto_cone(x, y, z, mu[i])
        out[k], out[k + 1], out[k + 2] = r[k] - x, r[k + 1] - y, r[k + 2] - z
    return out


def residual(problem: FrictionProblem, r: np.ndarray) -> float:
    """How far r is from a solution, relative to the largest reaction or to what would be needed
    to stop the largest velocity."""
    error = natural_map(problem.W, problem.q, problem.mu, r)
    needed = np.abs(problem.q) / np.maximum(np.diag(problem.W), 1e-300)
    scale = max(float(np.abs(r).max(initial=0.0)), float(needed.max(initial=0.0)))
    return float(np.abs(error).max(initial=0.0)) / scale if scale > 0.0 else 0.0


PROXIMAL = 1e-7
"""Of the diagonal, that makes the equations of redundant contacts regular."""
NOTHING, STIFFEST = 1e-14, 1e9
"""Pivot relative to the largest element that is none; lambda relative to a contact's own block at
which it as good as sticks."""
REFINED = 8
"""Proximal steps with one matrix; each takes away what is not redundant to PROXIMAL over its
smallest eigenvalue."""


@inline
def fill_equations(W, q, mu, r, u, A, b):
    """A r = b of the active set that the natural map has at r, with u = W r + q."""
    for i in range(mu.shape[0]):
        k = 3 * i
        size = max(W[k, k], max(W[k + 1, k + 1], W[k + 2, k + 2]))
        slip = math.sqrt(u[k + 1] ** 2 + u[k + 2] ** 2)
        x = r[k] - (u[k] + mu[i] * slip) / size
        y, z = r[k + 1] - u[k + 1] / size, r[k + 2] - u[k + 2] / size
        across = math.sqrt(y * y + z * z)
        for p in range(k, k + 3):
            b[p] = 0.0
            for j in range(A.shape[1]):
                A[p, j] = 0.0
        if mu[i] * across <= -x or (mu[i] == 0.0 and x <= 0.0):  # open
            for j in range(3):
                A[k + j, k + j] = size
            continue
        copy(A[k], W[k])
        b[k] = -q[k]
        if across <= mu[i] * x:
            copy(A[k + 1], W[k + 1])
            copy(A[k + 2], W[k + 2])
            b[k + 1], b[k + 2] = -q[k + 1], -q[k + 2]
            continue
        if mu[i] == 0.0:
            A[k + 1, k + 1], A[k + 2, k + 2] = size, size
            continue
        c, s = y / across, z / across
        length = max(mu[i] * x, 1e-300)
        stiff = min(max(-(c * u[k + 1] + s * u[k + 2]) / length, 0.0), STIFFEST * size)
        A[k + 1, k], A[k + 1, k + 1], A[k + 1, k + 2] = -mu[i] * size, c * size, s * size
        for j in range(A.shape[1]):
            A[k + 2, j] = c * W[k + 2, j] - s * W[k + 1, j]
        A[k + 2, k + 1] -= s * stiff
        A[k + 2, k + 2] += c * stiff
        b[k + 2] = s * q[k + 1] - c * q[k + 2]


@inline
def factorise(A, order):
    """LU with partial pivots, in place; False where a pivot is nothing."""
    n, most = A.shape[0], 0.0
    for i in range(n):
        most = max(most, largest(A[i]))
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(A[i, k]) > abs(A[best, k]):
                best = i
        order[k] = best
        if not abs(A[best, k]) > NOTHING * most:
            return False
        if best != k:
            for j in range(n):
                A[k, j], A[best, j] = A[best, j], A[k, j]
        for i in range(k + 1, n):
            if A[i, k] != 0.0:
                A[i, k] /= A[k, k]
                f = A[i, k]
                for j in range(k + 1, n):
                    A[i, j] -= f * A[k, j]
    return True


@inline
def solve_factorised(A, order, b):
    """x of A x = b from its factors, in place of b."""
    n = A.shape[0]
    for k in range(n):
        if order[k] != k:
            b[k], b[order[k]] = b[order[k]], b[k]
    for i in range(n):
        for j in range(i):
            b[i] -= A[i, j] * b[j]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            b[i] -= A[i, j] * b[j]
        b[i] /= A[i, i]


@entry
def newton(W, q, mu, r, rounds, settled):
    """(r, size of its natural map) after at most so many rounds from r, the best of them.

    settled: size of the natural map relative to the largest reaction at which it ends.
    """
    n = r.shape[0]
    A, b, order = np.zeros((n, n)), np.zeros(n), np.zeros(n, np.int64)
    best, least = r.copy(), largest(natural_map(W, q, mu, r))
    now, u, change = r.copy(), np.empty(n), np.empty(n)
    for _ in range(rounds):
        if least <= settled * largest(best):
            break
        times(W, now, u)
        for k in range(n):
            u[k] += q[k]
        fill_equations(W, q, mu, now, u, A, b)
        regular = A.copy()
        for k in range(n):
            regular[k, k] += PROXIMAL * W[k, k]
        if not factorise(regular, order):
            break
        for _ in range(REFINED):
            times(A, now, change)
            for k in range(n):
                change[k] = b[k] - change[k]
            solve_factorised(regular, order, change)
            for k in range(n):
                now[k] += change[k]
        error = largest(natural_map(W, q, mu, now))
        if not error < 1e300:
            break
        if error < least:
            copy(best, now)
            least = error
    return best, least


@inline
def element(graph, i, j, k, m):
    """Element (i's line k, j's line m) of the Delassus matrix."""
    rows, s = graph.rows, 0.0
    for p in range(2):
        for o in range(2):
            body = graph.ends[i, p]
            if body < 0 or body != graph.ends[j, o]:
                continue
            light = rows[m, LIGHT_B + o]
            for x in range(3):
                s += rows[k, 6 * p + x] * light * rows[m, 6 * o + x]
                s += rows[k, 6 * p + 3 + x] * rows[m, TURN_B + 3 * o + x]
    return s


@inline
def pushing(graph, x):
    """Numbers of the contacts that push."""
    found = 0
    chosen = np.zeros(graph.ends.shape[0], np.int64)
    for i in range(graph.ends.shape[0]):
        if x[LINES * i] > 0.0:
            chosen[found] = i
            found += 1
    return chosen[:found]


@entry
def delassus(graph, u, x, chosen):
    """(W, q, mu, r) of the chosen contacts: their dense friction problem, the others as they are.

    u: velocities that the impulses x have been pushed into.
    """
    n = chosen.shape[0]
    W, q, mu, r = np.zeros((3 * n, 3 * n)), np.zeros(3 * n), np.zeros(n), np.zeros(3 * n)
    for m in range(n):
        i = chosen[m]
        mu[m] = min(graph.rules[i, BOUND], ROUGH)
        b, a = graph.ends[i, 0], graph.ends[i, 1]
        for p in range(3):
            k = LINES * i + p
            r[3 * m + p] = x[k]
            q[3 * m + p] = rate_of(graph.rows, k, u, b, a) - graph.targets[k]
            for h in range(m + 1):
                for o in range(3):
                    s = element(graph, i, chosen[h], k, LINES * chosen[h] + o)
                    W[3 * m + p, 3 * h + o] = s
                    W[3 * h + o, 3 * m + p] = s
    own = np.empty(3 * n)
    times(W, r, own)
    for m in range(n):
        for p in range(3 * m, 3 * m + 3):
            q[p] -= own[p]
        W[3 * m, 3 * m] += graph.rules[chosen[m], GIVE]
    return W, q, mu, r
