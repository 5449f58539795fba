"""A series as laws: all orders in one call, and the sums of a series and of its slope."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rb_sim.graph.emit import Pieces
from rb_sim.graph.machine import Law, PlainLaw, interpreted, linked, named_law, pointer_type
from rb_sim.graph.series import Series
from rb_sim.graph.series_ir import Driver
from rb_sim.graph.series_sum import Sum
from rb_sim.graph.series_writer import BEFORE, HEAD
from rb_sim.graph.symbols import operations

WHOLE = 300
"""Operations up to which all is one function, and sums and factors stay in registers."""

PIECE = 1000
"""Operations per function: LLVM takes three times as long for orders in pieces of four thousand."""

SMALL = 4000
"""Operations of an order up to which it is worth the compiler's time."""


class SeriesLaws:
    """`expand`, void expand(t, y, p, room), writes the series; room[0]: its highest order.

    From room[first] on lie the orders 1, 2 ... with `width` numbers each: the n coefficients of y,
    then those of the events, whose values at order 0 are at room[events_at].
    `add`, void add(h, rows, &order, out), gives y(h) - y(0) and dy/dt(h), 2 n numbers, for the
    rows from room[first] on.
    """

    def __init__(self, outputs: Sequence[Any]) -> None:
        series = Series(outputs)
        self.n, self.events, self.width = series.n, series.events, series.width
        self.events_at = HEAD + series.sums
        self.first = self.events_at + series.numbers + series.n + BEFORE * series.width
        self.expand: Law | PlainLaw | PlainExpansion
        self.add: Law | PlainSum
        if interpreted():
            self.expand, self.add = PlainExpansion(series), PlainSum(series)
            return
        pointer = pointer_type()
        self.add = linked([Sum(series, pointer).sum()])
        calls = Pieces(series.start).externals
        if operations([*series.start, *series.order]) <= WHOLE and not calls:
            self.expand = linked([Driver(series, pointer).whole()])
            return
        laws = {}
        for role, made in (("start", series.start), ("order", series.order)):
            laws[role] = named_law(role, Pieces(made, PIECE), 2 if len(made) < SMALL else 0)
        names = {role: name for role, (name, _) in laws.items()}
        text = Driver(series, pointer).expansion(names["start"], names["order"])
        self.expand = linked([text], others=dict(laws.values()))

    def size(self, order: int) -> int:
        """Numbers of the room for series of this order."""
        return self.first + (order + 1) * self.width


class PlainExpansion:
    """As `expand`, in Python."""

    def __init__(self, series: Series) -> None:
        self._series = series
        self._start, self._order = PlainLaw(series.start), PlainLaw(series.order)

    def __call__(self, t: float, y: Any, p: Any, room: Any) -> None:
        series, order = self._series, int(room[0])
        n, sums, width = series.n, series.sums, series.width
        left, given = n + series.events, room[HEAD:]
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
    """As `add`, in Python."""

    def __init__(self, series: Series) -> None:
        self._n, self._width = series.n, series.width

    def __call__(self, h: float, rows: Any, order: Any, out: Any) -> None:
        n = self._n
        change, slope = np.zeros(n), np.zeros(n)
        for k in range(int(order[0]), 0, -1):
            row = rows[(k - 1) * self._width : (k - 1) * self._width + n]
            change, slope = row + h * change, k * row + h * slope
        out[:n], out[n : 2 * n] = h * change, slope
