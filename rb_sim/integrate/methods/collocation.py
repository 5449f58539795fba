# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

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

from rb_sim.base.rounding import TWO_ULPS
from rb_sim.integrate.layout import AT, SLOPES, size_of
from rb_sim.numerics.kernels import call_law, part

# Dense linear systems on flat vectors, real and complex: Gaussian elimination.


def factor(n, a, order):
    """L U factors of the rows of a (n * n numbers) in place; `order` stores the row exchanges."""
    for k in range(n):
        best, size = k, abs(a[k * n + k])
        for i in range(k + 1, n):
            if abs(a[i * n + k]) > size:
                best, size = i, abs(a[i * n + k])
        order[k] = best
        if best != k:
            for j in range(n):
                a[k * n + j], a[best * n + j] = a[best * n + j], a[k * n + j]
        inverse = 1.0 / a[k * n + k]
        for i in range(k + 1, n):
            if a[i * n + k] != 0.0:
                s = a[i * n + k] * inverse
                a[i * n + k] = s
                for j in range(k + 1, n):
                    a[i * n + j] -= s * a[k * n + j]


def solve_factored(n, a, order, x):
    """Solve A x = b in place, with the factors of A from `factor`; x is b before."""
    for k in range(n):
        best = int(order[k])
        if best != k:
            x[k], x[best] = x[best], x[k]
    for i in range(n):
        s = x[i]
        for j in range(i):
            s -= a[i * n + j] * x[j]
        x[i] = s
    for i in range(n - 1, -1, -1):
        s = x[i]
        for j in range(i + 1, n):
            s -= a[i * n + j] * x[j]
        x[i] = s / a[i * n + i]


def factor_complex(n, re, im, order):
    """As `factor`, for the matrix re + i im."""
    for k in range(n):
        best, size = k, -1.0
        for i in range(k, n):
            here = abs(re[i * n + k]) + abs(im[i * n + k])
            if here > size:
                best, size = i, here
        order[k] = best
        if best != k:
            for j in range(n):
                re[k * n + j], re[best * n + j] = re[best * n + j], re[k * n + j]
                im[k * n + j], im[best * n + j] = im[best * n + j], im[k * n + j]
        if not size > 0.0:  # singular, or not finite: the step fails
            re[k * n + k] = math.nan
        inverse = 1.0 / complex(re[k * n + k], im[k * n + k])
        for i in range(k + 1, n):
            if re[i * n + k] != 0.0 or im[i * n + k] != 0.0:
                s = complex(re[i * n + k], im[i * n + k]) * inverse
                a, b = s.real, s.imag
                re[i * n + k], im[i * n + k] = a, b
                for j in range(k + 1, n):
                    c, d = re[k * n + j], im[k * n + j]
                    re[i * n + j] -= a * c - b * d
                    im[i * n + j] -= a * d + b * c


def solve_complex(n, re, im, order, x, z):
    """As `solve_factored`, for the unknown x + i z."""
    for k in range(n):
        best = int(order[k])
        if best != k:
            x[k], x[best] = x[best], x[k]
            z[k], z[best] = z[best], z[k]
    for i in range(n):
        s, r = x[i], z[i]
        for j in range(i):
            a, b = re[i * n + j], im[i * n + j]
            s -= a * x[j] - b * z[j]
            r -= a * z[j] + b * x[j]
        x[i], z[i] = s, r
    for i in range(n - 1, -1, -1):
        s, r = x[i], z[i]
        for j in range(i + 1, n):
            a, b = re[i * n + j], im[i * n + j]
            s -= a * x[j] - b * z[j]
            r -= a * z[j] + b * x[j]
        q = complex(s, r) / complex(re[i * n + i], im[i * n + i])
        x[i], z[i] = q.real, q.imag


ITERATIONS = 40
STALLED = 1e-7
"""Relative change up to which an iteration that no longer improves counts as converged: stiff laws
leave noise up to this size, the rounding of the configuration times the fastest rate."""


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
"""First rows of work for the laws at the stages, the transformed unknowns and the stages."""
ORDER_1, ORDER_2, RIGHT = SLOPES + 9, SLOPES + 10, SLOPES + 11
MATRICES = SLOPES + 16
"""First of 3 n rows for the real matrix and both parts of the complex one."""


def factorise(jacobian, values, n, t, y, h, p, work):
    """Factorise the matrices values / h - df/dy of the step."""
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


def sweep(law, nodes, values, basis, inverse, n, t, y, h, p, work):
    """One iteration of Newton's method; returns the largest relative change of a stage."""
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
            if not size <= change:  # also for NaN
                change = size
    return change


def find_stages(law, jacobian, nodes, values, basis, inverse, n, t, y, h, p, work, stalled):
    """The stages of a step, in rows Z of work; False if the iteration does not converge.

    stalled: relative change up to which an iteration that no longer improves counts as converged.
    """
    factorise(jacobian, values, n, t, y, h, p, work)
    w, z = part(work, W * n), part(work, Z * n)
    for m in range(3 * n):
        w[m] = 0.0
        z[m] = 0.0
    last, slow = math.inf, 0
    for _ in range(ITERATIONS):
        change = sweep(law, nodes, values, basis, inverse, n, t, y, h, p, work)
        if change <= TWO_ULPS or (change >= last and change <= stalled):
            return True
        if not change < last:
            slow += 1
        if slow > 2 or not change - change == 0.0:
            return False
        last = change
    return False
