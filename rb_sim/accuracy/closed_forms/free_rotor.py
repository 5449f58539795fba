"""Free asymmetric body: Euler's case by Jacobi elliptic functions (LL 37), attitude by quadrature.

With I1 < I2 < I3 and M^2 > 2 E I2 (else 1 and 3 change places)
w1 = A1 cn tau, w2 = A2 sn tau, w3 = A3 dn tau, tau = n t + tau_0 (LL 37.8 to 37.10).  The angular
momentum is fixed in the world, so the attitude is known but for the turn psi about it,
dpsi/dt = M (I1 w1^2 + I2 w2^2) / (I1^2 w1^2 + I2^2 w2^2); that quadrature is by Gauss-Legendre on
panels short enough for the nearest pole.  Under gravity alone C moves on its parabola.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from rb_sim.accuracy.closed_forms.elliptic import argument, jacobi
from rb_sim.accuracy.closed_forms.exact import Exact
from rb_sim.accuracy.closed_forms.extended import (
    Array,
    Long,
    about,
    conjugate,
    gauss_legendre,
    long,
    np,
    product,
    turned,
    unit,
)
from rb_sim.accuracy.closed_forms.parabola import only_gravity, parabola
from rb_sim.engine.systems.free_rotor import FreeRotor

NODES = 24
MOST_PANELS = 100_000


class Spin(NamedTuple):
    """w(t) about the principal axes in the order of `roles`."""

    roles: tuple[int, int, int]
    """body axes that play the parts 1, 2, 3 of LL."""
    moments: Array
    amplitudes: Array
    rate: Long
    """dtau/dt, negative where the roles are a left-handed triple."""
    start: Long
    """tau_0."""
    m1: Long

    def velocity(self, t: Array) -> Array:
        """(w1, w2, w3) at times t, shape (n, 3)."""
        sn, cn, dn = jacobi(self.rate * t + self.start, self.m1)
        return np.stack([cn, sn, dn], axis=-1) * self.amplitudes


def free_rotor(system: Any, y: Any) -> Exact | None:
    """The exact motion of a free body with three different moments, or None."""
    if not isinstance(system, FreeRotor) or not only_gravity(system.effects):
        return None
    if any(abs(product_of) > 0.0 for product_of in system.body.inertia[3:]):
        return None
    moments, w = long(system.body.inertia[:3]), long(y[10:13])
    spin = spin_of(moments, w)
    if spin is None:
        return None
    q0 = unit(long(y[3:7]))
    momentum = turned(q0, moments * w)

    def coordinates(times: Array) -> Array:
        t = long(times)
        q, spins = attitude(spin, q0, momentum, t), np.empty((len(t), 3), dtype=Long)
        spins[:, list(spin.roles)] = spin.velocity(t)
        p, v = parabola(system.effects, y[0:3], y[7:10], t)
        return np.concatenate([p, q, v, spins], axis=1).astype(float)

    return Exact("free asymmetric body, Jacobi elliptic functions; LL 37", coordinates)


def spin_of(moments: Array, w: Array) -> Spin | None:
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
    return Spin(roles, moments[order], amplitudes, rate, start, min(m1, Long(1)))


def attitude(spin: Spin, q0: Array, momentum: Array, t: Array) -> Array:
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


def precession(spin: Spin, momentum: Long, t: Array) -> Array:
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
