"""A body on a fixed axis under gravity: a pendulum, with its angular acceleration as a variable.

With F the weight and m = n x rho in body axes, the angular acceleration is
    S = (P cos phi - Q sin phi),   J P = m . F_0,   J Q = m . (n x F_0),
F_0 in the body axes of phi = 0.  With C = dS/dphi the series needs two products and no sine:
    phi' = w,   w' = S,   S' = C w,   C' = -S w.
"""

from __future__ import annotations

from rb_sim.catalogue.effects.gravity import GravityRow
from rb_sim.engine.one_body import total_wrench
from rb_sim.engine.series.variables import AT_REST, Variables
from rb_sim.engine.systems.fixed_axis import FixedAxisBody
from rb_sim.maths.scalars import cos, sin
from rb_sim.maths.vectors import cross, dot, unrotate


def suits_pendulum(system):
    """Nothing but gravity acts."""
    return isinstance(system, FixedAxisBody) and all(
        isinstance(row, GravityRow) for row in system.effects
    )


def begin_as_pendulum(system, y):
    """phi, w, S and C."""
    weight, _ = total_wrench(system.effects, 0.0, system.body, AT_REST)
    n, down = system.axis_B, unrotate(system.q_0, weight)
    arm = cross(n, system.rho)
    P, Q = system.inverse_J * dot(arm, down), system.inverse_J * dot(arm, cross(n, down))
    c, s = cos(y[0]), sin(y[0])
    return y[0], y[1], P * c - Q * s, -(P * s + Q * c)


def rates_of_pendulum(system, z):
    _, w, S, C = z
    return w, S, C * w, -(S * w)


def change_of_pendulum(system, y, z, dz):
    return dz[:2]


AS_PENDULUM = Variables(suits_pendulum, 4, begin_as_pendulum, rates_of_pendulum, change_of_pendulum)
