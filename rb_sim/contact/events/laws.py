"""The problem between lines and laws, in the room: which lines take part, what each is bound to,
and its solution (see maths.complementarity).
"""

from __future__ import annotations

from rb_sim.loops.compiled import integers, pointer
from rb_sim.maths.complementarity import FIRST, PUSH, SECOND, Equations
from rb_sim.maths.complementarity_search import CONTRADICTION, solution
from rb_sim.maths.jit import inline

SOLVED, UNSOLVED, NOT_FINITE = 0, 1, 2
"""What becomes of a problem: a solution, none that Newton's iteration finds, or numbers that are
none."""


@inline
def add_line(room, n, k, rule):
    """Let line k take part as the n-th, with the rule; returns how many there are now."""
    room.used[n], room.place_of[k] = k, n
    room.rules[n], room.least[n] = rule, 0.0
    return n + 1


@inline
def add_bound(room, m, places, limit, move):
    """Let the lines at places (first, second or -1, push) have the m-th bound, for the move
    (contact, way); returns how many there are now."""
    room.bounds[m, FIRST], room.bounds[m, SECOND], room.bounds[m, PUSH] = places
    room.limits[m] = limit
    room.moves[m, 0], room.moves[m, 1] = move
    return m + 1


@inline
def solve_in(room, n, m, A, b, terms, x):
    """Into x the solution of n lines and m bounds; returns what has become of it."""
    none = pointer(x)
    p = Equations(
        n, m, pointer(A), pointer(b), none, integers(room.rules), pointer(room.least),
        integers(room.bounds), pointer(room.limits), 0.0,
    )  # fmt: skip
    residual = solution(p, pointer(terms), none)
    if residual != residual:
        return NOT_FINITE
    return SOLVED if residual <= CONTRADICTION else UNSOLVED
