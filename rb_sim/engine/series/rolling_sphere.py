"""A homogeneous sphere that rolls under a constant force at its centre and torque, in world axes.

LL 38, problem 1: about the contact (I + m a^2) dw/dt = K + a n x F across the normal n and
I dw_n/dt = K_n along it, so w = w_0 + alpha t in world axes, q' = (1/2) w q, and the centre goes
by w x a n.
"""

from __future__ import annotations

from rb_sim.catalogue.effects.gravity import GravityRow
from rb_sim.catalogue.effects.wrench import WorldWrenchRow
from rb_sim.contact.geometry.shapes import SphereSurface
from rb_sim.engine.one_body import total_wrench
from rb_sim.engine.series.variables import AT_REST, Variables
from rb_sim.engine.systems.rolling import RollingBody
from rb_sim.maths.vectors import (
    ZERO,
    add,
    cross,
    dot,
    quaternion_product,
    quaternion_unit,
    rotate,
    scale,
    sub,
    unrotate,
)


def suits_sphere(system):
    """Centre of mass at the centre, equal moments, and loads that are constant in the world."""
    if not isinstance(system, RollingBody) or not isinstance(system.surface, SphereSurface):
        return False
    inertia = system.body.inertia
    round_inertia = inertia[0] == inertia[1] == inertia[2] and not any(inertia[3:])
    steady = all(
        isinstance(row, GravityRow) or (isinstance(row, WorldWrenchRow) and row.r_B == ZERO)
        for row in system.effects
    )
    return tuple(system.surface.centre_C) == ZERO and round_inertia and steady


def gain(system):
    """(alpha, normal times radius), world axes; body axes at rest are those of the world."""
    force, torque = total_wrench(system.effects, 0.0, system.body, AT_REST)
    n, inertia, arm = system.normal, system.body.inertia[0], system.surface.radius
    up = scale(arm, n)
    along = scale(dot(torque, n), n)
    across = sub(add(torque, cross(up, force)), along)
    inertia_P = inertia + system.body.mass * arm * arm
    return add(scale(1.0 / inertia_P, across), scale(1.0 / inertia, along)), up


def begin_in_world_axes(system, y):
    """The quaternion, w in world axes, and the way of the centre since the start."""
    return (*y[3:7], *rotate(y[3:7], y[7:10]), 0.0, 0.0, 0.0)


def rates_in_world_axes(system, z):
    alpha, up = gain(system)
    w = z[4:7]
    turn = quaternion_product((*scale(0.5, w), 0.0), z[:4])
    return (*turn, *alpha, *cross(w, up))


def change_from_world_axes(system, y, z, dz):
    turned = quaternion_unit(tuple(a + b for a, b in zip(y[3:7], dz[:4], strict=True)))
    w = add(z[4:7], dz[4:7])
    return (*dz[7:], *dz[:4], *sub(unrotate(turned, w), y[7:10]))


IN_WORLD_AXES = Variables(
    suits_sphere, 10, begin_in_world_axes, rates_in_world_axes, change_from_world_axes
)
