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

from rb_sim.compiler.graph.symbols import External, call, divide, rarely, where
from rb_sim.mechanics.systems.many_bodies import (
    BODY,
    MULTIPLIERS,
    PARENT,
    RESPONSE,
    WIDTH,
    MultiBody,
)
from rb_sim.mechanics.systems.multibody import coupling, inverse_mass_times
from rb_sim.numerics.kernels import part, pointer, routine
from rb_sim.numerics.linear_solves import of_rank
from rb_sim.numerics.rank import RANK_TOLERANCE, rank_of

# Constraint rows that depend on others: decided once, with as many digits as possible.
#
# Of dependent rows some are omitted, and there is a choice. If a row is omitted in the order of
# elimination only when its pivot is rounding, the remaining rows may be nearly dependent, too:
# pivots shrink to 1e-6 of their diagonal elements, the next ones are rounding errors of 1e-10, and
# so is the rank. Here the rank comes from all rows together, and rows with small pivots are omitted
# as long as enough others remain.


LIMITS = tuple(10.0**-k for k in range(1, 11)) + (RANK_TOLERANCE,)
"""Pivots, relative to the diagonal element, up to which a row is omitted; tried in turn."""
SURE = 1e-3
"""Pivot, relative to the diagonal element, above which few digits are lost, so that no pivot is
rounding."""
MOST = 1500
"""Most rows for which the rank of all rows together is computed; its cost is cubic."""


class Dependent(NamedTuple):
    """Rows that permanently depend on others and get no multiplier.

    A stage of a step lies a little off the manifold, where these rows contradict the others: a new
    decision there would find no dependent rows as soon as the step is long.
    """

    rows: frozenset[int] = frozenset()
    """dependent rows among all rows."""
    positions: frozenset[int] = frozenset()
    """dependent rows among the holonomic rows alone."""


INDEPENDENT = Dependent()
"""No dependent rows."""

MOST_CHANGING = 60
"""Most rows in loops for which the choice of omitted rows is repeated during the motion."""


def changing_rows(system: MultiBody, dependent: Dependent, holonomic: list[bool]) -> list[int]:
    """Holonomic rows in loops of three or more bodies (the world included) with omitted rows.

    In such a loop rows that are omitted in one position are needed in another. With two bodies the
    rows turn with the parent, so that one choice holds throughout. Rows that are not holonomic, as
    of a drive, are always kept. If holonomic rows depend on them, positions and velocities would
    need different choices: then the choice is not repeated.
    """
    found = rows_in_loops(system)
    placed = [k for k in found if holonomic[k]]
    some, among = dependent.rows & set(found), dependent.positions & set(placed)
    alike = some <= set(placed) and len(some) == len(among)
    return placed if some and alike and len(placed) <= MOST_CHANGING else []


def rows_in_loops(system: MultiBody) -> list[int]:
    """The rows in loops of three or more bodies, the world included."""
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
    """Factors of A = G M^-1 G^T of the rows as written, in this order; the rows kept are
    independent.

    system: its tables hold numbers.
    """
    first = Factors(constraint_matrix(system, order), order)
    if min(first.kept.values(), default=1.0) > SURE:
        return first
    matrix = dense_matrix(system, order) if len(order) <= MOST else np.array(np.nan)
    rank = rank_of(matrix) if np.isfinite(matrix).all() else len(first.kept)
    for limit in LIMITS:
        found = Factors(constraint_matrix(system, order), order, limit)
        if len(found.kept) == rank:
            return found
    return first


def dense_matrix(system: MultiBody, rows: Sequence[int]) -> np.ndarray:
    """A = G M^-1 G^T of these rows as written, zeros included."""
    at = {k: i for i, k in enumerate(rows)}
    matrix = np.zeros((len(at), len(at)))
    for k, row in constraint_matrix(system, rows).items():
        for j, value in row.items():
            matrix[at[k], at[j]] = value
    return matrix


# A lambda = b for the sparse A = G M^-1 G^T, for numbers and for symbols: L D L^T without pivoting,
# in an order with little fill-in.
#
# A pivot that is rounding of its diagonal element belongs to a row that depends on earlier ones: it
# gets no multiplier, which for a consistent right side does not change G^T lambda.


NEARLY_DEPENDENT = 1e-4
"""Pivot, relative to its diagonal element, up to which small errors of a row are not corrected:
their rounding would be amplified at least a hundred times in positions, and by the square of that
in velocities."""


Matrix = dict[int, dict[int, Any]]
"""Rows of a symmetric matrix by index: both triangles, without structural zeros."""


def elimination_order(neighbours: Sequence[set[int]], last: Sequence[int] = ()) -> list[int]:
    """Minimum-degree order: the node with the fewest neighbours is next and couples its neighbours.

    neighbours: of each node, without itself. last: ranks of the nodes; lower ones come first.
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
    """The rows of the parts (indices for each part) in the order of elimination.

    bodies: those on which a part acts; parts that share one are neighbours.
    """
    on: dict[int, set[int]] = {}
    for i, names in enumerate(bodies):
        for body in names:
            on.setdefault(body, set()).add(i)
    near = [set().union(*(on[b] for b in names)) - {i} for i, names in enumerate(bodies)]
    return [pivot_row for i in elimination_order(near) for pivot_row in parts[i]]


class Factors:
    """L D L^T of a sparse matrix, which is consumed; `rank` counts the kept pivots.

    smallest: pivot relative to its diagonal element up to which it is dropped. sure: unknowns that
    are not rows; their pivots are always kept and not counted. scales: for some rows, comparison
    values instead of their diagonal elements.
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
        """each pivot relative to its diagonal element: rounding if the row depends on others."""
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
        """Kept pivots relative to their diagonal elements (numbers), by row."""
        return {k: share for k, share in self.shares.items() if share > self.smallest}

    def solve(
        self, right: Mapping[int, Any], rounding: Mapping[int, float] = MappingProxyType({})
    ) -> dict[int, Any]:
        """x with A x = b; entries of b for `sure` unknowns default to zero.

        rounding: for rows with a small pivot, |b| after the previous rows that counts as zero. Near
        a singular configuration such a pivot would turn rounding into a jump; the remaining error
        is corrected beyond it.
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


# Tables of bodies and rows that may hold symbols, and operations on them.


def hasten(system: MultiBody, y: list[Any]) -> None:
    """Add response to the velocities."""
    for i in range(len(y) // WIDTH):
        for j in range(6):
            k = WIDTH * i + 7 + j
            y[k] = y[k] + system.bodies[i, RESPONSE + j]


def with_object_tables(system: MultiBody) -> MultiBody:
    """The system with its own tables, which may hold symbols."""
    names = ("bodies", "rows", "vectors", "anchors")
    return system._replace(**{name: getattr(system, name).astype(object) for name in names})


def constraint_matrix(
    system: MultiBody, rows: Any, besides: frozenset[int] = frozenset()
) -> Matrix:
    """A = G M^-1 G^T of these rows; entries only for rows that share a body.

    besides: bodies that are omitted, as if they could not move.
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
    """Replace the multipliers by those of minimum norm with the same G^T lambda."""

    rows = range(system.row_table.shape[0])
    matrix = constraint_matrix(system, rows)
    entries = [matrix[i].get(j, 0.0) for i in rows for j in rows]
    system.vectors[MULTIPLIERS] = least_norm(entries, list(system.vectors[MULTIPLIERS]), rank)


# Choice of the redundant rows that get a multiplier, as one external function.
#
# In loops of bodies a choice that suits one position loses digits in another: an omitted row may be
# needed there. So it is repeated after every step. It pivots by value: compiled once and called by
# address, as the minimum-norm multipliers.


TIE = 1e-6
"""Relative excess of a pivot over one of a lower index above which it is taken first: rounding
must not decide between equal pivots."""


def largest_pivots(n, rank, matrix, chosen, left, factors):
    """(least pivot, its row) of `rank` rows, each chosen as the one with the largest pivot.

    Pivots of A = G M^-1 G^T scaled to a unit diagonal, as L L^T with the rows of L in the order
    found (Golub & Van Loan, section 4.2.8). matrix: A by rows. chosen: set to 1 for these rows, 0
    for the others. left (n) and factors (rank n) are workspace.
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
    """Write row k of L for a pivot row, and subtract its squares from the remaining diagonal."""
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
    """A routine as an external function of laws, with a Python equivalent."""

    def plain(*arguments: float) -> tuple[float, ...]:
        found = np.zeros(results)
        owner.function(np.array(arguments, dtype=float), found)
        return tuple(found.tolist())

    return External(name, results, plain, lambda: owner.address, **more)


@cache
def choice_external(n: int) -> External:
    """The external function of n rows: arguments n, rank and A by rows."""
    return external("rb_sim_choice", choice_routine, n + 2)


def chosen_rows(n: int, rank: int, entries: list[Any]) -> tuple[Any, ...]:
    """For each of n rows 1 if it is chosen else 0; then the least pivot and the index of its row.

    entries: A row by row, of this rank.
    """
    return call(choice_external(n), float(n), float(rank), *entries)


def switch_off(matrix: Matrix, chosen: Mapping[int, Any]) -> None:
    """Decouple the rows that are not chosen (0) from all others; they keep their own pivots."""
    for i, row in matrix.items():
        for j, value in row.items():
            if i != j:
                row[j] = value * chosen.get(i, 1.0) * chosen.get(j, 1.0)


# Minimum-norm multipliers of dependent constraints, as one external function for all scenes: P x, P
# = A+ A. This part of a law pivots by value: it is compiled once and called by address.


def times(matrix, x, n, result):
    """A x for a vector x."""
    for i in range(n):
        result[i] = 0.0
        for j in range(n):
            result[i] += matrix[i * n + j] * x[j]


@routine
def least_norm_routine(arguments, results):
    """arguments: n, rank, A (n n), x (n); results: P x (n)."""
    n, rank = int(arguments[0]), int(arguments[1])
    matrix, x, workspace = part(arguments, 2), part(arguments, 2 + n * n), np.empty(n * (n + 5))
    right, work = pointer(workspace), part(pointer(workspace), n)
    times(matrix, x, n, right)
    of_rank(matrix, right, n, rank, results, work)


@routine
def changed_routine(arguments, results):
    """Change of P x for changes of A that keep its rank.

        dP = (1 - P) dA A+ + A+ dA (1 - P)   (Golub & Pereyra 1973)

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
    """The external function of n multipliers: arguments n, rank, A by rows, x, dA by rows and
    dx."""
    return external("rb_sim_least_norm_changed", changed_routine, n)


def changes_of_least_norm(*arguments: Any) -> tuple[Any, ...]:
    """Changes of `least_norm`; arguments: those of it (n and rank first), then their changes."""
    given = len(arguments) // 2
    n, rank, *numbers = arguments[:given]
    return call(changed_external(int(n)), n, rank, *numbers, *arguments[given + 2 :])


@cache
def least_norm_external(n: int) -> External:
    """The external function of n multipliers: arguments n, rank, A by rows and x."""
    return external("rb_sim_least_norm", least_norm_routine, n, along=changes_of_least_norm)


def least_norm(entries: list[Any], x: list[Any], rank: Any) -> tuple[Any, ...]:
    """x of minimum norm with the same A x; entries: A row by row, of this rank."""
    return call(least_norm_external(len(x)), float(len(x)), rank, *entries, *x)
