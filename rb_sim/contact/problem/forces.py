"""The problem between forces and accelerations: w = A x + b, A = J M^-1 W^T, on the lines that hold
in the modes that the table of contacts has; and between impulses and velocities over a short time.
"""

from __future__ import annotations

import numpy as np

from rb_sim.contact.problem.delassus import fill_delassus, line_times, size_of_terms
from rb_sim.contact.problem.event_workspace import speed_that_is_none, turn_that_is_none
from rb_sim.mechanics.contact.contact_bodies import line_of
from rb_sim.mechanics.contact.contact_kinematics import SLIDING, STUCK
from rb_sim.mechanics.contact.contact_table import (
    BILATERAL,
    KINETIC,
    ROLL,
    ROLLING_ARM,
    SLIDE,
    SPIN,
    SPINNING_ARM,
    SPRING,
    STATIC,
)
from rb_sim.numerics.complementarity import (
    CONTRADICTION,
    FIRST,
    HOLDS,
    PUSH,
    PUSHES,
    RUBS,
    SECOND,
    Equations,
    solution,
)
from rb_sim.numerics.kernels import inline, integers, pointer

# The problem between lines and laws, in the workspace: which lines take part, what each is bound
# to, and its solution (see numerics.complementarity).


SOLVED, UNSOLVED, NOT_FINITE = 0, 1, 2
"""What becomes of a problem: a solution, none that Newton's iteration finds, or numbers that are
none."""


@inline
def add_line(workspace, n, k, rule):
    """Let line k take part as the n-th, with the rule; returns how many there are now."""
    workspace.used[n], workspace.place_of[k] = k, n
    workspace.rules[n], workspace.least[n] = rule, 0.0
    return n + 1


@inline
def add_bound(workspace, m, places, limit, move):
    """Let the lines at places (first, second or -1, push) have the m-th bound, for the move
    (contact, way); returns how many there are now."""
    workspace.bounds[m, FIRST], workspace.bounds[m, SECOND], workspace.bounds[m, PUSH] = places
    workspace.limits[m] = limit
    workspace.moves[m, 0], workspace.moves[m, 1] = move
    return m + 1


@inline
def solve_in(workspace, n, m, A, b, terms, x):
    """Into x the solution of n lines and m bounds; returns what has become of it."""
    none = pointer(x)
    p = Equations(
        n, m, pointer(A), pointer(b), none, integers(workspace.rules), pointer(workspace.least),
        integers(workspace.bounds), pointer(workspace.limits), 0.0,
    )  # fmt: skip
    residual = solution(p, pointer(terms), none)
    if residual != residual:
        return NOT_FINITE
    return SOLVED if residual <= CONTRADICTION else UNSOLVED


CANDIDATE, PRESSED = 1, 2
"""How a contact takes part: it may push, or a compliant support pushes it by a given force."""
EASED = 1e-8
"""Part of all bounds taken off where one has been reached: what shares the load, as the ends of an
edge, begins to slip as one, and in directions that go together."""


@inline
def easing(workspace):
    """What all bounds at rest are multiplied by."""
    for c in range(workspace.moved.shape[0]):
        for way in range(3):
            if workspace.moved[c, way] == 1:
                return 1.0 - EASED
    return 1.0


@inline
def bound_at_rest(workspace, c, way, static, kinetic):
    """Of contact c in a way: the kinetic one once it has left its rest."""
    return kinetic if workspace.moved[c, way] == 1 else static


@inline
def lay_out_forces(system, workspace):
    """The lines that hold, and their laws; the last lines are the given forces of pressed contacts,
    each with a value of its own. Returns (lines, bounds)."""
    touch, n, m, ease = system.touch, 0, 0, easing(workspace)
    for k in range(line_of(system, 0)):
        n = add_line(workspace, n, k, HOLDS)
    for c in range(touch.shape[0]):
        k = line_of(system, c)
        if workspace.taking_part[c] == CANDIDATE:
            n = add_line(workspace, n, k, HOLDS if touch[c, BILATERAL] == 1.0 else PUSHES)
        if workspace.taking_part[c] != 0:
            if touch[c, SLIDE] == STUCK:
                n = add_line(workspace, n, k + 1, RUBS)
                n = add_line(workspace, n, k + 2, RUBS)
            if touch[c, ROLL] == STUCK:
                n = add_line(workspace, n, k + 3, RUBS)
                n = add_line(workspace, n, k + 4, RUBS)
            if touch[c, SPIN] == STUCK:
                n = add_line(workspace, n, k + 5, RUBS)
    for c in range(touch.shape[0]):
        if workspace.taking_part[c] == 0:
            continue
        k = line_of(system, c)
        if workspace.taking_part[c] == PRESSED:
            n = add_line(workspace, n, k, HOLDS)
        push, at = workspace.place_of[k], workspace.place_of
        if touch[c, SLIDE] == STUCK:
            limit = ease * bound_at_rest(workspace, c, 0, touch[c, STATIC], touch[c, KINETIC])
            m = add_bound(workspace, m, (at[k + 1], at[k + 2], push), limit, (c, 0))
        if touch[c, ROLL] == STUCK:
            limit = ease * touch[c, ROLLING_ARM]
            m = add_bound(workspace, m, (at[k + 3], at[k + 4], push), limit, (c, 1))
        if touch[c, SPIN] == STUCK:
            limit = ease * touch[c, SPINNING_ARM]
            m = add_bound(workspace, m, (at[k + 5], -1, push), limit, (c, 2))
    return n, m


@inline
def given_forces(workspace):
    """How many of the last lines are given forces."""
    count = 0
    for c in range(workspace.taking_part.shape[0]):
        count += 1 if workspace.taking_part[c] == PRESSED else 0
    return count


@inline
def fill_forces(system, workspace, n, A, b, terms):
    """A, b and the sizes of the terms of b."""
    lines = n - given_forces(workspace)
    for i in range(lines, n):
        for j in range(n):
            A[i, j], A[j, i] = 0.0, 0.0
        A[i, i] = 1.0
    fill_delassus(system, workspace.J, workspace.W, workspace.used, lines, A)
    for i in range(lines):
        k = workspace.used[i]
        b[i] = (
            line_times(system, workspace.J, k, workspace.free_accelerations)
            + workspace.line_bias[k]
        )
        sizes = size_of_terms(system, workspace.J, k, workspace.free_accelerations)
        terms[i] = sizes + abs(workspace.line_bias[k])
    i = lines
    for c in range(system.touch.shape[0]):
        if workspace.taking_part[c] == PRESSED:
            b[i], terms[i] = -system.touch[c, SPRING], system.touch[c, SPRING]
            i += 1


@inline
def solve_forces(workspace, n, m, A, b, terms, x, w):
    """Into x the solution, into w = A x + b; returns what becomes of it (see laws)."""
    status = solve_in(workspace, n, m, A, b, terms, x)
    if status == SOLVED:
        for i in range(n):
            w[i] = b[i]
            for j in range(n):
                w[i] += A[i, j] * x[j]
    return status


@inline
def find_moving(system, workspace, m, w, duration):
    """What has a velocity at the end of so long a time has left its rest, w being accelerations;
    returns whether any of it had not yet."""
    new = False
    for i in range(m):
        c, way = workspace.moves[i, 0], workspace.moves[i, 1]
        first, second = workspace.bounds[i, 0], workspace.bounds[i, 1]
        size = w[first] ** 2 + (w[second] ** 2 if second >= 0 else 0.0)
        still = speed_that_is_none(system) if way == 0 else turn_that_is_none(system)
        if duration * size**0.5 > still:
            new = new or workspace.moved[c, way] == 0
            system.touch[c, SLIDE + way] = SLIDING
    return new


@inline
def answer_over(system, workspace, u, duration):
    """The impulses of all lines over a short time into the workspace, all contacts that take part
    closed and at rest in the table, u the velocities before; those that move at its end slide in
    the table then. Returns what becomes of it (see laws)."""
    modes = np.empty((system.touch.shape[0], 3))
    for c in range(modes.shape[0]):
        for way in range(3):
            modes[c, way] = system.touch[c, SLIDE + way]
    for _ in range(1 + 3 * modes.shape[0]):
        for c in range(modes.shape[0]):
            for way in range(3):
                system.touch[c, SLIDE + way] = modes[c, way]
        n, m = lay_out_forces(system, workspace)
        A, b, terms = np.empty((n, n)), np.empty(n), np.empty(n)
        x, w = np.empty(n), np.empty(n)
        fill_forces(system, workspace, n, A, b, terms)
        for i in range(n - given_forces(workspace)):
            k = workspace.used[i]
            rate = workspace.line_rate[k]
            b[i] += (line_times(system, workspace.J, k, u) - rate) / duration
            terms[i] += (size_of_terms(system, workspace.J, k, u) + abs(rate)) / duration
        status = solve_forces(workspace, n, m, A, b, terms, x, w)
        if status != SOLVED:
            return status
        if not find_moving(system, workspace, m, w, duration):
            break
        for i in range(m):
            c, way = workspace.moves[i, 0], workspace.moves[i, 1]
            if system.touch[c, SLIDE + way] == SLIDING:
                workspace.moved[c, way] = 1
    for k in range(workspace.impulses.shape[0]):
        workspace.impulses[k] = 0.0
    for i in range(n - given_forces(workspace)):
        workspace.impulses[workspace.used[i]] = duration * x[i]
    return SOLVED
