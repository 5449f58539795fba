"""Integrals over the samples of a run, as they come: memory does not grow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rb_sim.engine.samples import Array

Indices = NDArray[np.intp]

NODES = 4
"""Samples per interpolating cubic: the rule is of order 4 for smooth functions."""

_GAUSS = (-(3.0**-0.5), 3.0**-0.5)
"""Two points integrate a cubic exactly."""


class Quadrature:
    """Integral of a sampled function, shape (columns,), by the cubics through four neighbours.

    Where the function breaks, the cubics of either side go up to there.
    """

    def __init__(self, columns: int) -> None:
        self._sum = np.zeros(columns)
        self._break: float | None = None  # at which the present piece begins
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
        """Begin anew at a break; one that follows too closely on another is left out."""
        if len(self._t) < 2:
            return
        last = _span(self._t[-NODES:], self._f[-NODES:], self._t[-1], instant)
        self._sum = self.total() + last
        self._t, self._f = self._t[:0], self._f[:0]
        self._first, self._break = True, instant

    def _extend(self, t: Array, f: Array) -> None:
        if not len(t):
            return
        self._t = np.concatenate([self._t, t])
        self._f = np.concatenate([self._f, f])
        if len(self._t) < NODES:
            return
        if self._first:
            self._sum = self._sum + self._head()
            self._sum += self._intervals(np.array([0]), np.array([0]))
        new = np.arange(0 if self._first else 1, len(self._t) - NODES + 1)
        self._sum += self._intervals(new, new + 1)
        self._first = False
        self._t, self._f = self._t[-NODES:], self._f[-NODES:]

    def total(self) -> Array:
        """From the first to the last sample so far, shape (columns,)."""
        n = len(self._t)
        rest = range(n - 1) if self._first else [n - 2]
        start = self._sum + self._head() if self._first and n else self._sum
        return sum((_integral(self._t, self._f, i) for i in rest), start)

    def _head(self) -> Array:
        """From the break at which the piece begins to its first sample."""
        if self._break is None:
            return np.zeros_like(self._sum)
        return _span(self._t[:NODES], self._f[:NODES], self._break, self._t[0])

    def _intervals(self, windows: Indices, left: Indices) -> Array:
        """Sum of the integrals from samples `left` to the next, by the cubics of the windows."""
        nodes = windows[:, None] + np.arange(NODES)
        weights = _weights(self._t[nodes], self._t[left], self._t[left + 1])
        return np.einsum("kj,kjc->c", weights, self._f[nodes])


def _span(t: Array, f: Array, start: float, end: float) -> Array:
    """From start to end, with the one polynomial through all the samples given."""
    return _weights(t[None], np.array([start]), np.array([end]))[0] @ f


def _integral(t: Array, f: Array, left: int) -> Array:
    """From t[left] to t[left + 1], with the one polynomial through all the samples given."""
    return _span(t, f, t[left], t[left + 1])


def _weights(nodes: Array, start: Array, end: Array) -> Array:
    """Weights of the values at `nodes` (k, m), m <= 4, in the integrals from start to end (k,)."""
    middle, half = 0.5 * (start + end), 0.5 * (end - start)
    weights = np.zeros_like(nodes)
    for point in _GAUSS:
        x = middle + half * point
        for j in range(nodes.shape[1]):
            others = np.delete(nodes, j, axis=1)
            factors = (x[:, None] - others) / (nodes[:, j, None] - others)
            weights[:, j] += half * factors.prod(axis=1)
    return weights


class CheckedQuadrature:
    """A quadrature that also says what half the samples would have given."""

    def __init__(self, columns: int) -> None:
        self._all, self._half = Quadrature(columns), Quadrature(columns)
        self._seen = 0
        self._left_out: tuple[Array, Array] | None = None

    def add(self, t: Array, f: Array, breaks: Sequence[float] = ()) -> None:
        """The next samples, as in Quadrature."""
        if not len(t):
            return
        self._all.add(t, f, breaks)
        skip = self._seen % 2
        self._half.add(t[skip::2], f[skip::2], breaks)
        self._seen += len(t)
        self._left_out = None if self._seen % 2 else (t[-1:], f[-1:])

    def finish(self) -> tuple[Array, Array]:
        """(integral, how much it changes with every other sample left out), each (columns,)."""
        if self._left_out is not None:
            self._half.add(*self._left_out)
            self._left_out = None
        total = self._all.total()
        return total, np.abs(total - self._half.total())
