"""LLVM IR of a series: the loop over the orders with the sums of each, and the sum of a series.

The factors of order j of all sums lie next to each other, so that vectors of four sums go through
the orders side by side, and nothing is added across a vector.
"""

from __future__ import annotations

from collections.abc import Sequence

from rb_sim.graph.emit import RARELY, Piece, Pieces, constant
from rb_sim.graph.series import LANES, Series
from rb_sim.graph.symbols import INPUTS, Symbol

HEAD = 4
"""Numbers before the sums in the room of a series; the first of them is the highest order."""

GROUP = 8
"""Vectors that go through the orders together, each in a register."""

ROWS = 4
"""Orders that an iteration of a sum takes: the end of the loop is seldom guessed wrong."""

BEFORE = ROWS - 1
"""Rows of zeros before order 1, so that the sums may begin and end beyond their terms."""

CHAINS = 8
"""Additions under way at a time, none of which waits for another."""

NO_CUT = 10**9
"""Operations of a piece: the law is not cut."""


class _Inlined(Piece):
    """A law as part of the driver's function.

    zeros: names of the numbers of order 0; None for the law that gives them.
    """

    def __init__(self, pieces: Pieces, driver: Driver) -> None:
        super().__init__(pieces, 0, driver.p)
        self.driver, self.lines = driver, driver.lines
        self.k = "%t"
        self.zeros: list[str] | None = None

    def line(self, text: str) -> str:
        return self.driver.line(text)

    def values(self) -> list[str]:
        """Write the operations; the names of the outputs."""
        for x in self.pieces.parts[0]:
            self.names[x.number] = self.operation(x)
        return [self.value(x) for x in self.pieces.outputs]

    def from_outside(self, x: Symbol) -> str:
        if self.zeros is None or x.op not in INPUTS:
            return super().from_outside(x)
        if x.op == "t":
            return self.k
        index = x.operands[0]
        if x.op == "y":
            return self.load("%row", index)
        sums = self.driver.series.sums
        if index < sums:
            return self.driver.sum_of(index)
        return self.zeros[index - sums]


class Driver:
    """Writes LLVM IR."""

    def __init__(self, series: Series, pointer: str) -> None:
        self.series, self.p = series, pointer
        self.lines: list[str] = []
        self.count = 0
        self._sums: dict[int, list[str]] = {}

    def sum_of(self, index: int) -> str:
        """One of the sums."""
        first = max(at for at in self._sums if at <= index)
        vector = self._sums[first][(index - first) // LANES]
        return self.line(f"extractelement {self.vector(LANES)} {vector}, i32 {index % LANES}")

    def line(self, text: str) -> str:
        self.count += 1
        self.lines.append(f"  %v{self.count} = {text}")
        return f"%v{self.count}"

    def place(self, base: str, index: int | str) -> str:
        return self.line(f"getelementptr double, {self.p} {base}, i64 {index}")

    def vector(self, width: int) -> str:
        return f"<{width} x double>"

    def at(self, base: str, width: int) -> str:
        """The place as a pointer to a vector."""
        if self.p == "ptr":
            return base
        return self.line(f"bitcast {self.p} {base} to {self.vector(width)}*")

    def load(self, base: str, index: int, width: int) -> str:
        kind = self.vector(width)
        place = self.at(self.place(base, index), width)
        return self.line(f"load {kind}, {self._to(kind)} {place}, align 8")

    def store(self, value: str, base: str, index: int, width: int) -> None:
        kind = self.vector(width)
        place = self.at(self.place(base, index), width)
        self.lines.append(f"  store {kind} {value}, {self._to(kind)} {place}, align 8")

    def _to(self, kind: str) -> str:
        return "ptr" if self.p == "ptr" else f"{kind}*"

    def splat(self, value: str, width: int) -> str:
        """A vector of one number."""
        kind = self.vector(width)
        one = self.line(f"insertelement {kind} undef, double {value}, i32 0")
        mask = f"<{width} x i32> zeroinitializer"
        return self.line(f"shufflevector {kind} {one}, {kind} undef, {mask}")

    def label(self, name: str) -> None:
        self.lines.append(f"{name}:")

    def jump(self, name: str) -> None:
        self.lines.append(f"  br label %{name}")

    def branch(self, condition: str, yes: str, no: str) -> None:
        self.lines.append(f"  br i1 {condition}, label %{yes}, label %{no}")

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
        for first, names in self._sums.items():
            for i, name in enumerate(names):
                self.store(name, sums, first + LANES * i, LANES)
        out = self.place("%row", series.n)
        self.lines.append(f"  call void @{order}(double {k}, {p} %row, {p} {sums}, {p} {out})")
        return self._end(declared, last)

    def whole(self) -> str:
        """`expand` as one function."""
        series = self.series
        last, _, kept, rows = self._entry()
        start = _Inlined(Pieces(series.start, NO_CUT), self)
        values = start.values()
        for i, value in enumerate(values[: series.events]):
            start.store(value, kept, i)
        for i, value in enumerate(values[series.numbers :]):
            start.store(value, rows, i)
        k = self._orders(rows, carried=True)
        order = _Inlined(Pieces(series.order, NO_CUT), self)
        order.k, order.zeros = k, values[: series.numbers]
        values = order.values()
        at = series.n
        for i in range(series.events):
            order.store(values[i], "%row", at + i)
        at += series.events
        aside = self.place("%row", -series.sums - series.width)
        once = self.line("icmp eq i64 %k, 1")
        self.lines.append(f"  %right = select i1 {once}, {self.p} {aside}, {self.p} %row")
        for i in range(0, 2 * series.sums, LANES):
            name = f"%new{i // LANES}_"
            first = series.events + i
            vector = self.together(values[first : first + LANES])
            self.lines.append(f"  {name} = freeze {self.vector(LANES)} {vector}")
            self.store(name, "%row" if i < series.sums else "%right", at + i, LANES)
        for i, value in enumerate(values[-series.n :]):
            order.store(value, "%row", series.width + i)
        return self._end([*sorted(start.declared | order.declared)], last)

    def together(self, values: Sequence[str]) -> str:
        """A vector of these numbers."""
        kind, made = self.vector(len(values)), "undef"
        for i, value in enumerate(values):
            made = self.line(f"insertelement {kind} {made}, double {value}, i32 {i}")
        return made

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

    def _orders(self, rows: str, carried: bool = False) -> str:
        """Begin the loop over the orders: all sums of one; returns the order as a double.

        carried: the factors of the order before are in registers, %new0 and so on.
        """
        self.jump("again")
        self.label("again")
        self.lines += [
            "  %k = phi i64 [ 1, %entry ], [ %following, %each ]",
            f"  %row = phi {self.p} [ {rows}, %entry ], [ %after, %each ]",
        ]
        vectors, kind = self.series.sums // LANES, self.vector(LANES)
        if carried:
            self.lines += [
                f"  %new{i} = phi {kind} [ zeroinitializer, %entry ], [ %new{i}_, %each ]"
                for i in range(2 * vectors)
            ]
        for first in range(0, vectors, GROUP):
            self._group(first, min(GROUP, vectors - first), rows, carried)
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
                product = self.line(f"fmul {kind} {x}, {y}")
                one = f"{name}_s{i}_{r % chains}"
                text = f"fadd {kind} {latest[one]}, {product}"
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
        sums = [self._added([f"%{name}_s{i}_{c}_u" for c in range(chains)]) for i in range(count)]
        if carried:
            sums = [self._with_ends(first + i, one, rows) for i, one in enumerate(sums)]
        self._sums[LANES * first] = sums

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

    def _added(self, vectors: list[str]) -> str:
        """The sum of vectors, by halves."""
        while len(vectors) > 1:
            pairs = zip(vectors[::2], vectors[1::2], strict=True)
            vectors = [self.line(f"fadd {self.vector(LANES)} {a}, {b}") for a, b in pairs]
        return vectors[0]

    def sum(self) -> str:
        """`add`: Horner's rule for the series and its derivative."""
        n, p, width = self.series.n, self.p, self.series.width
        head = f"define void @law(double %h, {p} %rows, {p} %order, {p} %out) nounwind {{"
        self.label("entry")
        highest = self.line(f"load double, {p} %order, align 8")
        last = self.line(f"fptosi double {highest} to i64")
        offset = self.line(f"mul i64 {self.line(f'sub i64 {last}, 1')}, {width}")
        top = self.place("%rows", offset)
        before = "entry"
        for first in range(0, n, LANES * GROUP // 2):
            before = self._horner(first, min(LANES * GROUP // 2, n - first), top, last, before)
        return "\n".join([head, *self.lines, "  ret void", "}", ""])

    def _horner(self, first: int, count: int, top: str, last: str, before: str) -> str:
        """Some coordinates; returns the label after them."""
        p, name = self.p, f"h{first}"
        parts = [(i, min(LANES, count - i)) for i in range(0, count, LANES)]
        zero, one = constant(0.0), constant(1.0)
        starts = self.line("fadd double %h, " + zero)
        powers = self.line(f"sitofp i64 {last} to double")
        self.jump(name)
        self.label(name)
        phis = [
            ("i64", "k", last, f"%{name}_k1"),
            ("double", "f", powers, f"%{name}_f1"),
            (p, "r", top, f"%{name}_r1"),
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
            for what, term in (("c", row), ("d", self.line(f"fmul {kind} {row}, {k}"))):
                moved = self.line(f"fmul {kind} %{name}_{what}{i}, {h}")
                self.lines.append(f"  %{name}_{what}{i}_1 = fadd {kind} {term}, {moved}")
        self.lines += [
            f"  %{name}_k1 = sub i64 %{name}_k, 1",
            f"  %{name}_f1 = fsub double %{name}_f, {one}",
            f"  %{name}_r1 = getelementptr double, {p} %{name}_r, i64 -{self.series.width}",
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
