"""Block elimination L D L^T as a program: one kernel for pivots of one size with like neighbours.

The same rule as in `systems.elimination`: a pivot that is round-off of its diagonal element gets no
multiplier.
"""

from __future__ import annotations

from typing import Any

from rb_sim.engine.tables.block_products import (
    inverse_of,
    packed,
    product,
    reduced,
    reduced_block,
    symmetric,
    times,
)
from rb_sim.engine.tables.graph_of_lines import Plan
from rb_sim.graph.program import Field, Program

TOGETHER = 700
"""Products up to which a pivot and all that it changes are one kernel."""


class Elimination:
    """Room for the blocks of a plan, and what is done with them.

    diagonal, right: packed diagonal blocks and right sides (first the right side, then the
    diagonal as it was); between: block (i, k), size_i by size_k rows, of a later i with k.
    """

    def __init__(self, plan: Plan, program: Program) -> None:
        self.plan, self.program = plan, program
        sizes = self.sizes = [node.size for node in plan.nodes]
        self.diagonal = [program.room(packed(n)) for n in sizes]
        self.inverse = [program.room(packed(n)) for n in sizes]
        self.right = [program.room(2 * n) for n in sizes]
        self.found = [program.room(n) for n in sizes]
        self.between = {
            (i, k): program.room(sizes[i] * sizes[k])
            for k, later in enumerate(plan.later)
            for i in later
        }
        self.factor = {pair: program.room(sizes[pair[0]] * sizes[pair[1]]) for pair in self.between}
        self.rank = program.room(1)

    def clear(self, filled: set[tuple[int, int]]) -> None:
        """Zeros in the blocks that are only filled in."""
        zeros: dict[int, list[int]] = {1: [self.rank]}
        for pair, place in self.between.items():
            if pair not in filled:
                zeros.setdefault(self.sizes[pair[0]] * self.sizes[pair[1]], []).append(place)
        for width, places in zeros.items():
            clear(self.program, width, places)

    def factorise(self) -> None:
        """Pivots in turn; consecutive ones of a kind are one call."""
        self._in_runs(range(len(self.sizes)), self._pivots, self._pivot)

    def forward(self) -> None:
        """A further right side through the factors."""
        self._in_runs(range(len(self.sizes)), self._forward_all, self._forward_one)

    def backward(self) -> None:
        """The unknowns from the right sides."""
        order = range(len(self.sizes) - 1, -1, -1)
        self._in_runs(order, self._backward_all, self._backward_one)

    def _kind(self, k: int) -> tuple[Any, ...]:
        later = tuple(self.sizes[i] for i in self.plan.later[k])
        return self.sizes[k], bool(self.plan.nodes[k].parts), later

    def _together(self, k: int) -> bool:
        return self.sizes[k] * sum(self.sizes[i] for i in self.plan.later[k]) ** 2 <= TOGETHER

    def _in_runs(self, order: range, many: Any, one: Any) -> None:
        """many(nodes) for those in turn that are of one kind, one(node) for a large one."""
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
        """For each of the d neighbours of the nodes in the run: its number."""
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
        """A pivot with many neighbours: a call for itself, for each neighbour and each pair."""
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
    """Zeros in these places of the frame."""
    program.run(("clear", width), lambda t: [[0.0] * width], [], [("frame", places)])


def clear_out(program: Program, first: int, count: int) -> None:
    """Zeros in the output."""
    program.run(("clear", count), lambda t: [[0.0] * count], [], [("out", [first])])
