"""Which of lines that hold a motion more often than needed get a multiplier, as one function.

In loops of bodies a choice that serves at one place loses digits at another: lines are left out
that are needed there.  So it is made anew after every step.  Pivots by value: compiled once and
called by address, as the least-norm multipliers are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from rb_sim.engine.systems.elimination import Matrix
from rb_sim.graph.functions import call
from rb_sim.graph.symbols import External
from rb_sim.loops.compiled import part, pointer, routine

TIE = 1e-6
"""Share by which a pivot must be larger to go before one with a lower number: which of equal ones
comes first is not left to round-off."""


def largest_pivots(n, rank, matrix, chosen, left, factors):
    """(least pivot, its line) of `rank` lines, each in its turn the one with the largest pivot.

    Pivots of A = G M^-1 G^T scaled to a diagonal of ones, as L L^T with rows of L as they are
    found (Golub & Van Loan, section 4.2.8). matrix: A by rows. chosen: becomes 1 for these lines,
    0 for the others. left (n) and factors (rank n) are room.
    """
    for i in range(n):
        chosen[i], left[i] = 0.0, 1.0
    least, line = 1.0, 0
    for k in range(rank):
        least = 0.0
        for i in range(n):
            if chosen[i] == 0.0 and left[i] > (1.0 + TIE) * least:
                line, least = i, left[i]
        if not least > 0.0:
            return 0.0, line
        chosen[line] = 1.0
        next_row(n, k, line, matrix, left, factors)
    return least, line


def next_row(n, k, line, matrix, left, factors):
    """Write row k of L, of the line, and take it from what is left of the diagonal."""
    row, diagonal = part(factors, k * n), matrix[line * n + line]
    for i in range(n):
        row[i] = matrix[line * n + i] / math.sqrt(diagonal * matrix[i * n + i])
    for j in range(k):
        before = part(factors, j * n)
        factor = before[line]
        for i in range(n):
            row[i] -= factor * before[i]
    scale = 1.0 / math.sqrt(left[line])
    for i in range(n):
        row[i] *= scale
        left[i] -= row[i] * row[i]


@routine
def choice_routine(arguments, results):
    """arguments: n, rank, A (n n); results: the choice (n), least pivot, its line."""
    n, rank = int(arguments[0]), int(arguments[1])
    room = np.empty(n * (rank + 1))
    left, factors = pointer(room), part(pointer(room), n)
    least, line = largest_pivots(n, rank, part(arguments, 2), results, left, factors)
    results[n], results[n + 1] = least, float(line)


@cache
def choice_external(n: int) -> External:
    """The function for n lines: arguments n, rank and A by rows."""

    def plain(*arguments: float) -> tuple[float, ...]:
        results = np.zeros(n + 2)
        choice_routine.function(np.array(arguments, dtype=float), results)
        return tuple(results.tolist())

    return External("rb_sim_choice", n + 2, plain, lambda: choice_routine.address)


def chosen_lines(n: int, rank: int, entries: list[Any]) -> tuple[Any, ...]:
    """For n lines 1 if they are chosen and 0 if not; the least pivot, and the number of its line.

    entries: A row by row, of this rank.
    """
    return call(choice_external(n), float(n), float(rank), *entries)


def switch_off(matrix: Matrix, chosen: Mapping[int, Any]) -> None:
    """Part lines that are not chosen, those with 0, from all others; they keep their own pivots."""
    for i, row in matrix.items():
        for j, value in row.items():
            if i != j:
                row[j] = value * chosen.get(i, 1.0) * chosen.get(j, 1.0)
