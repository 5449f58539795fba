"""Series of a homogeneous sphere that rolls under a constant force at its centre and torque.

LL 38, problem 1: about the contact (I + m a^2) dw/dt = K + a n x F across the normal n and
I dw_n/dt = K_n along it, so w = w_0 + alpha t in world axes, the centre moves along a parabola, and
only the quaternion needs a series: q' = (1/2) (w_0 + alpha t) q, a recurrence of two terms.
"""

from __future__ import annotations

from rb_sim.catalogue.effects.gravity import GravityRow
from rb_sim.catalogue.effects.wrench import WorldWrenchRow
from rb_sim.catalogue.types import BodyState
from rb_sim.contact.geometry.shapes import SphereSurface
from rb_sim.engine.one_body import total_wrench
from rb_sim.engine.series.expansion import linear_order
from rb_sim.engine.series.rolling import (
    rolling_evaluate,
    rolling_expand,
    rolling_plan,
    rolling_suits,
)
from rb_sim.maths.jit import inline
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
    inertia = system.body.inertia
    round_inertia = inertia[0] == inertia[1] == inertia[2] and not any(inertia[3:])
    steady = all(
        isinstance(row, GravityRow) or (isinstance(row, WorldWrenchRow) and row.r_B == ZERO)
        for row in system.effects
    )
    return tuple(system.surface.centre_C) == ZERO and round_inertia and steady


rolling_suits[SphereSurface] = suits_sphere


@inline
def sphere_motion(system, t, y):
    """(angular velocity, its rate, normal times radius), world axes."""
    q, w = (y[3], y[4], y[5], y[6]), (y[7], y[8], y[9])
    B = BodyState((y[0], y[1], y[2]), q, ZERO, w)
    force, torque_B = total_wrench(system.effects, t, system.body, B)
    torque = rotate(q, torque_B)
    n, inertia, arm = system.normal, system.body.inertia[0], system.surface.radius
    up = scale(arm, n)
    along = scale(dot(torque, n), n)
    across = sub(add(torque, cross(up, force)), along)
    inertia_P = inertia + system.body.mass * arm * arm
    return rotate(q, w), add(scale(1.0 / inertia_P, across), scale(1.0 / inertia, along)), up


@rolling_plan.register(SphereSurface)
def sphere_plan(surface, tolerance):
    """The quaternion."""
    return 4, linear_order(tolerance)


@rolling_expand.register(SphereSurface)
def sphere_expand(surface, system, t, y, order, room):
    w, alpha, _ = sphere_motion(system, t, y)
    turn, gain = scale(0.5, w) + (0.0,), scale(0.5, alpha) + (0.0,)
    q, earlier = (y[3], y[4], y[5], y[6]), (0.0, 0.0, 0.0, 0.0)
    before = 0.0
    for n in range(1, order + 1):
        a, b = quaternion_product(turn, q), quaternion_product(gain, earlier)
        share = 1.0 / n
        before = max(abs(q[0]), abs(q[1]), abs(q[2]), abs(q[3]))
        earlier = q
        q = (
            share * (a[0] + b[0]),
            share * (a[1] + b[1]),
            share * (a[2] + b[2]),
            share * (a[3] + b[3]),
        )
        room[0, n], room[1, n], room[2, n], room[3, n] = q
    return before, max(abs(q[0]), abs(q[1]), abs(q[2]), abs(q[3]))


@rolling_evaluate.register(SphereSurface)
def sphere_evaluate(surface, system, t, y, order, room, h):
    x, y_, z, s = room[0, order], room[1, order], room[2, order], room[3, order]
    for k in range(order - 1, 0, -1):
        x, y_ = room[0, k] + h * x, room[1, k] + h * y_
        z, s = room[2, k] + h * z, room[3, k] + h * s
    dq = (h * x, h * y_, h * z, h * s)
    w, alpha, up = sphere_motion(system, t, y)
    turned = quaternion_unit((y[3] + dq[0], y[4] + dq[1], y[5] + dq[2], y[6] + dq[3]))
    spin = unrotate(turned, add(w, scale(h, alpha)))
    half = add(w, scale(0.5 * h, alpha))
    return scale(h, cross(half, up)) + dq + sub(spin, (y[7], y[8], y[9]))
