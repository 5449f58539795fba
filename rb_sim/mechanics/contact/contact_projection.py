"""The way back to the manifold of bodies in contact: as
`mechanics.systems.multipliers.settle_bodies`, on the lines that hold alone.

Most of a body's contacts are open most of the time; their lines are zero, and a factorisation that
carries them along costs as if they were not.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rb_sim.catalogue.constraints.rows import ERROR, HOLONOMIC, RATE
from rb_sim.integrate.attempt import LOST, correct_positions, position_error, return_to_positions
from rb_sim.mechanics.contact.accelerations import find_holding
from rb_sim.mechanics.contact.constraint_tables import write_lines
from rb_sim.mechanics.contact.contact_bodies import AMONG_LINES, AMONG_POSITIONS, HOLDS
from rb_sim.mechanics.systems.many_bodies import (
    BODY,
    MULTIPLIERS,
    ORDER,
    PARENT,
    PUSH,
    RIGHT,
    WIDTH,
    arm_of,
)
from rb_sim.mechanics.systems.multipliers import (
    add_multiplier,
    clear_push,
    inverse_mass_times,
    move_by_push,
    rise_of,
    row_velocity,
)
from rb_sim.numerics.kernels import inline
from rb_sim.numerics.linear_solves import solve_semidefinite


@inline
def fill_symmetric(system, holding, holonomic_only):
    """A = G M^-1 G^T of the lines that hold; with holonomic_only the other lines become those of
    the identity."""
    rows, lines = system.rows, system.lines
    for m in range(holding):
        i = lines[m, HOLDS]
        b, a = lines[i, BODY], lines[i, PARENT]
        fb, kb = inverse_mass_times(system, b, i, 0)
        fa, ka = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        if a >= 0:
            fa, ka = inverse_mass_times(system, a, i, 6)
        for n in range(m + 1):
            j = lines[n, HOLDS]
            s = rise_of(system, j, b, a, (fb, kb), (fa, ka))
            if holonomic_only and (rows[i, HOLONOMIC] == 0.0 or rows[j, HOLONOMIC] == 0.0):
                s = 1.0 if i == j else 0.0
            system.square[0, m, n] = s
            system.square[0, n, m] = s


@inline
def push_of_lines(system, holding, holonomic_only):
    """push = M^-1 G^T x, with A x = the right side."""
    fill_symmetric(system, holding, holonomic_only)
    x, lines = system.vectors[MULTIPLIERS], system.lines
    solve_semidefinite(
        system.square[0],
        system.vectors[RIGHT],
        x,
        system.square[1],
        lines[:, ORDER],
        holding,
    )
    clear_push(system)
    for m in range(holding):
        k = lines[m, HOLDS]
        if holonomic_only:
            x[m] *= system.rows[k, HOLONOMIC]
        add_multiplier(system, k, x[m])


class HoldingLines(NamedTuple):
    """The lines of a system that hold."""

    system: Any


@position_error.register(HoldingLines)
def error_of_holding(way, t, y):
    system, worst = way.system, 0.0
    write_lines(system, t, y, False)
    holding = find_holding(system, AMONG_POSITIONS)
    for m in range(holding):
        k = system.lines[m, HOLDS]
        system.vectors[RIGHT, m] = -system.rows[k, ERROR] * system.rows[k, HOLONOMIC]
        worst = max(worst, abs(system.vectors[RIGHT, m]) * arm_of(system, k))
    return worst, holding


@correct_positions.register(HoldingLines)
def correct_holding(way, t, y, lines):
    push_of_lines(way.system, lines, True)
    move_by_push(way.system, y)


@inline
def bring_positions(system, t, y):
    """y with g(q) = 0, in place; returns the largest error that it met last [m].

    The lines are those of y afterwards.
    """
    worst, written = return_to_positions(HoldingLines(system), t, y, system.length, 0.0)
    if not written:
        write_lines(system, t, y, False)
    return worst


@inline
def bring_to_manifold(system, t, y):
    """y with unit quaternions and on the manifold, in place; position first, then velocity.

    A state from which the manifold is out of reach (the step was absurd) becomes NaN.
    """
    clear_push(system)
    move_by_push(system, y)
    if not bring_positions(system, t, y) <= LOST * system.length:
        y[0] = np.nan
    holding = find_holding(system, AMONG_LINES)
    for m in range(holding):
        k = system.lines[m, HOLDS]
        system.vectors[RIGHT, m] = system.rows[k, RATE] - row_velocity(system, y, k)
    push_of_lines(system, holding, False)
    for i in range(system.bodies.shape[0]):
        for j in range(6):
            y[WIDTH * i + 7 + j] += system.bodies[i, PUSH + j]
    return y
