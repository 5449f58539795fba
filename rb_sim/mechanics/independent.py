"""Which lines of constraints depend on others: decided once, so that doubles can keep the decision.

Of lines that depend on each other some are left out, and there is a choice.  Left out in the order
of elimination as soon as a pivot is round-off, what remains may be all but dependent, too: pivots
then shrink to 1e-6 of their diagonal elements, the next ones are round-off of 1e-10, and so is the
rank.  Here the rank comes from the lines as a whole, and lines are left out whose pivots are small
as long as enough others remain.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rb_sim.mechanics.systems.elimination import Factors, constraint_matrix
from rb_sim.mechanics.systems.many_bodies import MultiBody
from rb_sim.numerics.rank import RANK_TOLERANCE

LIMITS = tuple(10.0**-k for k in range(1, 11)) + (RANK_TOLERANCE,)
"""Shares of the diagonal element up to which a pivot leaves its line out, tried in turn."""
SURE = 1e-3
"""Share of the diagonal element above which pivots cost few digits, so that none is round-off."""
APART = 1e-7
"""Eigenvalue of the scaled lines, the largest about 1, that is no round-off by far."""
MOST = 1500
"""Lines up to which the rank is asked of all lines as a whole, which takes their number cubed."""


class Dependent(NamedTuple):
    """Lines that depend on others for good, and get no multiplier.

    A stage of a step lies a little off the manifold, where they contradict the others: whoever asks
    anew there which lines depend on others finds none as soon as the step is long.
    """

    lines: frozenset[int] = frozenset()
    """among all lines."""
    positions: frozenset[int] = frozenset()
    """among the holonomic lines alone."""


INDEPENDENT = Dependent()
"""No line depends on others."""

MOST_CHANGING = 60
"""Lines in loops up to which it is chosen anew on the way which of them get no multiplier."""


def changing_lines(system: MultiBody, dependent: Dependent, holonomic: list[bool]) -> list[int]:
    """The holonomic lines in loops of three bodies and more, the world one of them, where some are
    left out.

    In such a loop lines that are left out at one place are needed at another.  Of two bodies the
    lines turn with the parent, so that one choice serves for good.  Lines that are not holonomic,
    as of a drive, are kept, whichever of the others are.  Where they depend on the others positions
    and velocities have choices of their own: none is made anew.
    """
    found = lines_in_loops(system)
    placed = [k for k in found if holonomic[k]]
    some, among = dependent.lines & set(found), dependent.positions & set(placed)
    alike = some <= set(placed) and len(some) == len(among)
    return placed if some and alike and len(placed) <= MOST_CHANGING else []


def lines_in_loops(system: MultiBody) -> list[int]:
    """The lines in loops of three bodies and more, the world one of them."""
    pairs = [frozenset((c.body, c.parent)) for c in system.constraints]
    loops, first = set(pairs), system.first_row
    while True:
        members = [body for pair in loops for body in pair]
        inner = {pair for pair in loops if all(members.count(body) > 1 for body in pair)}
        if inner == loops:
            break
        loops = inner
    return [
        k
        for part, pair in enumerate(pairs)
        if pair in loops
        for k in range(int(first[part]), int(first[part + 1]))
    ]


def factored(system: MultiBody, order: list[int]) -> Factors:
    """A = G M^-1 G^T of the lines as written, in this order; what it keeps depends on no others.

    system: its tables hold numbers.
    """
    first = Factors(constraint_matrix(system, order), order)
    if min(first.kept.values(), default=1.0) > SURE:
        return first
    rank = rank_as_a_whole(system, order, len(first.kept))
    for limit in LIMITS:
        found = Factors(constraint_matrix(system, order), order, limit)
        if len(found.kept) == rank:
            return found
    return first


def rank_as_a_whole(system: MultiBody, order: list[int], otherwise: int) -> int:
    """The number of eigenvalues of the scaled A that are not zero; `otherwise` where the lines are
    too many, or an eigenvalue is neither round-off nor far from it."""
    if len(order) > MOST:
        return otherwise
    matrix = dense_matrix(system, order)
    if not np.isfinite(matrix).all():
        return otherwise
    sizes = np.sqrt(np.diag(matrix))
    values = np.linalg.eigvalsh(matrix / np.outer(sizes, sizes))
    zero = values <= RANK_TOLERANCE * len(order)
    return int((~zero).sum()) if (values[~zero] > APART).all() else otherwise


def dense_matrix(system: MultiBody, lines: Sequence[int]) -> np.ndarray:
    """A = G M^-1 G^T of these lines as written, with its zeros."""
    at = {k: i for i, k in enumerate(lines)}
    matrix = np.zeros((len(at), len(at)))
    for k, row in constraint_matrix(system, lines).items():
        for j, value in row.items():
            matrix[at[k], at[j]] = value
    return matrix
