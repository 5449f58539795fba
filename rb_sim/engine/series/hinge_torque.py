"""The torque of an effect about a fixed axis, written over cos phi, sin phi and dphi/dt.

About the axis n through the bearing, a force F in world axes at the arm d (body axes) gives
n . (d x R^T F) = n . (d x F_0) cos phi - n . (d x (n x F_0)) sin phi with F_0 = R_0^T F, and a
torque in world axes n . R_0^T K, since n turns into itself.
"""

from __future__ import annotations

from typing import NamedTuple

from rb_sim.catalogue.effects.drag import AngularDampingRow, LinearDragRow
from rb_sim.catalogue.effects.gravity import GravityRow
from rb_sim.catalogue.effects.torsion import TorsionDamperRow
from rb_sim.catalogue.effects.wrench import BodyWrenchRow, CommandRow, WorldWrenchRow
from rb_sim.maths.jit import by_type, dispatch, inline
from rb_sim.maths.vectors import add, cross, dot, scale, unrotate


class HingeTorque(NamedTuple):
    """steady + cosine cos phi + sine sin phi + rate dphi/dt [N m]."""

    steady: float
    cosine: float
    sine: float
    rate: float


@dispatch
def hinge_torque(row, system):
    """HingeTorque of one effect on a FixedAxisBody."""


@inline
def of_world_force(system, arm, force_W):
    """A force that keeps its direction in the world, at a point of the body."""
    force = unrotate(system.q_0, force_W)
    n = system.axis_B
    return HingeTorque(0.0, dot(n, cross(arm, force)), -dot(n, cross(arm, cross(n, force))), 0.0)


@inline
def steady(system, torque_B):
    return HingeTorque(dot(system.axis_B, torque_B), 0.0, 0.0, 0.0)


@inline
def both(a, b):
    return HingeTorque(a.steady + b.steady, a.cosine + b.cosine, a.sine + b.sine, a.rate + b.rate)


@hinge_torque.register(GravityRow)
def of_gravity(row, system):
    return of_world_force(system, system.rho, scale(system.body.mass, row.acceleration_W))


@hinge_torque.register(WorldWrenchRow)
def of_world_wrench(row, system):
    force = of_world_force(system, add(system.rho, row.r_B), row.force_W)
    return both(force, steady(system, unrotate(system.q_0, row.torque_W)))


@hinge_torque.register(BodyWrenchRow)
def of_body_wrench(row, system):
    return steady(system, add(row.torque_B, cross(add(system.rho, row.r_B), row.force_B)))


@hinge_torque.register(CommandRow)
def of_command(row, system):
    arm = add(system.rho, row.r_B)
    torque = add(unrotate(system.q_0, row.torque_W), row.torque_B)
    held = steady(system, add(torque, cross(arm, row.force_B)))
    return both(of_world_force(system, arm, row.force_W), held)


@hinge_torque.register(AngularDampingRow)
def of_damping(row, system):
    n = system.axis_B
    return HingeTorque(0.0, 0.0, 0.0, -row.coefficient * dot(n, n))


@hinge_torque.register(TorsionDamperRow)
def of_torsion_damper(row, system):
    along = dot(system.axis_B, row.axis_B)
    return HingeTorque(0.0, 0.0, 0.0, -row.damping * along * along)


@hinge_torque.register(LinearDragRow)
def of_linear_drag(row, system):
    """The medium's wind is a world force; the rest opposes V = dphi/dt n x rho."""
    wind = of_world_force(system, system.rho, scale(row.coefficient, row.medium_W))
    swept = cross(system.axis_B, system.rho)
    return both(wind, HingeTorque(0.0, 0.0, 0.0, -row.coefficient * dot(swept, swept)))


NO_TORQUE = HingeTorque(0.0, 0.0, 0.0, 0.0)


def _total_hinge_torque(effects, system):
    """Sum over the effects."""


def _typed(effects, system):
    if len(effects) == 0:
        return lambda effects, system: NO_TORQUE
    if len(effects) == 1:
        return lambda effects, system: hinge_torque(effects[0], system)
    return lambda effects, system: both(
        hinge_torque(effects[0], system), total_hinge_torque(effects[1:], system)
    )


def _plain(effects, system):
    total = NO_TORQUE
    for row in effects:
        total = both(total, hinge_torque(row, system))
    return total


total_hinge_torque = by_type(_total_hinge_torque, _typed, _plain)
