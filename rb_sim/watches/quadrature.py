"""Integrals over the samples of a run, as they come: memory does not grow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from typing import Any

import numpy as np

from rb_sim.engine.samples import Array
from rb_sim.watches.gaps import Gaps

NODES = 4
"""Samples per interpolating cubic: the rule is of order 4 for smooth functions."""

_GAUSS = (-(3.0**-0.5), 3.0**-0.5)
"""Two points integrate a cubic exactly."""

_ENDS = np.array([-1.0, 12.0, 25.0]) / 24.0
"""Weights of the first samples, of equal spacing 1, where each integral from a sample to the next
is that of the cubic through the two and their neighbours; others weigh 1, the last as the first."""

_CUBIC = np.array([[9.0, 19.0, -5.0, 1.0], [-1.0, 13.0, 13.0, -1.0], [1.0, -5.0, 19.0, 9.0]]) / 24.0
"""Weights of four samples of equal spacing 1 in the integrals between neighbours."""

EQUAL = 1e-10
"""Relative difference of spacings that are taken as equal."""

WAITING = 8192
"""Samples that wait at most to be summed together: one by one or few by few costs far more."""


class Quadrature:
    """Integral of a sampled function, shape (columns,), by the cubics through four neighbours.

    Where the function breaks, the cubics of either side go up to there.
    """

    def __init__(self, columns: int) -> None:
        self._sum = np.zeros(columns)
        self._break: float | None = None  # at which the present piece begins
        self._crowded: float | None = None  # the last of more breaks before its first sample
        self._before = np.zeros(columns)  # size of the last sample before it
        self._untold = np.zeros(columns)  # of the pieces so far, see `untold`
        self._waiting: list[float] = []  # breaks after the last sample so far
        self._t = np.empty(0)
        self._f = np.empty((0, columns))
        self._first = True

    def add(self, t: Array, f: Array, breaks: Sequence[float] = ()) -> None:
        """The next samples. t: shape (n,), increasing, any spacing; f: shape (n, columns).

        breaks: increasing, where f or its derivatives jump; a sample there counts as after it.
        """
        waiting, self._waiting = [*self._waiting, *breaks], []
        for instant in waiting:
            before = int(np.searchsorted(t, instant, side="left"))
            self._extend(t[:before], f[:before])
            t, f = t[before:], f[before:]
            if len(t):
                self._end_piece(instant)
            else:
                self._waiting.append(instant)
        self._extend(t, f)

    def _end_piece(self, instant: float) -> None:
        """Begin anew at a break; one without a sample since the last is left out."""
        if not len(self._t):
            self._crowded = instant if self._break is not None else None
            return
        last = _span(self._t[-NODES:], self._f[-NODES:], self._t[-1], instant)
        self._untold = self.untold() + self._doubted(last, self._f[-1], instant - self._t[-1])
        self._sum = self.total() + last
        self._before = np.abs(self._f[-1])
        self._t, self._f = self._t[:0], self._f[:0]
        self._first, self._break, self._crowded = True, instant, None

    def _extend(self, t: Array, f: Array) -> None:
        if not len(t):
            return
        self._t = np.concatenate([self._t, t])
        self._f = np.concatenate([self._f, f])
        if len(self._t) < NODES:
            return
        if self._first:
            self._untold = self.untold()
            self._sum = self._sum + self._head()
            self._sum += _integral(self._t[:NODES], self._f[:NODES], 0)
        new = 0 if self._first else 1
        self._sum += self._intervals(new, new + 1, len(self._t) - NODES + 1 - new)
        self._first = False
        self._t, self._f = self._t[-NODES:], self._f[-NODES:]

    def total(self) -> Array:
        """From the first to the last sample so far, shape (columns,)."""
        n = len(self._t)
        rest = range(n - 1) if self._first else [n - 2]
        start = self._sum + self._head() if self._first and n else self._sum
        return sum((_integral(self._t, self._f, i) for i in rest), start)

    def untold(self) -> Array:
        """What the samples leave open of the parts of the integral beside breaks, beyond the
        samples of a piece, shape (columns,)."""
        if self._break is None or not self._first or not len(self._t):
            return self._untold
        doubt = self._doubted(self._head(), self._f[0], self._t[0] - self._break)
        if self._crowded is not None:
            doubt += np.abs(_span(self._t[:NODES], self._f[:NODES], self._break, self._crowded))
        return self._untold + doubt

    def _doubted(self, part: Array, f: Array, length: float) -> Array:
        """What may be wrong of an integral beyond the samples of the present piece, whose nearest
        value is f: all that it may be where there is one sample; of two or three, all but f times
        the length, for a slope that they happen to keep may change; of more, nothing."""
        if len(self._t) >= NODES:
            return np.zeros_like(part)
        if len(self._t) > 1:
            return np.abs(part - f * length)
        return np.maximum(np.abs(f), self._before) * length

    def followed_by(self, t: Array, f: Array) -> Quadrature:
        """Another quadrature of these samples and the next ones."""
        after = copy(self)
        after._sum = self._sum.copy()
        after.add(t, f)
        return after

    def _head(self) -> Array:
        """From the break at which the piece begins to its first sample."""
        if self._break is None:
            return np.zeros_like(self._sum)
        return _span(self._t[:NODES], self._f[:NODES], self._break, self._t[0])

    def _intervals(self, first: int, left: int, count: int) -> Array:
        """Sum of `count` integrals, each from a sample to the next, by cubics through NODES.

        The first cubic begins at sample `first`, the first integral at sample `left`.
        """
        t = self._t
        equal = self._equal_intervals(first, count) if left == first + 1 and count > 2 else None
        if equal is not None:
            return equal
        ends = t[left : left + count], t[left + 1 : left + 1 + count]
        nodes = [t[first + j : first + j + count] for j in range(NODES)]
        total = np.zeros(len(t))
        for j, weight in enumerate(_weights(nodes, *ends)):
            total[first + j : first + j + count] += weight
        return total @ self._f

    def _equal_intervals(self, first: int, count: int) -> Array | None:
        """As _intervals from the second sample on, where all are equally spaced; else None."""
        t = self._t[first : first + count + 3]
        h = (t[-1] - t[0]) / (len(t) - 1)
        if not np.abs(np.diff(t) - h).max() <= EQUAL * h:
            return None
        weights = np.ones(len(t))
        weights[:3] += _ENDS - 1.0
        weights[-3:] += _ENDS[::-1] - 1.0
        return h * (weights @ self._f[first : first + count + 3])


def _span(t: Array, f: Array, start: float, end: float) -> Array:
    """From start to end, with the one polynomial through all the samples given."""
    try:
        return np.array(_weights(t.tolist(), float(start), float(end))) @ f
    except ZeroDivisionError:  # two samples of one instant
        return np.full(f.shape[1], np.nan)


def _integral(t: Array, f: Array, left: int) -> Array:
    """From t[left] to t[left + 1], with the one polynomial through all the samples given."""
    if len(t) == NODES:
        a, b, c, d = t.tolist()
        h = (d - a) / 3.0
        if max(abs(b - a - h), abs(c - b - h), abs(d - c - h)) <= EQUAL * h:
            return h * (_CUBIC[left] @ f)
    return _span(t, f, t[left], t[left + 1])


def _weights(nodes: Sequence[Any], start: Any, end: Any) -> list[Any]:
    """Weights of the values at the m <= 4 nodes in the integral from start to end.

    Each node, start and end: a number, or an array of as many as there are integrals.
    """
    middle, half = 0.5 * (start + end), 0.5 * (end - start)
    ahead = [[middle + half * point - node for node in nodes] for point in _GAUSS]
    weights = []
    for j, node in enumerate(nodes):
        others = [i for i in range(len(nodes)) if i != j]
        at = [math.prod(distance[i] for i in others) for distance in ahead]
        between = math.prod(node - nodes[i] for i in others)
        weights.append(half * (at[0] + at[1]) / between)
    return weights


class CheckedQuadrature:
    """A quadrature that also says what half the samples would have given.

    What comes waits until there is enough of it. Up to the first value that is not zero the
    integral is zero, and only the last samples before it are kept.
    """

    def __init__(self, columns: int) -> None:
        self._columns = columns
        self._all, self._half = Quadrature(columns), Quadrature(columns)
        self._seen = 0
        self._nothing = True
        """whether all values so far are zero."""
        self._waiting: list[tuple[Array, Array]] = []
        self._count = 0
        self._breaks: list[float] = []
        self._gaps = Gaps(columns)
        self._left_out: tuple[Array, Array] | None = None
        self._finished: tuple[Array, Array] | None = None
        """what `finish` gave, until more comes."""

    def add(self, t: Array, f: Array, breaks: Sequence[float] = ()) -> None:
        """The next samples, as in Quadrature."""
        if not len(t):
            return
        self._finished = None
        self._waiting.append((t, f))
        self._breaks += breaks
        self._count += len(t)
        self._seen += len(t)
        if self._nothing and not f.any():
            self._forget()
        else:
            self._nothing = False
        if self._count >= WAITING:
            self._sum_up()

    def _forget(self) -> None:
        """Leave out all but the last of the samples, which are all zero."""
        t, f = self._taken()
        keep = min(len(t), 2 * NODES + (len(t) % 2))
        self._waiting, self._count = [(t[-keep:], f[-keep:])], keep
        self._breaks = [instant for instant in self._breaks if instant >= t[-1]]

    def _taken(self) -> tuple[Array, Array]:
        if len(self._waiting) == 1:
            return self._waiting[0]
        parts = zip(*self._waiting, strict=True)
        t, f = (np.concatenate(part) for part in parts)
        return t, f

    def _sum_up(self) -> None:
        """Add what waits to the integrals."""
        if not self._count:
            return
        t, f = self._taken()
        self._all.add(t, f, self._breaks)
        self._gaps.add(t, f)
        skip = (self._seen - self._count) % 2
        self._half.add(t[skip::2], f[skip::2], self._breaks)
        self._waiting, self._count, self._breaks = [], 0, []
        self._left_out = None if self._seen % 2 else (t[-1:], f[-1:])

    def finish(self) -> tuple[Array, Array]:
        """(integral, how much it changes with every other sample left out), each (columns,).

        Of two samples none can be left out, and half of them have a gap as all do: there all of the
        integral is in doubt. Beside a break half of them may be the same as all: see `untold`.
        """
        if self._nothing:
            return np.zeros(self._columns), np.zeros(self._columns)
        if self._finished is None:
            self._finished = self._taken_together()
        return self._finished

    def _taken_together(self) -> tuple[Array, Array]:
        self._sum_up()
        total = self._all.total()
        if self._seen == 2:
            return total, np.abs(total)
        half = self._half if self._left_out is None else self._half.followed_by(*self._left_out)
        return total, np.abs(total - half.total()) + self._gaps.total() + self._all.untold()
