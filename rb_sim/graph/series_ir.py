"""LLVM IR of a series: the orders one after the other, each with its sums.

The factors of order j of all sums lie next to each other, so that vectors of four sums go through
the orders side by side, and nothing is added across a vector.
"""

from __future__ import annotations

from collections.abc import Sequence

from rb_sim.graph.emit import RARELY, Pieces
from rb_sim.graph.series_factors import LANES
from rb_sim.graph.series_unrolled import Unrolled
from rb_sim.graph.series_writer import BEFORE, CHAINS, GROUP, HEAD, NO_CUT, ROWS, Inlined, Writer


class Driver(Writer):
    """Writes the laws that expand a series."""

    def expansion(self, start: str, order: str) -> str:
        """`expand`, which calls the two laws of the series by these names."""
        series, p = self.series, self.p
        declared = [f"declare void @{name}(double, {p}, {p}, {p})" for name in (start, order)]
        last, sums, kept, rows = self._entry()
        self.lines.append(f"  call void @{start}(double %t, {p} %y, {p} %p, {p} {kept})")
        slopes = self.place(kept, series.numbers)
        for i in range(0, series.n, LANES):
            width = min(LANES, series.n - i)
            self.store(self.load(slopes, i, width), rows, i, width)
        k = self._orders(rows)
        for first, names in self.sums.items():
            for i, name in enumerate(names):
                self.store(name, sums, first + LANES * i, LANES)
        out = self.place("%row", series.n)
        self.lines.append(f"  call void @{order}(double {k}, {p} %row, {p} {sums}, {p} {out})")
        return self._end(declared, last)

    def whole(self) -> str:
        """`expand` as one function."""
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
        self.lines.append(f"  %right = select i1 {once}, {self.p} {aside}, {self.p} %row")
        self.keep(order, values, "%row", "%right", "%new", "_")
        return self._end([*sorted(self.declared | order.declared)], last)

    def _entry(self) -> tuple[str, str, str, str]:
        """(highest order, places of the sums, the numbers of order 0, the rows)."""
        self.label("entry")
        highest = self.line(f"load double, {self.p} %room, align 8")
        last = self.line(f"fptosi double {highest} to i64")
        sums = self.place("%room", HEAD)
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
        """Begin the loop over the orders: all sums of one; returns the order as a double.

        before: the label from which it is entered, with this first order. carried: the factors of
        the order before, which are in registers, %new0 and so on.
        """
        row = rows if first == 1 else self.row_of(rows, first)
        self.jump("again")
        self.label("again")
        self.lines += [
            f"  %k = phi i64 [ {first}, %{before} ], [ %following, %each ]",
            f"  %row = phi {self.p} [ {row}, %{before} ], [ %after, %each ]",
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
        """End the loop and the function; returns its text."""
        p = self.p
        head = f"define void @law(double %t, {p} %y, {p} %p, {p} %room) nounwind {{"
        self.lines += [
            "  %following = add i64 %k, 1",
            f"  %after = getelementptr double, {p} %row, i64 {self.series.width}",
        ]
        self.branch(self.line(f"icmp slt i64 %following, {last}"), "again", "done")
        self.label("done")
        return "\n".join([*declared, head, *self.lines, "  ret void", "}", RARELY, ""])

    def _group(self, first: int, count: int, rows: str, carried: bool) -> None:
        """The sums of some vectors: left factors upwards, right ones downwards.

        Beyond the last term the left factors are those of an earlier series, and the right ones
        zero.  Terms with carried factors come after the others, which need not wait for them.
        """
        series, p, name, kind = self.series, self.p, f"g{first}", self.vector(LANES)
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
            f"  %{name}_a = phi {p} [ {a}, %{name} ], [ %{name}_a1, %{ahead} ]",
            f"  %{name}_b = phi {p} [ {b}, %{name} ], [ %{name}_b1, %{ahead} ]",
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
            f"  %{name}_a1 = getelementptr double, {p} %{name}_a, i64 {ROWS * series.width}",
            f"  %{name}_b1 = getelementptr double, {p} %{name}_b, i64 -{ROWS * series.width}",
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

        For k = 2 both terms are the same one, and at k = 1 there is none.  The right factors of
        order 1 are in row 0: in row 1 they are zero, as in all rows before it.
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
