"""A solution of a complementarity problem with friction (see complementarity), from several starts,
and by proximal steps where Newton's iteration finds none from any.
"""

from __future__ import annotations

import math

import numpy as np

from rb_sim.loops.compiled import integers, part, pointer
from rb_sim.maths.complementarity import (
    BOUND_WIDTH,
    FIRST,
    PUSH,
    SECOND,
    SOLVED,
    Equations,
    fill_steps,
    newton,
    room_of,
    sweep,
)
from rb_sim.maths.jit import entry, inline
from rb_sim.maths.least_squares import least_squares

CONTRADICTION = 1e-10
"""Residual, as `SOLVED`, that counts where none is smaller: points that touch to within that of the
scene's length, as those at the ends of a rod that lies, contradict each other by as much."""
STARTS = 3
"""Of Newton's iteration: zero, where all lines hold, and what sweeps give."""
SOFTER, PROXIMAL_STEPS = 1e-3, 60
"""Part of a line's own stiffness that a proximal step adds, and the most such steps."""


@inline
def search(p, x, room, starts):
    """Into x a solution by Newton's iteration from x and, if there are more starts than one, from
    where all lines hold and from what sweeps give: the first that is solved or the best; returns
    its residual. room: of `room_of(n)` numbers."""
    n, residual = p.n, math.inf
    trial, work = room, part(room, n)
    for start in range(starts):
        if residual <= SOLVED:
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
def approach(p, x, room):
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
        search(p._replace(A=softer, b=b, step=step, blur=blur), at, room, 1)
        for k in range(n):
            trial[k] = at[k]
        residual = search(p, trial, room, 1)
        if residual < least:
            least = residual
            for k in range(n):
                x[k] = trial[k]
        if least <= SOLVED:
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
    """The problem and the terms of its b in units in which every line alone gives way alike, into
    A, b, even_terms, limits and least. sizes: of those units, in those of x.

    A line of a turn has 1/I for its element, one of a place 1/m: in a scene of a micrometre they
    are a billion of thousands apart, and what is none beside the one would be all of the other.
    Powers of two change no digit; both lines of a bound have one unit, so that it stays a circle.
    Of a line that slips the element may vanish (Painleve), its couplings do not.
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
    room, step = np.empty(room_of(n)), np.empty(n)
    matrix, vectors, bounds = np.empty(n * n), np.empty(4 * n), np.empty(p.m + 1)
    A, b, limits = pointer(matrix), pointer(vectors), pointer(bounds)
    even_terms, least, sizes = part(b, n), part(b, 2 * n), part(b, 3 * n)
    even_out(p, terms, A, b, even_terms, limits, least, sizes)
    blur = fill_steps(n, A, even_terms, pointer(step))
    even = p._replace(A=A, b=b, step=pointer(step), least=least, limits=limits, blur=blur)
    residual = search(even, x, pointer(room), STARTS)
    if not residual <= CONTRADICTION:
        residual = approach(even, x, pointer(room))
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
