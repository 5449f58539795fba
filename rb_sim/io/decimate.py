"""Long runs in bounded memory: fewer points, but none of the peaks lost."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array


class Thinned:
    """Every stride-th row and the last one; the stride doubles when `capacity` is reached."""

    def __init__(self, columns: int, capacity: int) -> None:
        self._capacity = capacity
        self._room = np.empty((0, columns))
        """rows that are kept, `_count` of them, and room for more: it doubles when it is full."""
        self._count = 0
        self._last = np.empty((0, columns))
        self._stride = 1
        self._seen = 0

    def add(self, rows: Array) -> None:
        """The next rows, shape (n, columns)."""
        if not len(rows):
            return
        first = -self._seen % self._stride
        self._seen += len(rows)
        self._keep(rows[first :: self._stride])
        self._last = rows[-1:].copy()
        while self._count > self._capacity:
            kept = self._room[: self._count : 2].copy()
            self._count = len(kept)
            self._room[: self._count] = kept
            self._stride *= 2

    def _keep(self, rows: Array) -> None:
        count = self._count + len(rows)
        if count > len(self._room):
            size = max(count, min(2 * len(self._room), self._capacity))
            room = np.empty((size, self._room.shape[1]))
            room[: self._count] = self._room[: self._count]
            self._room = room
        self._room[self._count : count] = rows
        self._count = count

    @property
    def rows(self) -> Array:
        """At most capacity + 1 rows, from the first to the last."""
        return np.concatenate([self._room[: self._count], self._last])


BATCH = 1024
"""Samples that are collected before they are put into buckets."""


class Envelope:
    """Curves over time as the least and greatest value in each of at most 2 `capacity` buckets.

    A bucket is one sample as long as there are few; then two, four, ... samples. Columns are kept
    as rows, along which numpy is several times faster.
    """

    def __init__(self, columns: int, capacity: int) -> None:
        self._capacity = capacity
        self._times = np.empty(0)
        self._low = np.empty((columns, 0))
        self._high = np.empty((columns, 0))
        self._stride = 1
        self._pending: list[tuple[Array, Array]] = []
        self._waiting = 0
        self._open = 0  # samples in the last bucket, if it is not full

    def add(self, t: Array, values: Array) -> None:
        """The next samples, kept as they are. t: shape (n,), increasing; values: (n, columns)."""
        self._pending.append((t, values))
        self._waiting += len(t)
        if self._waiting >= BATCH:
            self._settle()

    def curves(self) -> tuple[Array, Array]:
        """Times, shape (m,), and values, shape (m, columns), to draw as lines."""
        self._settle()
        if self._stride == 1:
            return self._times, self._low.T
        both = np.stack([self._low, self._high], axis=2)
        return np.repeat(self._times, 2), both.reshape(len(both), -1).T

    def _settle(self) -> None:
        """Put what is pending into buckets."""
        pending, self._pending, self._waiting = self._pending, [], 0
        for t, values in pending:
            rows = np.ascontiguousarray(values.T)
            while len(t):
                n = min(len(t), self._room())
                self._put(t[:n], rows[:, :n])
                t, rows = t[n:], rows[:, n:]
                if len(self._times) >= 2 * self._capacity and not self._open:
                    self._halve()

    def _room(self) -> int:
        """Samples until the open bucket is full, or as many as make whole buckets at once."""
        if self._open:
            return self._stride - self._open
        return self._stride * max(1, 2 * self._capacity - len(self._times))

    def _put(self, t: Array, rows: Array) -> None:
        """Samples that fill the open bucket or a part of it, or start new ones."""
        if self._open:
            self._low[:, -1] = np.minimum(self._low[:, -1], rows.min(axis=1))
            self._high[:, -1] = np.maximum(self._high[:, -1], rows.max(axis=1))
        else:
            self._times = np.concatenate([self._times, t[:: self._stride]])
            self._low = np.hstack([self._low, _of_buckets(np.minimum, rows, self._stride)])
            self._high = np.hstack([self._high, _of_buckets(np.maximum, rows, self._stride)])
        self._open = (self._open + len(t)) % self._stride

    def _halve(self) -> None:
        """Join buckets in pairs."""
        self._times = self._times[::2].copy()
        self._low = _of_buckets(np.minimum, self._low, 2)
        self._high = _of_buckets(np.maximum, self._high, 2)
        self._stride *= 2


def _of_buckets(of: np.ufunc, rows: Array, stride: int) -> Array:
    """The least or greatest number of each `stride` (a power of 2) in a row, and of what is left.

    In pairs, pairs of pairs, ...: several times faster than `of.reduceat`.
    """
    whole = rows.shape[1] // stride * stride
    found, rest = rows[:, :whole], rows[:, whole:]
    while stride > 1:
        found, stride = of(found[:, ::2], found[:, 1::2]), stride // 2
    return np.hstack([found, of.reduce(rest, axis=1, keepdims=True)]) if rest.size else found
