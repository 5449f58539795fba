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
from rb_sim.numerics.kernels import entry, inline, integers, part, pointer
from rb_sim.numerics.linear_solves import least_squares
from rb_sim.numerics.rank import JUDGED_BY_CONTACT

# The equations of Alart and Curnier (1991) for a complementarity problem with friction, and
# Newton's iteration on them with steps of least squares.
#
# A problem is w = A x + b with a rule for each row and each bound of friction:
#
#     HOLDS   w = 0
#     PUSHES  x >= least, w >= 0, one of them zero
#     RUBS    a row of a bound: |x_t| <= bound x_n, x_t = -bound x_n w_t / |w_t| where w_t is not 0
#
# Rows in no item are equalities; a bound of inf holds its rows where the normal pushes. Rows
# that depend on each other do no harm. Matrices are vectors of their rows, one after another.


HOLDS, PUSHES, RUBS = 0, 1, 2
"""Rules of rows."""
FIRST, SECOND, PUSH, BOUND_WIDTH = 0, 1, 2, 3
"""Columns of `bounds`: the rows of a bound, the second -1 where there is none, and its normal."""
NEWTON_STEPS, HALVINGS, SWEEPS = 60, 6, 400


class Equations(NamedTuple):
    """A problem of n rows and m bounds, and what its residual is measured with."""

    n: int
    m: int
    A: Any
    """(n, n)."""
    b: Any
    step: Any
    """inverse of each diagonal element, or of the largest where it is none, (n,)."""
    rules: Any
    """of each row, (n,)."""
    least: Any
    """least x of each row that PUSHES, (n,)."""
    bounds: Any
    """rows and normal of each bound, (m, 3)."""
    limits: Any
    """each bound over its normal's x; inf: its rows hold where the normal pushes, (m,)."""
    blur: float
    """residual that is but the rounding of b."""


def workspace_of(n: int) -> int:
    """Numbers of work space that a problem of n rows takes."""
    return 2 * n * n + 16 * n


@inline
def line_times(p, k, x):
    """w of row k."""
    s = p.b[k]
    for j in range(p.n):
        s += p.A[k * p.n + j] * x[j]
    return s


@inline
def size_of(n, a):
    """|a|."""
    s = 0.0
    for i in range(n):
        s += a[i] * a[i]
    return s**0.5


@inline
def limit(p, i, x):
    """The i-th bound at x."""
    n = p.bounds[BOUND_WIDTH * i + PUSH]
    push = abs(x[n]) if p.rules[n] == HOLDS else max(0.0, x[n])
    if p.limits[i] == math.inf:
        return math.inf if push > 0.0 or p.rules[n] == HOLDS else 0.0
    return p.limits[i] * push


@inline
def lines_of(p, i):
    """(first row, second row or -1, the smaller of their steps) of the i-th bound."""
    k, m = p.bounds[BOUND_WIDTH * i + FIRST], p.bounds[BOUND_WIDTH * i + SECOND]
    return k, m, min(p.step[k], p.step[m]) if m >= 0 else p.step[k]


@inline
def equations(p, x, w, F, J):
    """Residual and its generalised Jacobian at x into F and J, w = A x + b; returns |F|."""
    n = p.n
    for k in range(n):
        w[k] = line_times(p, k, x)
        step = p.step[k]
        for j in range(n):
            J[k * n + j] = step * p.A[k * n + j]
        F[k] = step * w[k]
        if p.rules[k] == PUSHES and not x[k] - p.least[k] - step * w[k] > 0.0:
            for j in range(n):
                J[k * n + j] = 0.0
            F[k], J[k * n + k] = x[k] - p.least[k], 1.0
    for i in range(p.m):
        rub(p, i, x, w, F, J)
    return size_of(n, F)


@inline
def rub(p, i, x, w, F, J):
    """The equations of the i-th bound."""
    n, push = p.n, p.bounds[BOUND_WIDTH * i + PUSH]
    k, m, step = lines_of(p, i)
    y, z = x[k] - step * w[k], x[m] - step * w[m] if m >= 0 else 0.0
    size, most = (y * y + z * z) ** 0.5, limit(p, i, x)
    if p.limits[i] == math.inf:
        ahead = x[push] - p.least[push] - p.step[push] * w[push]
        holds = p.rules[push] == HOLDS or p.least[push] > 0.0 or ahead > 0.0
        most = math.inf if holds else 0.0
    sticks = size <= most
    ratio, y, z = (0.0, 0.0, 0.0) if sticks else (most / size, y / size, z / size)
    F[k] = step * w[k] if sticks else x[k] - most * y
    if m >= 0:
        F[m] = step * w[m] if sticks else x[m] - most * z
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
    if not sticks and most > 0.0:
        slope = math.copysign(p.limits[i], x[push])
        J[k * n + push] -= slope * y
        if m >= 0:
            J[m * n + push] -= slope * z


@inline
def relative(p, error, x):
    """Residual beyond the rounding of b, relative to the size of x, or of an x where every row
    alone would hold."""
    natural = 1e-300
    for k in range(p.n):
        natural = max(natural, abs(p.step[k] * p.b[k]))
    return max(0.0, error - p.blur) / (1e-3 * natural + size_of(p.n, x))


@inline
def newton(p, x, workspace):
    """Newton's iteration from x, in place, each step halved while it does not reduce the residual;
    returns that residual relative to the sizes of x.

    One step follows the first solution: a slip that begins where friction is at its bound has an
    acceleration of 1e-8 of the others, whose direction takes the digits below COMPUTED_ROUNDING.
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


@inline
def sweep(p, x):
    """Into x what projected Gauss-Seidel comes to from zero."""
    for k in range(p.n):
        x[k] = 0.0
    for _ in range(SWEEPS):
        for k in range(p.n):
            if p.rules[k] != RUBS:
                x[k] -= p.step[k] * line_times(p, k, x)
                if p.rules[k] == PUSHES:
                    x[k] = max(x[k], p.least[k])
        for i in range(p.m):
            k, m, step = lines_of(p, i)
            y = x[k] - step * line_times(p, k, x)
            z = x[m] - step * line_times(p, m, x) if m >= 0 else 0.0
            size, most = (y * y + z * z) ** 0.5, limit(p, i, x)
            ratio = 1.0 if size <= most else most / size
            x[k] = ratio * y
            if m >= 0:
                x[m] = ratio * z


@inline
def fill_steps(n, A, terms, step):
    """The step of each row; returns the residual that is but the rounding of such terms of b."""
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


# A solution of a complementarity problem with friction (see complementarity), from several starts,
# and by proximal steps where Newton's iteration finds none from any.


CONTRADICTION = JUDGED_BY_CONTACT
"""Relative residual that counts where none is smaller: points that touch to within that of the
scene's length, as those at the ends of a rod that lies, contradict each other by as much."""
STARTS = 3
"""Of Newton's iteration: zero, where all rows hold, and what sweeps give."""
SOFTER, PROXIMAL_STEPS = 1e-3, 60
"""Part of a row's own stiffness that a proximal step adds, and the most such steps."""


@inline
def search(p, x, workspace, starts):
    """Into x a solution by Newton's iteration from x and, if there are more starts than one, from
    where all rows hold and from what sweeps give: the first that is solved or the best; returns
    its residual. workspace: of `workspace_of(n)` numbers."""
    n, residual = p.n, math.inf
    trial, work = workspace, part(workspace, n)
    for start in range(starts):
        if residual <= COMPUTED_ROUNDING:
            break
        for k in range(n):
            trial[k] = -p.b[k] if start == 1 else x[k]
        if start == 1:
            least_squares(p.A, trial, n, trial, work)
        elif start == 2:
            sweep(p, trial)
        rest = newton(p, trial, work)
        if rest < residual:
            residual = rest
            for k in range(n):
                x[k] = trial[k]
    return residual


@inline
def approach(p, x, workspace):
    """As `search`, by proximal steps from where sweeps come to (Rockafellar 1976): each is the
    problem with what grips a little less than rigidly around the x before, whose solution Newton's
    method finds.

    Where friction follows from forces that nothing else changes it is the least of a convex
    function, and they always end; where pushes change with it, mostly.
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


@inline
def unit_of(element):
    """The power of two whose square times the element is about 1; 1 for an element of 0."""
    unit = 1.0
    while unit * unit * element > 2.0:
        unit *= 0.5
    while 0.0 < unit * unit * element < 0.5:
        unit *= 2.0
    return unit


@inline
def even_out(p, terms, A, b, even_terms, limits, least, sizes):
    """The problem and the terms of its b in units in which every row alone gives way alike, into
    A, b, even_terms, limits and least. sizes: of those units, in those of x.

    A row of a turn has 1/I for its element, one of a place 1/m: in a scene of a micrometre they
    are a billion of thousands apart, and what is none beside the one would be all of the other.
    Powers of two change no digit; both rows of a bound have one unit, so that it stays a circle.
    Of a row that slips the element may vanish (Painleve), its couplings do not.
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
        k, push = p.bounds[BOUND_WIDTH * i + FIRST], p.bounds[BOUND_WIDTH * i + PUSH]
        limits[i] = p.limits[i] * (sizes[push] / sizes[k])


@inline
def all_finite(n, a):
    """True if none of n numbers is NaN or infinite."""
    for i in range(n):
        if not math.isfinite(a[i]):
            return False
    return True


@inline
def solution(p, terms, x):
    """Into x a solution; returns its residual, NaN where A or b are not finite.

    p: without `step` and `blur`; terms: sizes of what b has been summed from. A residual above
    CONTRADICTION is no solution.
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
    """As `solution`, of arrays: bounds (m, BOUND_WIDTH)."""
    none = pointer(x)
    p = Equations(
        b.shape[0], limits.shape[0], pointer(A), pointer(b), none, integers(rules), pointer(least),
        integers(bounds), pointer(limits), 0.0,
    )  # fmt: skip
    return solution(p, pointer(terms), none)
