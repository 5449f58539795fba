"""Series of a turning body: free, or about a fixed point, under a constant force at its centre.

q' = (1/2) q w; Euler's equations are quadratic in w, in principal axes with one product each.  The
force as the body sees it, f = R^T F, turns with f' = f x w, so that its torque rho x f about a
fixed point needs no product of quaternions.
"""

from __future__ import annotations

from rb_sim.catalogue.effects.gravity import GravityRow
from rb_sim.engine.one_body import total_wrench
from rb_sim.engine.series.expansion import SUITS, evaluate, expand, plan, quadratic_order
from rb_sim.engine.systems.fixed_point import FixedPointBody, pivot_state
from rb_sim.engine.systems.free_rotor import FreeRotor, rotor_state
from rb_sim.maths.jit import inline
from rb_sim.maths.vectors import cross, scale, sub, symmetric_times, unrotate

Q, W, F = 0, 4, 7
"""First rows of the quaternion, the angular velocity and the force (body axes)."""


def only_gravity(system):
    return all(isinstance(row, GravityRow) for row in system.effects)


SUITS[FreeRotor] = SUITS[FixedPointBody] = only_gravity


@inline
def put(room, first, n, values):
    for i in range(len(values)):
        room[first + i, n] = values[i]


@inline
def triple(room, first, n):
    return (room[first, n], room[first + 1, n], room[first + 2, n])


@inline
def quaternion_term(room, n):
    """Coefficient n of q w / 2."""
    x, y, z, s = 0.0, 0.0, 0.0, 0.0
    for k in range(n + 1):
        a, b, c, d = room[Q, k], room[Q + 1, k], room[Q + 2, k], room[Q + 3, k]
        u, v, w = room[W, n - k], room[W + 1, n - k], room[W + 2, n - k]
        x += d * u + b * w - c * v
        y += d * v + c * u - a * w
        z += d * w + a * v - b * u
        s -= a * u + b * v + c * w
    return (0.5 * x, 0.5 * y, 0.5 * z, 0.5 * s)


@inline
def gyroscopic_term(room, n, inertia):
    """Coefficient n of w x I w, by differences of the moments as in `gyroscopic`."""
    xx, yy, zz, xy, xz, yz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(n + 1):
        x, y, z = room[W, k], room[W + 1, k], room[W + 2, k]
        u, v, w = room[W, n - k], room[W + 1, n - k], room[W + 2, n - k]
        xx += x * u
        yy += y * v
        zz += z * w
        xy += x * v
        xz += x * w
        yz += y * w
    i = inertia
    return (
        (i[2] - i[1]) * yz + i[5] * (yy - zz) + i[4] * xy - i[3] * xz,
        (i[0] - i[2]) * xz + i[4] * (zz - xx) + i[3] * yz - i[5] * xy,
        (i[1] - i[0]) * xy + i[3] * (xx - yy) + i[5] * xz - i[4] * yz,
    )


@inline
def turned_term(room, n):
    """Coefficient n of f x w."""
    x, y, z = 0.0, 0.0, 0.0
    for k in range(n + 1):
        a, b, c = room[F, k], room[F + 1, k], room[F + 2, k]
        u, v, w = room[W, n - k], room[W + 1, n - k], room[W + 2, n - k]
        x += b * w - c * v
        y += c * u - a * w
        z += a * v - b * u
    return (x, y, z)


@inline
def largest_term(room, n, w):
    """Largest coefficient n of q, and of w relative to max(1, |w_i|)."""
    size = 0.0
    for i in range(4):
        size = max(size, abs(room[Q + i, n]))
    for i in range(3):
        size = max(size, abs(room[W + i, n]) / max(1.0, abs(w[i])))
    return size


@inline
def turned_by(room, order, h):
    """(dq, dw) after h."""
    a, b, c, d = room[Q, order], room[Q + 1, order], room[Q + 2, order], room[Q + 3, order]
    u, v, w = room[W, order], room[W + 1, order], room[W + 2, order]
    for k in range(order - 1, 0, -1):
        a, b = room[Q, k] + h * a, room[Q + 1, k] + h * b
        c, d = room[Q + 2, k] + h * c, room[Q + 3, k] + h * d
        u, v, w = room[W, k] + h * u, room[W + 1, k] + h * v, room[W + 2, k] + h * w
    return (h * a, h * b, h * c, h * d), (h * u, h * v, h * w)


@plan.register(FreeRotor)
def rotor_plan(system, tolerance):
    return F, quadratic_order(tolerance)


@inline
def euler_term(room, n, coupling):
    """Coefficient n of (k1 w2 w3, k2 w3 w1, k3 w1 w2)."""
    x, y, z = 0.0, 0.0, 0.0
    for k in range(n + 1):
        a, b = room[W, k], room[W + 1, k]
        x += b * room[W + 2, n - k]
        y += a * room[W + 2, n - k]
        z += a * room[W + 1, n - k]
    return (coupling[0] * x, coupling[1] * y, coupling[2] * z)


@expand.register(FreeRotor)
def rotor_expand(system, t, y, order, room):
    P = rotor_state(y)
    put(room, Q, 0, P.q_WB)
    put(room, W, 0, P.w_WB_B)
    for n in range(order):
        share = 1.0 / (n + 1)
        q = quaternion_term(room, n)
        put(room, W, n + 1, scale(share, euler_term(room, n, system.coupling)))
        put(room, Q, n + 1, (share * q[0], share * q[1], share * q[2], share * q[3]))
    w = P.w_WB_B
    return largest_term(room, order - 1, w), largest_term(room, order, w)


@evaluate.register(FreeRotor)
def rotor_evaluate(system, t, y, order, room, h):
    P = rotor_state(y)
    force, _ = total_wrench(system.effects, t, system.body, P)
    dv = scale(h / system.body.mass, force)
    dq, dw = turned_by(room, order, h)
    v = P.v_WC
    dp = (h * (v[0] + 0.5 * dv[0]), h * (v[1] + 0.5 * dv[1]), h * (v[2] + 0.5 * dv[2]))
    return dp + dq + dv + dw


@plan.register(FixedPointBody)
def pivot_plan(system, tolerance):
    return F + 3, quadratic_order(tolerance)


@expand.register(FixedPointBody)
def pivot_expand(system, t, y, order, room):
    B = pivot_state(system, y)
    force, _ = total_wrench(system.effects, t, system.body, B)
    put(room, Q, 0, B.q_WB)
    put(room, W, 0, B.w_WB_B)
    put(room, F, 0, unrotate(B.q_WB, force))
    for n in range(order):
        share = 1.0 / (n + 1)
        moment = cross(system.rho, triple(room, F, n))
        moment = sub(moment, gyroscopic_term(room, n, system.inertia_O))
        q = quaternion_term(room, n)
        put(room, F, n + 1, scale(share, turned_term(room, n)))
        put(room, Q, n + 1, (share * q[0], share * q[1], share * q[2], share * q[3]))
        put(room, W, n + 1, scale(share, symmetric_times(system.inverse_O, moment)))
    w = B.w_WB_B
    return largest_term(room, order - 1, w), largest_term(room, order, w)


@evaluate.register(FixedPointBody)
def pivot_evaluate(system, t, y, order, room, h):
    dq, dw = turned_by(room, order, h)
    return dq + dw
