"""N bodies and any constraints in maximal coordinates, with explicit multipliers.

After every step the state is put back on the manifold, position first (Newton in the metric of
M), then velocity; see `multipliers`.
"""

from __future__ import annotations

import numpy as np

from rb_sim.catalogue.constraints.rows import COUNT, ERROR, HOLONOMIC, RATE, ROW_WIDTH
from rb_sim.catalogue.types import Inertial
from rb_sim.mechanics.system import inside, rate_into, sample, settle
from rb_sim.mechanics.systems.many_bodies import (
    ANGLE,
    BODY,
    BODY_WIDTH,
    INERTIA,
    INVERSE,
    LINE_COLUMNS,
    MASS,
    MULTIPLIERS,
    PARENT,
    PUSH,
    WIDTH,
    MultiBody,
    anchor_all,
    angles,
    arm_of,
    energetics,
    six,
    state_of,
    vec,
)
from rb_sim.mechanics.systems.multipliers import accelerations, row_velocity, settle_bodies
from rb_sim.numerics.kernels import inline
from rb_sim.numerics.rank import ranked
from rb_sim.numerics.vectors import (
    add,
    cross,
    dot,
    maximum,
    quaternion_rate,
    rotate,
    scale,
    sub,
    symmetric_times,
)


@rate_into.register(MultiBody)
def multibody_rate(system, t, y, dy):
    accelerations(system, t, y)
    put_rates(system, y, dy)


@inline
def put_rates(system, y, dy):
    """dy/dt of all bodies, the accelerations in push."""
    for i in range(system.bodies.shape[0]):
        B, k = state_of(y, i), WIDTH * i
        turn = quaternion_rate(B.q_WB, B.w_WB_B)
        for j in range(3):
            dy[k + j] = B.v_WC[j]
        for j in range(4):
            dy[k + 3 + j] = turn[j]
        for j in range(6):
            dy[k + 7 + j] = system.bodies[i, PUSH + j]


@settle.register(MultiBody)
def multibody_settle(system, t, y):
    return settle_bodies(system, t, y)


@inline
def put_reactions(system, y, out, first):
    """Reactions from the multipliers: force, torque about the anchor, anchor; world axes."""
    rows, members = system.rows, system.members
    anchor_all(system.constraints, system, y, 0)
    at = first
    for o in range(members.shape[0]):
        main = members[o, 0]
        B = state_of(y, system.lines[system.first_row[main], BODY])
        force, torque_B = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for part in range(members.shape[1] - 1):
            if members[o, 1 + part] != 0:
                for k in range(system.first_row[part], system.first_row[part + 1]):
                    x = system.vectors[MULTIPLIERS, k]
                    force = add(force, scale(x, vec(rows, k, 0)))
                    torque_B = add(torque_B, scale(x, vec(rows, k, 3)))
        point = vec(system.anchors, main, 0)
        torque = add(rotate(B.q_WB, torque_B), cross(sub(B.p_WC, point), force))
        for j in range(3):
            out[at + j] = force[j]
            out[at + 3 + j] = torque[j]
            out[at + 6 + j] = point[j]
        at += 9
    return at


@inline
def violation_of(system, y, k):
    """|g| / length or |G u - b| / speed of line k, an angle or spin at the end of its arm."""
    arm = arm_of(system, k)
    gap = abs(system.rows[k, ERROR]) * system.rows[k, HOLONOMIC] * arm
    slip = abs(row_velocity(system, y, k) - system.rows[k, RATE]) * arm
    return maximum(gap / system.length, slip / system.speed)


def worst_gap(system, holonomic):
    """The largest error of the holonomic lines as written [m], angles at the end of their arms."""
    worst = 0.0
    for k, held in enumerate(holonomic):
        if held:
            worst = maximum(worst, abs(system.rows[k, ERROR]) * arm_of(system, k))
    return worst


@inline
def residual_of(system, y):
    """The worst violation over all lines."""
    worst = 0.0
    for k in range(system.lines.shape[0]):
        worst = maximum(worst, violation_of(system, y, k))
    return worst


@inline
def put_momenta(system, y, out, at):
    """Momentum and angular momentum about the world origin into out; the kinetic energy."""
    kinetic = 0.0
    momentum, angular = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(system.bodies.shape[0]):
        B = state_of(y, i)
        p = scale(system.bodies[i, MASS], B.v_WC)
        spin = symmetric_times(six(system.bodies, i, INERTIA), B.w_WB_B)
        kinetic += 0.5 * (dot(p, B.v_WC) + dot(spin, B.w_WB_B))
        momentum = add(momentum, p)
        angular = add(angular, add(cross(B.p_WC, p), rotate(B.q_WB, spin)))
    for j in range(3):
        out[at + j] = momentum[j]
        out[at + 3 + j] = angular[j]
    return kinetic


def put_balances(system, t, y, out, at, reaction_power):
    """Energies, power, momenta and the residual."""
    kinetic = put_momenta(system, y, out, at + 3)
    u, power = energetics(system.effects, t, system, y)
    out[at], out[at + 1], out[at + 2] = kinetic, u, power + reaction_power
    out[at + 9] = residual_of(system, y)


@inline
def power_of_reactions(system):
    """Power of the multipliers on lines that prescribe a velocity [W]."""
    power = 0.0
    for k in range(system.lines.shape[0]):
        power += system.vectors[MULTIPLIERS, k] * system.rows[k, RATE]
    return power


@sample.register(MultiBody)
def multibody_sample(system, t, y, out):
    bodies = system.bodies.shape[0]
    for i in range(WIDTH * bodies):
        out[i] = y[i]
    at = WIDTH * bodies
    rank = accelerations(system, t, y)
    n = system.lines.shape[0]
    reaction_power = 0.0
    if n > 0:
        if rank < n:
            A, x = system.square[0], system.vectors[MULTIPLIERS]
            x[:] = ranked(A).least(A @ x)
        at = put_reactions(system, y, out, at)
        reaction_power = power_of_reactions(system)
    put_balances(system, t, y, out, at, reaction_power)


@inside.register(MultiBody)
def multibody_inside(system, y):
    return True


def multibody(
    bodies: list[Inertial],
    effects: tuple,
    constraints: tuple,
    outputs: list[tuple[list[int], int]],
    length: float,
    speed: float,
) -> MultiBody:
    """The system of these bodies; outputs lists (parts, anchor part) of each reaction."""
    counts = [COUNT[type(c.row)] for c in constraints]
    n, parts = sum(counts), len(constraints)
    members = np.zeros((len(outputs), 1 + parts), np.int64)
    for o, (counted, main) in enumerate(outputs):
        members[o, 0] = main
        members[o, [1 + part for part in counted]] = 1
    lines = np.zeros((n, LINE_COLUMNS), np.int64)
    lines[:, BODY] = np.repeat(np.array([c.body for c in constraints], np.int64), counts)
    lines[:, PARENT] = np.repeat(np.array([c.parent for c in constraints], np.int64), counts)
    lines[:, ANGLE] = angles([c.row for c in constraints])
    return MultiBody(
        bodies=body_table(bodies),
        lines=lines,
        rows=np.zeros((n, ROW_WIDTH)),
        square=np.zeros((2, n, n)),
        vectors=np.zeros((2, n)),
        first_row=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        members=members,
        anchors=np.zeros((parts, 3)),
        length=length,
        speed=speed,
        effects=effects,
        constraints=constraints,
    )


def body_table(bodies: list[Inertial]) -> np.ndarray:
    """Constants and work space of the bodies, (N, BODY_WIDTH)."""
    table = np.zeros((len(bodies), BODY_WIDTH))
    for i, body in enumerate(bodies):
        table[i, MASS] = body.mass
        table[i, INERTIA : INERTIA + 6] = body.inertia
        table[i, INVERSE : INVERSE + 6] = inverse_symmetric(body.inertia)
    return table


def inverse_symmetric(s: tuple[float, ...]) -> tuple[float, ...]:
    """Inverse of (xx, yy, zz, xy, xz, yz) in the same order."""
    m = np.array([[s[0], s[3], s[4]], [s[3], s[1], s[5]], [s[4], s[5], s[2]]])
    v = np.linalg.inv(m)
    return tuple(float(x) for x in (v[0, 0], v[1, 1], v[2, 2], v[0, 1], v[0, 2], v[1, 2]))
