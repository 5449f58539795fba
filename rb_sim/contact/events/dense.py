"""The tables of a system brought up to date at an instant, and its lines as dense matrices on the
velocities of all bodies: what is done between the calls of the loop.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from rb_sim.catalogue.constraints.rows import BIAS, RATE
from rb_sim.contact.events.steps import begin_step, system_of
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
from rb_sim.maths.jit import entry, plain, python_of

WRITE, LINES, ACCELERATE, SETTLE, BEGIN = range(5)
"""Tasks: write the lines of what is closed, or all of them as dense matrices; multipliers and
accelerations; bring y back to the manifold; begin a step."""


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


NO_DIGITS = np.zeros(0)
NO_LINES = Lines(np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0), np.zeros(0), np.zeros(0))


@plain
def write_lines(system, t, y, lines):
    """The lines at (t, y): the Jacobian with every contact closed and stuck, the pushes and loads
    in the modes that the table of contacts has."""
    touch, n = system.touch, system.lines.shape[0]
    modes = touch.copy()
    for c in range(touch.shape[0]):
        touch[c, CLOSED] = 1.0
        touch[c, SLIDE] = STUCK
        touch[c, ROLL] = STUCK
        touch[c, SPIN] = STUCK
    write_rows(system, t, y)
    for k in range(n):
        spread_line(system, system.rows, k, lines.J)
        lines.bias[k], lines.rate[k] = system.rows[k, BIAS], system.rows[k, RATE]
    for c in range(touch.shape[0]):
        touch[c, CLOSED] = modes[c, CLOSED]
        touch[c, SLIDE] = modes[c, SLIDE]
        touch[c, ROLL] = modes[c, ROLL]
        touch[c, SPIN] = modes[c, SPIN]
    unconstrained(system, t, y)
    for k in range(n):
        spread_line(system, system.pushes, k, lines.W)
        size = 0.0
        for j in range(lines.W.shape[1]):
            size += abs(lines.W[k, j])
        if size == 0.0:
            for j in range(lines.W.shape[1]):
                lines.W[k, j] = lines.J[k, j]
    for i in range(system.bodies.shape[0]):
        for j in range(6):
            lines.free[6 * i + j] = system.bodies[i, PUSH + j]


@plain
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


@entry
def bring_up_to_date(packed, t, y, c, task, J, W, bias, rate, free):
    """The task at (t, y); y may change in place, c is that of BEGIN, the rest that of LINES."""
    system = system_of(packed)
    if task == WRITE:
        write_rows(system, t, y)
    elif task == LINES:
        write_lines(system, t, y, Lines(J, W, bias, rate, free))
    elif task == ACCELERATE:
        contact_accelerations(system, t, y)
    elif task == SETTLE:
        write_rows(system, t, y)  # those of contacts that the modes open now, which are zero
        settle(system, t, y)
    else:
        begin_step(system, t, y, c)


Call = Callable[..., None]
"""call(task, t, y, lines, c): a task; y may change in place, `lines` are written by LINES alone, c,
the low digits of y, is read by BEGIN alone."""


class Interpreted:
    """The tasks as plain Python."""

    def __init__(self, system: ContactBodies) -> None:
        self.system = system

    def __call__(
        self, task: int, t: float, y: Array, lines: Lines = NO_LINES, c: Array = NO_DIGITS
    ) -> None:
        python_of(bring_up_to_date)(self.system, t, y, c, task, *lines)


def room_for_lines(system: ContactBodies) -> Lines:
    """Arrays for the lines of the system, not filled yet."""
    n, freedoms = system.lines.shape[0], 6 * system.bodies.shape[0]
    J, W = np.empty((n, freedoms)), np.empty((n, freedoms))
    return Lines(J, W, np.empty(n), np.empty(n), np.empty(freedoms))


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
    return y[: WIDTH * n].reshape(n, WIDTH)[:, 7:13].flatten()


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
