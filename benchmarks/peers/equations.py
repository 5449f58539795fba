# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Minimal equations of the six scenes, written by hand, for integrators of plain equations.

The same functions take floats (scipy) and symbolic expressions (heyoka). What has a trivial closed
form is not integrated: the free fall of a centre of mass and the sphere's translation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from benchmarks.peers.engine import Samples
from benchmarks.peers.scenes import Array, Scene, rotation


class Functions(NamedTuple):
    """Elementary functions of the number type in use, and its time."""

    sin: Callable[[Any], Any]
    cos: Callable[[Any], Any]
    sqrt: Callable[[Any], Any]


Rates = Callable[[Any, Sequence[Any], Functions], list[Any]]


class Equations(NamedTuple):
    """y' = rates(t, y, functions), and the pose that y stands for."""

    start: list[float]
    rates: Rates
    pose: Callable[[Array, Array], tuple[Array, Array]]
    """(t (n,), y (n, m)) -> centre of mass (n, 3), quaternion (n, 4)."""


def forms(scene: Scene) -> dict[str, Equations]:
    """Name of each form of the equations -> the equations."""
    if scene.name == "pendulum":
        return {"angle": _pendulum(scene)}
    if scene.name == "rolling_sphere":
        return {"quaternion": _sphere(scene)}
    if scene.name == "rolling_disk":
        return {"quaternion": _disk_quaternion(scene), "angles": _disk_angles(scene)}
    return {"quaternion": _rigid(scene)}


def samples(equations: Equations, t: Array, y: Array) -> Samples:
    """Poses from the states y (n, m)."""
    return Samples(t, *equations.pose(t, y))


def _turn(q: Sequence[Any], a: Any, b: Any, c: Any) -> list[Any]:
    """q' = q (w, 0) / 2."""
    x, y, z, s = q
    return [
        0.5 * (s * a + y * c - z * b),
        0.5 * (s * b + z * a - x * c),
        0.5 * (s * c + x * b - y * a),
        -0.5 * (x * a + y * b + z * c),
    ]


def _rigid(scene: Scene) -> Equations:
    """Euler's equations of a free body, or of the symmetric heavy top about its fixed point."""
    m, length = scene.mass, float(scene.center[1])
    i1, i2, i3 = scene.inertia + m * length**2 * np.array([1.0, 0.0, 1.0])
    k1, k2, k3 = float((i2 - i3) / i1), float((i3 - i1) / i2), float((i1 - i2) / i3)
    weight = m * float(scene.gravity[2]) * length
    pull1, pull3 = float(weight / i1), float(weight / i3)

    def rates(_: Any, state: Sequence[Any], __: Functions) -> list[Any]:
        x, y, z, s, a, b, c = state
        turn = _turn((x, y, z, s), a, b, c)
        if not length:
            return [*turn, k1 * (b * c), k2 * (c * a), k3 * (a * b)]
        # moment of the weight about the fixed point: (0, l, 0) x R^T (0, 0, m g)
        first = k1 * (b * c) + pull1 * (1.0 - 2.0 * (x * x + y * y))
        third = k3 * (a * b) - (2.0 * pull3) * (x * z - y * s)
        return [*turn, first, k2 * (c * a), third]

    def pose(t: Array, state: Array) -> tuple[Array, Array]:
        q = state[:, :4]
        if length:
            turned = [rotation(n / np.linalg.norm(n)) @ scene.center for n in q]
            return scene.origin + np.array(turned), q
        t = t[:, None]
        return scene.origin + t * scene.velocity + 0.5 * t**2 * scene.gravity, q

    return Equations([*scene.quaternion.tolist(), *scene.spin.tolist()], rates, pose)


def _pendulum(scene: Scene) -> Equations:
    """theta'' = -(m g l/J) sin(theta)."""
    length = float(np.linalg.norm(scene.center))
    moment = scene.inertia[1] + scene.mass * length**2
    rate = float(scene.mass * scene.gravity[2] * length / moment)

    def rates(_: Any, y: Sequence[Any], f: Functions) -> list[Any]:
        return [y[1], rate * f.sin(y[0])]

    def pose(_: Array, y: Array) -> tuple[Array, Array]:
        angle, zero = y[:, 0], 0.0 * y[:, 0]
        position = np.column_stack([-np.sin(angle), zero, -np.cos(angle)]) * length
        half = 0.5 * angle
        return position, np.column_stack([zero, np.sin(half), zero, np.cos(half)])

    angle = 2.0 * float(np.arctan2(scene.quaternion[1], scene.quaternion[3]))
    return Equations([angle, 0.0], rates, pose)


def _sphere(scene: Scene) -> Equations:
    """The quaternion under a spin that grows at a constant rate in world axes (LL section 38)."""
    m, a = scene.mass, float(scene.size[0])
    (fx, fy, _), (kx, ky, kz) = scene.force, scene.torque
    acceleration = 5.0 / (7.0 * m) * np.array([fx + ky / a, fy - kx / a, 0.0])
    p, q, r = -acceleration[1] / a, acceleration[0] / a, kz / (0.4 * m * a * a)
    p, q, r = 0.5 * float(p), 0.5 * float(q), 0.5 * float(r)

    def rates(t: Any, state: Sequence[Any], _: Functions) -> list[Any]:
        x, y, z, s = state
        a, b, c = p * t, q * t, r * t
        return [
            a * s + b * z - c * y,
            b * s + c * x - a * z,
            c * s + a * y - b * x,
            -(a * x + b * y + c * z),
        ]

    def pose(t: Array, state: Array) -> tuple[Array, Array]:
        return scene.origin + 0.5 * t[:, None] ** 2 * acceleration, state

    return Equations(scene.quaternion.tolist(), rates, pose)


def _disk_constants(scene: Scene) -> tuple[float, float, float]:
    """Radius, (4/5) g/a and (m a^2)/(C + m a^2) = 2/3; the mass cancels."""
    a = float(scene.size[0])
    return a, 0.8 * -float(scene.gravity[2]) / a, 2.0 / 3.0


def _disk_angles(scene: Scene) -> Equations:
    """Thin disk by inclination, heading and spin angle; spin along node, slope and axis.

    See reference._disk; for A = m a^2/4, C = m a^2/2 the masses cancel.
    """
    a, weight, rough = _disk_constants(scene)

    def rates(_: Any, y: Sequence[Any], f: Functions) -> list[Any]:
        tilt, heading, _, w1, w2, w3, _, _ = y
        s, c = f.sin(tilt), f.cos(tilt)
        turn = w2 / s
        own = turn * c
        ch, sh = f.cos(heading), f.sin(heading)
        side = w1 * s
        return [
            w1,
            turn,
            w3 - own,
            w2 * (0.2 * own - 1.2 * w3) - weight * c,
            w1 * (2.0 * w3 - own),
            rough * (w1 * w2),
            a * (side * sh - w3 * ch),
            -a * (side * ch + w3 * sh),
        ]

    def pose(_: Array, y: Array) -> tuple[Array, Array]:
        tilt, heading, spin = 0.5 * y[:, :3].T
        plus, minus = heading + spin, heading - spin
        quaternion = np.column_stack(
            [
                np.sin(tilt) * np.cos(minus),
                np.sin(tilt) * np.sin(minus),
                np.cos(tilt) * np.sin(plus),
                np.cos(tilt) * np.cos(plus),
            ]
        )
        position = np.column_stack([y[:, 6], y[:, 7], a * np.sin(y[:, 0])])
        return position, quaternion

    tilt = 2.0 * float(np.arctan2(scene.quaternion[0], scene.quaternion[3]))
    start = [tilt, 0.0, 0.0, *scene.spin.tolist(), *scene.origin[:2].tolist()]
    return Equations(start, rates, pose)


def _disk_quaternion(scene: Scene) -> Equations:
    """Thin disk by quaternion, spin in body axes and the centre's x and y.

    About the contact, with u the unit vector from the contact up the slope to the centre (body
    axes): the inertia there is J = I + m a^2 (1 - u u), and
        J w' = -w x I w - m a u x (g_B + a (w x u' + w x (w x u))).
    """
    a, g = float(scene.size[0]), -float(scene.gravity[2])

    def rates(_: Any, state: Sequence[Any], f: Functions) -> list[Any]:
        x, y, z, s, p, q, r, _, _ = state
        n1, n2 = 2.0 * (x * z - y * s), 2.0 * (y * z + x * s)
        n3 = 1.0 - 2.0 * (x * x + y * y)
        sine = f.sqrt(n1 * n1 + n2 * n2)
        u1, u2 = n1 / sine, n2 / sine
        # components along e1 = u x e3 (node) and u; the node turns in the body at -own spin
        w1, w2 = p * u2 - q * u1, p * u1 + q * u2
        own = w2 * n3 / sine
        w1_rate = w2 * (0.2 * own - 1.2 * r) - 0.8 * g / a * n3
        w2_rate = w1 * (2.0 * r - own)
        drift = r - own
        # d/dt (w1 e1 + w2 u) in body axes, where e1 and u turn at -(r - own) about the axis
        along1, along2 = w1_rate + drift * w2, w2_rate - drift * w1
        p_rate, q_rate = along1 * u2 + along2 * u1, along2 * u2 - along1 * u1
        r_rate = (2.0 / 3.0) * (w1 * w2)
        # V = a w x u, to world axes
        v1, v2, v3 = -r * u2, r * u1, p * u2 - q * u1
        t1, t2, t3 = 2.0 * (y * v3 - z * v2), 2.0 * (z * v1 - x * v3), 2.0 * (x * v2 - y * v1)
        vx = v1 + s * t1 + y * t3 - z * t2
        vy = v2 + s * t2 + z * t1 - x * t3
        return [*_turn((x, y, z, s), p, q, r), p_rate, q_rate, r_rate, a * vx, a * vy]

    def pose(_: Array, state: Array) -> tuple[Array, Array]:
        unit = state[:, :4] / np.linalg.norm(state[:, :4], axis=1)[:, None]
        n3 = 1.0 - 2.0 * (unit[:, 0] ** 2 + unit[:, 1] ** 2)
        height = a * np.sqrt(1.0 - n3 * n3)
        return np.column_stack([state[:, 7:9], height]), state[:, :4]

    start = [*scene.quaternion.tolist(), *scene.spin.tolist(), *scene.origin[:2].tolist()]
    return Equations(start, rates, pose)
