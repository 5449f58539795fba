# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Closed forms of rotation (pendulum, free rotor, symmetric rotor, top), and the coordinates of a
system at any time, in long doubles, that all closed forms are made of.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from rb_sim.base.rounding import SUM_ROUNDING
from rb_sim.catalogue.effects.gravity import GravityRow
from rb_sim.mechanics.compiled import Compiled
from rb_sim.mechanics.samples import Array
from rb_sim.mechanics.systems.fixed_point import FixedAxisBody, FixedPointBody
from rb_sim.mechanics.systems.free import FreeRotor
from rb_sim.mechanics.systems.translation import TranslatingBody
from rb_sim.numerics.rotations import conjugate, product, rotate, unit

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


# Body on a fixed axis under gravity: the pendulum's elliptic functions.
#
# theta'' = -W^2 sin theta with theta from the direction of gravity, W^2 = m g r / J.  With
# k^2 = sin^2(theta_0/2) + theta'_0^2 / (4 W^2): swings sin(theta/2) = k sn(W t + u, k^2) for k < 1,
# turns over theta/2 = am(k W t + u, 1/k^2) for k > 1 (Whittaker, Analytical Dynamics, section 44).


def pendulum(compiled: Compiled) -> Exact | None:
    """The exact motion about a fixed axis under gravity alone, or None."""
    system, y = compiled.system, compiled.y
    if not isinstance(system, FixedAxisBody) or not only_gravity(system.effects):
        return None
    frequency2, down = law(system)
    relative = about_hanging(Long(y[0]) - down, Long(y[1]), frequency2)
    if relative is None:
        return None
    motion = shifted(relative, down)

    def coordinates(times: LongArray) -> LongArray:
        return np.stack(motion(long(times)), axis=1).astype(float)

    return Exact("pendulum, Jacobi elliptic functions; Whittaker 44", coordinates)


PI = 4 * np.arctan(Long(1))


def about_hanging(theta: Long, speed: Long, frequency2: Long) -> Any:
    """motion(t) -> (theta, theta') of theta'' = -frequency2 sin theta; None near the separatrix."""
    if frequency2 == 0:
        return uniform(theta, speed)
    whole = 2 * PI * np.round(theta / (2 * PI))
    W, half = np.sqrt(frequency2), (theta - whole) / 2
    m1 = (np.cos(half) - speed / (2 * W)) * (np.cos(half) + speed / (2 * W))  # 1 - k^2
    if abs(m1) < SUM_ROUNDING:
        return None
    relative = swing(half, speed, W, m1) if m1 > 0 else turning(half, speed, W, m1)
    return shifted(relative, whole)


def law(system: FixedAxisBody) -> tuple[Long, Long]:
    """(W^2, the angle phi at which C hangs along gravity)."""
    n = long(system.axis_B)
    n = n / np.sqrt((n * n).sum())
    rho = long(system.rho)
    g = unturned(long(system.q_0), gravity_of(system.effects))
    mass = Long(system.body.mass)
    about_A = tensor(system.body.inertia) + mass * ((rho @ rho) * np.eye(3) - np.outer(rho, rho))
    arm, pull = rho - (rho @ n) * n, g - (g @ n) * n
    size = np.sqrt((arm @ arm) * (pull @ pull))
    down = np.arctan2(n @ np.cross(arm, pull), arm @ pull)
    return mass * size / (n @ about_A @ n), down


def uniform(angle: Long, speed: Long) -> Any:
    """(angle, speed) at times t of a turn at constant speed [rad, rad/s]."""
    return lambda t: (angle + speed * t, speed + 0 * t)


def shifted(motion: Any, by: Long) -> Any:
    """The motion with its angle larger by a constant [rad]."""

    def moved(t: LongArray) -> tuple[LongArray, LongArray]:
        angle, speed = motion(t)
        return angle + by, speed

    return moved


def swing(half: Long, speed: Long, W: Long, m1: Long) -> Any:
    """k < 1: theta and theta' over time."""
    k = np.sqrt(np.sin(half) ** 2 + (speed / (2 * W)) ** 2)
    if k == 0:
        return uniform(Long(0), Long(0))
    start = argument(np.sin(half) / k, speed / (2 * W * k), m1)

    def motion(t: LongArray) -> tuple[LongArray, LongArray]:
        sn, cn, dn = jacobi(W * t + start, m1)
        return 2 * np.arctan2(k * sn, dn), 2 * k * W * cn

    return motion


def turning(half: Long, speed: Long, W: Long, m1: Long) -> Any:
    """k > 1: theta (not wrapped) and theta' over time."""
    k = np.sqrt(np.sin(half) ** 2 + (speed / (2 * W)) ** 2)
    side = np.sign(speed)
    rest = -m1 / (k * k)  # 1 - 1/k^2
    K = quarter_period(rest)
    start = argument(side * np.sin(half), np.cos(half), rest)

    def motion(t: LongArray) -> tuple[LongArray, LongArray]:
        u = k * W * t + start
        sn, cn, dn = jacobi(u, rest)
        wrapped = np.arctan2(sn, cn)
        turns = np.round((u * PI / (2 * K) - wrapped) / (2 * PI))
        return side * 2 * (wrapped + 2 * PI * turns), side * 2 * k * W * dn

    return motion


# Free asymmetric body: Euler's case by Jacobi elliptic functions (LL 37), attitude by quadrature.
#
# With I1 < I2 < I3 and M^2 > 2 E I2 (else 1 and 3 change places)
# w1 = A1 cn tau, w2 = A2 sn tau, w3 = A3 dn tau, tau = n t + tau_0 (LL 37.8 to 37.10).  The angular
# momentum is fixed in the world, so the attitude is known but for the turn psi about it,
# dpsi/dt = M (I1 w1^2 + I2 w2^2) / (I1^2 w1^2 + I2^2 w2^2); that quadrature is by Gauss-Legendre on
# panels short enough for the nearest pole.  Under gravity alone C moves on its parabola.


NODES = 24
MOST_PANELS = 100_000


class PrincipalSpin(NamedTuple):
    """w(t) about the principal axes in the order of `roles`."""

    roles: tuple[int, int, int]
    """body axes that play the parts 1, 2, 3 of LL."""
    moments: LongArray
    amplitudes: LongArray
    rate: Long
    """dtau/dt, negative where the roles are a left-handed triple."""
    start: Long
    """tau_0."""
    m1: Long

    def velocity(self, t: LongArray) -> LongArray:
        """(w1, w2, w3) at times t, shape (n, 3)."""
        sn, cn, dn = jacobi(self.rate * t + self.start, self.m1)
        return np.stack([cn, sn, dn], axis=-1) * self.amplitudes


def free_rotor(compiled: Compiled) -> Exact | None:
    """The exact motion of a free body with three different moments, or None."""
    system, y = compiled.system, compiled.y
    if not isinstance(system, FreeRotor) or not only_gravity(system.effects):
        return None
    if any(abs(product_of) > 0.0 for product_of in system.body.inertia[3:]):
        return None
    moments, w = long(system.body.inertia[:3]), long(y[10:13])
    spin = spin_of(moments, w)
    if spin is None:
        return None
    q0 = unit(long(y[3:7]))
    momentum = rotate(q0, moments * w)

    def coordinates(times: LongArray) -> LongArray:
        t = long(times)
        q, spins = attitude(spin, q0, momentum, t), np.empty((len(t), 3), dtype=Long)
        spins[:, list(spin.roles)] = spin.velocity(t)
        p, v = parabola(system.effects, y[0:3], y[7:10], t)
        return np.concatenate([p, q, v, spins], axis=1).astype(float)

    return Exact("free asymmetric body, Jacobi elliptic functions; LL 37", coordinates)


def spin_of(moments: LongArray, w: LongArray) -> PrincipalSpin | None:
    """Amplitudes, rate and phase from the initial spin; None where the motion is elementary."""
    order = [int(i) for i in np.argsort(moments)]
    small, middle, large = moments[order]
    if min(middle - small, large - middle) <= 1e-12 * large or (w != 0).sum() < 2:
        return None
    a, b, c = w[order]
    excess = large * (large - middle) * c * c - small * (middle - small) * a * a  # M^2 - 2 E I2
    if excess == 0:
        return None
    if excess < 0:
        order, excess = order[::-1], -excess
    one, two, three = moments[order]
    w1, w2, w3 = w[order]
    s12, s13, s23 = abs(two - one), abs(three - one), abs(three - two)
    above = two * s12 * w2 * w2 + three * s13 * w3 * w3  # |M^2 - 2 E I1|
    below = one * s13 * w1 * w1 + two * s23 * w2 * w2  # |2 E I3 - M^2|
    m1 = s13 * excess / (s23 * above)
    if m1 <= 1e-15 or below == 0:
        return None
    side = np.sign(w3)
    amplitudes = long(
        [
            side * np.sqrt(below / (one * s13)),
            np.sqrt(below / (two * s23)),
            side * np.sqrt(above / (three * s13)),
        ]
    )
    even = tuple(order) in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
    hand = (1 if even else -1) * (1 if three > one else -1)
    rate = hand * np.sqrt(s23 * above / (one * two * three))
    start = argument(w2 / amplitudes[1], w1 / amplitudes[0], m1)
    roles = (order[0], order[1], order[2])
    return PrincipalSpin(roles, moments[order], amplitudes, rate, start, min(m1, Long(1)))


def attitude(spin: PrincipalSpin, q0: LongArray, momentum: LongArray, t: LongArray) -> LongArray:
    """Quaternions at increasing times, from Euler angles about the angular momentum."""
    k = spin.roles[2]
    i, j = (k + 1) % 3, (k + 2) % 3
    size = np.sqrt((momentum * momentum).sum())
    own = np.empty((len(t), 3), dtype=Long)
    own[:, list(spin.roles)] = spin.velocity(t) * spin.moments
    theta = np.arctan2(np.hypot(own[:, i], own[:, j]), own[:, k])
    phi = np.arctan2(own[:, i], own[:, j])
    unit_i, unit_k = np.eye(3, dtype=Long)[i], np.eye(3, dtype=Long)[k]
    lean = product(about(unit_i, theta), about(unit_k, phi))
    psi = precession(spin, size, t)
    first = product(q0, conjugate(lean[0]))
    return unit(product(product(first, about(unit_k, psi)), lean))


def precession(spin: PrincipalSpin, momentum: Long, t: LongArray) -> LongArray:
    """psi(t) from psi(t[0]) = 0 [rad]."""
    one, two = spin.moments[0], spin.moments[1]
    pole = min(1.0, float(abs(one * spin.amplitudes[0] / (two * spin.amplitudes[1]))))
    gaps = np.diff(t)
    longest = float(gaps.max() * abs(spin.rate))
    pieces = max(1, math.ceil(longest / (0.5 * pole)))
    if pieces * len(gaps) > MOST_PANELS:
        raise OverflowError("too many panels for the attitude's quadrature")
    nodes, weights = gauss_legendre(NODES)
    total = np.zeros(len(gaps), dtype=Long)
    for piece in range(pieces):
        width = gaps / pieces
        left = t[:-1] + piece * width
        at = (left[:, None] + (nodes + 1) / 2 * width[:, None]).ravel()
        squares = spin.velocity(at)[:, :2] ** 2
        moments = spin.moments[:2]
        slope = (squares * moments).sum(axis=1) / (squares * moments**2).sum(axis=1)
        total += (slope.reshape(-1, NODES) * weights).sum(axis=1) * width / 2
    return momentum * np.concatenate([np.zeros(1, dtype=Long), np.cumsum(total)])


# Free symmetric body: regular precession (LL 33), and steady spin about a principal axis.
#
# With moments I1 = I2 and I3 about the axis e: R(t) = turn(L / I1 t) R(0) turn(e w3 (1 - I3/I1) t),
# L the fixed angular momentum.  Under gravity alone C moves on its parabola.


def symmetric_rotor(compiled: Compiled) -> Exact | None:
    """The exact motion of a free body with two equal moments or in steady spin, or None."""
    system, y = compiled.system, compiled.y
    if not isinstance(system, FreeRotor) or not only_gravity(system.effects):
        return None
    if any(abs(product_of) > 0.0 for product_of in system.body.inertia[3:]):
        return None
    moments, w = long(system.body.inertia[:3]), long(y[10:13])
    axis = symmetry_axis(moments, w)
    if axis is None:
        return None
    across = moments[(axis + 1) % 3] if (w != 0).sum() > 1 else moments[axis]
    q0 = unit(long(y[3:7]))
    momentum = rotate(q0, moments * w)
    own = w[axis] * (1 - moments[axis] / across)

    def coordinates(times: LongArray) -> LongArray:
        t = long(times)
        size = np.sqrt((momentum * momentum).sum())
        direction = momentum / size if size > 0 else long([0, 0, 1])
        spin = about(np.eye(3, dtype=Long)[axis], own * t)
        q = unit(product(product(about(direction, size / across * t), q0), spin))
        p, v = parabola(system.effects, y[0:3], y[7:10], t)
        return np.concatenate([p, q, v, unturned(q, momentum) / moments], axis=1).astype(float)

    return Exact("free symmetric body, regular precession; LL 33", coordinates)


def symmetry_axis(moments: LongArray, w: LongArray) -> int | None:
    """Body axis about which the body is symmetric or steadily spins; None if there is none."""
    for k in range(3):
        steady = w[(k + 1) % 3] == 0 and w[(k + 2) % 3] == 0
        if steady or moments[(k + 1) % 3] == moments[(k + 2) % 3]:
            return k
    return None


# Symmetric top in steady precession about the vertical (LL 35, problem 1; Goldstein 5.7).
#
# R(t) = turn(k p t) R(0) turn(e s t), k up, e the axis of symmetry, where the precession p and the
# spin w3 = s + p cos(theta) satisfy p (I3 w3 - I1 p cos(theta)) = m g l (moments about the point).


def steady_top(compiled: Compiled) -> Exact | None:
    """The exact motion of a top whose initial state precesses steadily, or None."""
    system, y = compiled.system, compiled.y
    if not isinstance(system, FixedPointBody) or not only_gravity(system.effects):
        return None
    rho, g, mass = long(system.rho), gravity_of(system.effects), Long(system.body.mass)
    length, strength = np.sqrt(rho @ rho), np.sqrt(g @ g)
    if length == 0 or strength == 0:
        return None
    e, up, q0 = rho / length, -g / strength, unit(long(y[0:4]))
    own = tensor(system.body.inertia)
    about_O = own + mass * ((rho @ rho) * np.eye(3) - np.outer(rho, rho))
    w = long(y[4:7])
    axial, k = e @ about_O @ e, unturned(q0, up)
    across = (np.trace(about_O) - axial) / 2
    uniaxial = across * np.eye(3) + (axial - across) * np.outer(e, e)
    if np.abs(about_O - uniaxial).max() > SUM_ROUNDING * across:
        return None
    side = k - (k @ e) * e
    if side @ side < 1e-12:
        return None
    p, cosine, w3 = (w @ side) / (side @ side), k @ e, w @ e
    beside = w - p * side - w3 * e
    weight = mass * strength * length
    misfit = p * (axial * w3 - across * p * cosine) - weight
    if abs(misfit) > SUM_ROUNDING * weight or np.sqrt(beside @ beside) > SUM_ROUNDING * np.sqrt(
        w @ w
    ):
        return None

    def coordinates(times: LongArray) -> LongArray:
        t = long(times)
        q = product(product(about(up, p * t), q0), about(e, (w3 - p * cosine) * t))
        w_t = p * unturned(q, up) + (w3 - p * cosine) * e
        return np.concatenate([unit(q), w_t], axis=1).astype(float)

    return Exact("top in steady precession; LL 35", coordinates)
