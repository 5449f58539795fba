"""Body with a fixed point O: I_O dw/dt + w x I_O w = K_O, reaction R = m a_C - F (LL 36, 38).

Reduced coordinates: the point cannot drift, and the motion costs a solve with a constant matrix.
"""

from __future__ import annotations

from typing import NamedTuple

from rb_sim.catalogue.types import BodyState, Inertial, Symmetric, Vec3
from rb_sim.mechanics.system import CONFIGURATION, inside, rate, sample, settle
from rb_sim.mechanics.systems.free import unit_if_needed
from rb_sim.mechanics.systems.one_body import (
    put_balance,
    put_reaction,
    put_state,
    quaternion_defect,
    reaction_at_com,
    torque_about,
    total_wrench,
)
from rb_sim.numerics.kernels import inline
from rb_sim.numerics.vectors import (
    add,
    cross,
    gyroscopic,
    quaternion_rate,
    rotate,
    sub,
    symmetric_times,
)


class FixedPointBody(NamedTuple):
    """y = q_WB (4), w_WB_B (3)."""

    body: Inertial
    rho: Vec3
    """from the fixed point to C, body axes [m]."""
    point: Vec3
    """the fixed point, world [m]."""
    inertia_O: Symmetric
    """about the fixed point, body axes."""
    inverse_O: Symmetric
    effects: tuple


CONFIGURATION[FixedPointBody] = 4


@inline
def pivot_state(system, y):
    q, w = (y[0], y[1], y[2], y[3]), (y[4], y[5], y[6])
    p = add(system.point, rotate(q, system.rho))
    return BodyState(p, q, rotate(q, cross(w, system.rho)), w)


@inline
def pivot_spin_rate(system, t, B):
    moment = torque_about(system.effects, t, system.body, B, system.rho)
    return symmetric_times(system.inverse_O, sub(moment, gyroscopic(system.inertia_O, B.w_WB_B)))


@rate.register(FixedPointBody)
def pivot_rate(system, t, y):
    B = pivot_state(system, y)
    return quaternion_rate(B.q_WB, B.w_WB_B) + pivot_spin_rate(system, t, B)


@settle.register(FixedPointBody)
def pivot_settle(system, t, y):
    return unit_if_needed(y[0:4]) + y[4:7]


@sample.register(FixedPointBody)
def pivot_sample(system, t, y, out):
    B = pivot_state(system, y)
    w, rho = B.w_WB_B, system.rho
    alpha = pivot_spin_rate(system, t, B)
    a = rotate(B.q_WB, add(cross(alpha, rho), cross(w, cross(w, rho))))
    f, k = total_wrench(system.effects, t, system.body, B)
    force, torque_C = reaction_at_com(system.body, B, a, alpha, f, k)
    i = put_reaction(out, put_state(out, B), B, force, torque_C, system.point)
    put_balance(out, i, system.effects, t, system.body, B, quaternion_defect(B.q_WB))


@inside.register(FixedPointBody)
def pivot_inside(system, y):
    return True
