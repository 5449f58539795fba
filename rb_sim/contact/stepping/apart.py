"""Bodies that overlap after a step are moved apart, as little as can be, and pay for the lift."""

from __future__ import annotations

import math

import numpy as np

from rb_sim.contact.solvers.graph import LINES, coupled, push, rate_of
from rb_sim.contact.stepping.geometry import (
    CLOSED,
    GAP,
    MOVES,
    NORMAL,
    POINT,
    TURNS_AT,
    triple,
)
from rb_sim.contact.stepping.lines import six, write_line
from rb_sim.contact.stepping.room import EXACT, PUSH_SWEEPS
from rb_sim.contact.stepping.step import STATE, move
from rb_sim.contact.stepping.tables import COMPLIANT
from rb_sim.engine.systems.many_bodies import INERTIA, LOAD, MASS, state_of
from rb_sim.maths.jit import inline
from rb_sim.maths.vectors import dot, sub, symmetric_times

MARGIN = 4.0
"""Of the deepest overlap: contacts as near as this may come to overlap when others are moved."""
SETTLED = 1e-9
"""Change in one sweep, relative to the largest, at which the bodies are far enough apart."""


@inline
def deepest_overlap(tables, room):
    """(least gap of the rigid contacts or 0, which point it is)."""
    deepest, found = 0.0, -1
    for c in range(tables.owners.shape[0]):
        if tables.laws[c, COMPLIANT] == 0.0 and room.spots[c, GAP] < deepest:
            deepest, found = room.spots[c, GAP], c
    return deepest, found


@inline
def near_normals(tables, room, y, margin):
    """Write the normal lines of the rigid contacts with a gap below the margin; how many."""
    found, none = 0, (0.0, 0.0, 0.0)
    for c in range(tables.owners.shape[0]):
        if tables.laws[c, COMPLIANT] == 1.0 or not room.spots[c, GAP] <= margin:
            continue
        b, a = tables.owners[c, 0], tables.owners[c, 1]
        B, A = state_of(y, b), state_of(y, a)
        n, p = triple(room.spots, c, NORMAL), triple(room.spots, c, POINT)
        k = LINES * found
        r_B, r_A = sub(p, B.p_WC), sub(p, A.p_WC)
        write_line(room.rows, k, tables.bodies, B, A, b, a, n, none, r_B, r_A)
        room.ends[found, 0], room.ends[found, 1] = b, a
        room.targets[k], room.x[k] = -room.spots[c, GAP], 0.0
        room.blocks[found, 0] = coupled(room.rows, k, k, a)
        found += 1
    return found


@inline
def push_apart(tables, room, y):
    """One round: the least displacements (by mass) after which no gap is negative, to first order.

    After the spots at y have been found.  True once nothing overlaps.
    """
    deepest, _ = deepest_overlap(tables, room)
    if deepest >= -EXACT * tables.scales[0]:
        return True
    n, shift = near_normals(tables, room, y, -MARGIN * deepest), room.turning
    for i in range(shift.shape[0]):
        for j in range(6):
            shift[i, j] = 0.0
    for made in range(PUSH_SWEEPS):
        change, largest = 0.0, 0.0
        for turn in range(n):
            i = turn if made % 2 == 0 else n - 1 - turn
            k, b, a = LINES * i, room.ends[i, 0], room.ends[i, 1]
            missing = room.targets[k] - rate_of(room.rows, k, shift, b, a)
            value = max(0.0, room.x[k] + missing / room.blocks[i, 0])
            push(room.rows, k, shift, b, a, value - room.x[k])
            change, largest = max(change, abs(value - room.x[k])), max(largest, value)
            room.x[k] = value
        if change <= SETTLED * largest:
            break
    for i in range(shift.shape[0]):
        move(y, i, triple(shift, i, 0), triple(shift, i, 3), 1.0)
    return False


@inline
def shift_deepest(tables, room, y):
    """Shift the pair with the deepest overlap along its normal, where a long step has gone too far
    for the rounds of `push_apart` to converge.  True once nothing overlaps."""
    deepest, c = deepest_overlap(tables, room)
    if deepest >= -EXACT * tables.scales[0]:
        return True
    b, a = tables.owners[c, 0], tables.owners[c, 1]
    light_B = 1.0 / tables.bodies[b, MASS]
    light_A = 1.0 / tables.bodies[a, MASS] if a >= 0 else 0.0
    for j in range(3):
        way = -deepest * room.spots[c, NORMAL + j] / (light_A + light_B)
        y[STATE * b + j] += light_B * way
        if a >= 0:
            y[STATE * a + j] -= light_A * way
    return False


@inline
def find_carried(tables, memory, room, carried):
    """Write 1 for each body that bears on a driven support, whose work is what lifts it."""
    for c in range(tables.owners.shape[0]):
        if memory[c, CLOSED] != 1.0:
            continue
        moves, turns = triple(room.spots, c, MOVES), triple(room.spots, c, TURNS_AT)
        if dot(moves, moves) + dot(turns, turns) > 0.0:
            carried[tables.owners[c, 0]] = 1.0


@inline
def pay_for_lift(tables, memory, room, y, before):
    """Take what the loads lose where bodies were moved apart from their kinetic energy: else every
    long step on a curved surface would add some.  What cannot be paid is work of the contacts, the
    last of y, and returned; so is what driven supports lift, which is no error.  before: y as it
    was."""
    unpaid, carried = 0.0, np.zeros(tables.bodies.shape[0])
    find_carried(tables, memory, room, carried)
    for i in range(tables.bodies.shape[0]):
        B, k = state_of(y, i), STATE * i
        lifted = 0.0
        for j in range(3):
            lifted -= tables.bodies[i, LOAD + j] * (y[k + j] - before[k + j])
        if not lifted > 0.0 or carried[i] == 1.0:
            y[y.shape[0] - 1] += lifted
            continue
        spin = symmetric_times(six(tables.bodies, i, INERTIA), B.w_WB_B)
        kinetic = 0.5 * (tables.bodies[i, MASS] * dot(B.v_WC, B.v_WC) + dot(B.w_WB_B, spin))
        slower = math.sqrt(1.0 - lifted / kinetic) if kinetic > lifted else 0.0
        unpaid += lifted - min(lifted, kinetic)
        for j in range(7, STATE):
            y[k + j] *= slower
    y[y.shape[0] - 1] += unpaid
    return unpaid
