"""Arithmetic of the closed forms: arrays of long doubles (64-bit mantissa on most machines).

Quaternions are [x, y, z, w] as everywhere; vectors and quaternions run along the last axis.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Long = np.longdouble
Array = Any
"""An array of long doubles."""

EPS = np.finfo(Long).eps


def long(values: Any) -> Array:
    """The same numbers as an array of long doubles."""
    return np.asarray(values, dtype=Long)


def product(p: Array, q: Array) -> Array:
    """Quaternion p q (first turn by q, then by p), (..., 4)."""
    x, y, z, w = np.moveaxis(p, -1, 0)
    X, Y, Z, W = np.moveaxis(q, -1, 0)
    return np.stack(
        [
            w * X + x * W + y * Z - z * Y,
            w * Y - x * Z + y * W + z * X,
            w * Z + x * Y - y * X + z * W,
            w * W - x * X - y * Y - z * Z,
        ],
        axis=-1,
    )


def conjugate(q: Array) -> Array:
    return q * long([-1, -1, -1, 1])


def turned(q: Array, a: Array) -> Array:
    """R(q) a, (..., 3)."""
    u, w = q[..., :3], q[..., 3:]
    t = 2 * np.cross(u, a)
    return a + w * t + np.cross(u, t)


def unturned(q: Array, a: Array) -> Array:
    """R(q)^T a, (..., 3)."""
    return turned(conjugate(q), a)


def unit(q: Array) -> Array:
    return q / np.sqrt((q * q).sum(axis=-1, keepdims=True))


def about(axis: Array, angle: Array) -> Array:
    """Quaternion of a turn by `angle` (n,) about the unit vector `axis` (3,); shape (n, 4)."""
    half = np.asarray(angle) / 2
    return np.concatenate([np.sin(half)[..., None] * axis, np.cos(half)[..., None]], axis=-1)


def tensor(six: Any) -> Array:
    """3x3 inertia from (xx, yy, zz, xy, xz, yz)."""
    xx, yy, zz, xy, xz, yz = long(six)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=Long)


def gauss_legendre(count: int) -> tuple[Array, Array]:
    """Nodes and weights on [-1, 1]: numpy's, polished by Newton's method."""
    x = long(np.polynomial.legendre.leggauss(count)[0])
    slope = x
    for _ in range(3):
        below, value = np.ones_like(x), x.copy()
        for n in range(2, count + 1):
            below, value = value, ((2 * n - 1) * x * value - (n - 1) * below) / n
        slope = count * (x * value - below) / (x * x - 1)
        x = x - value / slope
    return x, 2 / ((1 - x * x) * slope * slope)
