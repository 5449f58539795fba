# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""3-vectors, unit quaternions [x, y, z, w] and symmetric 3x3 matrices as tuples of floats.

A symmetric matrix is (xx, yy, zz, xy, xz, yz). Compiled, tuples are in registers: no allocation.
"""

from __future__ import annotations

from rb_sim.compiler.graph.symbols import atan2, cos, maximum, rarely, sin, sqrt, where

# Functions of numbers for floats, compiled code and symbols of a trace. `where(condition, a, b)`
# replaces a branch on the state; both sides are computed.


__all__ = ["atan2", "cos", "maximum", "rarely", "sin", "sqrt", "where"]


ZERO = (0.0, 0.0, 0.0)


def add(a, b):
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def sub(a, b):
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scale(s, a):
    return (s * a[0], s * a[1], s * a[2])


def neg(a):
    return (-a[0], -a[1], -a[2])


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def norm(a):
    return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


def rotate(q, a):
    """R(q) a: from body to world axes."""
    u = (q[0], q[1], q[2])
    t = scale(2.0, cross(u, a))
    return add(a, add(scale(q[3], t), cross(u, t)))


def unrotate(q, a):
    """R(q)^T a: from world to body axes."""
    u = (q[0], q[1], q[2])
    t = scale(2.0, cross(a, u))
    return add(a, add(scale(q[3], t), cross(t, u)))


def quaternion_product(a, b):
    """a b: rotation by b first, then by a."""
    return (
        a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
        a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
        a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
        a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
    )


def conjugate(q):
    """The inverse of a unit quaternion."""
    return (-q[0], -q[1], -q[2], q[3])


def quaternion_rate(q, w):
    """dq/dt = (1/2) q (w, 0) for the angular velocity w in the body frame."""
    return (
        0.5 * (q[3] * w[0] + q[1] * w[2] - q[2] * w[1]),
        0.5 * (q[3] * w[1] + q[2] * w[0] - q[0] * w[2]),
        0.5 * (q[3] * w[2] + q[0] * w[1] - q[1] * w[0]),
        -0.5 * (q[0] * w[0] + q[1] * w[1] + q[2] * w[2]),
    )


def quaternion_unit(q):
    """q / |q|, accurate for any length of q."""
    s = 1.0 / sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return (s * q[0], s * q[1], s * q[2], s * q[3])


def symmetric_times(s, a):
    return (
        s[0] * a[0] + s[3] * a[1] + s[4] * a[2],
        s[3] * a[0] + s[1] * a[1] + s[5] * a[2],
        s[4] * a[0] + s[5] * a[1] + s[2] * a[2],
    )


def gyroscopic(s, w):
    """w x S w, from differences of the moments.

    Exactly zero about the axis of a body of revolution: with an axial moment of 1e-9 of the others,
    rounding of the plain product would accelerate the spin.
    """
    x, y, z = w
    return (
        (s[2] - s[1]) * y * z + s[5] * (y * y - z * z) + x * (s[4] * y - s[3] * z),
        (s[0] - s[2]) * z * x + s[4] * (z * z - x * x) + y * (s[3] * z - s[5] * x),
        (s[1] - s[0]) * x * y + s[3] * (x * x - y * y) + z * (s[5] * x - s[4] * y),
    )


def shifted_inertia(inertia, mass, r):
    """Inertia + mass (r.r 1 - r r^T): Steiner's theorem (LL 32.12)."""
    x, y, z = r
    return (
        inertia[0] + mass * (y * y + z * z),
        inertia[1] + mass * (x * x + z * z),
        inertia[2] + mass * (x * x + y * y),
        inertia[3] - mass * x * y,
        inertia[4] - mass * x * z,
        inertia[5] - mass * y * z,
    )


def symmetric_solve(s, b):
    """x with S x = b for a positive definite S, by L D L^T factors."""
    l10 = s[3] / s[0]
    l20 = s[4] / s[0]
    d1 = s[1] - l10 * s[3]
    l21 = (s[5] - l20 * s[3]) / d1
    d2 = s[2] - l20 * s[4] - l21 * l21 * d1
    y1 = b[1] - l10 * b[0]
    y2 = b[2] - l20 * b[0] - l21 * y1
    z = y2 / d2
    y = y1 / d1 - l21 * z
    return (b[0] / s[0] - l10 * y - l20 * z, y, z)


def perpendicular(n):
    """Unit vectors t1, t2 that complete the unit vector n to a right-handed frame (t1, t2, n)."""
    sign = where(n[2] >= 0.0, 1.0, -1.0)
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    return (
        (1.0 + sign * n[0] * n[0] * a, sign * b, -sign * n[0]),
        (b, sign + n[1] * n[1] * a, -n[1]),
    )
