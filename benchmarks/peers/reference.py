# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Reference motion of the six scenes: Taylor series in 192-bit fixed-point arithmetic.

Each scene is written as a polynomial system, integrated by an order-40 Taylor method on Python
integers (a number v is the integer v * 2**BITS, so about 57 digits and no library), and stored as
the series of the pose in each segment. The pose is then known at any time to the rounding of
doubles. Independent of rb_sim; `check.py` compares it with second derivations.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from math import isqrt
from operator import mul
from typing import NamedTuple

import numpy as np

from benchmarks.peers.scenes import Array, Scene, rotation

BITS = 192
ORDER = 40
STORED = 32
"""Orders kept in doubles; what follows is below 1e-20 of the scale."""

SEGMENT = {
    "free_tumble": 2,
    "gazebo_boxes": 4,
    "heavy_top": 7,
    "pendulum": 4,
    "rolling_sphere": 4,
    "rolling_disk": 5,
}
"""A segment lasts 2**-n s; chosen so that the last coefficient is below TAIL."""

TAIL = 1e-26

Series = list[int]
Rates = Callable[[list[Series], list[Series], int], list[int]]


class System(NamedTuple):
    """A polynomial system y' = rates(y)."""

    start: list[int]
    """initial values, fixed point."""
    products: int
    """number of auxiliary series that `rates` appends to."""
    rates: Rates
    """(variables, auxiliaries, k) -> coefficient k of each variable's derivative."""
    pose: tuple[int, ...]
    """index of x, y, z, w of the quaternion in the variables, then of the position, if any."""


class Reference:
    """Pose of the body at any time of the run, to the rounding of doubles."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._shift = SEGMENT[scene.name]
        system = _disk(scene) if scene.name == "rolling_disk" else _rigid(scene)
        self._series, self.tail = _integrate(system, self._shift, scene.duration)

    def pose(self, t: Array) -> tuple[Array, Array]:
        """Centre of mass [m] (n, 3) and quaternion [x, y, z, w] (n, 4), world, at times t [s]."""
        scaled = np.asarray(t, dtype=float) * 2.0**self._shift
        index = np.clip(scaled.astype(int), 0, len(self._series) - 1)
        part = (scaled - index)[:, None]
        series = self._series[index]
        value = series[:, :, -1]
        for order in range(series.shape[2] - 2, -1, -1):
            value = value * part + series[:, :, order]
        quaternion = value[:, :4] / np.linalg.norm(value[:, :4], axis=1)[:, None]
        if value.shape[1] == 7:
            return value[:, 4:], quaternion
        center = self.scene.center
        return self.scene.origin + np.array([rotation(q) @ center for q in quaternion]), quaternion


def pose_error(
    position: Array, quaternion: Array, true_position: Array, true_quaternion: Array
) -> Array:
    """Larger of the rotation angle [rad] and the distance [m] between poses, shape (n,).

    A pose that is not finite counts as infinitely wrong.
    """
    q = quaternion / np.linalg.norm(quaternion, axis=1)[:, None]
    vector = (
        true_quaternion[:, 3:] * q[:, :3]
        - q[:, 3:] * true_quaternion[:, :3]
        - np.cross(true_quaternion[:, :3], q[:, :3])
    )
    scalar = np.abs(np.sum(q * true_quaternion, axis=1))
    angle = 2.0 * np.arctan2(np.linalg.norm(vector, axis=1), scalar)
    worst = np.maximum(angle, np.linalg.norm(position - true_position, axis=1))
    return np.where(np.isfinite(worst), worst, np.inf)


def fixed(value: float | Fraction) -> int:
    """Nearest fixed-point number of an exact value."""
    return round(Fraction(value) * 2**BITS)


def product(a: Series, b: Series, k: int) -> int:
    """Coefficient k of the product of two series."""
    return sum(map(mul, a[: k + 1], b[k::-1])) >> BITS


def scaled(factor: int, value: int) -> int:
    """Product of two fixed-point numbers."""
    return (factor * value) >> BITS


def _integrate(system: System, shift: int, duration: float) -> tuple[Array, float]:
    values, segments, tail = list(system.start), [], 0.0
    for _ in range(round(duration * 2**shift)):
        series = [[value] for value in values]
        products: list[Series] = [[] for _ in range(system.products)]
        for k in range(ORDER):
            for one, rate in zip(series, system.rates(series, products, k), strict=True):
                one.append((rate >> shift) // (k + 1))
        tail = max(tail, *(abs(one[-1]) / 2**BITS for one in series))
        segments.append([[c / 2**BITS for c in series[i][: STORED + 1]] for i in system.pose])
        values = [sum(one) for one in series]
    if tail > TAIL:
        raise ArithmeticError(f"reference: segments of 2**-{shift} s are too long: {tail:.1e}")
    return np.array(segments), tail


def _unit(quaternion: Array) -> list[int]:
    """The doubles of a quaternion, made exactly unit."""
    values = [fixed(float(c)) for c in quaternion]
    norm = isqrt(sum(v * v for v in values))
    return [(v << BITS) // norm for v in values]


def _quaternion_rates(q: list[Series], w: list[Series], k: int) -> list[int]:
    """q' = q (w, 0) / 2 with the spin w in body axes."""
    (x, y, z, s), (a, b, c) = q, w
    p = product
    return [
        (p(s, a, k) + p(y, c, k) - p(z, b, k)) >> 1,
        (p(s, b, k) + p(z, a, k) - p(x, c, k)) >> 1,
        (p(s, c, k) + p(x, b, k) - p(y, a, k)) >> 1,
        -(p(x, a, k) + p(y, b, k) + p(z, c, k)) >> 1,
    ]


def _rigid(scene: Scene) -> System:
    """Free body, body on a fixed point or axis through the origin, or rolling sphere.

    Euler's equations about the centre of mass (free) or the pivot, whose offset lies on a principal
    axis; the sphere's spin is written in world axes and grows at a constant rate (LL 38.5).
    """
    m, c = Fraction(scene.mass), [Fraction(float(v)) for v in scene.center]
    g = [Fraction(float(v)) for v in scene.gravity]
    square = sum(v * v for v in c)
    moment = [
        Fraction(float(i)) + m * (square - v * v) for i, v in zip(scene.inertia, c, strict=True)
    ]
    acceleration, spin_rate = g, [Fraction(0)] * 3
    sphere = scene.name == "rolling_sphere"
    if sphere:
        acceleration, spin_rate = _sphere_rates(scene)
    turn = [fixed((moment[i - 2] - moment[i - 1]) / moment[i]) for i in range(3)]
    lever = [[fixed(m * g[2] * c[j] / moment[i]) for j in range(3)] for i in range(3)]
    constant = [fixed(v) for v in spin_rate]
    fall = [fixed(v) for v in acceleration]

    def up(q: list[Series], k: int) -> list[int]:
        """Coefficient k of the world's z axis in body axes."""
        x, y, z, s = q
        one = (1 << BITS) if k == 0 else 0
        return [
            2 * (product(x, z, k) - product(y, s, k)),
            2 * (product(y, z, k) + product(x, s, k)),
            one - 2 * (product(x, x, k) + product(y, y, k)),
        ]

    def rates(v: list[Series], _: list[Series], k: int) -> list[int]:
        q, w = v[:4], v[4:7]
        if sphere:
            # q' = (w, 0) q / 2: the conjugate of the body-axes rule
            back = [[-n for n in w[i]] for i in range(3)]
            conjugate = [[-n for n in q[i]] for i in range(3)] + [q[3]]
            x, y, z, s = _quaternion_rates(conjugate, back, k)
            turned = [-x, -y, -z, s]
            change = [n if k == 0 else 0 for n in constant]
        else:
            turned, u = _quaternion_rates(q, w, k), up(q, k)
            change = [
                scaled(turn[i], product(w[i - 2], w[i - 1], k))
                + scaled(lever[i][i - 2], u[i - 1])
                - scaled(lever[i][i - 1], u[i - 2])
                for i in range(3)
            ]
        return turned + change + [one[k] for one in v[10:]] + [n if k == 0 else 0 for n in fall]

    velocity = [fixed(float(n)) for n in scene.velocity]
    start = _unit(scene.quaternion) + [fixed(float(n)) for n in scene.spin]
    start += [fixed(float(n)) for n in scene.origin] + velocity
    pose = (0, 1, 2, 3) if square else (0, 1, 2, 3, 7, 8, 9)
    return System(start, 0, rates, pose)


def _sphere_rates(scene: Scene) -> tuple[list[Fraction], list[Fraction]]:
    """Constant acceleration of the centre and of the spin (world axes), LL section 38 problem 1."""
    force = [Fraction(float(v)) for v in scene.force]
    torque = [Fraction(float(v)) for v in scene.torque]
    m, a = Fraction(scene.mass), Fraction(float(scene.size[0]))
    ax = Fraction(5, 7) / m * (force[0] + torque[1] / a)
    ay = Fraction(5, 7) / m * (force[1] - torque[0] / a)
    return [ax, ay, Fraction(0)], [-ay / a, ax / a, torque[2] / (Fraction(2, 5) * m * a * a)]


def _disk(scene: Scene) -> System:
    """Thin disk by inclination and heading, in the frame that does not share the spin.

    e1 is horizontal in the disk's plane, e2 points from the contact to the centre, e3 is the axis;
    w1, w2, w3 are the components of the spin, s = sin(inclination), c = cos, i = 1/s. With
    A = m a^2/4, C = m a^2/2 and O = w2 c/s:
        (A + m a^2) w1' = A O w2 - (C + m a^2) w2 w3 - m g a c
        A w2' = (C w3 - A O) w1,   (C + m a^2) w3' = m a^2 w1 w2.
    Variables: quaternion, w1 w2 w3, x y z of the centre, s c i, cos and sin of heading and spin.
    """
    m, a = Fraction(scene.mass), Fraction(float(scene.size[0]))
    across, along, contact = m * a * a / 4, m * a * a / 2, m * a * a
    whole = across + contact
    k_turn, k_spin = fixed(across / whole), fixed((along + contact) / whole)
    k_weight = fixed(-m * Fraction(float(scene.gravity[2])) * a / whole)
    k_along, k_rough = fixed(along / across), fixed(contact / (along + contact))
    radius = fixed(a)

    def rates(v: list[Series], aux: list[Series], k: int) -> list[int]:
        w1, w2, w3 = v[4:7]
        s, c, i, cf, sf, cp, sp = v[10:]
        cot, own, heading, spin, fall, sfs, cfs, p, q = aux
        cot.append(product(c, i, k))
        own.append(product(w2, cot, k))
        heading.append(product(w2, i, k))
        spin.append(w3[k] - own[k])
        fall.append(product(cot, w1, k))
        sfs.append(product(sf, s, k))
        cfs.append(product(cf, s, k))
        p.append(product(w1, cp, k) + product(w2, sp, k))
        q.append(product(w2, cp, k) - product(w1, sp, k))
        w1_rate = scaled(k_turn, product(own, w2, k)) - scaled(k_spin, product(w2, w3, k))
        return [
            *_quaternion_rates(v[:4], [p, q, w3], k),
            w1_rate - scaled(k_weight, c[k]),
            scaled(k_along, product(w1, w3, k)) - product(own, w1, k),
            scaled(k_rough, product(w1, w2, k)),
            scaled(radius, product(w1, sfs, k) - product(w3, cf, k)),
            scaled(radius, -product(w1, cfs, k) - product(w3, sf, k)),
            scaled(radius, product(c, w1, k)),
            product(c, w1, k),
            -product(s, w1, k),
            -product(i, fall, k),
            -product(sf, heading, k),
            product(cf, heading, k),
            -product(sp, spin, k),
            product(cp, spin, k),
        ]

    q = _unit(scene.quaternion)
    sine = scaled(2 * q[0], q[3])
    cosine = scaled(q[3], q[3]) - scaled(q[0], q[0])
    one = 1 << BITS
    start = q + [fixed(float(n)) for n in scene.spin]
    start += [fixed(float(scene.origin[0])), fixed(float(scene.origin[1])), scaled(radius, sine)]
    start += [sine, cosine, (one << BITS) // sine, one, 0, one, 0]
    return System(start, 9, rates, (0, 1, 2, 3, 7, 8, 9))
