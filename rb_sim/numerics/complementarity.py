# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Complementarity problems with friction (Alart & Curnier 1991), by Newton's method."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from rb_sim.base.rounding import COMPUTED_ROUNDING, SUM_ROUNDING
from rb_sim.numerics.kernels import entry, integers, part, pointer
from rb_sim.numerics.linear_solves import least_squares
from rb_sim.numerics.rank import JUDGED_BY_CONTACT

# Equations of Alart and Curnier (1991) for a complementarity problem with friction, and Newton's
# iteration on them with least-squares steps.
#
# A problem is w = A x + b with a rule for each row and each friction bound:
#
#     EQUALITY    w = 0
#     UNILATERAL  x >= least, w >= 0, one of them zero
#     FRICTION    tangential row of a bound: |x_t| <= bound x_n, and
#                 x_t = -bound x_n w_t / |w_t| unless w_t = 0
#
# Rows in no bound are equalities; an infinite bound holds its rows while the normal row carries a
# force. Dependent rows are allowed. Matrices are vectors of their rows, one after another.


EQUALITY, UNILATERAL, FRICTION = 0, 1, 2
"""Rules of rows: equality, unilateral normal force, tangential friction force."""
FIRST, SECOND, NORMAL, BOUND_WIDTH = 0, 1, 2, 3
"""Columns of `bounds`: the rows of a bound (the second is -1 if there is one only), and its normal
row (-1: the limit is the bound itself)."""
NEWTON_STEPS, HALVINGS, SWEEPS = 60, 6, 400


class Equations(NamedTuple):
    """A problem of n rows and m friction bounds, with the scales of its residual."""

    n: int
    m: int
    A: Any
    """matrix A by rows, (n, n)."""
    b: Any
    step: Any
    """inverse of each diagonal element, or of the largest one if it is zero, (n,)."""
    rules: Any
    """rule of each row, (n,)."""
    least: Any
    """least x of each row with the rule UNILATERAL, (n,)."""
    bounds: Any
    """rows and normal row of each bound, (m, 3)."""
    limits: Any
    """each bound over x of its normal row; inf: its rows hold while the normal row carries a force,
    (m,)."""
    blur: float
    """residual that is only rounding of b."""


def workspace_of(n: int) -> int:
    """Length of the workspace of a problem of n rows."""
    return 2 * n * n + 16 * n


def row_times(p, k, x):
    """w of row k at x."""
    s = p.b[k]
    for j in range(p.n):
        s += p.A[k * p.n + j] * x[j]
    return s


def size_of(n, a):
    """Euclidean norm of n numbers."""
    s = 0.0
    for i in range(n):
        s += a[i] * a[i]
    return s**0.5


def limit(p, i, x):
    """Value of the i-th friction bound at x."""
    n = p.bounds[BOUND_WIDTH * i + NORMAL]
    if n < 0:
        return p.limits[i]
    normal_force = abs(x[n]) if p.rules[n] == EQUALITY else max(0.0, x[n])
    if p.limits[i] == math.inf:
        return math.inf if normal_force > 0.0 or p.rules[n] == EQUALITY else 0.0
    return p.limits[i] * normal_force


def tangential_rows(p, i):
    """(first row, second row or -1, smaller one of their steps) of the i-th bound."""
    k, m = p.bounds[BOUND_WIDTH * i + FIRST], p.bounds[BOUND_WIDTH * i + SECOND]
    return k, m, min(p.step[k], p.step[m]) if m >= 0 else p.step[k]


def friction_at(p, i, x, w):
    """(whether the i-th friction bound holds its rows, their x - step w, its value at x)."""
    normal = p.bounds[BOUND_WIDTH * i + NORMAL]
    k, m, step = tangential_rows(p, i)
    y, z = x[k] - step * w[k], x[m] - step * w[m] if m >= 0 else 0.0
    most = limit(p, i, x)
    if normal >= 0 and p.limits[i] == math.inf:
        ahead = x[normal] - p.least[normal] - p.step[normal] * w[normal]
        holds = p.rules[normal] == EQUALITY or p.least[normal] > 0.0 or ahead > 0.0
        most = math.inf if holds else 0.0
    return (y * y + z * z) ** 0.5 <= most, y, z, most


def natural_map(p, x, w, F):
    """Write the residual of the laws between x and w to F: x minus the projection of x - step w;
    returns |F|."""
    for k in range(p.n):
        F[k] = p.step[k] * w[k]
        if p.rules[k] == UNILATERAL and not x[k] - p.least[k] - F[k] > 0.0:
            F[k] = x[k] - p.least[k]
    for i in range(p.m):
        k, m, step = tangential_rows(p, i)
        sticks, y, z, most = friction_at(p, i, x, w)
        size = (y * y + z * z) ** 0.5
        F[k] = step * w[k] if sticks else x[k] - most * (y / size)
        if m >= 0:
            F[m] = step * w[m] if sticks else x[m] - most * (z / size)
    return size_of(p.n, F)


def equations(p, x, w, F, J):
    """Write w = A x + b, its natural map F and the generalised Jacobian J of F at x; returns
    |F|."""
    n = p.n
    for k in range(n):
        w[k] = row_times(p, k, x)
        step = p.step[k]
        for j in range(n):
            J[k * n + j] = step * p.A[k * n + j]
        if p.rules[k] == UNILATERAL and not x[k] - p.least[k] - step * w[k] > 0.0:
            for j in range(n):
                J[k * n + j] = 0.0
            J[k * n + k] = 1.0
    for i in range(p.m):
        write_friction(p, i, x, w, J)
    return natural_map(p, x, w, F)


def write_friction(p, i, x, w, J):
    """Write the rows of the i-th friction bound into J."""
    n, normal = p.n, p.bounds[BOUND_WIDTH * i + NORMAL]
    k, m, step = tangential_rows(p, i)
    sticks, y, z, most = friction_at(p, i, x, w)
    size = (y * y + z * z) ** 0.5
    ratio, y, z = (0.0, 0.0, 0.0) if sticks else (most / size, y / size, z / size)
    for j in range(n):
        turned_y, turned_z = -step * p.A[k * n + j], -step * p.A[m * n + j] if m >= 0 else 0.0
        if sticks:
            turned_y, turned_z = -turned_y, -turned_z
        else:
            own_y, own_z = 1.0 if j == k else 0.0, 1.0 if j == m else 0.0
            turned_y, turned_z = own_y + turned_y, own_z + turned_z
            along = y * turned_y + z * turned_z
            turned_y = own_y - ratio * (turned_y - y * along)
            turned_z = own_z - ratio * (turned_z - z * along)
        J[k * n + j] = turned_y
        if m >= 0:
            J[m * n + j] = turned_z
    if normal >= 0 and not sticks and most > 0.0:
        slope = math.copysign(p.limits[i], x[normal])
        J[k * n + normal] -= slope * y
        if m >= 0:
            J[m * n + normal] -= slope * z


def relative(p, error, x):
    """Residual beyond the rounding of b, relative to the size of x and of given bounds, or of the x
    of a single row alone."""
    natural, given = 1e-300, 0.0
    for k in range(p.n):
        natural = max(natural, abs(p.step[k] * p.b[k]))
    for i in range(p.m):
        if p.bounds[BOUND_WIDTH * i + NORMAL] < 0 and p.limits[i] < math.inf:
            given = max(given, p.limits[i])
    return max(0.0, error - p.blur) / (1e-3 * natural + size_of(p.n, x) + given)


def newton(p, x, workspace):
    """Newton's iteration from x, in place, with steps halved until the residual falls; returns the
    relative residual.

    One more step follows after convergence: a slip that begins at the friction bound has an
    acceleration of 1e-8 of the others, whose direction needs the digits below COMPUTED_ROUNDING.
    """
    n = p.n
    J, rest = workspace, part(workspace, n * n)
    w, F, dx, before, work = (
        rest, part(rest, n), part(rest, 2 * n), part(rest, 3 * n), part(rest, 4 * n),
    )  # fmt: skip
    error, polished = equations(p, x, w, F, J), False
    for _ in range(NEWTON_STEPS):
        solved = relative(p, error, x) <= COMPUTED_ROUNDING
        if not math.isfinite(error) or polished or error == 0.0:
            break
        for k in range(n):
            F[k], before[k] = -F[k], x[k]
        least_squares(J, F, n, dx, work)
        share, last = 1.0, error
        for _ in range(1 if solved else HALVINGS):
            for k in range(n):
                x[k] = before[k] + share * dx[k]
            error = equations(p, x, w, F, J)
            if error < last:
                break
            share *= 0.5
        if solved and not error < last:
            error = last
            for k in range(n):
                x[k] = before[k]
        polished = solved
    return relative(p, error, x)


def sweep(p, x):
    """Projected Gauss-Seidel from zero; the result is in x."""
    for k in range(p.n):
        x[k] = 0.0
    for _ in range(SWEEPS):
        for k in range(p.n):
            if p.rules[k] != FRICTION:
                x[k] -= p.step[k] * row_times(p, k, x)
                if p.rules[k] == UNILATERAL:
                    x[k] = max(x[k], p.least[k])
        for i in range(p.m):
            k, m, step = tangential_rows(p, i)
            y = x[k] - step * row_times(p, k, x)
            z = x[m] - step * row_times(p, m, x) if m >= 0 else 0.0
            size, most = (y * y + z * z) ** 0.5, limit(p, i, x)
            ratio = 1.0 if size <= most else most / size
            x[k] = ratio * y
            if m >= 0:
                x[m] = ratio * z


def fill_steps(n, A, terms, step):
    """Write the step of each row; returns the residual that is only rounding of b with these
    terms."""
    largest, blur = 0.0, 0.0
    for k in range(n):
        largest = max(largest, abs(A[k * n + k]))
    for k in range(n):
        size = abs(A[k * n + k])
        if not size > 1e-12 * largest:
            size = largest if largest > 0.0 else 1.0
        step[k] = 1.0 / size
        blur = max(blur, abs(step[k] * terms[k]))
    return SUM_ROUNDING * blur


# Solution of a complementarity problem with friction from two starts, and by proximal steps if
# Newton's iteration fails from both.


CONTRADICTION = JUDGED_BY_CONTACT
"""Relative residual above which there is no solution: contact points within that of the scene's
length, as at the ends of a lying rod, contradict each other by as much."""
STARTS = 2
"""Number of starts of Newton's iteration: zero, the solution with all rows held."""
SOFTER, PROXIMAL_STEPS = 1e-3, 60
"""Added stiffness of a proximal step, relative to a row's own, and the most such steps."""


def search(p, x, workspace, starts):
    """Newton's iteration from x and, for `starts` > 1, from all rows held, until it converges.

    The best result is in x; returns its residual. workspace: `workspace_of(n)` numbers.
    """
    n, residual = p.n, math.inf
    trial, work = workspace, part(workspace, n)
    for start in range(starts):
        if residual <= COMPUTED_ROUNDING:
            break
        for k in range(n):
            trial[k] = -p.b[k] if start == 1 else x[k]
        if start == 1:
            least_squares(p.A, trial, n, trial, work)
        rest = newton(p, trial, work)
        if rest < residual:
            residual = rest
            for k in range(n):
                x[k] = trial[k]
    return residual


def approach(p, x, workspace):
    """As `search`, by proximal steps from the result of sweeps (Rockafellar 1976).

    Each step solves the problem with a slightly compliant friction about the previous x, by
    Newton's method. They always converge if normal forces do not depend on friction (x minimises a
    convex function then), otherwise usually.
    """
    n, least = p.n, math.inf
    vectors, A = np.empty(4 * n), np.empty(n * n)
    at, trial, b, step = (
        pointer(vectors), part(pointer(vectors), n), part(pointer(vectors), 2 * n),
        part(pointer(vectors), 3 * n),
    )  # fmt: skip
    softer = pointer(A)
    sweep(p, at)
    for _ in range(PROXIMAL_STEPS):
        for i in range(n * n):
            softer[i] = p.A[i]
        for k in range(n):
            weight = SOFTER / p.step[k]
            softer[k * n + k] += weight
            b[k] = p.b[k] - weight * at[k]
        blur = fill_steps(n, softer, b, step)
        search(p._replace(A=softer, b=b, step=step, blur=blur), at, workspace, 1)
        for k in range(n):
            trial[k] = at[k]
        residual = search(p, trial, workspace, 1)
        if residual < least:
            least = residual
            for k in range(n):
                x[k] = trial[k]
        if least <= COMPUTED_ROUNDING:
            break
    return least


def unit_of(element):
    """The power of two whose square times the element is about 1; 1 for an element of 0."""
    unit = 1.0
    while unit * unit * element > 2.0:
        unit *= 0.5
    while 0.0 < unit * unit * element < 0.5:
        unit *= 2.0
    return unit


def even_out(p, terms, A, b, even_terms, limits, least, sizes):
    """Write the problem in units in which all rows have similar diagonal elements into A, b,
    even_terms, limits and least.

    sizes: these units, in those of x. terms: of b. Rows of rotations have elements 1/I, rows of
    displacements 1/m: in a scene of micrometres they differ by many orders of magnitude, and a
    negligible residual of one would be a large one of the other. Powers of two are exact; both rows
    of a bound have one unit, so that it stays a circle. The diagonal element of a slipping row may
    vanish (Painleve), its couplings do not.
    """
    n = p.n
    for k in range(n):
        own = abs(p.A[k * n + k])
        sizes[k] = own
        for j in range(n):
            other = abs(p.A[j * n + j])
            if other > own:
                sizes[k] = max(sizes[k], p.A[k * n + j] ** 2 / other)
    for i in range(p.m):
        k, m = p.bounds[BOUND_WIDTH * i + FIRST], p.bounds[BOUND_WIDTH * i + SECOND]
        if m >= 0:
            sizes[k] = max(sizes[k], sizes[m])
            sizes[m] = sizes[k]
    for k in range(n):
        sizes[k] = unit_of(sizes[k])
    for k in range(n):
        for j in range(n):
            A[k * n + j] = sizes[k] * p.A[k * n + j] * sizes[j]
        b[k], even_terms[k] = sizes[k] * p.b[k], sizes[k] * terms[k]
        least[k] = p.least[k] / sizes[k]
    for i in range(p.m):
        k, normal = p.bounds[BOUND_WIDTH * i + FIRST], p.bounds[BOUND_WIDTH * i + NORMAL]
        limits[i] = p.limits[i] * ((sizes[normal] if normal >= 0 else 1.0) / sizes[k])


def all_finite(n, a):
    """Whether none of n numbers is NaN or infinite."""
    for i in range(n):
        if not math.isfinite(a[i]):
            return False
    return True


def solution(p, terms, x):
    """Write a solution into x; returns its residual, NaN if A or b is not finite.

    p: without `step` and `blur`; terms: sizes of the summands of b. A residual above CONTRADICTION
    means that there is no solution.
    """
    n = p.n
    if not (all_finite(n * n, p.A) and all_finite(n, p.b)):
        return math.nan
    for k in range(n):
        x[k] = 0.0
    if n == 0:
        return 0.0
    workspace, step = np.empty(workspace_of(n)), np.empty(n)
    matrix, vectors, bounds = np.empty(n * n), np.empty(4 * n), np.empty(p.m + 1)
    A, b, limits = pointer(matrix), pointer(vectors), pointer(bounds)
    even_terms, least, sizes = part(b, n), part(b, 2 * n), part(b, 3 * n)
    even_out(p, terms, A, b, even_terms, limits, least, sizes)
    blur = fill_steps(n, A, even_terms, pointer(step))
    even = p._replace(A=A, b=b, step=pointer(step), least=least, limits=limits, blur=blur)
    residual = search(even, x, pointer(workspace), STARTS)
    if not residual <= CONTRADICTION:
        residual = approach(even, x, pointer(workspace))
    for k in range(n):
        x[k] *= sizes[k]
    return residual


@entry
def solve(A, b, terms, rules, least, bounds, limits, x):
    """As `solution`, for arrays: bounds (m, BOUND_WIDTH)."""
    none = pointer(x)
    p = Equations(
        b.shape[0], limits.shape[0], pointer(A), pointer(b), none, integers(rules), pointer(least),
        integers(bounds), pointer(limits), 0.0,
    )  # fmt: skip
    return solution(p, pointer(terms), none)
