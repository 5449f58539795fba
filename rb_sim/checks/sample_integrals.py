# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Integrals over the samples of a run, in bounded memory, and whether the samples resolve it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rb_sim.mechanics.samples import Array, Indices
from rb_sim.numerics.rotations import cross, norms, turn_between

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import SampleBlock

# Integrals of sampled functions by the cubics through four neighbours.
#
# Where the functions break, as forces do at an impact, the cubics of either side go up to there.
# Between two breaks the integral from a sample to the next is that of the cubic through the two and
# their neighbours, at the ends through the four nearest; of fewer samples all make one polynomial.
# What leaving out the farthest of these samples changes, interval by interval and added up without
# signs, is how far the integral may be wrong: errors of two intervals may cancel by chance.


NODES = 4
"""Samples per interpolating cubic: the rule is of order 4 for smooth functions."""

GAUSS = 3.0**-0.5
"""Two points, this far from the middle of an interval of half length 1, integrate a cubic."""

LONG = 10.0
"""Times all its neighbours, from which on an interval is a gap: nobody knows what was in it."""

MANY_WAITING = 256
"""Samples that wait to be integrated together."""


def integrals(t: Array, f: Array, breaks: Array) -> Array:
    """Integral, how far it may be wrong, and integral of |f| by trapezoids, of each interval,
    shape (3, n - 1, columns).

    t: (n,), increasing; f: (n, columns); breaks: increasing, a sample at one counts as after it.
    """
    piece = np.searchsorted(breaks, t, side="right")
    first, end = np.searchsorted(piece, piece), np.searchsorted(piece, piece, side="right")
    divided = piece[1:] > piece[:-1]
    cut, whole = np.flatnonzero(divided), np.flatnonzero(~divided)
    size = 0.5 * np.diff(t)[:, None] * (np.abs(f[1:]) + np.abs(f[:-1]))
    found = np.stack([np.zeros_like(size), np.zeros_like(size), size])
    largest = np.maximum(np.abs(f[1:]), np.abs(f[:-1]))
    spans = _Spans(t, f, first, end)
    found[:2, whole] = spans.parts(t[whole], t[whole + 1], whole, whole - 1, largest[whole])
    if len(cut):
        # several breaks between two samples count as the first, and what lies between is in doubt
        at, last = breaks[piece[cut]], breaks[piece[cut + 1] - 1]
        found[:2, cut] = spans.parts(t[cut], at, cut, cut, largest[cut])
        found[:2, cut] += spans.parts(at, t[cut + 1], cut + 1, cut + 1, largest[cut])
        found[1, cut] += (last - at)[:, None] * largest[cut]
    return found


class _Spans(NamedTuple):
    """Samples between breaks."""

    t: Array
    f: Array
    first: Indices
    """of the samples between the same two breaks, for each sample."""
    end: Indices

    def parts(
        self, start: Array, stop: Array, at: Indices, begin: Indices, largest: Array
    ) -> Array:
        """Integral over each span from start to stop (S,), and how far it may be wrong, shape
        (2, S, columns).

        at: a sample (S,) between the same two breaks as the span; begin: where its NODES samples
        begin if they can; largest: |f| (S, columns) where nobody knows better.
        """
        t, out = self.t, np.zeros((2, len(start), self.f.shape[1]))
        low, high = self.first[at], self.end[at]
        begin = np.maximum(low, np.minimum(begin, high - NODES))
        count = np.minimum(high - low, NODES)
        for n in np.flatnonzero(np.bincount(count)).tolist():
            span = np.flatnonzero(count == n) if (count != n).any() else slice(None)
            a, b, nodes = start[span], stop[span], begin[span] + np.arange(n)[:, None]
            order = np.abs(t[nodes] - 0.5 * (a + b)).argsort(axis=0, kind="stable")
            nodes = np.take_along_axis(nodes, order, 0)
            x, unknown = t[nodes], (b - a)[:, None] * largest[span]
            terms = _terms(a, b, x, list(self.f[nodes]))
            out[0, span] = sum(terms)
            if n < 3:
                out[1, span] = unknown
                continue
            # beside the samples one term that vanishes by chance says nothing
            beside = (a < x.min(axis=0)) | (b > x.max(axis=0))
            lengths = np.sort(np.diff(np.sort(x, axis=0), axis=0), axis=0)
            gap = ~beside & (b - a > LONG * lengths[-2])
            doubt = np.abs(terms[-1]) + np.where(beside[:, None], np.abs(terms[-2]), 0.0)
            out[1, span] = np.where(gap[:, None], unknown, doubt)
        return out


def _terms(a: Array, b: Array, x: Array, values: list[Array]) -> list[Array]:
    """The integrals from a to b (S,) of the terms of Newton's form of the polynomial through
    values (n, S, columns) at x (n, S), in their order; n at most NODES."""
    middle, half = 0.5 * (a + b), 0.5 * (b - a)
    places = middle - GAUSS * half, middle + GAUSS * half
    terms, products = [], [np.ones_like(middle)] * 2
    for k in range(len(x)):
        terms.append((half * (products[0] + products[1]))[:, None] * values[0])
        products = [p * (place - x[k]) for p, place in zip(products, places, strict=True)]
        steps = [(x[j + k + 1] - x[j])[:, None] for j in range(len(values) - 1)]
        values = [(values[j + 1] - values[j]) / step for j, step in enumerate(steps)]
    return terms


class Quadrature:
    """Integrals of sampled functions over samples that come in pieces; memory does not grow."""

    def __init__(self, columns: int) -> None:
        self._t, self._f = np.zeros(0), np.zeros((0, columns))
        """the last samples, on which the integral over the last intervals hangs."""
        self._breaks: list[float] = []
        """that lie among these samples, or after them."""
        self._open = 0
        """the first of the intervals between them that more samples may change."""
        self._settled, self._last = np.zeros((3, columns)), np.zeros((3, columns))
        """sums of `integrals` over the intervals before, and from there on."""
        self._waiting: list[tuple[Array, Array]] = []
        self._count = 0

    def add(self, t: Array, f: Array, breaks: Sequence[float] = ()) -> None:
        """The next samples. t: shape (n,), increasing, any spacing; f: shape (n, columns).

        breaks: increasing, where f or its derivatives jump; a sample there counts as after it.
        """
        self._breaks += breaks
        self._waiting.append((np.array(t), np.array(f)))
        self._count += len(t)
        if self._count >= MANY_WAITING:
            self._take()

    def total(self) -> Array:
        """Integral, how far it may be wrong, and integral of |f| by trapezoids, from the first to
        the last sample so far, shape (3, columns)."""
        if self._waiting:
            self._take()
        return self._settled + self._last

    def _take(self) -> None:
        """Integrate over what waits."""
        times, values = zip(*self._waiting, strict=True)
        self._t = t = np.concatenate([self._t, *times])
        self._f = f = np.concatenate([self._f, *values])
        self._waiting, self._count = [], 0
        if len(t) < 2:
            return
        breaks = np.array(self._breaks, dtype=float)
        found = integrals(t, f, breaks)[:, self._open :]
        # settled is what lies before the last break, or has a sample after its cubic
        begun = int(np.searchsorted(t, breaks[breaks <= t[-1]].max(initial=-np.inf)))
        settled = len(t) - 2 if len(t) - begun >= NODES else max(begun - 1, 0)
        self._settled = self._settled + found[:, : settled - self._open].sum(axis=1)
        self._last = found[:, settled - self._open :].sum(axis=1)
        kept = max(0, settled - NODES + 1)
        self._t, self._f, self._open = t[kept:], f[kept:], settled - kept
        self._breaks = breaks[breaks > t[kept]].tolist()


# Whether the samples of a run resolve its motion, so that integrals over them mean something.


#     x(t1) - x(t0) = (t1 - t0) (v(t0) + v(t1)) / 2 + O(dt^3)
#
# holds to a fraction where they do; a body that turns by much between two samples is not resolved.
# So does its turn between them about each of its axes, up to what turns about two axes make of each
# other,
#
#     2 (q(t0)^-1 q(t1))_xyz = (t1 - t0) (w(t0) + w(t1)) / 2 + O(dt^2),
#
# for a thin rod may swing about its own axis without turning far: the power of a damper there goes
# to and fro between samples. Where a body hardly moves the fraction says little, and where a coarse
# method parts positions from velocities it is not the samples' fault: what all intervals miss is
# held against the whole way, too.


PART = 0.2
"""Share of the way that the trapezoid of the velocities may miss."""

PART_OF_ALL = 0.1
"""Share of the whole way of a body that all its intervals together may miss."""

TURN = 0.5
"""Angle between two samples [rad]."""

MOST = 0.02
"""Share of the intervals that may be unresolved: impacts and other jumps."""

MANY = 256
"""Intervals of one block from which on every fourth stands for all."""


class Resolution:
    """Counts the intervals between samples that do not resolve the motion of a body."""

    def __init__(self, bodies: int) -> None:
        self._last: tuple[np.ndarray, ...] | None = None
        self._intervals = 0
        self._missed, self._turned = np.zeros((2, bodies), dtype=int)
        self._all = np.zeros((2, bodies, 4))
        """What the intervals miss of the way [m] and of the turn about each axis [rad], and these
        themselves, added up."""

    def resolved(self, bodies: Sequence[int] | None = None) -> bool:
        """Whether integrals over the samples so far of what hangs on these bodies (None: on all)
        can be trusted: they turn little between two, and the velocities at the samples tell the
        ways between them."""
        chosen = slice(None) if bodies is None else list(bodies)
        most = MOST * self._intervals
        if (self._turned[chosen] > most).any():
            return False
        missed, way = self._all[:, chosen]
        return bool((self._missed[chosen] <= most).all() or (missed <= PART_OF_ALL * way).all())

    def add(self, block: SampleBlock) -> None:
        """The next samples."""
        columns = block.t, block.position, block.linear_velocity, block.orientation
        columns = *columns, block.angular_velocity
        last, self._last = self._last, tuple(column[-1:] for column in columns)
        if last is not None:
            columns = tuple(np.append(*pair, 0) for pair in zip(last, columns, strict=True))
        t, x, v, q, w = columns
        if len(t) < 2:
            return
        stride = 1 if len(t) <= MANY else 4
        ends, starts = slice(1, None, stride), slice(0, -1, stride)
        dt = (t[ends] - t[starts])[:, None]
        with np.errstate(all="ignore"):
            moved = x[ends] - x[starts]
            expected = 0.5 * dt[..., None] * (v[ends] + v[starts])
            noise = 1e-12 * np.abs(x[ends]).max(axis=0).max(axis=1)
            way = norms(moved - expected), norms(moved) + norms(expected), noise
            turn = turned(q[starts], q[ends], dt[..., None] * w[starts], dt[..., None] * w[ends])
            # rounding is no part of what is missed: of what is held at rest it is all of the way
            parts = [np.maximum(0.0, miss - noise) for miss, _, noise in (way, turn)]
            miss = np.concatenate([parts[0][..., None], parts[1]], axis=2)
            size = np.concatenate([way[1][..., None], turn[1]], axis=2)
            fast = ~(norms(w[ends]) * dt <= TURN)
            lost = fast | np.any(~(miss <= PART * size), axis=2)
        self._intervals += stride * len(dt)
        self._missed += stride * lost.sum(axis=0)
        self._turned += stride * fast.sum(axis=0)
        self._all += stride * np.stack([miss.sum(axis=0), size.sum(axis=0)])


def turned(
    before: np.ndarray, after: np.ndarray, spin_before: np.ndarray, spin: np.ndarray
) -> tuple[np.ndarray, ...]:
    """About each axis of each body what the mean of the spins, times the interval [rad], misses of
    the turn, more than turns about two axes make of each other (Magnus 1954) and a sine of its
    angle; both sizes, (n, bodies, 3); and what is rounding."""
    found = turn_between(before, after)
    expected = 0.5 * (spin_before + spin)
    both = norms(cross(spin_before, spin)) / 6.0 + norms(expected) ** 3 / 12.0
    miss = np.maximum(0.0, np.abs(found - expected) - both[..., None])
    return miss, np.abs(found) + np.abs(expected), np.full(1, 1e-12)
