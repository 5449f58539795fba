# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Interface of sinks, order of their samples, and data reduction for long runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from rb_sim.mechanics.samples import ARRAYS, Input, SampleBlock

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array, ContactEvent, SampleLayout
    from rb_sim.scene.schema import Scene


# Interface of every logger, topic set and recorder.


class Sink(Protocol):
    """Receives the samples of one run in time order."""

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Called once before the first sample."""
        ...

    def write(self, block: SampleBlock) -> None:
        """Called with every block of samples, in time order."""
        ...

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Called at the end, also after errors and signals; may be called again.

        What was written so far must be readable afterwards.
        """
        ...


# Monotonic time, for logs of a simulation that may be reset.


class Timeline:
    """Simulated time that continues after a reset of the simulation."""

    def __init__(self) -> None:
        self._last: float | None = None
        self._offset = 0.0

    @property
    def offset(self) -> float:
        """Present offset added to times [s]."""
        return self._offset

    def follow(self, t: Array) -> Array:
        """The times `t` [s] of the next samples, shifted so that they never decrease."""
        if not len(t):
            return t
        steps = np.diff(t, prepend=t[0] if self._last is None else self._last)
        offsets = self._offset + np.cumsum(np.maximum(0.0, -steps))
        self._last, self._offset = float(t[-1]), float(offsets[-1])
        return t + offsets


def event_text(event: ContactEvent) -> str:
    """A contact event as one line of text."""
    strength = float(np.linalg.norm(event.impulse))
    struck = f", impulse {strength:.4g} N s" if strength else ""
    return f"t = {event.t:.9g} s: {event.contact} {event.kind}{struck}"


# Restarts of a run: no motion connects the samples before and after.


def restarts(inputs: tuple[Input, ...]) -> list[tuple[int, Input]]:
    """(sample index, last reset or set state before it) for each sample that follows one."""
    return list({given.index: given for given in inputs if not given.body or given.state}.items())


def stretches(block: SampleBlock) -> Iterator[tuple[SampleBlock, Input | None]]:
    """Parts of a block, each with the reset or set state before it; None without one."""
    done, before, left = 0, None, block
    for index, given in restarts(block.inputs):
        if index > done:
            part, left = split_at(left, index - done)
            yield part, before
            done = index
        before = given
    yield left, before


def split_at(block: SampleBlock, size: int) -> tuple[SampleBlock, SampleBlock]:
    """The first `size` > 0 samples, and the rest; events stay with the sample that they precede."""
    first, rest = samples_at(block, slice(None, size)), samples_at(block, slice(size, None))
    end = first.t[-1] if len(rest) else np.inf
    before = tuple(event for event in block.events if event.t <= end)
    now = tuple(given for given in block.inputs if given.index < size)
    later = tuple(g._replace(index=g.index - size) for g in block.inputs[len(now) :])
    return (
        replace(first, events=before, inputs=now),
        replace(rest, events=block.events[len(before) :], inputs=later),
    )


def samples_at(block: SampleBlock, which: Any) -> SampleBlock:
    """The samples of a slice or with these indices, without events and inputs."""
    arrays = {name: getattr(block, name)[which] for name in ARRAYS}
    return replace(block, **arrays, events=(), inputs=())


# Data reduction of long runs in bounded memory.


class Thinned:
    """Every stride-th row and the last one; the stride doubles when `capacity` is reached."""

    def __init__(self, columns: int, capacity: int) -> None:
        self._capacity = capacity
        self._room = np.empty((0, columns))
        """buffer of rows, of which `_count` are used; doubled when full."""
        self._count = 0
        self._last = np.empty((0, columns))
        self._stride = 1
        self._seen = 0

    def add(self, rows: Array) -> None:
        """Append rows, shape (n, columns)."""
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
        """At most capacity + 1 rows, including first and last."""
        return np.concatenate([self._room[: self._count], self._last])


BATCH = 1024
"""Number of samples collected before they are put into buckets."""


class Envelope:
    """Curves over time as least and largest value in each of at most 2 `capacity` buckets.

    A bucket is one sample at first, then two, four, ... samples. Columns are stored as rows, along
    which numpy is several times faster.
    """

    def __init__(self, columns: int, capacity: int) -> None:
        self._capacity = capacity
        self._times = np.empty(0)
        self._low = np.empty((columns, 0))
        self._high = np.empty((columns, 0))
        self._stride = 1
        self._waiting = [(np.empty(0), np.empty((0, columns)))]
        """samples not yet in a bucket."""
        self._fresh = 0
        """number of samples since buckets were made."""

    def add(self, t: Array, values: Array) -> None:
        """Append samples, without a copy. t: shape (n,), increasing; values: (n, columns)."""
        self._waiting.append((t, values))
        self._fresh += len(t)
        if self._fresh >= max(BATCH, self._stride):
            self._fill_buckets()

    def curves(self) -> tuple[Array, Array]:
        """Times, shape (m,), and values, shape (m, columns), to plot as lines."""
        ((t, rest),) = self._fill_buckets()
        times, low, high = self._times, self._low, self._high
        if len(t):  # the last, partly filled bucket
            times = np.append(times, t[0])
            low = np.column_stack([low, rest.min(axis=0)])
            high = np.column_stack([high, rest.max(axis=0)])
        if self._stride == 1:
            return times, low.T
        both = np.stack([low, high], axis=2)
        return np.repeat(times, 2), both.reshape(len(both), -1).T

    def _fill_buckets(self) -> list[tuple[Array, Array]]:
        """Put waiting samples into buckets, as many as are full; returns the rest."""
        parts = [part for part in self._waiting if len(part[0])] or self._waiting[:1]
        t, values = parts[0]
        if len(parts) > 1:  # a single part needs no copy
            t, values = (np.concatenate(part) for part in zip(*parts, strict=True))
        while len(t) >= self._stride:
            room = 2 * self._capacity - len(self._times)
            n = self._stride * min(room, len(t) // self._stride)
            rows = np.ascontiguousarray(values[:n].T)
            self._times = np.concatenate([self._times, t[: n : self._stride]])
            self._low = np.hstack([self._low, _of_buckets(np.minimum, rows, self._stride)])
            self._high = np.hstack([self._high, _of_buckets(np.maximum, rows, self._stride)])
            t, values = t[n:], values[n:]
            if len(self._times) == 2 * self._capacity:
                self._times = self._times[::2].copy()
                self._low = _of_buckets(np.minimum, self._low, 2)
                self._high = _of_buckets(np.maximum, self._high, 2)
                self._stride *= 2
        self._waiting, self._fresh = [(t, values)], 0
        return self._waiting


def _of_buckets(of: np.ufunc, rows: Array, stride: int) -> Array:
    """Least or largest value in each bucket of `stride` columns (a power of 2).

    By repeated pairing, which is several times faster than `of.reduceat`.
    """
    while stride > 1:
        rows, stride = of(rows[:, ::2], rows[:, 1::2]), stride // 2
    return rows
