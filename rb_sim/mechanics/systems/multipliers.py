"""Accelerations and multipliers of N constrained bodies, and the way back to the manifold.

M du/dt = f + G^T lambda with G du/dt = -bias gives accelerations AND reactions from one solve,
A lambda = -(bias + G M^-1 f), A = G M^-1 G^T (LL 38.2, 38.6).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rb_sim.catalogue.constraints.rows import BIAS, ERROR, HOLONOMIC, RATE
from rb_sim.integrate.attempt import LOST, correct_positions, position_error, return_to_positions
from rb_sim.mechanics.systems.many_bodies import (
    BODY,
    INERTIA,
    INVERSE,
    LOAD,
    MASS,
    MULTIPLIERS,
    ORDER,
    PARENT,
    PUSH,
    RIGHT,
    WIDTH,
    MultiBody,
    apply_effects,
    arm_of,
    fill_all,
    six,
    state_of,
    vec,
)
from rb_sim.numerics.kernels import dispatch, inline
from rb_sim.numerics.linear_solves import solve_semidefinite
from rb_sim.numerics.vectors import (
    dot,
    gyroscopic,
    quaternion_rate,
    quaternion_unit,
    scale,
    sub,
    symmetric_times,
)


@inline
def inverse_mass_times(system, i, k, column):
    """M_i^-1 J^T of line k on body i, whose columns start at `column`."""
    force = scale(1.0 / system.bodies[i, MASS], vec(system.rows, k, column))
    inverse = six(system.bodies, i, INVERSE)
    return force, symmetric_times(inverse, vec(system.rows, k, column + 3))


@inline
def coupling(rows, i, column, force, turn):
    return dot(vec(rows, i, column), force) + dot(vec(rows, i, column + 3), turn)


@inline
def rise_of(system, j, b, a, of_body, of_parent):
    """What line j gains by the accelerations (linear, angular) of a push on body b and its parent
    a, -1 for the world."""
    rows, lines, s = system.rows, system.lines, 0.0
    if lines[j, BODY] == b:
        s += coupling(rows, j, 0, of_body[0], of_body[1])
    if lines[j, PARENT] == b:
        s += coupling(rows, j, 6, of_body[0], of_body[1])
    if a >= 0:
        if lines[j, BODY] == a:
            s += coupling(rows, j, 0, of_parent[0], of_parent[1])
        if lines[j, PARENT] == a:
            s += coupling(rows, j, 6, of_parent[0], of_parent[1])
    return s


@inline
def fill_matrix(system, holonomic_only):
    """A = G M^-1 G^T; with holonomic_only the other lines become those of the identity."""
    rows, lines = system.rows, system.lines
    for i in range(lines.shape[0]):
        b, a = lines[i, BODY], lines[i, PARENT]
        fb, kb = inverse_mass_times(system, b, i, 0)
        fa, ka = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        if a >= 0:
            fa, ka = inverse_mass_times(system, a, i, 6)
        for j in range(i + 1):
            s = rise_of(system, j, b, a, (fb, kb), (fa, ka))
            if holonomic_only and (rows[i, HOLONOMIC] == 0.0 or rows[j, HOLONOMIC] == 0.0):
                s = 1.0 if i == j else 0.0
            system.square[0, i, j] = s
            system.square[0, j, i] = s


@inline
def add_push(bodies, i, force, turn, s):
    for j in range(3):
        bodies[i, PUSH + j] += s * force[j]
        bodies[i, PUSH + 3 + j] += s * turn[j]


@inline
def clear_push(system):
    for i in range(system.bodies.shape[0]):
        for j in range(6):
            system.bodies[i, PUSH + j] = 0.0


@inline
def add_multiplier(system, k, x):
    """push += M^-1 J^T x of line k."""
    b, a = system.lines[k, BODY], system.lines[k, PARENT]
    force, turn = inverse_mass_times(system, b, k, 0)
    add_push(system.bodies, b, force, turn, x)
    if a >= 0:
        force, turn = inverse_mass_times(system, a, k, 6)
        add_push(system.bodies, a, force, turn, x)


@inline
def add_multipliers(system):
    """push += M^-1 G^T lambda."""
    for k in range(system.lines.shape[0]):
        add_multiplier(system, k, system.vectors[MULTIPLIERS, k])


@inline
def row_times_push(system, k):
    """G push of line k."""
    bodies, b, a = system.bodies, system.lines[k, BODY], system.lines[k, PARENT]
    s = coupling(system.rows, k, 0, vec(bodies, b, PUSH), vec(bodies, b, PUSH + 3))
    if a >= 0:
        s += coupling(system.rows, k, 6, vec(bodies, a, PUSH), vec(bodies, a, PUSH + 3))
    return s


@inline
def row_velocity(system, y, k):
    """G u of line k."""
    B, A = state_of(y, system.lines[k, BODY]), state_of(y, system.lines[k, PARENT])
    s = coupling(system.rows, k, 0, B.v_WC, B.w_WB_B)
    if system.lines[k, PARENT] >= 0:
        s += coupling(system.rows, k, 6, A.v_WC, A.w_WB_B)
    return s


@inline
def solve_lines(system):
    """Multipliers from the right side; returns the rank of A."""
    return solve_semidefinite(
        system.square[0],
        system.vectors[RIGHT],
        system.vectors[MULTIPLIERS],
        system.square[1],
        system.lines[:, ORDER],
        system.lines.shape[0],
    )


def _write_rows(system, t, y):
    """Write the lines of all constraints at (t, y)."""


write_rows = dispatch(_write_rows)


@inline
def clear_loads(system):
    for i in range(system.bodies.shape[0]):
        for j in range(6):
            system.bodies[i, LOAD + j] = 0.0


@inline
def free_accelerations(system, y):
    """push = accelerations (world, body axes) that the loads alone would give."""
    bodies = system.bodies
    for i in range(bodies.shape[0]):
        w = state_of(y, i).w_WB_B
        a = scale(1.0 / bodies[i, MASS], vec(bodies, i, LOAD))
        turn = gyroscopic(six(bodies, i, INERTIA), w)
        alpha = symmetric_times(six(bodies, i, INVERSE), sub(vec(bodies, i, LOAD + 3), turn))
        for j in range(3):
            bodies[i, PUSH + j] = a[j]
            bodies[i, PUSH + 3 + j] = alpha[j]


@inline
def accelerations(system, t, y):
    """Fill the multipliers and push = accelerations (world, body axes); returns the rank of G."""
    clear_loads(system)
    apply_effects(system.effects, t, system, y)
    free_accelerations(system, y)
    n = system.lines.shape[0]
    if n == 0:
        return 0
    write_rows(system, t, y)
    fill_matrix(system, False)
    for k in range(n):
        system.vectors[RIGHT, k] = -(system.rows[k, BIAS] + row_times_push(system, k))
    rank = solve_lines(system)
    add_multipliers(system)
    return rank


@write_rows.register(MultiBody)
def write_constraint_rows(system, t, y):
    fill_all(system.constraints, t, system, y, 0)


@inline
def move_by_push(system, y):
    """Shift and turn every body by push, read as a small displacement."""
    for i in range(system.bodies.shape[0]):
        B, k = state_of(y, i), WIDTH * i
        turn = quaternion_rate(B.q_WB, vec(system.bodies, i, PUSH + 3))
        for j in range(3):
            y[k + j] += system.bodies[i, PUSH + j]
        q = quaternion_unit(
            (B.q_WB[0] + turn[0], B.q_WB[1] + turn[1], B.q_WB[2] + turn[2], B.q_WB[3] + turn[3])
        )
        for j in range(4):
            y[k + 3 + j] = q[j]


class AllLines(NamedTuple):
    """The lines of a system, all of which hold."""

    system: Any


@position_error.register(AllLines)
def error_of_all(way, t, y):
    system, worst = way.system, 0.0
    write_rows(system, t, y)
    for k in range(system.lines.shape[0]):
        system.vectors[RIGHT, k] = -system.rows[k, ERROR] * system.rows[k, HOLONOMIC]
        worst = max(worst, abs(system.vectors[RIGHT, k]) * arm_of(system, k))
    return worst, system.lines.shape[0]


@correct_positions.register(AllLines)
def correct_all(way, t, y, lines):
    system = way.system
    fill_matrix(system, True)
    solve_lines(system)
    for k in range(lines):
        system.vectors[MULTIPLIERS, k] *= system.rows[k, HOLONOMIC]
    clear_push(system)
    add_multipliers(system)
    move_by_push(system, y)


@inline
def project_velocities(system, t, y):
    """u += M^-1 G^T A^-1 (b - G u): the nearest admissible velocity in the metric of M."""
    write_rows(system, t, y)
    fill_matrix(system, False)
    for k in range(system.lines.shape[0]):
        system.vectors[RIGHT, k] = system.rows[k, RATE] - row_velocity(system, y, k)
    solve_lines(system)
    clear_push(system)
    add_multipliers(system)
    for i in range(system.bodies.shape[0]):
        for j in range(6):
            y[WIDTH * i + 7 + j] += system.bodies[i, PUSH + j]


@inline
def settle_bodies(system, t, y):
    """y with unit quaternions and on the manifold, in place; position first, then velocity.

    A state from which the manifold is out of reach (the step was absurd) becomes NaN.
    """
    clear_push(system)
    move_by_push(system, y)
    if system.lines.shape[0] > 0:
        worst, _ = return_to_positions(AllLines(system), t, y, system.length, 0.0)
        if not worst <= LOST * system.length:
            y[0] = np.nan
        project_velocities(system, t, y)
    return y
