# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The constraint rows of a program: evaluation, solution for their multipliers, application."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import Any, NamedTuple

import numpy as np

from rb_sim.catalogue.constraints.rows import COUNT
from rb_sim.catalogue.curves import Pieces
from rb_sim.catalogue.spec import Placed
from rb_sim.compiler.graph.symbols import Symbol
from rb_sim.compiler.graph.table_program import Field, Program
from rb_sim.mechanics import blocks, local
from rb_sim.mechanics.blocks import Elimination, Node, Plan, clear, packed
from rb_sim.mechanics.systems.elimination import least_norm_external
from rb_sim.mechanics.systems.many_bodies import WIDTH

# Instances of one kind: which of their numbers are constants of the kernel. 0, 1 and -1 are
# constants of the kernel, so that it does not compute with zeros; other numbers are constants of
# each instance in a table, and those that change between steps are inputs of the law.


PATTERNS = 6
"""Most patterns of zeros and ones of a kind that get separate kernels; with more, all share one."""


class UntabledError(Exception):
    """Raised for a law that cannot be evaluated over tables."""


def shape_of(x: Any) -> Hashable:
    """Structure of nested tuples without their numbers."""
    if isinstance(x, float | Symbol):
        return float
    if isinstance(x, tuple):
        return type(x), tuple(map(shape_of, x))
    if isinstance(x, np.ndarray | Pieces):  # a kernel in a loop calls no functions by address
        raise UntabledError
    return x


def leaves_of(x: Any) -> list[Any]:
    """The numbers of nested tuples: floats, or symbols of inputs."""
    if isinstance(x, tuple):
        return [leaf for entry in x for leaf in leaves_of(entry)]
    if isinstance(x, Symbol) and x.op != "p":
        raise UntabledError
    return [x] if isinstance(x, float | Symbol) else []


def joined(shape: Any, leaves: Any) -> Any:
    """The nested tuples of this structure with numbers from the iterator."""
    if shape is float:
        return next(leaves)
    if isinstance(shape, tuple):
        kind, entries = shape
        made = [joined(entry, leaves) for entry in entries]
        return kind._make(made) if hasattr(kind, "_make") else tuple(made)
    return shape


class Instance(NamedTuple):
    """One object to which a kernel is applied."""

    thing: Any
    """nested tuples, without numpy arrays."""
    inputs: tuple[tuple[str, int, int], ...]
    """(base, place, width) of each input field."""
    outputs: tuple[tuple[str, int], ...]
    """(base, place) of each output field."""


def run(
    program: Program,
    name: Hashable,
    function: Callable[..., Any],
    instances: Sequence[Instance],
) -> None:
    """Apply f(thing, t, *inputs) to every instance, with one kernel per kind.

    name: identifies the function.
    """
    kinds: dict[tuple[Hashable, ...], dict[tuple, list[tuple[Instance, list[Any]]]]] = {}
    for instance in instances:
        leaves = leaves_of(instance.thing)
        taken = tuple((base, width) for base, _, width in instance.inputs)
        kind = shape_of(instance.thing), taken, tuple(base for base, _ in instance.outputs)
        # 0, 1 and -1 as they are, None for other numbers, "p" for inputs
        marks = tuple(
            "p" if isinstance(x, Symbol) else x if x in (0.0, 1.0, -1.0) else None for x in leaves
        )
        kinds.setdefault(kind, {}).setdefault(marks, []).append((instance, leaves))
    for (shape, *_), patterns in kinds.items():
        if len(patterns) > PATTERNS:
            marks = tuple("p" if "p" in each else None for each in zip(*patterns, strict=True))
            patterns = {marks: [entry for entries in patterns.values() for entry in entries]}
        for marks, entries in patterns.items():
            _run_kind(program, (name, shape, marks), function, entries)


def _run_kind(
    program: Program,
    key: tuple[Hashable, Any, tuple[Any, ...]],
    function: Callable[..., Any],
    entries: Sequence[tuple[Instance, list[Any]]],
) -> None:
    """Apply one kernel to a table of instances with zeros and ones at the same places."""
    name, shape, marks = key
    free = [k for k, mark in enumerate(marks) if mark is None]
    varied = [k for k, mark in enumerate(marks) if mark == "p"]
    inputs = []
    for k, (base, _, width) in enumerate(entries[0][0].inputs):
        inputs.append(Field(base, width, [instance.inputs[k][1] for instance, _ in entries]))
    own = len(inputs)
    if free:
        places = [program.keep([leaves[k] for k in free]) for _, leaves in entries]
        inputs.append(Field("const", len(free), places))
    for k in varied:
        inputs.append(Field("p", 1, [leaves[k].operands[0] for _, leaves in entries]))
    outputs = [
        (base, [instance.outputs[k][1] for instance, _ in entries])
        for k, (base, _) in enumerate(entries[0][0].outputs)
    ]

    def on_fields(t: Any, *fields: tuple[Any, ...]) -> Any:
        leaves = list(marks)
        given = iter(fields[own:])
        if free:
            for k, value in zip(free, next(given), strict=True):
                leaves[k] = value
        for k in varied:
            (leaves[k],) = next(given)
        return function(joined(shape, iter(leaves)), t, *fields[:own])

    program.run((name, shape, marks), on_fields, inputs, outputs)


Place = tuple[str, int, int]
"""(base, place, width) of a field."""


class ConstraintRows:
    """The constraint rows of the nodes of a plan, in one program.

    constraints: rows with the inputs of the law as symbols; bodies: constants of each body; barred:
    for each part BARRED for a row without a multiplier, else 0; () if there are none.
    """

    def __init__(
        self,
        program: Program,
        plan: Plan,
        constraints: Sequence[Placed],
        bodies: Sequence[tuple[float, ...]],
        barred: Sequence[tuple[float, ...]] = (),
    ) -> None:
        self.program, self.plan, self.bodies = program, plan, bodies
        self.constraints, self.barred = constraints, barred
        self.blocks = Elimination(plan, program)
        self.response = program.workspace(6 * len(bodies))
        self.load = -1
        """place of the loads on the bodies; -1 without loads."""
        self.gradient: dict[tuple[int, int], int] = {}
        self.responses: dict[tuple[int, int], int] = {}
        self.rates: dict[int, int] = {}
        for k, node in enumerate(plan.nodes):
            for body in self._on(node):
                self.gradient[k, body] = program.workspace(6 * node.size)
                if body not in plan.hubs:
                    self.responses[k, body] = program.workspace(6 * node.size)

    def _on(self, node: Node) -> list[int]:
        """Bodies on which a constraint node acts."""
        return [b for b in (node.body, node.parent) if b >= 0] if node.parts else []

    def _joints(self) -> list[tuple[int, Node]]:
        return [(k, node) for k, node in enumerate(self.plan.nodes) if node.parts]

    def _thing(self, node: Node) -> tuple[Any, ...]:
        parent = None if node.parent < 0 else self.bodies[node.parent]
        rows = tuple(self.constraints[part].row for part in node.parts)
        hubs = tuple(b in self.plan.hubs for b in self._on(node))
        barred = tuple(x for part in node.parts for x in self.barred[part]) if self.barred else ()
        return self.bodies[node.body], parent, rows, hubs, barred if any(barred) else ()

    def _states(self, node: Node, base: str, first: int) -> list[Place]:
        return [(base, first + WIDTH * b, WIDTH) for b in self._on(node)]

    def gap(self, base: str, first: int, worst: Place, length: float) -> None:
        """Write the worst position error at y (base, first), with angles at the end of an arm
        `length` [m]."""
        arm = ("const", self.program.keep((length,)), 1)
        instances = [
            Instance(
                self._thing(node), (*self._states(node, base, first), worst, arm), (worst[:2],)
            )
            for _, node in self._joints()
        ]
        run(self.program, "gap", local.worst_gap, instances)

    def write(self, base: str, first: int, kind: str, extra: dict[str, Any] | None = None) -> None:
        """Write blocks and right sides at y (base, first); kind: name of a function of `local`."""
        instances, extra, function = [], extra or {}, getattr(local, kind)
        if "scales" in extra:
            function, kind = local.sampled, "sampled"
            scales = ("const", self.program.keep(extra["scales"]), 2)
        for k, node in self._joints():
            inputs: list[Place] = self._states(node, base, first)
            if kind in ("accelerated", "sampled"):
                own = [b for b in self._on(node) if b not in self.plan.hubs]
                inputs += [("frame", self.response + 6 * b, 6) for b in own]
            outputs = self._outputs(k, node)
            if kind == "sampled":
                self.rates[k] = self.program.workspace(node.size)
                inputs += [extra["worst"], scales]
                outputs += [("frame", self.rates[k]), extra["worst"][:2]]
            elif "worst" in extra:
                arm = ("const", self.program.keep((extra["length"],)), 1)
                inputs += [extra["worst"], arm]
                outputs.append(extra["worst"][:2])
            instances.append(Instance(self._thing(node), tuple(inputs), tuple(outputs)))
        if "worst" in extra and extra["worst"][0] == "out":
            base_of, place, _ = extra["worst"]
            zeros = 10 if kind == "sampled" else 1
            self.program.run(
                ("clear", zeros),
                lambda t: [[0.0] * zeros],
                [],
                [(base_of, [place + 1 - zeros])],
            )
        run(self.program, kind, function, instances)
        self._write_hubs()
        self._couple()

    def _outputs(self, k: int, node: Node) -> list[tuple[str, int]]:
        blocks = self.blocks
        places = [blocks.diagonal[k], blocks.right[k]]
        places += [self.gradient[k, b] for b in self._on(node)]
        places += [self.responses[k, b] for b in self._on(node) if b not in self.plan.hubs]
        return [("frame", place) for place in places]

    def _write_hubs(self) -> None:
        loaded, unloaded = [], []
        for k, node in enumerate(self.plan.nodes):
            if node.parts:
                continue
            b = node.body
            outputs = (("frame", self.blocks.diagonal[k]), ("frame", self.blocks.right[k]))
            if self.load < 0:
                unloaded.append(Instance(self.bodies[b], (), outputs))
                continue
            fields = (("y", WIDTH * b, WIDTH), ("frame", self.load + 6 * b, 6))
            loaded.append(Instance(self.bodies[b], fields, outputs))
        run(self.program, "hub", local.of_hub, loaded)
        run(self.program, "unloaded hub", local.unloaded_hub, unloaded)

    def _couple(self) -> None:
        """Write the blocks between nodes that share a body."""
        blocks, plan = self.blocks, self.plan
        on: dict[int, list[int]] = {}
        for k, node in self._joints():
            for b in self._on(node):
                on.setdefault(b, []).append(k)
        filled: set[tuple[int, int]] = set()
        shares: list[list[tuple[int, int, int]]] = [[], []]
        hubs: list[tuple[int, int, int]] = []
        number = {node.body: k for k, node in enumerate(plan.nodes) if not node.parts}
        for b, members in on.items():
            if b in plan.hubs:
                hubs += [(number[b], k, b) for k in members]
                filled |= {(max(number[b], k), min(number[b], k)) for k in members}
                continue
            for a, j in enumerate(members):
                for i in members[a + 1 :]:
                    pair = (max(i, j), min(i, j))
                    shares[pair in filled].append((*pair, b))
                    filled.add(pair)
        blocks.clear(filled)
        for more, entries in enumerate(shares):
            sizes: dict[tuple[int, int], list[tuple[int, int, int]]] = {}
            for i, j, b in entries:
                sizes.setdefault((blocks.sizes[i], blocks.sizes[j]), []).append((i, j, b))
            for (n, m), some in sizes.items():
                self._couple_alike(n, m, bool(more), some)
        for hub, k, b in hubs:
            self._couple_hub(hub, k, b)

    def _couple_alike(
        self, n: int, m: int, more: bool, entries: Sequence[tuple[int, int, int]]
    ) -> None:
        places = [self.blocks.between[i, j] for i, j, _ in entries]
        fields = [
            Field("frame", 6 * n, [self.gradient[i, b] for i, _, b in entries]),
            Field("frame", 6 * m, [self.responses[j, b] for _, j, b in entries]),
        ]
        if more:
            fields.append(Field("frame", n * m, places))
        kernel = blocks.coupled(n, m, more)
        self.program.run(("coupled", n, m, more), kernel, fields, [("frame", places)])

    def _couple_hub(self, hub: int, k: int, body: int) -> None:
        """Copy G_h^T (if the hub is eliminated later) or G_h into its block."""
        n = self.blocks.sizes[k]
        fields = [Field("frame", 6 * n, [self.gradient[k, body]])]
        if hub > k:
            to = [("frame", [self.blocks.between[hub, k]])]
            self.program.run(("transposed", n), blocks.transposed(n), fields, to)
        else:
            to = [("frame", [self.blocks.between[k, hub]])]
            self.program.run(("same", 6 * n), lambda t, x: [x], fields, to)

    def solve(self) -> None:
        """Find the multipliers, and accelerations of hubs, for the right sides as written."""
        self.blocks.factorise()
        self.blocks.backward()

    def right_again(self, base: str, first: int) -> None:
        """Write right sides b - G u at y (base, first) for the existing blocks."""
        instances = [
            Instance(
                self._thing(node),
                tuple(self._states(node, base, first)),
                (("frame", self.blocks.right[k]),),
            )
            for k, node in self._joints()
        ]
        run(self.program, "slips", local.slips, instances)
        hubs = [self.blocks.right[k] for k, node in enumerate(self.plan.nodes) if not node.parts]
        if hubs:
            clear(self.program, 6, hubs)

    def solve_again(self) -> None:
        """As solve, with the existing factors."""
        self.blocks.forward()
        self.blocks.backward()

    def add_multipliers(self) -> None:
        """response += M^-1 G^T lambda; response of a hub is its found acceleration."""
        sizes: dict[int, list[tuple[int, int]]] = {}
        for k, b in self.responses:
            sizes.setdefault(self.blocks.sizes[k], []).append((k, b))
        for n, entries in sizes.items():
            places = [self.response + 6 * b for _, b in entries]
            fields = [
                Field("frame", 6, places),
                Field("frame", 6 * n, [self.responses[entry] for entry in entries]),
                Field("frame", n, [self.blocks.found[k] for k, _ in entries]),
            ]
            self.program.run(
                ("with multipliers", n), blocks.with_multipliers(n), fields, [("frame", places)]
            )
        hubs = [(k, node.body) for k, node in enumerate(self.plan.nodes) if not node.parts]
        if hubs:
            found = [Field("frame", 6, [self.blocks.found[k] for k, _ in hubs])]
            to = [("frame", [self.response + 6 * b for _, b in hubs])]
            self.program.run(("same", 6), lambda t, x: [x], found, to)

    def of_part(self, part: int) -> list[Place]:
        """Fields of a part: its rows on the body, and its multipliers."""
        for k, node in self._joints():
            if part in node.parts:
                before = node.parts[: node.parts.index(part)]
                first = sum(self._count(other) for other in before)
                n = self._count(part)
                gradient = self.gradient[k, node.body] + 6 * first
                return [("frame", gradient, 6 * n), ("frame", self.blocks.found[k] + first, n)]
        raise KeyError(part)

    def _count(self, part: int) -> int:
        return COUNT[type(self.constraints[part].row)]

    def power(self, so_far: tuple[str, int]) -> None:
        """Add the power of the multipliers on rows that prescribe a velocity."""
        for n in sorted({node.size for _, node in self._joints()}):
            nodes = [k for k, node in self._joints() if node.size == n]
            fields = [
                Field("frame", n, [self.blocks.found[k] for k in nodes]),
                Field("frame", n, [self.rates[k] for k in nodes]),
                Field(so_far[0], 1, [so_far[1]] * len(nodes)),
            ]
            to = [(so_far[0], [so_far[1]] * len(nodes))]
            self.program.run(("power", n), local.power, fields, to)

    def dense(self) -> int:
        """Workspace with the arguments of least_norm, the matrix as it is before elimination; its
        place."""
        sizes = self.blocks.sizes
        n = sum(sizes)
        first = [sum(sizes[:k]) for k in range(len(sizes))]
        start = self.program.workspace(2 + n * n + n)
        matrix = start + 2
        clear(self.program, n, [matrix + n * i for i in range(n)])
        to = [("frame", [start])]
        self.program.run(("count of lines", n), lambda t: [[float(n)]], [], to)
        for k, size in enumerate(sizes):
            fields = [Field("frame", packed(size), [self.blocks.diagonal[k]])]
            rows = [("frame", [matrix + n * (first[k] + i) + first[k]]) for i in range(size)]
            self.program.run(("unpacked", size), blocks.unpacked(size), fields, rows)
        for (i, k), place in self.blocks.between.items():
            s, r = sizes[i], sizes[k]
            fields = [Field("frame", s * r, [place])]
            rows = [("frame", [matrix + n * (first[i] + a) + first[k]]) for a in range(s)]
            rows += [("frame", [matrix + n * (first[k] + b) + first[i]]) for b in range(r)]
            self.program.run(("both ways", s, r), blocks.both_ways(s, r), fields, rows)
        return start

    def least_norm(self, start: int) -> None:
        """Replace the multipliers by those of minimum norm with the same G^T lambda."""
        sizes = self.blocks.sizes
        n = sum(sizes)
        self._copy(1, [self.blocks.rank], [start + 1])
        at_x, results = start + 2 + n * n, self.program.workspace(n)
        for k, size in enumerate(sizes):
            self._copy(size, [self.blocks.found[k]], [at_x + sum(sizes[:k])])
        self.program.call(least_norm_external(n), start, results)
        for k, size in enumerate(sizes):
            self._copy(size, [results + sum(sizes[:k])], [self.blocks.found[k]])

    def _copy(self, width: int, of: list[int], to: list[int]) -> None:
        fields = [Field("frame", width, of)]
        self.program.run(("same", width), lambda t, x: [x], fields, [("frame", to)])
