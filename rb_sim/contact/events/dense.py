"""The lines of constraints and contacts as dense matrices on the velocities of all bodies."""

from __future__ import annotations

import numpy as np

from rb_sim.catalogue.constraints.rows import BIAS, RATE
from rb_sim.contact.events.delassus import read_velocities
from rb_sim.contact.system.accelerations import unconstrained
from rb_sim.contact.system.bodies import ContactBodies
from rb_sim.contact.system.terms import STUCK
from rb_sim.contact.system.touch import CLOSED, ROLL, SLIDE, SPIN
from rb_sim.engine.samples import Array
from rb_sim.engine.systems.many_bodies import BODY, PARENT, PUSH, WIDTH
from rb_sim.engine.systems.multipliers import write_rows
from rb_sim.maths.jit import inline


@inline
def write_lines(system, t, y, room):
    """The lines at (t, y) into the room: the Jacobian with every contact closed and stuck, the
    pushes and loads in the modes that the table of contacts has."""
    touch, n = system.touch, system.lines.shape[0]
    modes = np.empty((touch.shape[0], 4))
    for c in range(touch.shape[0]):
        for j in range(4):
            modes[c, j] = touch[c, CLOSED + j]
        touch[c, CLOSED] = 1.0
        touch[c, SLIDE] = STUCK
        touch[c, ROLL] = STUCK
        touch[c, SPIN] = STUCK
    write_rows(system, t, y)
    for k in range(n):
        spread_line(system, system.rows, k, room.J)
        room.line_bias[k], room.line_rate[k] = system.rows[k, BIAS], system.rows[k, RATE]
    for c in range(touch.shape[0]):
        for j in range(4):
            touch[c, CLOSED + j] = modes[c, j]
    unconstrained(system, t, y)
    for k in range(n):
        spread_line(system, system.pushes, k, room.W)
        size = 0.0
        for j in range(12):
            size += abs(system.pushes[k, j])
        if size == 0.0:
            for j in range(room.W.shape[1]):
                room.W[k, j] = room.J[k, j]
    for i in range(system.bodies.shape[0]):
        for j in range(6):
            room.free_accelerations[6 * i + j] = system.bodies[i, PUSH + j]


@inline
def spread_line(system, columns, k, out):
    """Line k of 12 columns (body, parent) as a line of 6N."""
    b, a = system.lines[k, BODY], system.lines[k, PARENT]
    for j in range(out.shape[1]):
        out[k, j] = 0.0
    for j in range(6):
        out[k, 6 * b + j] += columns[k, j]
    if a >= 0:
        for j in range(6):
            out[k, 6 * a + j] += columns[k, 6 + j]


def velocities(system: ContactBodies, y: Array) -> Array:
    """u = (v_WC, w_WB_B) of all bodies, (6N,)."""
    u = np.empty(6 * system.bodies.shape[0])
    read_velocities(system, y, u)
    return u


def set_velocities(system: ContactBodies, y: Array, u: Array) -> None:
    for i in range(system.bodies.shape[0]):
        y[WIDTH * i + 7 : WIDTH * i + 13] = u[6 * i : 6 * i + 6]


def spread(system: ContactBodies, columns: Array) -> Array:
    """Rows of 12 columns (body, parent) as rows of 6N."""
    n = len(columns)
    out = np.empty((n, 6 * system.bodies.shape[0]))
    for k in range(n):
        spread_line(system, columns, k, out)
    return out
