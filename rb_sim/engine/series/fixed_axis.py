"""Series of a body on a fixed axis: phi'' = (steady + rate phi' + u) / J.

u = cosine cos phi + sine sin phi and its turn v = du/dphi obey u' = v phi', v' = -u phi', so that
no coefficient needs a sine, only two convolutions.
"""

from __future__ import annotations

import math

from rb_sim.engine.series.expansion import SUITS, evaluate, expand, plan, quadratic_order
from rb_sim.engine.series.hinge_torque import hinge_torque, total_hinge_torque
from rb_sim.engine.systems.fixed_axis import FixedAxisBody

SUITS[FixedAxisBody] = lambda system: all(
    type(row) in hinge_torque.kernels for row in system.effects
)


@plan.register(FixedAxisBody)
def hinge_plan(system, tolerance):
    """phi', u and v; phi has the coefficients of phi', divided by their order."""
    return 3, quadratic_order(tolerance)


@expand.register(FixedAxisBody)
def hinge_expand(system, t, y, order, room):
    torque = total_hinge_torque(system.effects, system)
    cosine, sine = system.inverse_J * torque.cosine, system.inverse_J * torque.sine
    rate = system.inverse_J * torque.rate
    c, s = math.cos(y[0]), math.sin(y[0])
    w, u, v = room[0], room[1], room[2]
    w[0], u[0], v[0] = y[1], cosine * c + sine * s, sine * c - cosine * s
    w[1] = system.inverse_J * torque.steady + u[0] + rate * w[0]
    for n in range(1, order):
        share, next_share = 1.0 / n, 1.0 / (n + 1)  # ahead of the sums that wait for each other
        up, down = 0.0, 0.0
        for k in range(n):
            up += v[k] * w[n - 1 - k]
            down += u[k] * w[n - 1 - k]
        u[n], v[n] = share * up, -share * down
        w[n + 1] = next_share * (u[n] + rate * w[n])
    angle, speed = max(1.0, abs(y[0])), max(1.0, abs(y[1]))
    before = max(abs(w[order - 2]) / ((order - 1) * angle), abs(w[order - 1]) / speed)
    last = max(abs(w[order - 1]) / (order * angle), abs(w[order]) / speed)
    return before, last


@evaluate.register(FixedAxisBody)
def hinge_evaluate(system, t, y, order, room, h):
    w = room[0]
    angle, speed = w[order - 1] / order, w[order]
    for k in range(order - 1, 0, -1):
        angle = w[k - 1] / k + h * angle
        speed = w[k] + h * speed
    return (h * angle, h * speed)
