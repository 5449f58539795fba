# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Second derivations of the reference motions, by other equations and other methods.

`python -m benchmarks.peers.check` prints the largest difference of each from reference.py.

Closed forms: free bodies by Jacobi's elliptic functions (Landau & Lifshitz section 37) with the
precession by Gauss-Legendre quadrature, pendulum by elliptic functions (section 11), sphere by
section 38 problem 1. All scenes: Newton-Euler in maximal coordinates with multipliers
(accelerations and reactions from one linear solve), integrated by SciPy's DOP853.
Both work in doubles, so they confirm the reference to their own rounding, not to its 20 digits.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk, ellipkinc

from benchmarks.peers.reference import Reference, pose_error
from benchmarks.peers.scenes import NAMES, Array, Scene, load, rotation

Pose = tuple[Array, Array]


def sphere(scene: Scene, t: Array) -> Pose:
    """Rolling sphere from rest: constant acceleration, spin of fixed direction (world)."""
    (fx, fy, _), (kx, ky, kz) = scene.force, scene.torque
    m, a = scene.mass, scene.size[0]
    acceleration = 5.0 / (7.0 * m) * np.array([fx + ky / a, fy - kx / a, 0.0])
    spin = np.array([-acceleration[1] / a, acceleration[0] / a, kz / (0.4 * m * a * a)])
    rate = np.linalg.norm(spin)
    half = 0.25 * rate * t**2
    quaternion = np.column_stack([np.sin(half)[:, None] * spin / rate, np.cos(half)])
    return scene.origin + 0.5 * t[:, None] ** 2 * acceleration, quaternion


def pendulum(scene: Scene, t: Array) -> Pose:
    """Pendulum from rest: sin(theta/2) = k sn(K + n t), k = sin(theta0/2), n^2 = m g l/J."""
    length = np.linalg.norm(scene.center)
    moment = scene.inertia[1] + scene.mass * length**2
    rate = np.sqrt(-scene.mass * scene.gravity[2] * length / moment)
    k = scene.quaternion[1]
    sn, cn, dn, _ = ellipj(ellipk(k * k) + rate * t, k * k)
    # cos(theta/2) = dn: theta stays within +-pi when released from rest
    quaternion = np.column_stack([0 * t, k * sn, 0 * t, dn])
    angle = 2.0 * np.arctan2(k * sn, dn)
    position: Any = length * np.column_stack([-np.sin(angle), 0 * t, -np.cos(angle)])
    return position, quaternion


def free(scene: Scene, t: Array) -> Pose:
    """Free body from identity, M^2 > 2 E I2: Jacobi's functions and the precession about M.

    The precession about M of the axis of the largest moment is
    M (I1 w1^2 + I2 w2^2) / (I1^2 w1^2 + I2^2 w2^2).
    """
    order = np.argsort(scene.inertia)
    # an odd relabelling of the axes turns Euler's equations into those of reversed time
    sense = np.linalg.det(np.eye(3)[order])
    i1, i2, i3 = scene.inertia[order]
    w0 = scene.spin[order]
    energy2 = i1 * w0[0] ** 2 + i2 * w0[1] ** 2 + i3 * w0[2] ** 2
    high = i2 * (i3 - i2) * w0[1] ** 2 + i1 * (i3 - i1) * w0[0] ** 2  # 2 E I3 - M^2
    low = i2 * (i2 - i1) * w0[1] ** 2 + i3 * (i3 - i1) * w0[2] ** 2  # M^2 - 2 E I1
    momentum = np.sqrt(i3 * energy2 - high)
    size = np.sqrt([high / (i1 * (i3 - i1)), high / (i2 * (i3 - i2)), low / (i3 * (i3 - i1))])
    rate = sense * np.sqrt((i3 - i2) * low / (i1 * i2 * i3))
    m = (i2 - i1) * high / ((i3 - i2) * low)
    phase = ellipkinc(np.arctan2(w0[1] / size[1], w0[0] / size[0]), m)

    def spin(at: Array) -> Array:
        sn, cn, dn, _ = ellipj(phase + rate * at, m)
        return size * np.column_stack([cn, sn, dn])

    def precession(at: Array) -> Array:
        w = spin(at) ** 2
        return momentum * (i1 * w[:, 0] + i2 * w[:, 1]) / (i1**2 * w[:, 0] + i2**2 * w[:, 1])

    angle = _integral(precession, t)
    body = np.empty((len(t), 3))
    body[:, order] = spin(t) * np.array([i1, i2, i3]) / momentum
    axis = np.eye(3)[order[2]]
    frames = np.array([_node_frame(axis, direction) for direction in body])
    quaternion = np.empty((len(t), 4))
    for n, (turn, frame) in enumerate(zip(angle, frames, strict=True)):
        about = rotation(np.array([0.0, 0.0, np.sin(0.5 * turn), np.cos(0.5 * turn)]))
        quaternion[n] = _quaternion_of(frames[0] @ about @ frame.T)
    fall = 0.5 * t[:, None] ** 2 * scene.gravity
    return scene.origin + t[:, None] * scene.velocity + fall, quaternion


def _node_frame(axis: Array, direction: Array) -> Array:
    """Columns: node line of `axis` about `direction`, its completion, `direction`."""
    node = np.cross(axis, direction)
    node /= np.linalg.norm(node)
    return np.column_stack([node, np.cross(direction, node), direction])


def _integral(rate: Callable[[Array], Array], t: Array) -> Array:
    """Integral of `rate` from t[0] to each t, 16-point Gauss-Legendre on pieces of <= 0.05 s."""
    node, weight = np.polynomial.legendre.leggauss(16)
    total, out = 0.0, [0.0]
    for begin, end in zip(t[:-1], t[1:], strict=True):
        edges = np.linspace(begin, end, 1 + max(1, int(np.ceil((end - begin) / 0.05))))
        half = 0.5 * np.diff(edges)[:, None]
        at = edges[:-1, None] + half * (1.0 + node)
        total += float(np.sum(half * weight * rate(at.ravel()).reshape(at.shape)))
        out.append(total)
    return np.array(out)


def _quaternion_of(matrix: Array) -> Array:
    """[x, y, z, w] of a rotation matrix: eigenvector of the largest eigenvalue."""
    (a, b, c), (d, e, f), (g, h, i) = matrix
    table = [
        [a - e - i, 0.0, 0.0, 0.0],
        [b + d, e - a - i, 0.0, 0.0],
        [c + g, f + h, i - a - e, 0.0],
        [h - f, c - g, d - b, a + e + i],
    ]
    return np.linalg.eigh(np.array(table))[1][:, -1]


CLOSED_FORMS: dict[str, Callable[[Scene, Array], Pose]] = {
    "free_tumble": free,
    "gazebo_boxes": free,
    "pendulum": pendulum,
    "rolling_sphere": sphere,
}


def constrained(scene: Scene, t: Array) -> Pose:
    """Newton-Euler with multipliers, DOP853 at tolerance 1e-13.

    State: centre of mass, quaternion, velocity of the centre, spin in body axes.
    """
    mass = np.concatenate([np.full(3, scene.mass), scene.inertia])

    def rates(_: float, y: Array) -> Array:
        q, v, w = y[3:7] / np.linalg.norm(y[3:7]), y[7:10], y[10:]
        r = rotation(q)
        weight = scene.mass * scene.gravity + scene.force
        load = np.concatenate([weight, r.T @ scene.torque - np.cross(w, scene.inertia * w)])
        jacobian, bias = _constraint(scene, r, v, w)
        free_acceleration = load / mass
        compliance = (jacobian / mass) @ jacobian.T
        multipliers = np.linalg.lstsq(compliance, bias - jacobian @ free_acceleration, rcond=1e-10)[
            0
        ]
        change = free_acceleration + (jacobian.T @ multipliers) / mass
        turn = 0.5 * np.append(q[3] * w + np.cross(q[:3], w), -q[:3] @ w)
        return np.concatenate([v, turn, change])

    r = rotation(scene.quaternion)
    velocity = scene.velocity + r @ np.cross(scene.spin, scene.center)
    start = np.concatenate([scene.position, scene.quaternion, velocity, scene.spin])
    # the sphere starts from rest, where the error estimate sees nothing: hence a largest step
    solution = solve_ivp(
        rates, (0.0, t[-1]), start, "DOP853", t, rtol=1e-13, atol=1e-14, max_step=0.02
    )
    return solution.y[:3].T, solution.y[3:7].T


def _skew(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _constraint(scene: Scene, r: Array, v: Array, w: Array) -> tuple[Array, Array]:
    """G on (V world, w body) and -G' u, for the constraint that the scene's name implies."""
    if scene.name in ("heavy_top", "pendulum"):
        arm = -scene.center
        point = np.hstack([np.eye(3), -r @ _skew(arm)])
        bias = -r @ np.cross(w, np.cross(w, arm))
        if scene.name == "heavy_top":
            return point, bias
        axis = np.zeros((2, 6))
        axis[0, 3] = axis[1, 5] = 1.0
        return np.vstack([point, axis]), np.append(bias, [0.0, 0.0])
    if scene.name.startswith("rolling"):
        arm, arm_rate = _contact_arm(scene, r, v, w)
        # V + (R w) x arm = 0
        return np.hstack([np.eye(3), -_skew(arm) @ r]), -np.cross(r @ w, arm_rate)
    return np.zeros((0, 6)), np.zeros(0)


def _contact_arm(scene: Scene, r: Array, v: Array, w: Array) -> tuple[Array, Array]:
    """From the centre to the contact point of the plane z = 0, and its rate, world axes."""
    up, radius = np.array([0.0, 0.0, 1.0]), scene.size[0]
    if scene.name == "rolling_sphere":
        return -radius * up, np.zeros(3)
    axis = r[:, 2]
    axis_rate = np.cross(r @ w, axis)
    down = axis * axis[2] - up
    size = np.linalg.norm(down)
    down_rate = axis_rate * axis[2] + axis * axis_rate[2]
    unit = down / size
    return radius * unit, radius / size * (down_rate - unit * (unit @ down_rate))


def main() -> None:
    """Print the largest difference of each second derivation from the reference."""
    for name in NAMES:
        scene = load(name)
        reference = Reference(scene)
        true = reference.pose(scene.times)
        line = f"{name:15s} Newton-Euler DOP853 "
        line += f"{pose_error(*constrained(scene, scene.times), *true).max():.1e}"
        if name in CLOSED_FORMS:
            closed = CLOSED_FORMS[name](scene, scene.times)
            line += f", closed form {pose_error(*closed, *true).max():.1e}"
        print(line, flush=True)


if __name__ == "__main__":
    main()
