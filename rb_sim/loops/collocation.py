"""Implicit Runge-Kutta steps of three stages by Newton's method with the exact Jacobian.

The stages Z_i = Y_i - y solve Z = h (A x 1) F(y + Z).  A^-1 has one real eigenvalue and a pair of
complex ones, so that each step factorises one real and one complex matrix of n rows (Butcher 1976;
Hairer & Wanner, Solving Ordinary Differential Equations II, section IV.8): the Jacobian at the
start of the step is used for all iterations, which go on to round-off.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rb_sim.loops.compiled import call_law, helper, part
from rb_sim.loops.dense import factor, factor_complex, solve_complex, solve_factored
from rb_sim.loops.rows import AT, SLOPES, size_of

ITERATIONS = 40
ROUND_OFF = 4e-16
"""Change of a stage, relative to its size, at which the iteration has converged."""
STALLED = 1e-7
"""Change up to which an iteration that gains no more has: stiff laws leave noise of this size at
most, since it is the round-off of the configuration times the fastest rate."""


def transformed(a):
    """(eigenvalues [real, re, im] of A^-1, T, T^-1) with T^-1 A^-1 T in real block form."""
    found: Any = np.linalg.eig(np.linalg.inv(np.array(a)))
    values, vectors = found
    real = int(np.argmin(abs(values.imag)))
    pair = int(np.argmax(values.imag))
    basis = np.array([vectors[:, real].real, vectors[:, pair].real, -vectors[:, pair].imag]).T
    eigenvalues = np.array([values[real].real, values[pair].real, values[pair].imag])
    return eigenvalues, basis, np.linalg.inv(basis)


F, W, Z = SLOPES, SLOPES + 3, SLOPES + 6
"""Rows of work: the laws at the stages, the transformed unknowns, the stages."""
ORDER_1, ORDER_2, RIGHT = SLOPES + 9, SLOPES + 10, SLOPES + 11
MATRICES = SLOPES + 16
"""First of 3 n rows: the real matrix and both parts of the complex one."""


@helper
def factorise(jacobian, values, n, t, y, h, p, work):
    """The matrices values / h - df/dy of the step, factorised."""
    real, re, im = (
        part(work, MATRICES * n),
        part(work, (MATRICES + n) * n),
        part(work, (MATRICES + 2 * n) * n),
    )
    call_law(jacobian, t, y, p, real)
    for i in range(n * n):
        real[i] = -real[i]
        re[i] = real[i]
        im[i] = 0.0
    for i in range(n):
        real[i * n + i] += values[0] / h
        re[i * n + i] += values[1] / h
        im[i * n + i] += values[2] / h
    factor(n, real, part(work, ORDER_1 * n))
    factor_complex(n, re, im, part(work, ORDER_2 * n))


@helper
def sweep(law, nodes, values, basis, inverse, n, t, y, h, p, work):
    """One iteration of Newton's method; the largest change of a stage relative to its size."""
    at, f, w, z = part(work, AT * n), part(work, F * n), part(work, W * n), part(work, Z * n)
    x = part(work, RIGHT * n)
    for i in range(3):
        for m in range(n):
            at[m] = y[m] + z[i * n + m]
        call_law(law, t + nodes[i] * h, at, p, part(f, i * n))
    for i in range(3):
        for m in range(n):
            s = 0.0
            for j in range(3):
                s += inverse[i, j] * f[j * n + m]
            x[i * n + m] = s
    a, b, c = values[0] / h, values[1] / h, values[2] / h
    for m in range(n):
        u, v = w[n + m], w[2 * n + m]
        x[m] -= a * w[m]
        x[n + m] -= b * u - c * v
        x[2 * n + m] -= c * u + b * v
    solve_factored(n, part(work, MATRICES * n), part(work, ORDER_1 * n), x)
    solve_complex(
        n,
        part(work, (MATRICES + n) * n),
        part(work, (MATRICES + 2 * n) * n),
        part(work, ORDER_2 * n),
        part(x, n),
        part(x, 2 * n),
    )
    change = 0.0
    for m in range(n):
        for i in range(3):
            w[i * n + m] += x[i * n + m]
        for i in range(3):
            moved = basis[i, 0] * x[m] + basis[i, 1] * x[n + m] + basis[i, 2] * x[2 * n + m]
            z[i * n + m] = basis[i, 0] * w[m] + basis[i, 1] * w[n + m] + basis[i, 2] * w[2 * n + m]
            size = abs(moved) / size_of(n, y, work, m)
            if not size <= change:  # NaN too
                change = size
    return change


@helper
def find_stages(law, jacobian, nodes, values, basis, inverse, n, t, y, h, p, work, stalled):
    """The stages of a step in rows Z of work; False where the iteration does not converge.

    stalled: change up to which an iteration that gains no more has (see STALLED)."""
    factorise(jacobian, values, n, t, y, h, p, work)
    w, z = part(work, W * n), part(work, Z * n)
    for m in range(3 * n):
        w[m] = 0.0
        z[m] = 0.0
    last, slow = math.inf, 0
    for _ in range(ITERATIONS):
        change = sweep(law, nodes, values, basis, inverse, n, t, y, h, p, work)
        if change <= ROUND_OFF or (change >= last and change <= stalled):
            return True
        if not change < last:
            slow += 1
        if slow > 2 or not change - change == 0.0:
            return False
        last = change
    return False
