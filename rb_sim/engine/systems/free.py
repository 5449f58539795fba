"""Free body: m dV/dt = F, I dw/dt + w x I w = K about the centre of mass (LL 34, 36)."""

from __future__ import annotations

from typing import NamedTuple

from rb_sim.catalogue.types import BodyState, Inertial, Symmetric
from rb_sim.engine.one_body import (
    put_balance,
    put_state,
    quaternion_defect,
    total_wrench,
)
from rb_sim.engine.system import CONFIGURATION, inside, rate, sample, settle
from rb_sim.maths.jit import inline
from rb_sim.maths.scalars import rarely, sqrt
from rb_sim.maths.vectors import (
    gyroscopic,
    quaternion_rate,
    scale,
    sub,
    symmetric_times,
)

SMALL_DEFECT = 1e-13
"""|q|^2 - 1 below which the quaternion is left alone: rescaling would only add rounding."""


class FreeBody(NamedTuple):
    """y = p_WC (3), q_WB (4), v_WC (3), w_WB_B (3)."""

    body: Inertial
    inverse_inertia: Symmetric
    effects: tuple


CONFIGURATION[FreeBody] = 7


@inline
def free_state(y):
    return BodyState(
        (y[0], y[1], y[2]), (y[3], y[4], y[5], y[6]), (y[7], y[8], y[9]), (y[10], y[11], y[12])
    )


@rate.register(FreeBody)
def free_rate(system, t, y):
    B = free_state(y)
    f, k = total_wrench(system.effects, t, system.body, B)
    a = scale(1.0 / system.body.mass, f)
    moment = sub(k, gyroscopic(system.body.inertia, B.w_WB_B))
    alpha = symmetric_times(system.inverse_inertia, moment)
    return B.v_WC + quaternion_rate(B.q_WB, B.w_WB_B) + a + alpha


@inline
def unit_if_needed(q):
    square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    s = rarely(abs(square - 1.0) > SMALL_DEFECT, 1.0 / sqrt(square), 1.0)
    return (s * q[0], s * q[1], s * q[2], s * q[3])


@settle.register(FreeBody)
def free_settle(system, t, y):
    return y[0:3] + unit_if_needed(y[3:7]) + y[7:13]


@sample.register(FreeBody)
def free_sample(system, t, y, out):
    B = free_state(y)
    residual = quaternion_defect(B.q_WB)
    put_balance(out, put_state(out, B), system.effects, t, system.body, B, residual)


@inside.register(FreeBody)
def free_inside(system, y):
    return True
