# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Elimination of the constraint rows: A lambda = b for the sparse A = G M^-1 G^T."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from rb_sim.graph.symbols import External, call, divide, rarely, where
from rb_sim.mechanics.systems.many_bodies import BODY, MULTIPLIERS, PARENT, PUSH, WIDTH, MultiBody
from rb_sim.mechanics.systems.multibody import coupling, inverse_mass_times
from rb_sim.numerics.kernels import inline, part, pointer, routine
from rb_sim.numerics.linear_solves import of_rank
from rb_sim.numerics.rank import RANK_TOLERANCE, rank_of

# Which rows of constraints depend on others: decided once, so that doubles can keep the decision.
#
# Of rows that depend on each other some are left out, and there is a choice.  Left out in the
# order of elimination as soon as a pivot is round-off, what remains may be all but dependent, too:
# pivots then shrink to 1e-6 of their diagonal elements, the next ones are round-off of 1e-10, and
# so is the rank.  Here the rank comes from the rows as a whole, and rows are left out whose
# pivots are small as long as enough others remain.


LIMITS = tuple(10.0**-k for k in range(1, 11)) + (RANK_TOLERANCE,)
"""Shares of the diagonal element up to which a pivot leaves its row out, tried in turn."""
SURE = 1e-3
"""Share of the diagonal element above which pivots cost few digits, so that none is round-off."""
MOST = 1500
"""Rows up to which the rank is asked of all rows as a whole, which takes their number cubed."""


class Dependent(NamedTuple):
    """Rows that depend on others for good, and get no multiplier.

    A stage of a step lies a little off the manifold, where they contradict the others: whoever asks
    anew there which rows depend on others finds none as soon as the step is long.
    """

    rows: frozenset[int] = frozenset()
    """among all rows."""
    positions: frozenset[int] = frozenset()
    """among the holonomic rows alone."""


INDEPENDENT = Dependent()
"""No row depends on others."""

MOST_CHANGING = 60
"""Rows in loops up to which it is chosen anew on the way which of them get no multiplier."""


def changing_rows(system: MultiBody, dependent: Dependent, holonomic: list[bool]) -> list[int]:
    """The holonomic rows in loops of three bodies and more, the world one of them, where some are
    left out.

    In such a loop rows that are left out at one place are needed at another.  Of two bodies the
    rows turn with the parent, so that one choice serves for good.  Rows that are not holonomic,
    as of a drive, are kept, whichever of the others are.  Where they depend on the others positions
    and velocities have choices of their own: none is made anew.
    """
    found = rows_in_loops(system)
    placed = [k for k in found if holonomic[k]]
    some, among = dependent.rows & set(found), dependent.positions & set(placed)
    alike = some <= set(placed) and len(some) == len(among)
    return placed if some and alike and len(placed) <= MOST_CHANGING else []


def rows_in_loops(system: MultiBody) -> list[int]:
    """The rows in loops of three bodies and more, the world one of them."""
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
    """A = G M^-1 G^T of the rows as written, in this order; what it keeps depends on no others.

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
    """The rank of A by its eigenvalues; `otherwise` where the rows are too many or not finite."""
    if len(order) > MOST:
        return otherwise
    matrix = dense_matrix(system, order)
    return rank_of(matrix) if np.isfinite(matrix).all() else otherwise


def dense_matrix(system: MultiBody, rows: Sequence[int]) -> np.ndarray:
    """A = G M^-1 G^T of these rows as written, with its zeros."""
    at = {k: i for i, k in enumerate(rows)}
    matrix = np.zeros((len(at), len(at)))
    for k, row in constraint_matrix(system, rows).items():
        for j, value in row.items():
            matrix[at[k], at[j]] = value
    return matrix


# A lambda = b for the sparse A = G M^-1 G^T, written once for numbers and for symbols.
#
# L D L^T without pivoting, in an order that fills little in.  A pivot that is round-off of its
# diagonal element belongs to a row that depends on those before it: it gets no multiplier, which
# for a consistent right side leaves G^T lambda what it is.


NEARLY_DEPENDENT = 1e-4
"""Pivot relative to its diagonal element up to which small errors of a row are not corrected: what
rounds off of them would move bodies by a hundred times as much and more, and velocities by the
square of that."""


Matrix = dict[int, dict[int, Any]]
"""Rows of a symmetric matrix: both triangles, structural zeros left out."""


def elimination_order(neighbours: Sequence[set[int]], last: Sequence[int] = ()) -> list[int]:
    """Minimum degree: the node with the fewest neighbours goes next and makes them neighbours.

    neighbours: of each node, itself left out. last: ranks of the nodes, lower ones go first.
    """
    graph = {i: set(near) for i, near in enumerate(neighbours)}
    ranks = last or [0] * len(graph)
    order = []
    while graph:
        k = min(graph, key=lambda i: (ranks[i], len(graph[i]), i))
        near = graph.pop(k)
        for i in near:
            graph[i] |= near
            graph[i] -= {i, k}
        order.append(k)
    return order


def rows_in_order(parts: Sequence[Iterable[int]], bodies: Sequence[set[int]]) -> list[int]:
    """The rows of the parts (their indices each) in the order of elimination.

    bodies: those on which a part acts; parts that share one are neighbours.
    """
    on: dict[int, set[int]] = {}
    for i, names in enumerate(bodies):
        for body in names:
            on.setdefault(body, set()).add(i)
    near = [set().union(*(on[b] for b in names)) - {i} for i, names in enumerate(bodies)]
    return [pivot_row for i in elimination_order(near) for pivot_row in parts[i]]


class Factors:
    """L D L^T of a sparse matrix, which is used up; `rank` counts the pivots that are kept.

    smallest: share of its diagonal element up to which a pivot is not kept. sure: unknowns that
    are no rows; their pivots are kept, whatever their sign, and not counted. scales: of rows
    whose pivots are compared with another number than their diagonal element.
    """

    def __init__(
        self,
        matrix: Matrix,
        order: Sequence[int],
        smallest: float = RANK_TOLERANCE,
        sure: frozenset[int] = frozenset(),
        scales: Mapping[int, Any] = MappingProxyType({}),
    ) -> None:
        self.order, self.smallest, self.sure = tuple(order), smallest, sure
        self.inverse: dict[int, Any] = {}
        self.rows: dict[int, dict[int, Any]] = {}
        self.shares: dict[int, Any] = {}
        """each pivot relative to its diagonal element: round-off where a row depends on others."""
        diagonal = {k: scales[k] if k in scales else matrix[k][k] for k in order}
        self.rank: Any = 0.0
        for k in order:
            row = matrix.pop(k)
            pivot = row.pop(k)
            if k in sure:
                self.inverse[k] = divide(1.0, pivot)
            else:
                lost = pivot <= smallest * diagonal[k]
                self.shares[k] = divide(pivot, diagonal[k])
                self.inverse[k] = rarely(lost, 0.0, divide(1.0, pivot))
                self.rank = self.rank + rarely(lost, 0.0, 1.0)
            self.rows[k] = {i: value * self.inverse[k] for i, value in row.items()}
            left = list(row.items())
            for at, (i, _) in enumerate(left):
                del matrix[i][k]
                factor = self.rows[k][i]
                for j, value in left[: at + 1]:
                    changed = matrix[i].get(j, 0.0) - factor * value
                    matrix[i][j] = matrix[j][i] = changed

    @property
    def kept(self) -> dict[int, Any]:
        """The shares of the pivots that are kept, which are numbers, by row."""
        return {k: share for k, share in self.shares.items() if share > self.smallest}

    def solve(
        self, right: Mapping[int, Any], rounding: Mapping[int, float] = MappingProxyType({})
    ) -> dict[int, Any]:
        """x with A x = b; of `sure`, b may be left out where it is zero.

        rounding: of rows, up to which b counts as zero once the rows before are solved, if the
        pivot is small. Near a singular configuration such a pivot would make a jump of round-off;
        what is left of b goes out beyond it.
        """
        z, x = {**dict.fromkeys(self.sure, 0.0), **right}, {}
        for k in self.order:
            if k in rounding and k in self.shares:
                rounded = where(z[k] * z[k] <= rounding[k] ** 2, 0.0, z[k])
                z[k] = where(self.shares[k] <= NEARLY_DEPENDENT, rounded, z[k])
            for i, factor in self.rows[k].items():
                z[i] = z[i] - factor * z[k]
        for k in reversed(self.order):
            s = z[k] * self.inverse[k]
            for i, factor in self.rows[k].items():
                s = s - factor * x[i]
            x[k] = s
        return x


# Tables of bodies and rows that may hold symbols, and what is done with them.


def hasten(system: MultiBody, y: list[Any]) -> None:
    """Add push to the velocities."""
    for i in range(len(y) // WIDTH):
        for j in range(6):
            k = WIDTH * i + 7 + j
            y[k] = y[k] + system.bodies[i, PUSH + j]


def with_object_tables(system: MultiBody) -> MultiBody:
    """The system with tables of its own that may hold symbols."""
    names = ("bodies", "rows", "vectors", "anchors")
    return system._replace(**{name: getattr(system, name).astype(object) for name in names})


def constraint_matrix(
    system: MultiBody, rows: Any, besides: frozenset[int] = frozenset()
) -> Matrix:
    """A = G M^-1 G^T of these rows; entries only where two share a body.

    besides: bodies that are left out, as if nothing could move them.
    """
    matrix: Matrix = {i: {} for i in rows}
    on: dict[int, list[tuple[int, int]]] = {}
    for i in rows:
        for body, column in ((system.row_table[i, BODY], 0), (system.row_table[i, PARENT], 6)):
            if body >= 0 and body not in besides:
                on.setdefault(int(body), []).append((i, column))
    for body, members in on.items():
        for at, (i, column) in enumerate(members):
            force, turn = inverse_mass_times(system, body, i, column)
            for j, other in members[: at + 1]:
                share = coupling(system.rows, j, other, force, turn)
                matrix[i][j] = matrix[j][i] = matrix[i].get(j, 0.0) + share
    return matrix


def take_least_norm(system: MultiBody, rank: Any) -> None:
    """Replace the multipliers by those of least norm with the same G^T lambda."""

    rows = range(system.row_table.shape[0])
    matrix = constraint_matrix(system, rows)
    entries = [matrix[i].get(j, 0.0) for i in rows for j in rows]
    system.vectors[MULTIPLIERS] = least_norm(entries, list(system.vectors[MULTIPLIERS]), rank)


# Which of rows that hold a motion more often than needed get a multiplier, as one function.
#
# In loops of bodies a choice that serves at one place loses digits at another: rows are left out
# that are needed there.  So it is made anew after every step.  Pivots by value: compiled once and
# called by address, as the least-norm multipliers are.


TIE = 1e-6
"""Share by which a pivot must be larger to go before one with a lower number: which of equal ones
comes first is not left to round-off."""


def largest_pivots(n, rank, matrix, chosen, left, factors):
    """(least pivot, its row) of `rank` rows, each in its turn the one with the largest pivot.

    Pivots of A = G M^-1 G^T scaled to a diagonal of ones, as L L^T with rows of L as they are
    found (Golub & Van Loan, section 4.2.8). matrix: A by rows. chosen: becomes 1 for these rows,
    0 for the others. left (n) and factors (rank n) are workspace.
    """
    for i in range(n):
        chosen[i], left[i] = 0.0, 1.0
    least, pivot_row = 1.0, 0
    for k in range(rank):
        least = 0.0
        for i in range(n):
            if chosen[i] == 0.0 and left[i] > (1.0 + TIE) * least:
                pivot_row, least = i, left[i]
        if not least > 0.0:
            return 0.0, pivot_row
        chosen[pivot_row] = 1.0
        next_row(n, k, pivot_row, matrix, left, factors)
    return least, pivot_row


def next_row(n, k, pivot_row, matrix, left, factors):
    """Write row k of L, of the row, and take it from what is left of the diagonal."""
    row, diagonal = part(factors, k * n), matrix[pivot_row * n + pivot_row]
    for i in range(n):
        row[i] = matrix[pivot_row * n + i] / math.sqrt(diagonal * matrix[i * n + i])
    for j in range(k):
        before = part(factors, j * n)
        factor = before[pivot_row]
        for i in range(n):
            row[i] -= factor * before[i]
    scale = 1.0 / math.sqrt(left[pivot_row])
    for i in range(n):
        row[i] *= scale
        left[i] -= row[i] * row[i]


@routine
def choice_routine(arguments, results):
    """arguments: n, rank, A (n n); results: the choice (n), least pivot, its row."""
    n, rank = int(arguments[0]), int(arguments[1])
    workspace = np.empty(n * (rank + 1))
    left, factors = pointer(workspace), part(pointer(workspace), n)
    least, pivot_row = largest_pivots(n, rank, part(arguments, 2), results, left, factors)
    results[n], results[n + 1] = least, float(pivot_row)


def external(name: str, owner: Any, results: int, **more: Any) -> External:
    """A routine as a function that laws call, of which it is also the plain form."""

    def plain(*arguments: float) -> tuple[float, ...]:
        found = np.zeros(results)
        owner.function(np.array(arguments, dtype=float), found)
        return tuple(found.tolist())

    return External(name, results, plain, lambda: owner.address, **more)


@cache
def choice_external(n: int) -> External:
    """The function for n rows: arguments n, rank and A by rows."""
    return external("rb_sim_choice", choice_routine, n + 2)


def chosen_rows(n: int, rank: int, entries: list[Any]) -> tuple[Any, ...]:
    """For n rows 1 if they are chosen and 0 if not; the least pivot, and the number of its row.

    entries: A row by row, of this rank.
    """
    return call(choice_external(n), float(n), float(rank), *entries)


def switch_off(matrix: Matrix, chosen: Mapping[int, Any]) -> None:
    """Part rows that are not chosen, those with 0, from all others; they keep their own pivots."""
    for i, row in matrix.items():
        for j, value in row.items():
            if i != j:
                row[j] = value * chosen.get(i, 1.0) * chosen.get(j, 1.0)


# Least-norm multipliers where constraints depend on each other, as one function for all scenes:
# P x, P = A+ A. The only part of a law that pivots by value: it is compiled once and called by
# address.


@inline
def times(matrix, x, n, result):
    """A x."""
    for i in range(n):
        result[i] = 0.0
        for j in range(n):
            result[i] += matrix[i * n + j] * x[j]


@routine
def least_norm_routine(arguments, results):
    """arguments: n, rank, the matrix (n n), x (n); results: n numbers."""
    n, rank = int(arguments[0]), int(arguments[1])
    matrix, x, workspace = part(arguments, 2), part(arguments, 2 + n * n), np.empty(n * (n + 5))
    right, work = pointer(workspace), part(pointer(workspace), n)
    times(matrix, x, n, right)
    of_rank(matrix, right, n, rank, results, work)


@routine
def changed_routine(arguments, results):
    """The change of P x as A changes and keeps its rank:

        dP = (1 - P) dA A+ + A+ dA (1 - P)   (Golub & Pereyra 1973).

    arguments: n, rank, A (n n), x (n), dA (n n), dx (n); results: n numbers.
    """
    n, rank = int(arguments[0]), int(arguments[1])
    matrix, x, workspace = part(arguments, 2), part(arguments, 2 + n * n), np.empty(n * (n + 8))
    d_matrix, d_x = part(arguments, 2 + n * n + n), part(arguments, 2 + 2 * n * n + n)
    right, rest = pointer(workspace), part(pointer(workspace), n)
    outward, inward = part(pointer(workspace), 2 * n), part(pointer(workspace), 3 * n)
    work = part(pointer(workspace), 4 * n)
    times(matrix, x, n, right)
    of_rank(matrix, right, n, rank, rest, work)
    for i in range(n):
        rest[i] = x[i] - rest[i]
    times(d_matrix, rest, n, inward)
    of_rank(matrix, x, n, rank, right, work)
    times(d_matrix, right, n, outward)
    for i in range(n):
        rest[i] = d_x[i] - outward[i]
    times(matrix, rest, n, right)
    for i in range(n):
        right[i] += inward[i]
    of_rank(matrix, right, n, rank, results, work)
    for i in range(n):
        results[i] += outward[i]


@cache
def changed_external(n: int) -> External:
    """The function for n multipliers: arguments n, rank, A by rows, x, dA by rows and dx."""
    return external("rb_sim_least_norm_changed", changed_routine, n)


def changes_of_least_norm(*arguments: Any) -> tuple[Any, ...]:
    """The changes of `least_norm`; its arguments, n and the rank first, then their changes."""
    given = len(arguments) // 2
    n, rank, *numbers = arguments[:given]
    return call(changed_external(int(n)), n, rank, *numbers, *arguments[given + 2 :])


@cache
def least_norm_external(n: int) -> External:
    """The function for n multipliers: arguments n, rank, A by rows and x."""
    return external("rb_sim_least_norm", least_norm_routine, n, along=changes_of_least_norm)


def least_norm(entries: list[Any], x: list[Any], rank: Any) -> tuple[Any, ...]:
    """x of least norm among those with the same A x; entries: A row by row, of this rank."""
    return call(least_norm_external(len(x)), float(len(x)), rank, *entries, *x)
