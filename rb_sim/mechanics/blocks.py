# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Block elimination L D L^T of the constraint rows, as a program of kernels.

Pivots of one size with neighbours of the same sizes share one kernel. As in `systems.elimination`,
a pivot that is only rounding of its diagonal element gets no multiplier.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from rb_sim.compiler.graph.table_program import Field, Program
from rb_sim.mechanics.systems.elimination import Factors, elimination_order

# Neighbours of each constraint row, bodies that stay unknowns, and the order of elimination.
#
# Nodes are the constraints between one pair of bodies, up to six rows each, and the hubs: bodies
# that stay unknowns, since they would make all of their many constraints neighbours of each other
# (star of n arms: n^3). The unknowns of a hub are its six accelerations:
#
#     [ A    G_h ] [lambda]   [-bias - G M^-1 f]
#     [G_h^T -M_h] [ a_h  ] = [      -f_h      ],   A = G M^-1 G^T over all other bodies.


MOST_ROWS = 6
"""Most rows of one node."""
HUB = 5
"""Least number of constraints on a body that may stay an unknown."""


class Node(NamedTuple):
    """Unknowns that are eliminated together: constraint rows, or the accelerations of a hub."""

    body: int
    """body of the constraints, or the hub."""
    parent: int
    """parent of the constraints; -1: the world."""
    parts: tuple[int, ...]
    """indices of constraint parts; () for a hub."""
    size: int
    """number of rows; 6 for a hub."""


class Plan(NamedTuple):
    """Elimination plan: the nodes in order, and the later neighbours of each."""

    nodes: tuple[Node, ...]
    later: tuple[tuple[int, ...], ...]
    """indices of the later nodes with which each node is coupled when it is eliminated,
    increasing."""
    hubs: frozenset[int]


def constraint_nodes(
    bodies: Sequence[tuple[int, int]], sizes: Sequence[int], parts: Sequence[int]
) -> list[Node]:
    """Nodes of the constraint parts, those on one pair of bodies together; bodies, sizes: per
    part."""
    on: dict[tuple[int, int], list[int]] = {}
    nodes = []
    for part in parts:
        pair = bodies[part]
        if sum(sizes[k] for k in on.get(pair, ())) + sizes[part] > MOST_ROWS:
            own = tuple(on.pop(pair))
            nodes.append(Node(*pair, own, sum(sizes[k] for k in own)))
        on.setdefault(pair, []).append(part)
    nodes += [Node(*pair, tuple(own), sum(sizes[k] for k in own)) for pair, own in on.items()]
    return nodes


def hubs_of(nodes: Sequence[Node]) -> frozenset[int]:
    """Bodies that may stay unknowns.

    Without the hubs and the world the joints must form trees, each connected to them at one place
    only: then the rows are independent on the other bodies alone, and no pivot is lost that a hub
    would restore.
    """
    degree: dict[int, int] = {}
    for node in nodes:
        for body in {node.body, node.parent} - {-1}:
            degree[body] = degree.get(body, 0) + 1
    hubs = {body for body, count in degree.items() if count >= HUB}
    while True:
        wrong = _touched_twice(nodes, hubs)
        if not wrong:
            return frozenset(hubs)
        hubs -= wrong


def _touched_twice(nodes: Sequence[Node], hubs: set[int]) -> set[int]:
    """Hubs next to a component of the other bodies that is not a tree with one edge outwards."""
    near: dict[int, list[Node]] = {}
    for node in nodes:
        for body in {node.body, node.parent} - {-1} - hubs:
            near.setdefault(body, []).append(node)
    seen: set[int] = set()
    wrong: set[int] = set()
    for first in near:
        if first in seen:
            continue
        component, stack, edges = {first}, [first], set()
        while stack:
            for node in near[stack.pop()]:
                edges.add(node)
                for body in {node.body, node.parent} - {-1} - hubs - component:
                    component.add(body)
                    stack.append(body)
        seen |= component
        if len(edges) > len(component):
            wrong |= {body for node in edges for body in (node.body, node.parent)} & hubs
    return wrong


def planned(constraints: Sequence[Node], hubs: frozenset[int]) -> Plan:
    """Elimination plan of minimum degree; constraints on hubs alone come after all others."""
    nodes = [*constraints, *(Node(h, h, (), 6) for h in sorted(hubs))]
    on: dict[int, set[int]] = {}
    for k, node in enumerate(nodes):
        for body in {node.body, node.parent} - {-1}:
            on.setdefault(body, set()).add(k)
    near: list[set[int]] = [set() for _ in nodes]
    for body, members in on.items():
        hub = {k for k in members if not nodes[k].parts}
        for k in members:
            near[k] |= (hub if body in hubs and nodes[k].parts else members) - {k}
    order = elimination_order(near, [_rank(node, hubs) for node in nodes])
    place = {k: i for i, k in enumerate(order)}
    left = [{place[j] for j in near[k]} for k in order]
    later = []
    for i, ahead in enumerate(left):
        mine = sorted(j for j in ahead if j > i)
        later.append(tuple(mine))
        for j in mine:
            left[j] |= set(mine) - {j}
    return Plan(tuple(nodes[k] for k in order), tuple(later), hubs)


def _rank(node: Node, hubs: frozenset[int]) -> int:
    """Rank of a node in the order: constraints on other bodies, hubs, constraints on hubs alone."""
    if not node.parts:
        return 1
    return 0 if {node.body, node.parent} - {-1} - hubs else 2


# Operations of the elimination on one or two small dense matrices, element by element.
#
# Symmetric matrices are packed by their lower rows.


def packed(n: int) -> int:
    """Number of elements of a packed symmetric matrix."""
    return n * (n + 1) // 2


def at(i: int, j: int) -> int:
    """Index of the element (i, j) in a packed symmetric matrix."""
    return packed(max(i, j)) + min(i, j)


def inverse_of(matrix: tuple[Any, ...], diagonal: tuple[Any, ...], hub: bool) -> tuple[list, Any]:
    """(D^+, rank): L^-T E^-1 L^-1 for D = L E L^T, packed, without rows whose pivots are lost.

    All rows of a hub are kept.
    """
    n = len(diagonal)
    rows = range(n)
    full = {i: {j: matrix[at(i, j)] for j in rows} for i in rows}
    kept = frozenset(rows if hub else ())
    factors = Factors(full, rows, sure=kept, scales=dict(enumerate(diagonal)))
    unit = {(i, i): 1.0 for i in rows}  # elements of L^-1
    for j in rows:
        for i in range(j + 1, n):
            unit[i, j] = -sum(factors.rows[k][i] * unit[k, j] for k in range(j, i))
    result = [
        sum(unit[k, i] * factors.inverse[k] * unit[k, j] for k in range(i, n))
        for i in rows
        for j in range(i + 1)
    ]
    return result, factors.rank


def times(rows: int, columns: int, a: Any, x: Any) -> list[Any]:
    """A x, for the matrix A given by its rows."""
    return [sum(a[i * columns + k] * x[k] for k in range(columns)) for i in range(rows)]


def product(C: Any, P: Any, s: int, n: int) -> list[Any]:
    """C P for a symmetric, packed P."""
    return [sum(C[i * n + k] * P[at(k, j)] for k in range(n)) for i in range(s) for j in range(n)]


def symmetric(P: Any, z: Any, n: int) -> list[Any]:
    """P z for a symmetric, packed P."""
    return [sum(P[at(i, k)] * z[k] for k in range(n)) for i in range(n)]


def reduced(D: Any, W: Any, C: Any, s: int, n: int) -> list[Any]:
    """D - W C^T, packed."""
    return [
        D[at(i, j)] - sum(W[i * n + k] * C[j * n + k] for k in range(n))
        for i in range(s)
        for j in range(i + 1)
    ]


def reduced_block(block: Any, W: Any, C: Any, s: int, r: int, n: int) -> list[Any]:
    """C_ij - W_i C_j^T."""
    return [
        block[i * r + j] - sum(W[i * n + k] * C[j * n + k] for k in range(n))
        for i in range(s)
        for j in range(r)
    ]


# Kernels on blocks of rows; each depends on the sizes only.


def with_multipliers(n: int) -> Any:
    """Kernel of response + M^-1 G^T lambda, for n rows."""

    def kernel(t: Any, response: Any, responses: Any, found: Any) -> list[Any]:
        return [
            [response[j] + sum(responses[6 * k + j] * found[k] for k in range(n)) for j in range(6)]
        ]

    return kernel


def coupled(n: int, m: int, more: bool) -> Any:
    """Kernel of G_i M^-1 G_j^T over one body; with `more` it is added to the existing block."""

    def kernel(t: Any, gradient: Any, responses: Any, *there: Any) -> list[Any]:
        made = []
        for i in range(n):
            for j in range(m):
                s = sum(gradient[6 * i + c] * responses[6 * j + c] for c in range(6))
                made.append(there[0][i * m + j] + s if more else s)
        return [made]

    return kernel


def transposed(n: int) -> Any:
    """Kernel of G^T for n rows, 6 by n."""

    def kernel(t: Any, gradient: Any) -> list[Any]:
        return [[gradient[6 * k + j] for j in range(6) for k in range(n)]]

    return kernel


def unpacked(n: int) -> Any:
    """Kernel that unpacks the rows of a symmetric matrix."""

    def kernel(t: Any, matrix: Any) -> list[Any]:
        place = {(i, j): i * (i + 1) // 2 + j for i in range(n) for j in range(i + 1)}
        return [[matrix[place[max(i, j), min(i, j)]] for j in range(n)] for i in range(n)]

    return kernel


def both_ways(n: int, m: int) -> Any:
    """Kernel of the rows of a matrix (n, m), followed by those of its transpose."""

    def kernel(t: Any, matrix: Any) -> list[Any]:
        rows = [matrix[i * m : (i + 1) * m] for i in range(n)]
        return [*rows, *zip(*rows, strict=True)]

    return kernel


TOGETHER = 700
"""Most products of a pivot and its updates that form one kernel."""


class Elimination:
    """Workspace for the blocks of a plan, and the operations on them.

    diagonal, right: packed diagonal blocks and right sides (each followed by the original
    diagonal); between: block (i, k), size_i by size_k rows, of a later node i with k.
    """

    def __init__(self, plan: Plan, program: Program) -> None:
        self.plan, self.program = plan, program
        sizes = self.sizes = [node.size for node in plan.nodes]
        self.diagonal = [program.workspace(packed(n)) for n in sizes]
        self.inverse = [program.workspace(packed(n)) for n in sizes]
        self.right = [program.workspace(2 * n) for n in sizes]
        self.found = [program.workspace(n) for n in sizes]
        self.between = {
            (i, k): program.workspace(sizes[i] * sizes[k])
            for k, later in enumerate(plan.later)
            for i in later
        }
        self.factor = {
            pair: program.workspace(sizes[pair[0]] * sizes[pair[1]]) for pair in self.between
        }
        self.rank = program.workspace(1)

    def clear(self, filled: set[tuple[int, int]]) -> None:
        """Set to zero the blocks that get only fill-in."""
        zeros: dict[int, list[int]] = {1: [self.rank]}
        for pair, place in self.between.items():
            if pair not in filled:
                zeros.setdefault(self.sizes[pair[0]] * self.sizes[pair[1]], []).append(place)
        for width, places in zeros.items():
            clear(self.program, width, places)

    def factorise(self) -> None:
        """Factorise: pivots in order; consecutive ones of one kind are one call."""
        self._in_runs(range(len(self.sizes)), self._pivots, self._pivot)

    def forward(self) -> None:
        """Forward substitution of a further right side."""
        self._in_runs(range(len(self.sizes)), self._forward_all, self._forward_one)

    def backward(self) -> None:
        """Back substitution: the unknowns from the right sides."""
        order = range(len(self.sizes) - 1, -1, -1)
        self._in_runs(order, self._backward_all, self._backward_one)

    def _kind(self, k: int) -> tuple[Any, ...]:
        later = tuple(self.sizes[i] for i in self.plan.later[k])
        return self.sizes[k], bool(self.plan.nodes[k].parts), later

    def _together(self, k: int) -> bool:
        return self.sizes[k] * sum(self.sizes[i] for i in self.plan.later[k]) ** 2 <= TOGETHER

    def _in_runs(self, order: range, many: Any, one: Any) -> None:
        """Call many(nodes) for consecutive nodes of one kind, one(node) for a large one."""
        run: list[int] = []
        for k in order:
            if run and (not self._together(k) or self._kind(k) != self._kind(run[0])):
                many(run)
                run = []
            if self._together(k):
                run.append(k)
            else:
                one(k)
        if run:
            many(run)

    def _field(self, places: Any, width: int, keys: Any) -> Field:
        return Field("frame", width, [places[key] for key in keys])

    def _columns(self, run: list[int], d: int) -> list[list[int]]:
        """For each of the d neighbours of the nodes in the run: the indices of these neighbours."""
        return [[self.plan.later[k][a] for k in run] for a in range(d)]

    def _pivots(self, run: list[int]) -> None:
        n, joint, later = self._kind(run[0])
        d = len(later)
        near = self._columns(run, d)
        pairs = [(a, b) for a in range(d) for b in range(a)]
        fields = [
            self._field(self.diagonal, packed(n), run),
            self._field(self.right, 2 * n, run),
            Field("frame", 1, [self.rank] * len(run)),
        ]
        blocks, changed = [], []
        columns = [list(zip(near[a], run, strict=True)) for a in range(d)]
        for a, own in enumerate(columns):
            blocks.append(self._field(self.between, later[a] * n, own))
            changed.append(self._field(self.diagonal, packed(later[a]), near[a]))
            changed.append(self._field(self.right, later[a], near[a]))
        for a, b in pairs:
            both = list(zip(near[a], near[b], strict=True))
            changed.append(self._field(self.between, later[a] * later[b], both))
        factors = [("frame", [self.factor[pair] for pair in own]) for own in columns]
        outputs = [
            ("frame", [self.inverse[k] for k in run]),
            ("frame", fields[2].at),
            *factors,
            *(("frame", field.at) for field in changed),
        ]

        def pivot(t: Any, D: Any, z: Any, rank: Any, *given: Any) -> Any:
            P, more = inverse_of(D, z[n:], not joint)
            W = [product(C, P, s, n) for C, s in zip(given[:d], later, strict=True)]
            kept = list(given[d:])
            made = []
            for a, s in enumerate(later):
                made.append(reduced(kept[2 * a], W[a], given[a], s, n))
                moved = times(s, n, W[a], z)
                made.append([x - m for x, m in zip(kept[2 * a + 1], moved, strict=True)])
            for block, (a, b) in zip(kept[2 * d :], pairs, strict=True):
                made.append(reduced_block(block, W[a], given[b], later[a], later[b], n))
            return [P, [rank[0] + more], *W, *made]

        self.program.run(("pivot", n, joint, later), pivot, [*fields, *blocks, *changed], outputs)

    def _pivot(self, k: int) -> None:
        """Eliminate a pivot with many neighbours: one call for the pivot, each neighbour and each
        pair."""
        n, joint, later = self._kind(k)
        run = self.program.run

        def first(t: Any, D: Any, z: Any, rank: Any) -> Any:
            P, more = inverse_of(D, z[n:], not joint)
            return [P, [rank[0] + more]]

        fields = [
            self._field(self.diagonal, packed(n), [k]),
            self._field(self.right, 2 * n, [k]),
            Field("frame", 1, [self.rank]),
        ]
        outputs = [("frame", [self.inverse[k]]), ("frame", [self.rank])]
        run(("pivot alone", n, joint), first, fields, outputs)
        of_size: dict[int, list[int]] = {}
        for i in self.plan.later[k]:
            of_size.setdefault(self.sizes[i], []).append(i)
        for s, members in of_size.items():
            self._pivot_on_neighbours(k, n, s, members)
        for s, members in of_size.items():
            for r, others in of_size.items():
                pairs = [(i, j) for i in members for j in others if j < i]
                self._pivot_on_pairs(k, n, s, r, pairs)

    def _pivot_on_neighbours(self, k: int, n: int, s: int, members: list[int]) -> None:
        own = [(i, k) for i in members]
        fields = [
            self._field(self.inverse, packed(n), [k] * len(members)),
            self._field(self.right, n, [k] * len(members)),
            self._field(self.between, s * n, own),
            self._field(self.diagonal, packed(s), members),
            self._field(self.right, s, members),
        ]

        def second(t: Any, P: Any, z: Any, C: Any, D: Any, right: Any) -> Any:
            W = product(C, P, s, n)
            moved = times(s, n, W, z)
            left = [x - m for x, m in zip(right, moved, strict=True)]
            return [W, reduced(D, W, C, s, n), left]

        outputs = [
            ("frame", [self.factor[pair] for pair in own]),
            ("frame", fields[3].at),
            ("frame", fields[4].at),
        ]
        self.program.run(("pivot's neighbours", n, s), second, fields, outputs)

    def _pivot_on_pairs(self, k: int, n: int, s: int, r: int, pairs: list) -> None:
        if not pairs:
            return
        fields = [
            self._field(self.factor, s * n, [(i, k) for i, _ in pairs]),
            self._field(self.between, r * n, [(j, k) for _, j in pairs]),
            self._field(self.between, s * r, pairs),
        ]

        def third(t: Any, W: Any, C: Any, block: Any) -> Any:
            return [reduced_block(block, W, C, s, r, n)]

        self.program.run(("pivot's pairs", n, s, r), third, fields, [("frame", fields[2].at)])

    def _forward_all(self, run: list[int]) -> None:
        n, _, later = self._kind(run[0])
        d = len(later)
        if not d:
            return
        near = self._columns(run, d)
        fields = [self._field(self.right, n, run)]
        for a in range(d):
            own = list(zip(near[a], run, strict=True))
            fields.append(self._field(self.factor, later[a] * n, own))
        fields += [self._field(self.right, later[a], near[a]) for a in range(d)]

        def through(t: Any, z: Any, *given: Any) -> Any:
            return [
                [x - m for x, m in zip(right, times(s, n, W, z), strict=True)]
                for W, right, s in zip(given[:d], given[d:], later, strict=True)
            ]

        outputs = [("frame", field.at) for field in fields[1 + d :]]
        self.program.run(("forward", n, later), through, fields, outputs)

    def _forward_one(self, k: int) -> None:
        n = self.sizes[k]
        for i in self.plan.later[k]:
            s = self.sizes[i]
            fields = [
                self._field(self.right, n, [k]),
                self._field(self.factor, s * n, [(i, k)]),
                self._field(self.right, s, [i]),
            ]

            def through(t: Any, z: Any, W: Any, right: Any, s: int = s) -> Any:
                return [[x - m for x, m in zip(right, times(s, n, W, z), strict=True)]]

            self.program.run(("forward", n, (s,)), through, fields, [("frame", fields[2].at)])

    def _backward_all(self, run: list[int]) -> None:
        n, _, later = self._kind(run[0])
        d = len(later)
        near = self._columns(run, d)
        fields = [self._field(self.inverse, packed(n), run), self._field(self.right, n, run)]
        for a in range(d):
            own = list(zip(near[a], run, strict=True))
            fields.append(self._field(self.factor, later[a] * n, own))
        fields += [self._field(self.found, later[a], near[a]) for a in range(d)]

        def back(t: Any, P: Any, z: Any, *given: Any) -> Any:
            x = symmetric(P, z, n)
            for W, known, s in zip(given[:d], given[d:], later, strict=True):
                x = [x[j] - sum(W[i * n + j] * known[i] for i in range(s)) for j in range(n)]
            return [x]

        outputs = [("frame", [self.found[k] for k in run])]
        self.program.run(("backward", n, later), back, fields, outputs)

    def _backward_one(self, k: int) -> None:
        n = self.sizes[k]
        fields = [self._field(self.inverse, packed(n), [k]), self._field(self.right, n, [k])]
        own = ("frame", [self.found[k]])

        def alone(t: Any, P: Any, z: Any) -> Any:
            return [symmetric(P, z, n)]

        self.program.run(("backward", n, ()), alone, fields, [own])
        of_size: dict[int, list[int]] = {}
        for i in self.plan.later[k]:
            of_size.setdefault(self.sizes[i], []).append(i)
        for s, members in of_size.items():
            fields = [
                self._field(self.found, n, [k] * len(members)),
                self._field(self.factor, s * n, [(i, k) for i in members]),
                self._field(self.found, s, members),
            ]

            def less(t: Any, x: Any, W: Any, known: Any, s: int = s) -> Any:
                return [[x[j] - sum(W[i * n + j] * known[i] for i in range(s)) for j in range(n)]]

            self.program.run(("less", n, s), less, fields, [("frame", fields[0].at)])


def clear(program: Program, width: int, places: list[int]) -> None:
    """Set to zero fields of the frame at these places."""
    program.run(("clear", width), lambda t: [[0.0] * width], [], [("frame", places)])


def clear_out(program: Program, place: int) -> None:
    """Set to zero the output at this place."""
    program.run(("clear", 1), lambda t: [[0.0]], [], [("out", [place])])
