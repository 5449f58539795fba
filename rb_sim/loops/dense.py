"""Dense linear systems on flat vectors, real and complex: Gaussian elimination."""

from __future__ import annotations

import math

from rb_sim.loops.compiled import helper


@helper
def factor(n, a, order):
    """L U of the rows of a (n * n numbers) in place; `order` keeps the row exchanges."""
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


@helper
def solve_factored(n, a, order, x):
    """x becomes the solution of A x = b for what `factor` made of A; x holds b before."""
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


@helper
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


@helper
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
