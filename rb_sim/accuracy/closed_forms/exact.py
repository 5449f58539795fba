# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What closed forms are made of: the coordinates of a system at any time, in long doubles."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from rb_sim.catalogue.effects.gravity import GravityRow
from rb_sim.mechanics.samples import Array
from rb_sim.mechanics.systems.translation import TranslatingBody
from rb_sim.numerics.rotations import conjugate, product, rotate, unit
from rb_sim.scene.compiled import Compiled

# Arithmetic of the closed forms: arrays of long doubles (64-bit mantissa on most machines).
#
# Quaternions are [x, y, z, w] as everywhere; vectors and quaternions run along the last axis.


Long = np.longdouble
LongArray = Any
"""An array of long doubles."""

EPS = np.finfo(Long).eps


def long(values: Any) -> LongArray:
    """The same numbers as an array of long doubles."""
    return np.asarray(values, dtype=Long)


def unturned(q: LongArray, a: LongArray) -> LongArray:
    """R(q)^T a, (..., 3)."""
    return rotate(conjugate(q), a)


def about(axis: LongArray, angle: LongArray) -> LongArray:
    """Quaternion of a turn by `angle` (n,) about the unit vector `axis` (3,); shape (n, 4)."""
    half = np.asarray(angle) / 2
    return np.concatenate([np.sin(half)[..., None] * axis, np.cos(half)[..., None]], axis=-1)


def tensor(six: Any) -> LongArray:
    """3x3 inertia from (xx, yy, zz, xy, xz, yz)."""
    xx, yy, zz, xy, xz, yz = long(six)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=Long)


def gauss_legendre(count: int) -> tuple[LongArray, LongArray]:
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


# Jacobi's elliptic functions and integrals of the first kind in long doubles.
#
# R. Bulirsch, Numer. Math. 7 (1965) 78 (descending Landen transformation); B. C. Carlson, Numer.
# Algorithms 10 (1995) 13 (duplication).  The complementary parameter m1 = 1 - m is the argument, so
# that nothing is lost near the separatrix, where m1 is small.


def jacobi(u: LongArray, m1: Long) -> tuple[LongArray, LongArray, LongArray]:
    """(sn, cn, dn) of u, shape (n,), for 0 < m1 <= 1."""
    means, roots = [], []
    a, c, rest = Long(1), Long(1), Long(m1)
    while True:
        root = np.sqrt(rest)
        means.append(a)
        roots.append(root)
        c = (a + root) / 2
        if abs(a - root) <= np.sqrt(EPS) * a / 8:
            break
        rest, a = root * a, c
    angle = long(u) * c
    s = np.sin(angle)
    safe = np.where(s == 0, 1, s)
    a = np.cos(angle) / safe
    c = c * a
    dn = np.ones_like(angle)
    for mean, root in zip(reversed(means), reversed(roots), strict=True):
        a = a * c
        c = c * dn
        dn = (root + a) / (mean + a)
        a = c / mean
    sn = np.sign(s) / np.sqrt(c * c + 1)
    cn = np.where(s == 0, np.cos(angle), c * sn)
    return sn, cn, np.where(s == 0, 1, dn)


def carlson_rf(x: Long, y: Long, z: Long) -> Long:
    """R_F(x, y, z) = 1/2 integral of dt / sqrt((t + x)(t + y)(t + z))."""
    for _ in range(200):
        shift = np.sqrt(x * y) + np.sqrt(y * z) + np.sqrt(z * x)
        x, y, z = (x + shift) / 4, (y + shift) / 4, (z + shift) / 4
        mean = (x + y + z) / 3
        spread = max(abs(x - mean), abs(y - mean), abs(z - mean)) / mean
        if spread < Long(EPS) ** (Long(1) / 8):
            break
    X, Y = 1 - x / mean, 1 - y / mean
    Z = -X - Y
    e2, e3 = X * Y - Z * Z, X * Y * Z
    series = (
        1 - e2 / 10 + e3 / 14 + e2 * e2 / 24 - 3 * e2 * e3 / 44
        - 5 * e2**3 / 208 + 3 * e3 * e3 / 104 + e2 * e2 * e3 / 16
    )  # fmt: skip
    return series / np.sqrt(mean)


def quarter_period(m1: Long) -> Long:
    """K(m) by the arithmetic-geometric mean."""
    a, b = Long(1), np.sqrt(Long(m1))
    while abs(a - b) > EPS * a * 2:
        a, b = (a + b) / 2, np.sqrt(a * b)
    return 2 * np.arctan(Long(1)) / a


def argument(sn: Long, cn: Long, m1: Long) -> Long:
    """u in (-2K, 2K] with these sn and cn."""
    size = np.sqrt(sn * sn + cn * cn)
    sn, cn = sn / size, cn / size
    first = sn * carlson_rf(cn * cn, cn * cn + m1 * sn * sn, Long(1))
    if cn >= 0:
        return first
    return (2 if sn >= 0 else -2) * quarter_period(m1) - first


# Attitude from a spin that is known in closed form: dq/dt = w(t) q / 2, by power series.
#
# w(t) is entire, so its series and that of q converge at any length of panel; panels are short
# enough for the rest after ORDER terms to be below the last digit.


ORDER = 28
REACH = 0.5
"""Turn of a panel at most [rad]: REACH^ORDER / ORDER! is far below the last digit."""


class Spin(NamedTuple):
    """w(t) = steady + growing t + cosine cos(rate t) + sine sin(rate t), world axes [rad/s]."""

    steady: LongArray
    growing: LongArray
    cosine: LongArray
    sine: LongArray
    rate: Long

    def at(self, t: LongArray) -> LongArray:
        """w at times t, (n, 3)."""
        angle, t = (self.rate * t)[:, None], t[:, None]
        wave = self.cosine * np.cos(angle) + self.sine * np.sin(angle)
        return self.steady + self.growing * t + wave

    def series(self, t: LongArray) -> list[LongArray]:
        """Coefficients of w(t + s) in s, each (n, 3), at the times t."""
        angle = (self.rate * t)[:, None]
        cos, sin = np.cos(angle), np.sin(angle)
        found, factor = [], Long(1)
        for k in range(ORDER):
            found.append(factor * (self.cosine * cos + self.sine * sin))
            cos, sin = -sin, cos
            factor *= self.rate / (k + 1)
        found[0] = found[0] + self.steady + self.growing * t[:, None]
        found[1] = found[1] + self.growing
        return found


def steady_spin(w: LongArray) -> Spin:
    """The spin that stays w [rad/s], (3,)."""
    none = np.zeros(3, dtype=Long)
    return Spin(long(w), none, none, none, Long(0))


def attitudes(q0: LongArray, spin: Spin, t: LongArray) -> LongArray:
    """Quaternions at increasing times t from q0 at t[0], (n, 4)."""
    gaps = np.diff(t)
    if not len(gaps):
        return unit(q0)[None]
    fastest = np.sqrt((spin.at(t) ** 2).sum(axis=1)).max() + abs(spin.rate)
    pieces = max(1, math.ceil(float(gaps.max() * fastest / REACH)))
    width = np.repeat(gaps / pieces, pieces)
    starts = (t[:-1, None] + np.arange(pieces) * (gaps / pieces)[:, None]).ravel()
    turns = panel_turns(spin, starts, width)
    q, found = unit(q0), [unit(q0)]
    for i, turn in enumerate(turns):
        q = unit(product(turn, q))
        if (i + 1) % pieces == 0:
            found.append(q)
    return np.stack(found)


def panel_turns(spin: Spin, t: LongArray, width: LongArray) -> LongArray:
    """Quaternions of the turns from t to t + width, (n, 4)."""
    rates = [np.concatenate([w, np.zeros_like(w[:, :1])], axis=1) for w in spin.series(t)]
    terms: list[LongArray] = [np.tile(long([0, 0, 0, 1]), (len(t), 1))]
    total, power = terms[0], np.ones_like(width)
    for k in range(ORDER):
        products = [product(rates[j], terms[k - j]) for j in range(k + 1)]
        following = np.sum(products, axis=0) / (2 * (k + 1))
        terms.append(following)
        power = power * width
        total = total + following * power[:, None]
    return total


# What a closed form gives: the coordinates of a system at any time.


class Exact(NamedTuple):
    """The exact motion of one compiled system."""

    name: str
    """what it is, and the source."""
    coordinates: Callable[[Array], Array]
    """times (n,) [s] -> coordinates y (n, len y) of the system."""


# Uniform acceleration: p = p0 + v0 t + g t^2 / 2, of a body that gravity alone acts on.


def only_gravity(effects: tuple[Any, ...]) -> bool:
    """Whether no effect but uniform gravity acts."""
    return all(isinstance(row, GravityRow) for row in effects)


def gravity_of(effects: tuple[Any, ...]) -> LongArray:
    """Sum of the accelerations [m/s^2], (3,)."""
    return sum((long(row.acceleration_W) for row in effects), np.zeros(3, dtype=Long))


def parabola(effects: tuple[Any, ...], p: Any, v: Any, t: LongArray) -> tuple[LongArray, LongArray]:
    """Position and velocity of C at times t from p and v at 0, (n, 3) each."""
    g, t = gravity_of(effects), t[:, None]
    return long(p) + long(v) * t + g * t * t / 2, long(v) + g * t


def falling_body(compiled: Compiled) -> Exact | None:
    """The exact motion of a body that does not turn, under gravity alone, or None."""
    system, y = compiled.system, compiled.y
    if not isinstance(system, TranslatingBody) or not only_gravity(system.effects):
        return None

    def coordinates(times: LongArray) -> LongArray:
        p, v = parabola(system.effects, y[0:3], y[3:6], long(times))
        return np.concatenate([p, v], axis=1).astype(float)

    return Exact("uniform acceleration", coordinates)
