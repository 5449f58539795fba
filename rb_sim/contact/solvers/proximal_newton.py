"""Newton's method in the velocities of the bodies, for heaps that sweeps alone leave unsolved.

Each contact obeys its law with a slight give around the impulses c that it comes with (a proximal
step; Rockafellar 1976):

    v_n + (r_n - c_n) / s >= 0,  r_n >= 0,  the product none;  Coulomb's law between r_T and
    v_T + (r_T - c_T) / s

with s = STIFF over the contact's own block of the Delassus matrix.  Where many contacts are
redundant their laws alone leave the impulses undetermined, and closing many gaps at once asks for
what hardly fits together; the give makes both regular, and is none once the impulses stay what
they were: what rests does not creep.  The active set that the natural map has (Alart and Curnier
1991) makes the laws linear, r = A - D v; eliminated into the balance of momentum,

    (M + J^T D J) (u+ - u) = J^T (A - D v - r),

which has six unknowns for each body, however many points it touches with.
"""

from __future__ import annotations

import math

import numpy as np

from rb_sim.contact.kernels import inner, once
from rb_sim.contact.solvers.gauss_seidel import BOUND, GIVE, LINES, gauss_seidel, push, rate_of
from rb_sim.contact.solvers.one_contact import ROUGH
from rb_sim.engine.systems.many_bodies import INERTIA, MASS

STIFF = 1e5
"""Stiffness of a proximal step relative to the contact's own block."""
PASSES, ROUNDS, SWEEPS = 3, 10, 3
"""Proximal steps, rounds of Newton's method in each, sweeps before each: the bound of the work."""
SOLVED = 1e-9
"""Size of the natural map of a proximal step, relative to the largest impulse, at which it ends."""


@inner
def block_size(blocks, i):
    """The largest diagonal element of the own block of contact i."""
    return max(blocks[i, 0], max(blocks[i, 3], blocks[i, 5]))


@inner
def linear_laws(ends, rows, targets, rules, blocks, u, x, c, stiff, A, D):
    """Fill r = A - D v of the active set at (u, x); the size of the natural map over the largest
    impulse.  c: centres of the proximal step; stiff: 1e200 for the laws themselves,
    where A and D are of no use."""
    most, largest = 0.0, 0.0
    for i in range(ends.shape[0]):
        k, b, a = LINES * i, ends[i, 0], ends[i, 1]
        size, mu = block_size(blocks, i), min(rules[i, BOUND], ROUGH)
        soft = size / stiff
        v0 = rate_of(rows, k, u, b, a) - targets[k] + rules[i, GIVE] * x[k]
        v0 += soft * (x[k] - c[k])
        largest = max(largest, abs(x[k]))
        for j in range(3):
            A[i, j] = 0.0
        for j in range(9):
            D[i, j] = 0.0
        push_n = x[k] - v0 / size
        if push_n <= 0.0:
            most = max(most, max(abs(x[k]), max(abs(x[k + 1]), abs(x[k + 2]))))
            continue
        most = max(most, abs(push_n - x[k]))
        D[i, 0] = 1.0 / (soft + rules[i, GIVE])
        A[i, 0] = c[k] * soft * D[i, 0]
        if mu == 0.0:
            continue
        v1 = rate_of(rows, k + 1, u, b, a) - targets[k + 1] + soft * (x[k + 1] - c[k + 1])
        v2 = rate_of(rows, k + 2, u, b, a) - targets[k + 2] + soft * (x[k + 2] - c[k + 2])
        y, z = x[k + 1] - v1 / size, x[k + 2] - v2 / size
        across = math.sqrt(y * y + z * z)
        if across <= mu * push_n:  # sticks
            most = max(most, max(abs(y - x[k + 1]), abs(z - x[k + 2])))
            A[i, 1], A[i, 2] = c[k + 1], c[k + 2]
            D[i, 4] = D[i, 8] = 1.0 / soft
            continue
        p, q, bound = y / across, z / across, mu * push_n
        most = max(most, max(abs(bound * p - x[k + 1]), abs(bound * q - x[k + 2])))
        A[i, 1], A[i, 2] = mu * p * A[i, 0], mu * q * A[i, 0]
        D[i, 3], D[i, 6] = mu * p * D[i, 0], mu * q * D[i, 0]
        slope = max(-(p * v1 + q * v2) / max(bound, 1e-300), 0.0)
        turning = 1.0 / (slope + soft)
        centre = soft * (p * c[k + 2] - q * c[k + 1]) * turning
        A[i, 1] -= q * centre
        A[i, 2] += p * centre
        D[i, 4] += q * q * turning
        D[i, 5] -= q * p * turning
        D[i, 7] -= q * p * turning
        D[i, 8] += p * p * turning
    return most / largest if largest > 0.0 else most


@inner
def fill_matrix(ends, rows, bodies, D, H):
    """H = M + J^T D J."""
    H[:, :] = 0.0
    for b in range(bodies.shape[0]):
        o = 6 * b
        for j in range(3):
            H[o + j, o + j] = bodies[b, MASS]
            H[o + 3 + j, o + 3 + j] = bodies[b, INERTIA + j]
        H[o + 3, o + 4] = H[o + 4, o + 3] = bodies[b, INERTIA + 3]
        H[o + 3, o + 5] = H[o + 5, o + 3] = bodies[b, INERTIA + 4]
        H[o + 4, o + 5] = H[o + 5, o + 4] = bodies[b, INERTIA + 5]
    T = np.empty((3, 12))
    for i in range(ends.shape[0]):
        if D[i, 0] == 0.0:
            continue
        k = LINES * i
        for p in range(3):
            d0, d1, d2 = D[i, 3 * p], D[i, 3 * p + 1], D[i, 3 * p + 2]
            for j in range(12):
                T[p, j] = d0 * rows[k, j] + d1 * rows[k + 1, j] + d2 * rows[k + 2, j]
        for first in range(2):
            for second in range(2):
                b, a = ends[i, first], ends[i, second]
                if b < 0 or a < 0:
                    continue
                for m in range(6):
                    f0, f1 = rows[k, 6 * first + m], rows[k + 1, 6 * first + m]
                    f2, o = rows[k + 2, 6 * first + m], 6 * second
                    for j in range(6):
                        T_j = f0 * T[0, o + j] + f1 * T[1, o + j] + f2 * T[2, o + j]
                        H[6 * b + m, 6 * a + j] += T_j


@inner
def eliminate(H, g):
    """Solve H x = g in place of g, inside the envelope of H, without pivots (M keeps the diagonal
    away from none, friction hardly takes from it); False where one is none."""
    n = H.shape[0]
    for k in range(n):
        pivot = H[k, k]
        if not abs(pivot) > 0.0:
            return False
        last = n - 1
        while last > k and H[k, last] == 0.0 and H[last, k] == 0.0:
            last -= 1
        for i in range(k + 1, last + 1):
            if H[i, k] != 0.0:
                f = H[i, k] / pivot
                g[i] -= f * g[k]
                for j in range(k + 1, last + 1):
                    H[i, j] -= f * H[k, j]
    for i in range(n - 1, -1, -1):
        s = g[i]
        for j in range(i + 1, n):
            s -= H[i, j] * g[j]
        g[i] = s / H[i, i]
    return True


@inner
def add_misfit(ends, rows, targets, A, D, u, x, g):
    """g += J^T (A - D v - r)."""
    for i in range(ends.shape[0]):
        k, b, a = LINES * i, ends[i, 0], ends[i, 1]
        v0 = rate_of(rows, k, u, b, a) - targets[k]
        v1 = rate_of(rows, k + 1, u, b, a) - targets[k + 1]
        v2 = rate_of(rows, k + 2, u, b, a) - targets[k + 2]
        for p in range(3):
            f = A[i, p] - x[k + p]
            f -= D[i, 3 * p] * v0 + D[i, 3 * p + 1] * v1 + D[i, 3 * p + 2] * v2
            for j in range(6):
                g[6 * b + j] += rows[k + p, j] * f
                if a >= 0:
                    g[6 * a + j] += rows[k + p, 6 + j] * f


@inner
def take_impulses(ends, rows, targets, A, D, u, x, moved):
    """x = A - D v at the velocities u + moved; u follows from x."""
    for b in range(u.shape[0]):
        for j in range(6):
            moved[b, j] += u[b, j]
    for i in range(ends.shape[0]):
        k, b, a = LINES * i, ends[i, 0], ends[i, 1]
        v0 = rate_of(rows, k, moved, b, a) - targets[k]
        v1 = rate_of(rows, k + 1, moved, b, a) - targets[k + 1]
        v2 = rate_of(rows, k + 2, moved, b, a) - targets[k + 2]
        for p in range(3):
            f = A[i, p] - D[i, 3 * p] * v0 - D[i, 3 * p + 1] * v1 - D[i, 3 * p + 2] * v2
            if f != x[k + p]:
                push(rows, k + p, u, b, a, f - x[k + p])
                x[k + p] = f


@once
def proximal_step(graph, bodies, u, x, c, room):
    """Newton's method on one proximal step around c, from (u, x); rounds made."""
    ends, rows, targets = graph.ends, graph.rows, graph.targets
    A, D, H, g = room
    for made in range(ROUNDS):
        e = linear_laws(ends, rows, targets, graph.rules, graph.blocks, u, x, c, STIFF, A, D)
        if not e > SOLVED:
            return made
        fill_matrix(ends, rows, bodies, D, H)
        g[:] = 0.0
        add_misfit(ends, rows, targets, A, D, u, x, g)
        if not eliminate(H, g):
            return made
        take_impulses(ends, rows, targets, A, D, u, x, g.reshape((-1, 6)))
    return ROUNDS


@inner
def proximal_newton(graph, bodies, u, x, joints, length, enough):
    """Solve a graph that is a friction problem with nothing besides (see is_plain).

    As `gauss_seidel`, whose sweeps come before each proximal step: x and u change in place.
    Returns (size of the natural map over the largest impulse, sweeps and rounds made); what comes
    back is never worse than what was found on the way.
    """
    n, N = graph.ends.shape[0], bodies.shape[0]
    A, D = np.empty((n, 3)), np.empty((n, 9))
    room = A, D, np.empty((6 * N, 6 * N)), np.empty(6 * N)
    best_x, best_u, least, made = x.copy(), u.copy(), 1e300, 0
    for half in range(2 * PASSES):
        if half % 2 == 0:
            _, more = gauss_seidel(graph, u, x, joints, length, 0.0, SWEEPS)
        else:
            more = proximal_step(graph, bodies, u, x, x.copy(), room)
        made += more
        e = linear_laws(
            graph.ends, graph.rows, graph.targets, graph.rules, graph.blocks, u, x, x, 1e200, A, D
        )
        if e < least:
            least = e
            best_x[:] = x
            best_u[:, :] = u
        if not least > enough:
            break
    x[:] = best_x
    u[:, :] = best_u
    return least, made
