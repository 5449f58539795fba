"""The first orders of a series written out, each with its own sums: no loop, no end to guess."""

from __future__ import annotations

from rb_sim.graph.emit import Pieces, constant
from rb_sim.graph.series_factors import LANES
from rb_sim.graph.series_writer import CHAINS, NO_CUT, Inlined, Writer
from rb_sim.graph.symbols import operations

MOST = 28
"""Orders that are written out, at most."""

LINES = 9000
"""Lines that they may have together."""


class Unrolled:
    """Orders 1, 2 ... `most` of a series.

    rows: the place of order 1. slopes: names of the coefficients of order 1.
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
        """(label at the end, order that follows); `last` is the highest order of all."""
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
        """The factors of order j for a sum of order k: in registers those of order k - 1."""
        series = self.writer.series
        if j == k - 1:
            return self.carried[vector + (self.vectors if right else 0)]
        at = self.at + LANES * vector + (j - 1) * series.width
        if right:
            at += -series.width if j == 1 else series.sums
        return self.writer.load(self.rows, at, LANES)

    def _sum(self, vector: int, k: int) -> str:
        """S of order k; what was known last is added last."""
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
