"""The Delassus matrix A = J M^-1 W^T of some lines, and products with lines and inverse mass.

u and accelerations are (v_WC, w_WB_B) of all bodies, one after another; a line has 6 columns of its
body and 6 of its parent.
"""

from __future__ import annotations

import numpy as np

from rb_sim.catalogue.constraints.rows import BIAS, RATE
from rb_sim.mechanics.contact.accelerations import unconstrained
from rb_sim.mechanics.contact.contact_bodies import ContactBodies
from rb_sim.mechanics.contact.contact_kinematics import STUCK
from rb_sim.mechanics.contact.contact_table import CLOSED, ROLL, SLIDE, SPIN
from rb_sim.mechanics.samples import Array
from rb_sim.mechanics.systems.many_bodies import BODY, INVERSE, MASS, PARENT, PUSH, WIDTH, six
from rb_sim.mechanics.systems.multipliers import write_rows
from rb_sim.numerics.kernels import inline
from rb_sim.numerics.vectors import symmetric_times


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


@inline
def accelerated(system, i, a, k):
    """M_i^-1 of the six numbers of body i in row k of a."""
    s, j = 1.0 / system.bodies[i, MASS], 6 * i
    turn = symmetric_times(six(system.bodies, i, INVERSE), (a[k, j + 3], a[k, j + 4], a[k, j + 5]))
    return s * a[k, j], s * a[k, j + 1], s * a[k, j + 2], turn[0], turn[1], turn[2]


@inline
def along(J, k, i, a):
    """Row k of J times six numbers of body i."""
    s = 0.0
    for j in range(6):
        s += J[k, 6 * i + j] * a[j]
    return s


@inline
def fill_in_loops(system, J, W, used, n, A):
    lines = system.lines
    for q in range(n):
        j = used[q]
        b, a = lines[j, BODY], lines[j, PARENT]
        of_body = accelerated(system, b, W, j)
        of_parent = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        if a >= 0:
            of_parent = accelerated(system, a, W, j)
        for p in range(n):
            i, s = used[p], 0.0
            if lines[i, BODY] == b or lines[i, PARENT] == b:
                s += along(J, i, b, of_body)
            if a >= 0 and (lines[i, BODY] == a or lines[i, PARENT] == a):
                s += along(J, i, a, of_parent)
            A[p, q] = s


def fill_delassus(system, J, W, used, n, A):
    """A of the first n lines of `used`, into its first n rows and columns."""
    some = used[:n]
    A[:n, :n] = J[some] @ inverse_mass(system) @ W[some].T


fill_delassus.compiled_as = fill_in_loops  # type: ignore[attr-defined]


@inline
def line_times(system, J, k, u):
    """Line k times u."""
    b, a = system.lines[k, BODY], system.lines[k, PARENT]
    s = 0.0
    for j in range(6):
        s += J[k, 6 * b + j] * u[6 * b + j]
    if a >= 0:
        for j in range(6):
            s += J[k, 6 * a + j] * u[6 * a + j]
    return s


@inline
def size_of_terms(system, J, k, u):
    """|line k| times |u|: the size of what `line_times` sums."""
    b, a = system.lines[k, BODY], system.lines[k, PARENT]
    s = 0.0
    for j in range(6):
        s += abs(J[k, 6 * b + j] * u[6 * b + j])
    if a >= 0:
        for j in range(6):
            s += abs(J[k, 6 * a + j] * u[6 * a + j])
    return s


@inline
def momentum_of(system, J, x, p):
    """p = J^T x, of all lines."""
    for j in range(p.shape[0]):
        p[j] = 0.0
    for k in range(x.shape[0]):
        if x[k] != 0.0:
            b, a = system.lines[k, BODY], system.lines[k, PARENT]
            for j in range(6):
                p[6 * b + j] += J[k, 6 * b + j] * x[k]
            if a >= 0:
                for j in range(6):
                    p[6 * a + j] += J[k, 6 * a + j] * x[k]


@inline
def inverse_mass_times(system, p, du):
    """du = M^-1 p."""
    for i in range(system.bodies.shape[0]):
        j, s = 6 * i, 1.0 / system.bodies[i, MASS]
        turn = symmetric_times(six(system.bodies, i, INVERSE), (p[j + 3], p[j + 4], p[j + 5]))
        for k in range(3):
            du[j + k] = s * p[j + k]
            du[j + 3 + k] = turn[k]


@inline
def read_velocities(system, y, u):
    """u of the coordinates y."""
    for i in range(system.bodies.shape[0]):
        for j in range(6):
            u[6 * i + j] = y[WIDTH * i + 7 + j]


# The lines of constraints and contacts as dense matrices on the velocities of all bodies.


@inline
def write_lines(system, t, y, workspace):
    """The lines at (t, y) into the workspace: the Jacobian with every contact closed and stuck, the
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
        spread_line(system, system.rows, k, workspace.J)
        workspace.line_bias[k], workspace.line_rate[k] = system.rows[k, BIAS], system.rows[k, RATE]
    for c in range(touch.shape[0]):
        for j in range(4):
            touch[c, CLOSED + j] = modes[c, j]
    unconstrained(system, t, y)
    for k in range(n):
        spread_line(system, system.pushes, k, workspace.W)
        size = 0.0
        for j in range(12):
            size += abs(system.pushes[k, j])
        if size == 0.0:
            for j in range(workspace.W.shape[1]):
                workspace.W[k, j] = workspace.J[k, j]
    for i in range(system.bodies.shape[0]):
        for j in range(6):
            workspace.free_accelerations[6 * i + j] = system.bodies[i, PUSH + j]


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
