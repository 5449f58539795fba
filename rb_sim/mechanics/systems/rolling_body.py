# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""One body rolling on a fixed plane: Euler's equations about the moving contact point.

With rho from the contact point P to C (body axes), V = w x rho and
(I + m (rho.rho 1 - rho rho^T)) dw/dt = K + rho x F - w x I w - m rho x (w x rho' + w x (w x rho)),
rho' the change of rho in the body as the contact wanders (LL 38; Newton-Euler with the reaction
eliminated).  A cylinder keeps its axis along the plane and has one degree of freedom.
"""

from __future__ import annotations

from typing import NamedTuple

from rb_sim.catalogue.geometry.smooth_surfaces import support, support_rate
from rb_sim.catalogue.spec import BodyState, Inertial, Quaternion, Vec3
from rb_sim.mechanics.system import project
from rb_sim.mechanics.systems.free import unit_if_needed
from rb_sim.mechanics.systems.one_body import (
    Dynamics,
    Held,
    about,
    body_system,
    quaternion_defect,
    torque_about,
    total_wrench,
)
from rb_sim.numerics.vectors import (
    add,
    cross,
    dot,
    gyroscopic,
    maximum,
    neg,
    quaternion_product,
    quaternion_rate,
    rotate,
    scale,
    shifted_inertia,
    sub,
    symmetric_solve,
    symmetric_times,
    unrotate,
)


class RollingBody(NamedTuple):
    """y = p_WC (3), q_WB (4), w_WB_B (3)."""

    body: Inertial
    surface: tuple
    normal: Vec3
    """normal of the plane towards the body, world."""
    offset: float
    """normal . x of points x in the plane [m]."""
    effects: tuple


class LineRollingBody(NamedTuple):
    """A cylinder that rolls straight: y = (phi, dphi/dt); phi from the first pose [rad]."""

    body: Inertial
    surface: tuple
    normal: Vec3
    offset: float
    q_0: Quaternion
    centre_0: Vec3
    """centre of the cylinder at phi = 0, world [m]."""
    forward: Vec3
    """direction of motion of the centre for phi > 0, world; the axis crossed with the normal."""
    effects: tuple


def contact_arm(system, q, w):
    """rho = r_PC and its rate in the body frame."""
    gamma = unrotate(q, system.normal)
    rho = neg(support(system.surface, gamma))
    return rho, neg(support_rate(system.surface, gamma, cross(gamma, w)))


def right_side(system, B, rho, rho_dot, f, k):
    """K + rho x F - w x I w - m rho x (w x rho' + w x (w x rho)), body axes."""
    w = B.w_WB_B
    moment = torque_about(B, rho, f, k)
    carried = cross(w, add(rho_dot, cross(w, rho)))
    return sub(
        sub(moment, gyroscopic(system.body.inertia, w)),
        scale(system.body.mass, cross(rho, carried)),
    )


def held_at_contact(system, B, rho, rho_dot, alpha, f, k):
    """(residual, Held) of the point of contact at C - rho; alpha: dw_B/dt.

    The residual is the larger one of the relative height of the point and the defect of q.
    """
    w = B.w_WB_B
    a_B = add(cross(alpha, rho), cross(w, add(rho_dot, cross(w, rho))))
    point = sub(B.p_WC, rotate(B.q_WB, rho))
    height = abs(dot(system.normal, point) - system.offset) / (
        abs(system.offset) + dot(rho, rho) ** 0.5
    )
    residual = maximum(height, quaternion_defect(B.q_WB))
    return residual, Held(rotate(B.q_WB, a_B), alpha, f, k, point)


@body_system(RollingBody, configuration=7)
def rolling_dynamics(system, t, y):
    """The velocity of C, and Newton-Euler about the point of contact."""
    q, w = (y[3], y[4], y[5], y[6]), (y[7], y[8], y[9])
    rho, rho_dot = contact_arm(system, q, w)
    B = BodyState((y[0], y[1], y[2]), q, rotate(q, cross(w, rho)), w)
    f, k = total_wrench(system.effects, t, system.body, B)
    inertia_P = shifted_inertia(system.body.inertia, system.body.mass, rho)
    alpha = symmetric_solve(inertia_P, right_side(system, B, rho, rho_dot, f, k))
    rates = B.v_WC + quaternion_rate(q, w) + alpha
    return Dynamics(rates, B, *held_at_contact(system, B, rho, rho_dot, alpha, f, k))


@project.register(RollingBody)
def rolling_project(system, t, y):
    """y with a unit quaternion and the height at which the surface touches the plane."""
    q = unit_if_needed(y[3:7])
    gamma = unrotate(q, system.normal)
    lowest = dot(gamma, support(system.surface, gamma))
    p = (y[0], y[1], y[2])
    rise = system.offset - lowest - dot(system.normal, p)
    return add(p, scale(rise, system.normal)) + q + y[7:10]


@body_system(LineRollingBody, configuration=1)
def line_dynamics(system, t, y):
    """Newton-Euler of the cylinder about its line of contact."""
    n = system.surface.axis_B
    q, w = quaternion_product(system.q_0, about(n, y[0])), scale(y[1], n)
    rho, rho_dot = contact_arm(system, q, w)
    centre = add(system.centre_0, scale(system.surface.radius * y[0], system.forward))
    p = sub(centre, rotate(q, system.surface.centre_C))
    B = BodyState(p, q, rotate(q, cross(w, rho)), w)
    f, k = total_wrench(system.effects, t, system.body, B)
    inertia_P = shifted_inertia(system.body.inertia, system.body.mass, rho)
    moment = dot(n, right_side(system, B, rho, rho_dot, f, k))
    alpha = scale(moment / dot(n, symmetric_times(inertia_P, n)), n)
    rates = (y[1], dot(n, alpha))
    return Dynamics(rates, B, *held_at_contact(system, B, rho, rho_dot, alpha, f, k))
