"""N bodies and any constraints in maximal coordinates, with explicit multipliers.

M du/dt = f + G^T lambda with G du/dt = -bias gives accelerations AND reactions from one solve,
A lambda = -(bias + G M^-1 f), A = G M^-1 G^T (LL 38.2, 38.6).  After every step the state is put
back on the manifold, position first (Newton in the metric of M), then velocity.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rb_sim.catalogue.constraints.rows import COUNT, RowTable, anchor, fill
from rb_sim.catalogue.types import WORLD, BodyState, Inertial, potential, wrench
from rb_sim.engine.system import inside, rate_into, sample, settle
from rb_sim.maths.jit import by_type, entry, inline, plain
from rb_sim.maths.semidefinite import minimum_norm, solve_semidefinite
from rb_sim.maths.vectors import (
    add,
    cross,
    dot,
    quaternion_rate,
    quaternion_unit,
    rotate,
    scale,
    sub,
    symmetric_times,
    unrotate,
)

WIDTH = 13
"""Coordinates of one body: p_WC (3), q_WB (4), v_WC (3), w_WB_B (3)."""
POSITION_SWEEPS = 8
ON_MANIFOLD = 2e-15
"""Position error, relative to the scene's length, at which Newton's iteration ends."""


class Solver(NamedTuple):
    """Work space of the constraint solve for n rows and N bodies."""

    A: np.ndarray
    L: np.ndarray
    order: np.ndarray
    right: np.ndarray
    multipliers: np.ndarray
    push: np.ndarray
    """M^-1 (f + G^T lambda), shape (N, 6)."""
    load: np.ndarray
    """active [force (world), torque (body axes)] about C, shape (N, 6)."""


class Outputs(NamedTuple):
    """Which parts of the constraints count in which reaction."""

    member: np.ndarray
    """1 where the part counts, shape (K, parts)."""
    anchor_part: np.ndarray
    """the part whose anchor the reaction is about, shape (K,)."""
    first_row: np.ndarray
    """first line of each part, and the total at the end, shape (parts + 1,)."""
    anchors: np.ndarray
    """world, shape (parts, 3)."""


class MultiBody(NamedTuple):
    """y: WIDTH coordinates per body, one after the other."""

    mass: np.ndarray
    """shape (N,)."""
    inertia: np.ndarray
    """(xx, yy, zz, xy, xz, yz) about C, shape (N, 6)."""
    inverse_inertia: np.ndarray
    row_body: np.ndarray
    """body of each line, shape (n,)."""
    row_parent: np.ndarray
    """its parent, -1 for the world."""
    length: float
    """characteristic length of the scene [m]."""
    speed: float
    """characteristic speed of the scene [m/s]."""
    effects: tuple
    constraints: tuple
    rows: RowTable
    solver: Solver
    outputs: Outputs


@inline
def state_of(y, i):
    """State of body i; the world for -1."""
    if i < 0:
        return WORLD
    k = WIDTH * i
    return BodyState(
        (y[k], y[k + 1], y[k + 2]),
        (y[k + 3], y[k + 4], y[k + 5], y[k + 6]),
        (y[k + 7], y[k + 8], y[k + 9]),
        (y[k + 10], y[k + 11], y[k + 12]),
    )


@inline
def vec(a, i, k):
    return (a[i, k], a[i, k + 1], a[i, k + 2])


@inline
def six(a, i):
    return (a[i, 0], a[i, 1], a[i, 2], a[i, 3], a[i, 4], a[i, 5])


@inline
def inertial_of(system, i):
    return Inertial(system.mass[i], six(system.inertia, i), (0.0, 0.0, 0.0))


@inline
def accumulate_load(load, i, force, torque):
    for j in range(3):
        load[i, j] += force[j]
        load[i, 3 + j] += torque[j]


@inline
def apply_one(placed, t, system, y):
    """Add the wrench of one effect to its body, and the opposite to its parent."""
    B, A = state_of(y, placed.body), state_of(y, placed.parent)
    f, k = wrench(placed.row, t, inertial_of(system, placed.body), B, A)
    accumulate_load(system.solver.load, placed.body, f, k)
    if placed.parent >= 0:
        moment = add(rotate(B.q_WB, k), cross(sub(B.p_WC, A.p_WC), f))
        back = scale(-1.0, unrotate(A.q_WB, moment))
        accumulate_load(system.solver.load, placed.parent, scale(-1.0, f), back)


def _apply(effects, t, system, y):
    """Add the wrenches of all effects to system.solver.load."""


def _apply_plain(effects, t, system, y):
    for placed in effects:
        apply_one(placed, t, system, y)


def _apply_typed(effects, t, system, y):
    if len(effects) == 0:
        return lambda effects, t, system, y: None

    def implementation(effects, t, system, y):
        apply_one(effects[0], t, system, y)
        apply_effects(effects[1:], t, system, y)

    return implementation


apply_effects = by_type(_apply, _apply_typed, _apply_plain)


def _fill_all(constraints, t, system, y, part):
    """Write the lines of all constraints from this part on."""


def _fill_plain(constraints, t, system, y, part):
    for i, placed in enumerate(constraints):
        k = system.outputs.first_row[part + i]
        fill(placed.row, t, state_of(y, placed.body), state_of(y, placed.parent), system.rows, k)


def _fill_typed(constraints, t, system, y, part):
    if len(constraints) == 0:
        return lambda constraints, t, system, y, part: None

    def implementation(constraints, t, system, y, part):
        c = constraints[0]
        k = system.outputs.first_row[part]
        fill(c.row, t, state_of(y, c.body), state_of(y, c.parent), system.rows, k)
        fill_all(constraints[1:], t, system, y, part + 1)

    return implementation


fill_all = by_type(_fill_all, _fill_typed, _fill_plain)


def _anchor_all(constraints, system, y, part):
    """Write the anchors of all parts from this one on."""


@inline
def anchor_one(placed, system, y, part):
    point = anchor(placed.row, state_of(y, placed.body), state_of(y, placed.parent))
    for j in range(3):
        system.outputs.anchors[part, j] = point[j]


def _anchor_plain(constraints, system, y, part):
    for i, placed in enumerate(constraints):
        anchor_one(placed, system, y, part + i)


def _anchor_typed(constraints, system, y, part):
    if len(constraints) == 0:
        return lambda constraints, system, y, part: None

    def implementation(constraints, system, y, part):
        anchor_one(constraints[0], system, y, part)
        anchor_all(constraints[1:], system, y, part + 1)

    return implementation


anchor_all = by_type(_anchor_all, _anchor_typed, _anchor_plain)


def _energetics(effects, t, system, y):
    """(potential energy, power of the effects that have none)."""


@inline
def power_one(placed, t, system, y):
    B, A = state_of(y, placed.body), state_of(y, placed.parent)
    f, k = wrench(placed.row, t, inertial_of(system, placed.body), B, A)
    power = dot(f, B.v_WC) + dot(k, B.w_WB_B)
    if placed.parent >= 0:
        moment = add(rotate(B.q_WB, k), cross(sub(B.p_WC, A.p_WC), f))
        power -= dot(f, A.v_WC) + dot(moment, rotate(A.q_WB, A.w_WB_B))
    return power


@inline
def potential_one(placed, t, system, y):
    B, A = state_of(y, placed.body), state_of(y, placed.parent)
    return potential(placed.row, t, inertial_of(system, placed.body), B, A)


def _energetics_plain(effects, t, system, y):
    u, p = 0.0, 0.0
    for placed in effects:
        if type(placed.row) in potential.kernels:
            u += potential_one(placed, t, system, y)
        else:
            p += power_one(placed, t, system, y)
    return u, p


def _energetics_typed(effects, t, system, y):
    if len(effects) == 0:
        return lambda effects, t, system, y: (0.0, 0.0)
    if effects.types[0].types[0].instance_class in potential.kernels:

        def conservative(effects, t, system, y):
            u, p = energetics(effects[1:], t, system, y)
            return u + potential_one(effects[0], t, system, y), p

        return conservative

    def active(effects, t, system, y):
        u, p = energetics(effects[1:], t, system, y)
        return u, p + power_one(effects[0], t, system, y)

    return active


energetics = by_type(_energetics, _energetics_typed, _energetics_plain)


@inline
def inverse_mass_times(system, i, J, k, column):
    """M_i^-1 J^T of line k on body i, whose columns start at `column`."""
    force = scale(1.0 / system.mass[i], vec(J, k, column))
    return force, symmetric_times(six(system.inverse_inertia, i), vec(J, k, column + 3))


@inline
def coupling(J, i, column, force, turn):
    return dot(vec(J, i, column), force) + dot(vec(J, i, column + 3), turn)


@plain
def fill_matrix(system, holonomic_only):
    """A = G M^-1 G^T; with holonomic_only the other lines become those of the identity."""
    n = system.row_body.shape[0]
    J, A = system.rows.jacobian, system.solver.A
    body, parent, holonomic = system.row_body, system.row_parent, system.rows.holonomic
    for i in range(n):
        b, a = body[i], parent[i]
        fb, kb = inverse_mass_times(system, b, J, i, 0)
        fa, ka = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        if a >= 0:
            fa, ka = inverse_mass_times(system, a, J, i, 6)
        for j in range(i + 1):
            s = 0.0
            if body[j] == b:
                s += coupling(J, j, 0, fb, kb)
            if parent[j] == b:
                s += coupling(J, j, 6, fb, kb)
            if a >= 0:
                if body[j] == a:
                    s += coupling(J, j, 0, fa, ka)
                if parent[j] == a:
                    s += coupling(J, j, 6, fa, ka)
            if holonomic_only and (holonomic[i] == 0.0 or holonomic[j] == 0.0):
                s = 1.0 if i == j else 0.0
            A[i, j] = s
            A[j, i] = s


@inline
def add_push(push, i, force, turn, s):
    for j in range(3):
        push[i, j] += s * force[j]
        push[i, 3 + j] += s * turn[j]


@plain
def add_multipliers(system):
    """push += M^-1 G^T lambda."""
    J, push, x = system.rows.jacobian, system.solver.push, system.solver.multipliers
    for k in range(system.row_body.shape[0]):
        force, turn = inverse_mass_times(system, system.row_body[k], J, k, 0)
        add_push(push, system.row_body[k], force, turn, x[k])
        if system.row_parent[k] >= 0:
            force, turn = inverse_mass_times(system, system.row_parent[k], J, k, 6)
            add_push(push, system.row_parent[k], force, turn, x[k])


@plain
def row_times_push(system, k):
    """G push of line k."""
    J, push, b, a = (
        system.rows.jacobian,
        system.solver.push,
        system.row_body[k],
        system.row_parent[k],
    )
    s = coupling(J, k, 0, vec(push, b, 0), vec(push, b, 3))
    if a >= 0:
        s += coupling(J, k, 6, vec(push, a, 0), vec(push, a, 3))
    return s


@plain
def row_velocity(system, y, k):
    """G u of line k."""
    J = system.rows.jacobian
    B, A = state_of(y, system.row_body[k]), state_of(y, system.row_parent[k])
    s = coupling(J, k, 0, B.v_WC, B.w_WB_B)
    if system.row_parent[k] >= 0:
        s += coupling(J, k, 6, A.v_WC, A.w_WB_B)
    return s


@plain
def solve(system):
    s = system.solver
    return solve_semidefinite(s.A, s.right, s.multipliers, s.L, s.order, s.right.shape[0])


@plain
def accelerations(system, t, y):
    """Fill solver.push with the accelerations (world, body axes); returns the rank of G."""
    s = system.solver
    s.load[:, :] = 0.0
    apply_effects(system.effects, t, system, y)
    for i in range(system.mass.shape[0]):
        B = state_of(y, i)
        spin = symmetric_times(six(system.inertia, i), B.w_WB_B)
        a = scale(1.0 / system.mass[i], vec(s.load, i, 0))
        moment = sub(vec(s.load, i, 3), cross(B.w_WB_B, spin))
        alpha = symmetric_times(six(system.inverse_inertia, i), moment)
        for j in range(3):
            s.push[i, j] = a[j]
            s.push[i, 3 + j] = alpha[j]
    n = system.row_body.shape[0]
    if n == 0:
        return 0
    fill_all(system.constraints, t, system, y, 0)
    fill_matrix(system, False)
    for k in range(n):
        s.right[k] = -(system.rows.bias[k] + row_times_push(system, k))
    rank = solve(system)
    return rank


@rate_into.register(MultiBody)
def multibody_rate(system, t, y, dy):
    accelerations(system, t, y)
    add_multipliers(system)
    push = system.solver.push
    for i in range(system.mass.shape[0]):
        B, k = state_of(y, i), WIDTH * i
        turn = quaternion_rate(B.q_WB, B.w_WB_B)
        for j in range(3):
            dy[k + j] = B.v_WC[j]
        for j in range(4):
            dy[k + 3 + j] = turn[j]
        for j in range(6):
            dy[k + 7 + j] = push[i, j]


@plain
def move_by_push(system, y):
    """Shift and turn every body by solver.push, read as a small displacement."""
    push = system.solver.push
    for i in range(system.mass.shape[0]):
        B, k = state_of(y, i), WIDTH * i
        turn = quaternion_rate(B.q_WB, vec(push, i, 3))
        for j in range(3):
            y[k + j] += push[i, j]
        for j in range(4):
            y[k + 3 + j] += turn[j]
        q = quaternion_unit((y[k + 3], y[k + 4], y[k + 5], y[k + 6]))
        for j in range(4):
            y[k + 3 + j] = q[j]


@plain
def project_positions(system, t, y):
    """Newton's iteration on g(q) = 0; ends at round-off or when it no longer gains."""
    n, s = system.row_body.shape[0], system.solver
    last = np.inf
    for _ in range(POSITION_SWEEPS):
        fill_all(system.constraints, t, system, y, 0)
        worst = 0.0
        for k in range(n):
            s.right[k] = -system.rows.error[k] * system.rows.holonomic[k]
            worst = max(worst, abs(s.right[k]))
        if worst <= ON_MANIFOLD * system.length or worst >= last:
            return
        last = worst
        fill_matrix(system, True)
        solve(system)
        for k in range(n):
            s.multipliers[k] *= system.rows.holonomic[k]
        s.push[:, :] = 0.0
        add_multipliers(system)
        move_by_push(system, y)


@plain
def project_velocities(system, t, y):
    """u += M^-1 G^T A^-1 (b - G u): the nearest admissible velocity in the metric of M."""
    n, s = system.row_body.shape[0], system.solver
    fill_all(system.constraints, t, system, y, 0)
    fill_matrix(system, False)
    for k in range(n):
        s.right[k] = system.rows.rate[k] - row_velocity(system, y, k)
    solve(system)
    s.push[:, :] = 0.0
    add_multipliers(system)
    for i in range(system.mass.shape[0]):
        for j in range(6):
            y[WIDTH * i + 7 + j] += s.push[i, j]


@settle.register(MultiBody)
def multibody_settle(system, t, y):
    s = system.solver
    s.push[:, :] = 0.0
    move_by_push(system, y)
    if system.row_body.shape[0] > 0:
        project_positions(system, t, y)
        project_velocities(system, t, y)
    return y


@plain
def put_reactions(system, y, out, first):
    """Reactions from the multipliers: force, torque about the anchor, anchor; world axes."""
    J, x, outputs = system.rows.jacobian, system.solver.multipliers, system.outputs
    anchor_all(system.constraints, system, y, 0)
    at = first
    for o in range(outputs.member.shape[0]):
        main = outputs.anchor_part[o]
        B = state_of(y, system.row_body[outputs.first_row[main]])
        force, torque_B = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for part in range(outputs.member.shape[1]):
            if outputs.member[o, part] != 0.0:
                for k in range(outputs.first_row[part], outputs.first_row[part + 1]):
                    force = add(force, scale(x[k], vec(J, k, 0)))
                    torque_B = add(torque_B, scale(x[k], vec(J, k, 3)))
        point = vec(outputs.anchors, main, 0)
        torque = add(rotate(B.q_WB, torque_B), cross(sub(B.p_WC, point), force))
        for j in range(3):
            out[at + j] = force[j]
            out[at + 3 + j] = torque[j]
            out[at + 6 + j] = point[j]
        at += 9
    return at


@plain
def residual_of(system, y):
    """Worst |g| / length and |G u - b| / speed over all lines."""
    worst = 0.0
    for k in range(system.row_body.shape[0]):
        worst = max(worst, abs(system.rows.error[k]) * system.rows.holonomic[k] / system.length)
        slip = abs(row_velocity(system, y, k) - system.rows.rate[k])
        worst = max(worst, slip / system.speed)
    return worst


@sample.register(MultiBody)
def multibody_sample(system, t, y, out):
    bodies = system.mass.shape[0]
    for i in range(WIDTH * bodies):
        out[i] = y[i]
    at = WIDTH * bodies
    rank = accelerations(system, t, y)
    n = system.row_body.shape[0]
    reaction_power = 0.0
    if n > 0:
        if rank < n:
            minimum_norm(system.solver.A, system.solver.multipliers, rank)
        at = put_reactions(system, y, out, at)
        for k in range(n):
            reaction_power += system.solver.multipliers[k] * system.rows.rate[k]
    kinetic = 0.0
    momentum, angular = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(bodies):
        B = state_of(y, i)
        p = scale(system.mass[i], B.v_WC)
        spin = symmetric_times(six(system.inertia, i), B.w_WB_B)
        kinetic += 0.5 * (dot(p, B.v_WC) + dot(spin, B.w_WB_B))
        momentum = add(momentum, p)
        angular = add(angular, add(cross(B.p_WC, p), rotate(B.q_WB, spin)))
    u, power = energetics(system.effects, t, system, y)
    out[at], out[at + 1], out[at + 2] = kinetic, u, power + reaction_power
    for j in range(3):
        out[at + 3 + j] = momentum[j]
        out[at + 6 + j] = angular[j]
    out[at + 9] = residual_of(system, y)


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
    n, N = sum(counts), len(bodies)
    first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    member = np.zeros((len(outputs), len(constraints)))
    for o, (parts, _) in enumerate(outputs):
        member[o, parts] = 1.0
    inertia = np.array([b.inertia for b in bodies])
    inverse = np.array([inverse_symmetric(tuple(row)) for row in inertia])
    table = RowTable(np.zeros((n, 12)), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n))
    solver = Solver(
        np.zeros((n, n)), np.zeros((n, n)), np.zeros(n, np.int64), np.zeros(n), np.zeros(n),
        np.zeros((N, 6)), np.zeros((N, 6)),
    )  # fmt: skip
    return MultiBody(
        np.array([b.mass for b in bodies]),
        inertia,
        inverse,
        np.repeat(np.array([c.body for c in constraints], np.int64), counts),
        np.repeat(np.array([c.parent for c in constraints], np.int64), counts),
        length,
        speed,
        effects,
        constraints,
        table,
        solver,
        Outputs(
            member,
            np.array([main for _, main in outputs], np.int64),
            first,
            np.zeros((len(constraints), 3)),
        ),
    )


def inverse_symmetric(s: tuple[float, ...]) -> tuple[float, ...]:
    """Inverse of (xx, yy, zz, xy, xz, yz) in the same order."""
    m = np.array([[s[0], s[3], s[4]], [s[3], s[1], s[5]], [s[4], s[5], s[2]]])
    v = np.linalg.inv(m)
    return tuple(float(x) for x in (v[0, 0], v[1, 1], v[2, 2], v[0, 1], v[0, 2], v[1, 2]))


@entry
def violations(system, t, y):
    """|g| and |G u - b| of each line at (t, y), shapes (n,), and the rank of G."""
    n = system.row_body.shape[0]
    position, velocity = np.zeros(n), np.zeros(n)
    rank = accelerations(system, t, y)
    for k in range(n):
        position[k] = abs(system.rows.error[k]) * system.rows.holonomic[k]
        velocity[k] = abs(row_velocity(system, y, k) - system.rows.rate[k])
    return position, velocity, rank


@entry
def settled(system, t, y):
    """y moved onto the manifold, in place."""
    return settle(system, t, y)
