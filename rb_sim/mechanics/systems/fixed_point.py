# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Body on a fixed point or a fixed axis: equations of motion and reactions."""

from __future__ import annotations

from typing import NamedTuple

from rb_sim.catalogue.spec import BodyState, Inertial, Quaternion, Symmetric, Vec3
from rb_sim.mechanics.system import project, sample
from rb_sim.mechanics.systems.free import unit_if_needed
from rb_sim.mechanics.systems.one_body import (
    Dynamics,
    Held,
    about,
    body_system,
    dynamics,
    put_balance,
    put_reaction,
    put_state,
    put_wrench,
    quaternion_defect,
    reaction_at_com,
    torque_about,
    total_wrench,
)
from rb_sim.numerics.vectors import (
    ZERO,
    add,
    cross,
    dot,
    gyroscopic,
    quaternion_product,
    quaternion_rate,
    rotate,
    scale,
    sub,
    symmetric_times,
)


class FixedPointBody(NamedTuple):
    """y = q_WB (4), w_WB_B (3)."""

    body: Inertial
    rho: Vec3
    """vector from the fixed point to C, body axes [m]."""
    point: Vec3
    """the fixed point, world [m]."""
    inertia_O: Symmetric
    """inertia about the fixed point, body axes [kg m^2]."""
    inverse_O: Symmetric
    effects: tuple


def held_by(system, B, alpha, f, k):
    """The Held of a body that turns about the point at C - rho."""
    w, rho = B.w_WB_B, system.rho
    a = rotate(B.q_WB, add(cross(alpha, rho), cross(w, cross(w, rho))))
    return Held(a, alpha, f, k, system.point)


@body_system(FixedPointBody, configuration=4)
def pivot_dynamics(system, t, y):
    """Euler's equations about the fixed point."""
    q, w = (y[0], y[1], y[2], y[3]), (y[4], y[5], y[6])
    p = add(system.point, rotate(q, system.rho))
    B = BodyState(p, q, rotate(q, cross(w, system.rho)), w)
    f, k = total_wrench(system.effects, t, system.body, B)
    moment = torque_about(B, system.rho, f, k)
    alpha = symmetric_times(system.inverse_O, sub(moment, gyroscopic(system.inertia_O, w)))
    rates = quaternion_rate(q, w) + alpha
    return Dynamics(rates, B, quaternion_defect(q), held_by(system, B, alpha, f, k))


@project.register(FixedPointBody)
def pivot_project(system, t, y):
    """y with the quaternion normalised."""
    return unit_if_needed(y[0:4]) + y[4:7]


# A body on a fixed axis, with the reactions of its two bearings.


class FixedAxisBody(NamedTuple):
    """y = phi [rad], dphi/dt [rad/s]; phi counts from the initial pose and does not wrap."""

    body: Inertial
    rho: Vec3
    """vector from bearing A to C, body axes [m]."""
    point: Vec3
    """position of bearing A, world [m]."""
    axis_B: Vec3
    q_0: Quaternion
    """orientation at phi = 0."""
    inverse_J: float
    """1 / (n . I_A n) [1/(kg m^2)]."""
    bearing_distance: float
    axial_share_A: float
    """fraction of the axial force on bearing A: 0, 1, or 1/2 if it is not unique."""
    effects: tuple


@body_system(FixedAxisBody, configuration=1)
def hinge_dynamics(system, t, y):
    """Angular acceleration: torque about the axis over the moment of inertia about it."""
    n, rho = system.axis_B, system.rho
    q, w = quaternion_product(system.q_0, about(n, y[0])), scale(y[1], n)
    B = BodyState(add(system.point, rotate(q, rho)), q, rotate(q, cross(w, rho)), w)
    f, k = total_wrench(system.effects, t, system.body, B)
    acceleration = system.inverse_J * dot(n, torque_about(B, rho, f, k))
    held = held_by(system, B, scale(acceleration, n), f, k)
    return Dynamics((y[1], acceleration), B, 0.0, held)


@sample.register(FixedAxisBody)
def hinge_sample(system, t, y, out):
    """Write state, total reaction about bearing A, forces at A and B, and balances.

    The transverse forces follow from the torque about A; the axial one is divided by
    `axial_share_A`.
    """
    now = dynamics(system, t, y)
    B = now.B
    force, torque_C = reaction_at_com(system.body, B, now.held)
    n = rotate(B.q_WB, system.axis_B)
    torque_A = add(torque_C, cross(sub(B.p_WC, system.point), force))
    axial = dot(n, force)
    force_B = add(
        scale(1.0 / system.bearing_distance, cross(torque_A, n)),
        scale((1.0 - system.axial_share_A) * axial, n),
    )
    far = add(system.point, scale(system.bearing_distance, n))
    i = put_reaction(out, put_state(out, B), B, force, torque_C, system.point)
    i = put_wrench(out, i, sub(force, force_B), ZERO, system.point)
    i = put_wrench(out, i, force_B, ZERO, far)
    put_balance(out, i, system.effects, t, system.body, B, now.residual)
