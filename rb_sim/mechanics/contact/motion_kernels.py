"""The laws of motion, the samples and the way back to the manifold of bodies in contact."""

from __future__ import annotations

from rb_sim.catalogue.constraints.rows import RATE
from rb_sim.integrate.layout import PackedSystem, address
from rb_sim.mechanics.contact.accelerations import contact_accelerations, moving, power_of_contacts
from rb_sim.mechanics.contact.constraint_tables import energies, write_anchors
from rb_sim.mechanics.contact.contact_bodies import ContactBodies, line_of
from rb_sim.mechanics.contact.contact_kinematics import STUCK
from rb_sim.mechanics.contact.contact_projection import bring_to_manifold
from rb_sim.mechanics.contact.contact_table import (
    CLOSED,
    COMPLIANT,
    DIRECT,
    DIRECT_TORQUE,
    GAP,
    POINT,
    SLIDE,
)
from rb_sim.mechanics.system import rate_into, sample, settle
from rb_sim.mechanics.systems.many_bodies import BODY, MULTIPLIERS, WIDTH, state_of, vec
from rb_sim.mechanics.systems.multibody import put_momenta, put_rates, residual_of
from rb_sim.numerics.kernels import call_law, inline, pointer
from rb_sim.numerics.vectors import add, cross, rotate, scale, sub


@rate_into.register(ContactBodies)
def contact_rate(system, t, y, dy):
    moving(system, t, y, False)
    put_rates(system, y, dy)
    dy[WIDTH * system.bodies.shape[0]] = power_of_contacts(system, y)


@settle.register(ContactBodies)
def contact_settle(system, t, y):
    return bring_to_manifold(system, t, y)


@settle.register(PackedSystem)
def settle_by_address(system, t, y):
    call_law(system.settle_by_address, t, pointer(y), address(system), pointer(system.workspace))
    return y


@inline
def reported_state(touch, c):
    """Open, slip, or stick/roll."""
    if touch[c, CLOSED] == 0.0:
        return 0.0
    if touch[c, SLIDE] == STUCK:
        return 2.0
    return 1.0


@inline
def put_contact_reactions(system, y, out, first):
    """Reactions of constraints and contacts: force, torque about the anchor, anchor; world axes.

    members[o, 0] is the part whose anchor counts, or -1 - body for the centre of mass.
    """
    members, joints = system.members, system.joints
    write_anchors(system, y)
    for c in range(system.touch.shape[0]):
        for j in range(3):
            system.anchors[joints + c, j] = system.touch[c, POINT + j]
    at = first
    for o in range(members.shape[0]):
        main = members[o, 0]
        b = system.lines[system.first_row[main], BODY] if main >= 0 else -1 - main
        B = state_of(y, b)
        force, torque = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for part in range(members.shape[1] - 1):
            if members[o, 1 + part] != 0:
                torque_B = (0.0, 0.0, 0.0)
                for k in range(system.first_row[part], system.first_row[part + 1]):
                    x = system.vectors[MULTIPLIERS, k]
                    force = add(force, scale(x, vec(system.pushes, k, 0)))
                    torque_B = add(torque_B, scale(x, vec(system.pushes, k, 3)))
                torque = add(torque, rotate(B.q_WB, torque_B))
                if part >= joints:
                    f, p = (
                        vec(system.touch, part - joints, DIRECT),
                        vec(system.anchors, part, 0),
                    )
                    force = add(force, f)
                    m = vec(system.touch, part - joints, DIRECT_TORQUE)
                    torque = add(torque, add(m, cross(sub(p, B.p_WC), f)))
        point = vec(system.anchors, main, 0) if main >= 0 else B.p_WC
        torque = add(torque, cross(sub(B.p_WC, point), force))
        for j in range(3):
            out[at + j] = force[j]
            out[at + 3 + j] = torque[j]
            out[at + 6 + j] = point[j]
        at += 9
    return at


@inline
def overlap(system):
    """Deepest overlap of a rigid contact that is open, relative to the scene's length."""
    touch, deepest = system.touch, 0.0
    for c in range(touch.shape[0]):
        if touch[c, CLOSED] == 0.0 and touch[c, COMPLIANT] == 0.0:
            deepest = max(deepest, -touch[c, GAP] / system.length)
    return deepest


@sample.register(ContactBodies, PackedSystem)
def contact_sample(system, t, y, out):
    bodies = system.bodies.shape[0]
    for i in range(WIDTH * bodies):
        out[i] = y[i]
    contact_accelerations(system, t, y)
    at = put_contact_reactions(system, y, out, WIDTH * bodies)
    reaction_power = power_of_contacts(system, y)
    for k in range(line_of(system, 0)):
        reaction_power += system.vectors[MULTIPLIERS, k] * system.rows[k, RATE]
    kinetic = put_momenta(system, y, out, at + 3)
    u, power = energies(system, t, y)
    out[at], out[at + 1], out[at + 2] = kinetic, u, power + reaction_power
    out[at + 9] = max(residual_of(system, y), overlap(system))
    out[at + 10] = y[WIDTH * bodies]
    for c in range(system.touch.shape[0]):
        out[at + 11 + c] = reported_state(system.touch, c)
