# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""LLVM IR of Taylor series: convolution sums, recurrences by order, unrolled first orders."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from rb_sim.compiler.graph.emit import RARELY, Piece, Pieces, constant
from rb_sim.compiler.graph.machine import Law, PlainLaw, interpreted, linked, named_law
from rb_sim.compiler.graph.symbols import INPUTS, Symbol, operations
from rb_sim.compiler.graph.taylor_series import LANES, Series

# Writers of LLVM IR of a series: vectors of sums, and laws inlined into the same function.


HEAD = 4
"""Numbers before the sums in the workspace of a series; the first one is the highest order."""

GROUP = 8
"""Vectors that go through the orders together, each in a register."""

ROWS = 4
"""Orders per iteration of a sum: the end of the loop is usually mispredicted."""

BEFORE = ROWS - 1
"""Rows of zeros before order 1, so that sums may start and end beyond their terms."""

CHAINS = 8
"""Number of independent additions in progress."""

NO_CUT = 10**9
"""Operations of a piece: never reached, as the law is not cut."""


CONTRACTED = re.compile(r"^(fadd|fsub|fmul) double")
"""Instructions that may be fused with a preceding product (rounded once): terms of a series differ
from Python's in the last bits anyway, since their sums are in another order."""


class Inlined(Piece):
    """A law inlined into the driver's function.

    zeros: names of the numbers of order 0; None for the law that computes them. coefficients: names
    of the coefficients of order k of y; None if they are in the row.
    """

    def __init__(self, pieces: Pieces, driver: Writer) -> None:
        super().__init__(pieces, 0)
        self.driver, self.lines = driver, driver.lines
        self.k, self.row = "%t", "%row"
        self.zeros: list[str] | None = None
        self.coefficients: list[str] | None = None

    def line(self, text: str) -> str:
        """Write one instruction through the driver, with contraction allowed."""
        return self.driver.line(CONTRACTED.sub(r"\1 contract double", text))

    def values(self) -> list[str]:
        """Write all operations; returns the names of the outputs."""
        for x in self.pieces.parts[0]:
            self.names[x.number] = self.operation(x)
        return [self.value(x) for x in self.pieces.outputs]

    def from_outside(self, x: Symbol) -> str:
        """Name of an input: a coefficient of the series instead of a number of the state."""
        if self.zeros is None or x.op not in INPUTS:
            return super().from_outside(x)
        if x.op == "t":
            return self.k
        index = x.operands[0]
        if x.op == "y":
            return self.coefficients[index] if self.coefficients else self.load(self.row, index)
        sums = self.driver.series.sums
        if index < sums:
            return self.driver.sum_of(index)
        return self.zeros[index - sums]


class Writer:
    """Writer of LLVM IR of a series."""

    def __init__(self, series: Series) -> None:
        self.series = series
        self.lines: list[str] = []
        self.count = 0
        self.sums: dict[int, list[str]] = {}
        self.zeros: list[str] = []
        """names of the numbers of order 0."""
        self.declared: set[str] = set()

    def sum_of(self, index: int) -> str:
        """Name of one of the sums."""
        first = max(at for at in self.sums if at <= index)
        vector = self.sums[first][(index - first) // LANES]
        return self.line(f"extractelement {self.vector(LANES)} {vector}, i32 {index % LANES}")

    def line(self, text: str) -> str:
        """Write one instruction; returns the name of its result."""
        self.count += 1
        self.lines.append(f"  %v{self.count} = {text}")
        return f"%v{self.count}"

    def place(self, base: str, index: int | str) -> str:
        """Name of the address of the number at an index."""
        return self.line(f"getelementptr double, ptr {base}, i64 {index}")

    def vector(self, width: int) -> str:
        """LLVM type of a vector of `width` numbers."""
        return f"<{width} x double>"

    def load(self, base: str, index: int, width: int) -> str:
        """Load a vector of `width` numbers from an index on."""
        kind = self.vector(width)
        return self.line(f"load {kind}, ptr {self.place(base, index)}, align 8")

    def store(self, value: str, base: str, index: int, width: int) -> None:
        """Store a vector from an index on."""
        kind = self.vector(width)
        at = self.place(base, index)
        self.lines.append(f"  store {kind} {value}, ptr {at}, align 8")

    def row_of(self, rows: str, order: int) -> str:
        """Address of the coefficients of an order."""
        return self.place(rows, (order - 1) * self.series.width)

    def splat(self, value: str, width: int) -> str:
        """Name of a vector with one number in all lanes."""
        kind = self.vector(width)
        one = self.line(f"insertelement {kind} undef, double {value}, i32 0")
        mask = f"<{width} x i32> zeroinitializer"
        return self.line(f"shufflevector {kind} {one}, {kind} undef, {mask}")

    def label(self, name: str) -> None:
        """Start a basic block."""
        self.lines.append(f"{name}:")

    def jump(self, name: str) -> None:
        """End the block with a jump."""
        self.lines.append(f"  br label %{name}")

    def branch(self, condition: str, yes: str, no: str) -> None:
        """End the block with a conditional jump."""
        self.lines.append(f"  br i1 {condition}, label %{yes}, label %{no}")

    def keep(
        self, order: Inlined, values: list[str], row: str, right: str, name: str, suffix: str = ""
    ) -> list[str]:
        """Store the results of the law of one order; returns the names of the factors as
        vectors."""
        series, names = self.series, []
        at = series.n
        for i in range(series.events):
            order.store(values[i], row, at + i)
        at += series.events
        for i in range(0, 2 * series.sums, LANES):
            names.append(f"{name}{i // LANES}{suffix}")
            vector = self.together(values[series.events + i :][:LANES])
            self.lines.append(f"  {names[-1]} = freeze {self.vector(LANES)} {vector}")
            self.store(names[-1], row if i < series.sums else right, at + i, LANES)
        for i, value in enumerate(values[-series.n :]):
            order.store(value, row, series.width + i)
        return names

    def together(self, values: Sequence[str]) -> str:
        """Name of a vector of these numbers."""
        kind, made = self.vector(len(values)), "undef"
        for i, value in enumerate(values):
            made = self.line(f"insertelement {kind} {made}, double {value}, i32 {i}")
        return made

    def added(self, vectors: list[str]) -> str:
        """Name of the sum of vectors, added pairwise."""
        while len(vectors) > 1:
            pairs = zip(vectors[::2], vectors[1::2], strict=False)
            odd = vectors[len(vectors) // 2 * 2 :]
            vectors = [self.line(f"fadd {self.vector(LANES)} {a}, {b}") for a, b in pairs] + odd
        return vectors[0]


# LLVM IR of the sum of a series and its derivative.


class Sum(Writer):
    """Writer of the law that sums a series."""

    def sum(self) -> str:
        """LLVM IR of `add`: Horner's rule for the series and its derivative."""
        n, width = self.series.n, self.series.width
        head = "define void @law(double %h, ptr %rows, ptr %order, ptr %out) nounwind {"
        self.label("entry")
        highest = self.line("load double, ptr %order, align 8")
        last = self.line(f"fptosi double {highest} to i64")
        offset = self.line(f"mul i64 {self.line(f'sub i64 {last}, 1')}, {width}")
        top = self.place("%rows", offset)
        before = "entry"
        for first in range(0, n, LANES * GROUP // 2):
            before = self._horner(first, min(LANES * GROUP // 2, n - first), top, last, before)
        return "\n".join([head, *self.lines, "  ret void", "}", ""])

    def _horner(self, first: int, count: int, top: str, last: str, before: str) -> str:
        """Write Horner's rule for `count` coordinates from `first` on; returns the label of the
        block after it."""
        name = f"h{first}"
        parts = [(i, min(LANES, count - i)) for i in range(0, count, LANES)]
        zero, one = constant(0.0), constant(1.0)
        starts = self.line("fadd double %h, " + zero)
        powers = self.line(f"sitofp i64 {last} to double")
        self.jump(name)
        self.label(name)
        phis = [
            ("i64", "k", last, f"%{name}_k1"),
            ("double", "f", powers, f"%{name}_f1"),
            ("ptr", "r", top, f"%{name}_r1"),
        ]
        for i, w in parts:
            phis += [
                (self.vector(w), f"c{i}", "zeroinitializer", f"%{name}_c{i}_1"),
                (self.vector(w), f"d{i}", "zeroinitializer", f"%{name}_d{i}_1"),
            ]
        for kind, what, begin, again in phis:
            self.lines.append(
                f"  %{name}_{what} = phi {kind} [ {begin}, %{before} ], [ {again}, %{name} ]"
            )
        for i, w in parts:
            kind = self.vector(w)
            h, k = self.splat(starts, w), self.splat(f"%{name}_f", w)
            row = self.load(f"%{name}_r", first + i, w)
            for what, term in (("c", row), ("d", self.line(f"fmul contract {kind} {row}, {k}"))):
                moved = self.line(f"fmul contract {kind} %{name}_{what}{i}, {h}")
                self.lines.append(f"  %{name}_{what}{i}_1 = fadd contract {kind} {term}, {moved}")
        self.lines += [
            f"  %{name}_k1 = sub i64 %{name}_k, 1",
            f"  %{name}_f1 = fsub double %{name}_f, {one}",
            f"  %{name}_r1 = getelementptr double, ptr %{name}_r, i64 -{self.series.width}",
        ]
        end = f"{name}_end"
        self.branch(self.line(f"icmp sgt i64 %{name}_k1, 0"), name, end)
        self.label(end)
        for i, w in parts:
            kind = self.vector(w)
            change = self.line(f"fmul {kind} %{name}_c{i}_1, {self.splat(starts, w)}")
            self.store(change, "%out", first + i, w)
            self.store(f"%{name}_d{i}_1", "%out", self.series.n + first + i, w)
        return end


# The first orders of a series unrolled, each with its own sums: no loop end to mispredict.


MOST = 28
"""Most unrolled orders."""

LINES = 9000
"""Most lines of all unrolled orders together."""


class Unrolled:
    """The unrolled orders 1, 2 ... `most` of a series.

    rows: address of order 1. slopes: names of the coefficients of order 1.
    """

    def __init__(self, writer: Writer, rows: str, slopes: list[str]) -> None:
        self.writer, self.rows, self.slopes = writer, rows, slopes
        series = writer.series
        self.vectors = series.sums // LANES
        self.at = series.n + series.events
        self.carried = ["zeroinitializer"] * (2 * self.vectors)
        each, self.most, lines = operations(series.order) + 3 * series.width, 0, 0
        while self.most < MOST and lines <= LINES:
            self.most += 1
            lines += each + 6 * sum(min(terms, self.most) for terms in series.terms)

    def write(self, last: str) -> tuple[str, int]:
        """Write the orders; returns (label at the end, next order). `last`: name of the highest
        order."""
        for k in range(1, self.most + 1):
            self._order(k)
            more = self.writer.line(f"icmp sgt i64 {last}, {k + 1}")
            self.writer.branch(more, f"order{k + 1}", "done")
            self.writer.label(f"order{k + 1}")
        return f"order{self.most + 1}", self.most + 1

    def _order(self, k: int) -> None:
        writer, series = self.writer, self.writer.series
        writer.sums = {0: [self._sum(vector, k) for vector in range(self.vectors)]}
        order = Inlined(Pieces(series.order, NO_CUT), writer)
        order.k, order.zeros, order.coefficients = constant(float(k)), writer.zeros, self.slopes
        values = order.values()
        writer.declared |= order.declared
        row = writer.row_of(self.rows, k)
        # the right factors of order 1 lie before the left ones of order 1, see Driver
        right = writer.place(row, -series.sums - series.width) if k == 1 else row
        self.carried = writer.keep(order, values, row, right, f"%o{k}_")
        self.slopes = values[-series.n :]

    def _factor(self, vector: int, k: int, j: int, right: bool) -> str:
        """Name of the factors of order j for a sum of order k; those of order k - 1 are in
        registers."""
        series = self.writer.series
        if j == k - 1:
            return self.carried[vector + (self.vectors if right else 0)]
        at = self.at + LANES * vector + (j - 1) * series.width
        if right:
            at += -series.width if j == 1 else series.sums
        return self.writer.load(self.rows, at, LANES)

    def _sum(self, vector: int, k: int) -> str:
        """Name of the sum S of order k; the factors computed last are added last."""
        writer, kind = self.writer, self.writer.vector(LANES)
        terms = [j for j in range(1, k) if j <= writer.series.terms[vector]]
        count = max(1, min(4, CHAINS // self.vectors, len(terms) // 3))
        chains: list[str] = []
        for i, j in enumerate(sorted(terms, key=lambda j: max(j, k - j))):
            a, b = self._factor(vector, k, j, False), self._factor(vector, k, k - j, True)
            product = writer.line(f"fmul contract {kind} {a}, {b}")
            if i < count:
                chains.append(product)
            else:
                text = f"fadd contract {kind} {chains[i % count]}, {product}"
                chains[i % count] = writer.line(text)
        return writer.added(chains) if chains else "zeroinitializer"


# LLVM IR of a series: the orders in sequence, each with its sums.
#
# The factors of order j of all sums are consecutive, so that vectors of four sums go through the
# orders side by side, without additions across a vector.


class Driver(Writer):
    """Writer of the laws that expand a series."""

    def expansion(self, start: str, order: str) -> str:
        """LLVM IR of `expand`, which calls the two laws of the series by these names."""
        series = self.series
        declared = [f"declare void @{name}(double, ptr, ptr, ptr)" for name in (start, order)]
        last, sums, kept, rows = self._entry()
        self.lines.append(f"  call void @{start}(double %t, ptr %y, ptr %p, ptr {kept})")
        slopes = self.place(kept, series.numbers)
        for i in range(0, series.n, LANES):
            width = min(LANES, series.n - i)
            self.store(self.load(slopes, i, width), rows, i, width)
        k = self._orders(rows)
        for first, names in self.sums.items():
            for i, name in enumerate(names):
                self.store(name, sums, first + LANES * i, LANES)
        out = self.place("%row", series.n)
        self.lines.append(f"  call void @{order}(double {k}, ptr %row, ptr {sums}, ptr {out})")
        return self._end(declared, last)

    def whole(self) -> str:
        """LLVM IR of `expand` as one function."""
        series = self.series
        last, _, kept, rows = self._entry()
        start = Inlined(Pieces(series.start, NO_CUT), self)
        values = start.values()
        for i, value in enumerate(values[: series.events]):
            start.store(value, kept, i)
        for i, value in enumerate(values[series.numbers :]):
            start.store(value, rows, i)
        self.zeros = values[: series.numbers]
        self.declared |= start.declared
        unrolled = Unrolled(self, rows, values[series.numbers :])
        before, at = unrolled.write(last)
        k = self._orders(rows, before, at, unrolled.carried)
        order = Inlined(Pieces(series.order, NO_CUT), self)
        order.k, order.zeros = k, self.zeros
        values = order.values()
        once = self.line("icmp eq i64 %k, 1")
        aside = self.place("%row", -series.sums - series.width)
        self.lines.append(f"  %right = select i1 {once}, ptr {aside}, ptr %row")
        self.keep(order, values, "%row", "%right", "%new", "_")
        return self._end([*sorted(self.declared | order.declared)], last)

    def _entry(self) -> tuple[str, str, str, str]:
        """Write the entry: (highest order, addresses of the sums, the numbers of order 0, the
        rows)."""
        self.label("entry")
        highest = self.line("load double, ptr %workspace, align 8")
        last = self.line(f"fptosi double {highest} to i64")
        sums = self.place("%workspace", HEAD)
        kept = self.place(sums, self.series.sums)
        series = self.series
        return (
            last,
            sums,
            kept,
            self.place(kept, series.numbers + series.n + BEFORE * series.width),
        )

    def _orders(
        self,
        rows: str,
        before: str = "entry",
        first: int = 1,
        carried: Sequence[str] | None = None,
    ) -> str:
        """Start the loop over the orders with all sums of one order; returns the order as a double.

        before: label of the block before the loop; first: its first order. carried: factors of the
        previous order, in registers %new0 and so on.
        """
        row = rows if first == 1 else self.row_of(rows, first)
        self.jump("again")
        self.label("again")
        self.lines += [
            f"  %k = phi i64 [ {first}, %{before} ], [ %following, %each ]",
            f"  %row = phi ptr [ {row}, %{before} ], [ %after, %each ]",
        ]
        vectors, kind = self.series.sums // LANES, self.vector(LANES)
        if carried is not None:
            self.lines += [
                f"  %new{i} = phi {kind} [ {name}, %{before} ], [ %new{i}_, %each ]"
                for i, name in enumerate(carried)
            ]
        for group in range(0, vectors, GROUP):
            self._group(group, min(GROUP, vectors - group), rows, carried is not None)
        self.jump("each")
        self.label("each")
        return self.line("sitofp i64 %k to double")

    def _end(self, declared: Sequence[str], last: str) -> str:
        """End the loop and the function; returns the text of the function."""
        head = "define void @law(double %t, ptr %y, ptr %p, ptr %workspace) nounwind {"
        self.lines += [
            "  %following = add i64 %k, 1",
            f"  %after = getelementptr double, ptr %row, i64 {self.series.width}",
        ]
        self.branch(self.line(f"icmp slt i64 %following, {last}"), "again", "done")
        self.label("done")
        return "\n".join([*declared, head, *self.lines, "  ret void", "}", RARELY, ""])

    def _group(self, first: int, count: int, rows: str, carried: bool) -> None:
        """Write the sums of `count` vectors: left factors in rising order, right ones in falling
        order.

        Beyond the last term the left factors are those of an earlier series, and the right ones
        zero. Terms with carried factors are added last, so that the others need not wait for them.
        """
        series, name, kind = self.series, f"g{first}", self.vector(LANES)
        chains = min(ROWS, max(1, CHAINS // count))
        names = [f"{name}_s{i}_{c}" for i in range(count) for c in range(chains)]
        left = series.n + series.events + LANES * first
        right = left + series.sums
        skipped = 1 if carried else 0
        self.jump(name)
        self.label(name)
        a = self.place(rows, left + skipped * series.width)
        b = self.place("%row", right - (1 + skipped) * series.width)
        ahead = f"{name}_more"
        self.branch(self.line(f"icmp sgt i64 %k, {1 + 2 * skipped}"), ahead, f"{name}_end")
        self.label(ahead)
        self.lines += [
            f"  %{name}_j = phi i64 [ {1 + 2 * skipped}, %{name} ], [ %{name}_next, %{ahead} ]",
            f"  %{name}_a = phi ptr [ {a}, %{name} ], [ %{name}_a1, %{ahead} ]",
            f"  %{name}_b = phi ptr [ {b}, %{name} ], [ %{name}_b1, %{ahead} ]",
            *(
                f"  %{one} = phi {kind} [ zeroinitializer, %{name} ], [ %{one}_t, %{ahead} ]"
                for one in names
            ),
        ]
        latest = {one: f"%{one}" for one in names}
        for r in range(ROWS):
            for i in range(count):
                x = self.load(f"%{name}_a", r * series.width + LANES * i, LANES)
                y = self.load(f"%{name}_b", LANES * i - r * series.width, LANES)
                product = self.line(f"fmul contract {kind} {x}, {y}")
                one = f"{name}_s{i}_{r % chains}"
                text = f"fadd contract {kind} {latest[one]}, {product}"
                if r < ROWS - chains:
                    latest[one] = self.line(text)
                else:
                    self.lines.append(f"  %{one}_t = {text}")
        self.lines += [
            f"  %{name}_a1 = getelementptr double, ptr %{name}_a, i64 {ROWS * series.width}",
            f"  %{name}_b1 = getelementptr double, ptr %{name}_b, i64 -{ROWS * series.width}",
            f"  %{name}_next = add i64 %{name}_j, {ROWS}",
        ]
        self.branch(self.line(f"icmp slt i64 %{name}_next, %k"), ahead, f"{name}_end")
        self.label(f"{name}_end")
        self.lines += [
            f"  %{one}_u = phi {kind} [ zeroinitializer, %{name} ], [ %{one}_t, %{ahead} ]"
            for one in names
        ]
        sums = [self.added([f"%{name}_s{i}_{c}_u" for c in range(chains)]) for i in range(count)]
        if carried:
            sums = [self._with_ends(first + i, one, rows) for i, one in enumerate(sums)]
        self.sums[LANES * first] = sums

    def _with_ends(self, vector: int, known: str, rows: str) -> str:
        """The sums with their first and last terms, whose factors of order k - 1 are carried.

        For k = 2 both terms are the same, for k = 1 there is none. The right factors of order 1 are
        in row 0: in row 1 they are zero, as in all rows before it.
        """
        series, kind = self.series, self.vector(LANES)
        left = series.n + series.events + LANES * vector
        first = self.load(rows, left, LANES)
        last = self.load(rows, left - series.width, LANES)
        many = self.line("icmp sgt i64 %k, 2")
        begin = self.line(f"select i1 {many}, {kind} {first}, {kind} zeroinitializer")
        a = self.line(f"fmul {kind} {begin}, %new{vector + series.sums // LANES}")
        b = self.line(f"fmul {kind} %new{vector}, {last}")
        return self.line(f"fadd {kind} {known}, {self.line(f'fadd {kind} {a}, {b}')}")


# A series as laws: all orders in one call, and the sums of a series and of its derivative.


WHOLE = 300
"""Most operations for which the whole expansion is one function, with sums and factors in
registers."""

PIECE = 1000
"""Operations per function: LLVM takes three times as long for orders in pieces of four thousand."""

SMALL = 4000
"""Most outputs of an order for which optimising its code is worth the time."""


class SeriesLaws:
    """Laws of a series: `expand`, void expand(t, y, p, workspace), writes it; workspace[0]: highest
    order.

    From workspace[first] on are the orders 1, 2 ... with `width` numbers each: the n coefficients
    of y, then those of the events, whose values at order 0 are at workspace[events_at]. `add`, void
    add(h, rows, &order, out), gives y(h) - y(0) and dy/dt(h), 2 n numbers, from the rows at
    workspace[first].
    """

    def __init__(self, outputs: Sequence[Any]) -> None:
        series = Series(outputs)
        self.n, self.events, self.width = series.n, series.events, series.width
        self.roots = series.roots
        self.events_at = HEAD + series.sums
        self.first = self.events_at + series.numbers + series.n + BEFORE * series.width
        self.expand: Law | PlainLaw | PlainExpansion
        self.add: Law | PlainSum
        if interpreted():
            self.expand, self.add = PlainExpansion(series), PlainSum(series)
            return
        self.add = linked([Sum(series).sum()])
        calls = Pieces(series.start).externals
        if operations([*series.start, *series.order]) <= WHOLE and not calls:
            self.expand = linked([Driver(series).whole()])
            return
        laws = {}
        for role, made in (("start", series.start), ("order", series.order)):
            laws[role] = named_law(role, Pieces(made, PIECE), 2 if len(made) < SMALL else 0)
        names = {role: name for role, (name, _) in laws.items()}
        text = Driver(series).expansion(names["start"], names["order"])
        self.expand = linked([text], others=dict(laws.values()))

    def size(self, order: int) -> int:
        """Numbers of the workspace for series of this order."""
        return self.first + (order + 1) * self.width


class PlainExpansion:
    """`expand` in Python."""

    def __init__(self, series: Series) -> None:
        self._series = series
        self._start, self._order = PlainLaw(series.start), PlainLaw(series.order)

    def __call__(self, t: float, y: Any, p: Any, workspace: Any) -> None:
        """Write the series at (t, y) into the workspace, whose first number is the required
        order."""
        series, order = self._series, int(workspace[0])
        n, sums, width = series.n, series.sums, series.width
        left, given = n + series.events, workspace[HEAD:]
        self._start(t, y, p, given[sums:])
        first = sums + series.numbers
        rows = given[first + n + BEFORE * width :]
        rows[:n] = given[first : first + n]
        for k in range(1, order):
            given[:sums] = 0.0
            for j in range(1, k):
                a, b = (j - 1) * width + left, (k - j - 1) * width + left + sums
                given[:sums] += rows[a : a + sums] * rows[b : b + sums]
            at = (k - 1) * width
            self._order(float(k), rows[at:], given, rows[at + n :])


class PlainSum:
    """`add` in Python."""

    def __init__(self, series: Series) -> None:
        self._n, self._width = series.n, series.width

    def __call__(self, h: float, rows: Any, order: Any, out: Any) -> None:
        """Write the change over h, by Horner's rule, and its rate into out: n numbers each."""
        n = self._n
        change, slope = np.zeros(n), np.zeros(n)
        for k in range(int(order[0]), 0, -1):
            row = rows[(k - 1) * self._width : (k - 1) * self._width + n]
            change, slope = row + h * change, k * row + h * slope
        out[:n], out[n : 2 * n] = h * change, slope
