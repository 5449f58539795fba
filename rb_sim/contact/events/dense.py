"""The lines of a system as dense matrices on the velocities of all bodies, for events."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from rb_sim.catalogue.constraints.rows import BIAS, RATE
from rb_sim.contact.events.steps import ACCELERATE, BEGIN, SETTLE, UNCONSTRAINED, WRITE, begin_step
from rb_sim.contact.system.accelerations import contact_accelerations, unconstrained
from rb_sim.contact.system.bodies import ContactBodies
from rb_sim.contact.system.terms import STUCK
from rb_sim.contact.system.touch import CLOSED, ROLL, SLIDE, SPIN
from rb_sim.engine.samples import Array
from rb_sim.engine.system import settle
from rb_sim.engine.systems.many_bodies import (
    BODY,
    INVERSE,
    MASS,
    PARENT,
    PUSH,
    WIDTH,
)
from rb_sim.engine.systems.multipliers import write_rows


class Lines(NamedTuple):
    """Every line of constraints and contacts, those of the candidates written as if they held."""

    J: Array
    """(n, 6N)."""
    W: Array
    """pushes, (n, 6N): J, but for the normals of slipping contacts."""
    bias: Array
    rate: Array
    """b of J u = b, (n,)."""
    free: Array
    """accelerations from the loads alone, (6N,)."""


def inverse_mass(system: ContactBodies) -> Array:
    """M^-1, (6N, 6N)."""
    n = system.bodies.shape[0]
    out = np.zeros((6 * n, 6 * n))
    for i in range(n):
        xx, yy, zz, xy, xz, yz = system.bodies[i, INVERSE : INVERSE + 6]
        out[6 * i : 6 * i + 3, 6 * i : 6 * i + 3] = np.eye(3) / system.bodies[i, MASS]
        out[6 * i + 3 : 6 * i + 6, 6 * i + 3 : 6 * i + 6] = [
            [xx, xy, xz],
            [xy, yy, yz],
            [xz, yz, zz],
        ]
    return out


def velocities(system: ContactBodies, y: Array) -> Array:
    """u = (v_WC, w_WB_B) of all bodies, (6N,)."""
    n = system.bodies.shape[0]
    return np.concatenate([y[WIDTH * i + 7 : WIDTH * i + 13] for i in range(n)])


def set_velocities(system: ContactBodies, y: Array, u: Array) -> None:
    for i in range(system.bodies.shape[0]):
        y[WIDTH * i + 7 : WIDTH * i + 13] = u[6 * i : 6 * i + 6]


def spread(system: ContactBodies, columns: Array) -> Array:
    """Rows of 12 columns (body, parent) as rows of 6N."""
    n = len(columns)
    out = np.zeros((n, 6 * system.bodies.shape[0]))
    for k in range(n):
        b, a = system.lines[k, BODY], system.lines[k, PARENT]
        out[k, 6 * b : 6 * b + 6] += columns[k, :6]
        if a >= 0:
            out[k, 6 * a : 6 * a + 6] += columns[k, 6:]
    return out


Call = Callable[[int, float, Array], None]
"""call(task, t, y): a task of the kernel (see steps); y may change in place."""


def interpreted_call(system: ContactBodies) -> Call:
    """The tasks as plain Python."""
    tasks = {
        WRITE: write_rows,
        UNCONSTRAINED: unconstrained,
        ACCELERATE: contact_accelerations,
        SETTLE: settle,
        BEGIN: begin_step,
    }
    return lambda task, t, y: tasks[task](system, t, y)


def lines_at(system: ContactBodies, call: Call, t: float, y: Array) -> Lines:
    """The lines at (t, y): the Jacobian with every contact closed and stuck, the pushes and loads
    in the modes that the table of contacts has."""
    modes = system.touch[:, [CLOSED, SLIDE, ROLL, SPIN]].copy()
    system.touch[:, CLOSED] = 1.0
    system.touch[:, [SLIDE, ROLL, SPIN]] = STUCK
    call(WRITE, t, y)
    J = spread(system, system.rows[:, :12])
    bias, rate = system.rows[:, BIAS].copy(), system.rows[:, RATE].copy()
    system.touch[:, [CLOSED, SLIDE, ROLL, SPIN]] = modes
    call(UNCONSTRAINED, t, y)
    W = spread(system, system.pushes)
    W = np.where(np.abs(W).any(axis=1, keepdims=True), W, J)
    free = system.bodies[:, PUSH : PUSH + 6].reshape(-1).copy()
    return Lines(J, W, bias, rate, free)
