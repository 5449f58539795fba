# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Functions common to the systems of one body: active wrench and sample."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from rb_sim.catalogue.spec import WORLD, BodyState, Vec3, potential, wrench
from rb_sim.mechanics.system import CONFIGURATION, inside, project, sample
from rb_sim.numerics.kernels import dispatch
from rb_sim.numerics.vectors import (
    ZERO,
    add,
    cos,
    cross,
    dot,
    gyroscopic,
    rotate,
    scale,
    sin,
    sub,
    symmetric_times,
    unrotate,
)


class Held(NamedTuple):
    """Acceleration and active wrench of a body that a joint holds; its reaction follows."""

    a_W: Vec3
    """acceleration of C, world [m/s^2]."""
    alpha_B: Vec3
    """angular acceleration, body axes [rad/s^2]."""
    f_W: Vec3
    k_B: Vec3
    """active force, world [N], and torque about C, body axes [N m]."""
    point: Vec3
    """point about which the reaction is reported, world [m]."""


class Dynamics(NamedTuple):
    """One body at one instant: dy/dt, and what its sample reports besides."""

    rates: tuple
    """dy/dt."""
    B: BodyState
    residual: Any
    """how far y is from the manifold, relative to the size of the joint."""
    held: Held | None = None
    """None without a joint."""


@dispatch
def dynamics(system, t, y):
    """The Dynamics of a system of one body; laws keep the part that they need."""


def body_system(kind: type, configuration: int) -> Callable[[Any], Any]:
    """Decorator of the `dynamics` of a class of systems of one body, with so many coordinates of
    configuration.

    Its coordinates are independent and its domain has no end, unless it registers `project` and
    `inside` as well; its sample is `body_sample`, unless it registers another.
    """
    CONFIGURATION[kind] = configuration
    sample.register(kind)(body_sample)
    project.register(kind)(as_it_is)
    inside.register(kind)(endless)
    return dynamics.register(kind)


def rate(system, t, y):
    """dy/dt of one body as a tuple."""
    return dynamics(system, t, y).rates


def body_sample(system, t, y, out):
    """Write state, the reaction of the joint if there is one, and balances."""
    now = dynamics(system, t, y)
    i = put_state(out, now.B)
    if now.held is not None:
        force, torque_C = reaction_at_com(system.body, now.B, now.held)
        i = put_reaction(out, i, now.B, force, torque_C, now.held.point)
    put_balance(out, i, system.effects, t, system.body, now.B, now.residual)


def as_it_is(system, t, y):
    """y itself: the coordinates are independent."""
    return y


def endless(system, y):
    """True: the domain has no end."""
    return True


def total_wrench(effects, t, body, B):
    """Sum of the wrenches of all effects: force at C (world), torque about C (body)."""
    f, k = ZERO, ZERO
    for row in effects:
        df, dk = wrench(row, t, body, B, WORLD)
        f, k = add(f, df), add(k, dk)
    return f, k


def energetics(effects, t, body, B):
    """(potential energy, power of the effects that have none)."""
    u, p = 0.0, 0.0
    for row in effects:
        if type(row) in potential.kernels:
            u += potential(row, t, body, B, WORLD)
        else:
            f, k = wrench(row, t, body, B, WORLD)
            p += dot(f, B.v_WC) + dot(k, B.w_WB_B)
    return u, p


def reaction_at_com(body, B, held):
    """Reaction force (world) and torque about C (world) from Newton-Euler (LL 38.6)."""
    force = sub(scale(body.mass, held.a_W), held.f_W)
    turning = add(symmetric_times(body.inertia, held.alpha_B), gyroscopic(body.inertia, B.w_WB_B))
    return force, rotate(B.q_WB, sub(turning, held.k_B))


def about(n, angle):
    """Quaternion of a turn about the unit vector n by an angle [rad]."""
    half = 0.5 * angle
    s = sin(half)
    return (s * n[0], s * n[1], s * n[2], cos(half))


def put3(out, i, a):
    """Write a vector into out from index i on; returns the next index."""
    out[i], out[i + 1], out[i + 2] = a[0], a[1], a[2]
    return i + 3


def put_state(out, B):
    """Write position, orientation and velocities of the body; returns the next index."""
    i = put3(out, 0, B.p_WC)
    q = B.q_WB
    out[i], out[i + 1], out[i + 2], out[i + 3] = q[0], q[1], q[2], q[3]
    return put3(out, put3(out, i + 4, B.v_WC), B.w_WB_B)


def put_wrench(out, i, force, torque, point):
    """Write force, torque about `point`, and the point; all world. Returns the next index."""
    return put3(out, put3(out, put3(out, i, force), torque), point)


def put_reaction(out, i, B, force, torque_C, point):
    """Write the reaction about `point` of a force and a torque about C. Returns the next index."""
    return put_wrench(out, i, force, add(torque_C, cross(sub(B.p_WC, point), force)), point)


def put_balance(out, i, effects, t, body, B, residual):
    """Write energies, power, momenta and the residual."""
    spin = symmetric_times(body.inertia, B.w_WB_B)
    u, power = energetics(effects, t, body, B)
    momentum = scale(body.mass, B.v_WC)
    out[i] = 0.5 * (body.mass * dot(B.v_WC, B.v_WC) + dot(B.w_WB_B, spin))
    out[i + 1] = u
    out[i + 2] = power
    i = put3(out, i + 3, momentum)
    i = put3(out, i, add(cross(B.p_WC, momentum), rotate(B.q_WB, spin)))
    out[i] = residual


def torque_about(B, rho, f, k):
    """Active torque about the point at C - rho, body axes: K + rho x R^T F."""
    return add(k, cross(rho, unrotate(B.q_WB, f)))


def quaternion_defect(q):
    """| |q|^2 - 1 |."""
    return abs(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0)
