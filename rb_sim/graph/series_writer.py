"""Lines of LLVM IR of a series: vectors of sums, and laws written into the same function."""

from __future__ import annotations

import re
from collections.abc import Sequence

from rb_sim.graph.emit import Piece, Pieces
from rb_sim.graph.series import Series
from rb_sim.graph.series_factors import LANES
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


CONTRACTED = re.compile(r"^(fadd|fsub|fmul) double")
"""What may become one operation with a product before it, rounded once: terms of a series are not
what Python would give to the last bit anyway, for their sums are in another order."""


class Inlined(Piece):
    """A law as part of the driver's function.

    zeros: names of the numbers of order 0; None for the law that gives them. coefficients: names of
    those of order k of y; None where they are in the row.
    """

    def __init__(self, pieces: Pieces, driver: Writer) -> None:
        super().__init__(pieces, 0, driver.p)
        self.driver, self.lines = driver, driver.lines
        self.k, self.row = "%t", "%row"
        self.zeros: list[str] | None = None
        self.coefficients: list[str] | None = None

    def line(self, text: str) -> str:
        return self.driver.line(CONTRACTED.sub(r"\1 contract double", text))

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
            return self.coefficients[index] if self.coefficients else self.load(self.row, index)
        sums = self.driver.series.sums
        if index < sums:
            return self.driver.sum_of(index)
        return self.zeros[index - sums]


class Writer:
    """Writes LLVM IR."""

    def __init__(self, series: Series, pointer: str) -> None:
        self.series, self.p = series, pointer
        self.lines: list[str] = []
        self.count = 0
        self.sums: dict[int, list[str]] = {}
        self.zeros: list[str] = []
        """Names of the numbers of order 0."""
        self.declared: set[str] = set()

    def sum_of(self, index: int) -> str:
        """One of the sums."""
        first = max(at for at in self.sums if at <= index)
        vector = self.sums[first][(index - first) // LANES]
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

    def row_of(self, rows: str, order: int) -> str:
        """Where the coefficients of an order are."""
        return self.place(rows, (order - 1) * self.series.width)

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

    def keep(
        self, order: Inlined, values: list[str], row: str, right: str, name: str, suffix: str = ""
    ) -> list[str]:
        """Store what the law of an order gives; the names of the factors as vectors."""
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
        """A vector of these numbers."""
        kind, made = self.vector(len(values)), "undef"
        for i, value in enumerate(values):
            made = self.line(f"insertelement {kind} {made}, double {value}, i32 {i}")
        return made

    def added(self, vectors: list[str]) -> str:
        """The sum of vectors, by halves."""
        while len(vectors) > 1:
            pairs = zip(vectors[::2], vectors[1::2], strict=False)
            odd = vectors[len(vectors) // 2 * 2 :]
            vectors = [self.line(f"fadd {self.vector(LANES)} {a}, {b}") for a, b in pairs] + odd
        return vectors[0]
