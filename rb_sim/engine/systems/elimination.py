"""A lambda = b for the sparse A = G M^-1 G^T, written once for numbers and for symbols.

L D L^T without pivoting, in an order that fills little in.  A pivot that is round-off of its
diagonal element belongs to a line that depends on those before it: it gets no multiplier, which
for a consistent right side leaves G^T lambda what it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from rb_sim.graph.functions import divide, rarely
from rb_sim.maths.rank import RANK_TOLERANCE

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


def lines_in_order(parts: Sequence[Iterable[int]], bodies: Sequence[set[int]]) -> list[int]:
    """The lines of the parts (their indices each) in the order of elimination.

    bodies: those on which a part acts; parts that share one are neighbours.
    """
    on: dict[int, set[int]] = {}
    for part, names in enumerate(bodies):
        for body in names:
            on.setdefault(body, set()).add(part)
    near = [set().union(*(on[b] for b in names)) - {i} for i, names in enumerate(bodies)]
    return [line for part in elimination_order(near) for line in parts[part]]


class Factors:
    """L D L^T of a sparse matrix, which is used up; `rank` counts the pivots that are kept.

    smallest: share of its diagonal element up to which a pivot is not kept. sure: unknowns that
    are no lines; their pivots are kept, whatever their sign, and not counted. scales: of lines
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
        """each pivot relative to its diagonal element: round-off where a line depends on others."""
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
        """The shares of the pivots that are kept, which are numbers, by line."""
        return {k: share for k, share in self.shares.items() if share > self.smallest}

    def solve(self, right: Mapping[int, Any]) -> dict[int, Any]:
        """x with A x = b; of `sure`, b may be left out where it is zero."""
        z, x = {**dict.fromkeys(self.sure, 0.0), **right}, {}
        for k in self.order:
            for i, factor in self.rows[k].items():
                z[i] = z[i] - factor * z[k]
        for k in reversed(self.order):
            s = z[k] * self.inverse[k]
            for i, factor in self.rows[k].items():
                s = s - factor * x[i]
            x[k] = s
        return x
