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

from typing import TYPE_CHECKING

import numpy as np

from rb_sim.numerics.rotations import cross, norms, turn_between

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array, SampleBlock

Flags = np.ndarray
"""Of truth values."""

# Integrals of sampled functions by cubics through four neighbours.
#
# The integral from one sample to the next is that of the cubic through these two and their
# neighbours, or through the four nearest samples at the ends of a piece, or of the polynomial
# through all samples of a shorter piece. The change if the farthest sample is left out, summed over
# the intervals without signs, is the uncertainty. An interval that is left out separates pieces.


NODES = 4
"""Samples of a cubic: the rule has order 4 for smooth functions."""

GAUSS = 3.0**-0.5
"""Gauss points of an interval of half length 1 about its middle; two integrate a cubic exactly."""

LONG = 10.0
"""An interval longer than its neighbours by this factor is a gap, in which nothing is known."""

MANY_WAITING = 256
"""Number of samples that are integrated together."""


def integrals(t: Array, f: Array, left_out: Flags | None = None) -> Array:
    """Integral, its uncertainty, and integral of |f| by trapezoids over each interval, (3, n - 1,
    columns); the first two are 0 in intervals that are left out.

    t: (n,), increasing; f: (n, columns); left_out: whether the interval up to each sample is, (n,).
    """
    piece = np.cumsum(np.zeros(len(t), dtype=bool) if left_out is None else left_out)
    low, high = np.searchsorted(piece, piece), np.searchsorted(piece, piece, side="right")
    size = 0.5 * np.diff(t)[:, None] * (np.abs(f[1:]) + np.abs(f[:-1]))
    found = np.stack([np.zeros_like(size), np.zeros_like(size), size])
    inside = np.flatnonzero(piece[1:] == piece[:-1])
    count = np.minimum(high - low, NODES)[inside]
    for n in np.flatnonzero(np.bincount(count)).tolist():
        k = inside[count == n]
        a, b = t[k], t[k + 1]
        nodes = np.maximum(low[k], np.minimum(k - 1, high[k] - n)) + np.arange(n)[:, None]
        order = np.abs(t[nodes] - 0.5 * (a + b)).argsort(axis=0, kind="stable")
        nodes = np.take_along_axis(nodes, order, 0)
        terms = _terms(a, b, t[nodes], list(f[nodes]))
        found[0, k] = sum(terms)
        unknown = (b - a)[:, None] * np.maximum(np.abs(f[k + 1]), np.abs(f[k]))
        if n > 2:
            lengths = np.sort(np.diff(np.sort(t[nodes], axis=0), axis=0), axis=0)
            unknown = np.where((b - a > LONG * lengths[-2])[:, None], unknown, np.abs(terms[-1]))
        found[1, k] = unknown
    return found


def _terms(a: Array, b: Array, x: Array, values: list[Array]) -> list[Array]:
    """Integrals from a to b (S,) of the terms of Newton's polynomial through values (n, S, columns)
    at x (n, S); n at most NODES."""
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
    """Integrals of sampled functions over samples that arrive in blocks, in bounded memory."""

    def __init__(self, columns: int) -> None:
        self._t, self._f = np.zeros(0), np.zeros((0, columns))
        """the last samples, which the integrals over the last intervals need ..."""
        self._left_out = np.zeros(0, dtype=bool)
        """... and whether the interval up to each is left out."""
        self._open = 0
        """the first interval between them whose integral later samples may change."""
        self._final, self._last = np.zeros((3, columns)), np.zeros((3, columns))
        """sums of `integrals` over the intervals before it, and from it on."""
        self._waiting: list[tuple[Array, Array, Array]] = []
        self._count = 0

    def add(self, t: Array, f: Array, left_out: Flags | None = None) -> None:
        """Add samples. t: (n,), increasing, any spacing; f: (n, columns); left_out: whether the
        interval up to each sample is left out."""
        none = np.zeros(len(t), dtype=bool)
        self._waiting.append((np.array(t), np.array(f), none if left_out is None else left_out))
        self._count += len(t)
        if self._count >= MANY_WAITING:
            self._take()

    def total(self) -> Array:
        """Integral, its uncertainty, and integral of |f| by trapezoids over all samples so far, (3,
        columns)."""
        if self._waiting:
            self._take()
        return self._final + self._last

    def _take(self) -> None:
        """Integrate over the waiting samples."""
        times, values, left_out = zip(*self._waiting, strict=True)
        self._t = t = np.concatenate([self._t, *times])
        self._f = f = np.concatenate([self._f, *values])
        self._left_out = out = np.concatenate([self._left_out, *left_out])
        self._waiting, self._count = [], 0
        if len(t) < 2:
            return
        found = integrals(t, f, out)[:, self._open :]
        # final are intervals before the last piece, and those with a sample after their cubic
        begun = int(np.flatnonzero(out).max(initial=0))
        final = len(t) - 2 if len(t) - begun >= NODES else max(begun - 1, 0)
        self._final = self._final + found[:, : final - self._open].sum(axis=1)
        self._last = found[:, final - self._open :].sum(axis=1)
        kept = max(0, final - NODES + 1)
        self._t, self._f, self._open = t[kept:], f[kept:], final - kept
        self._left_out = out[kept:].copy()


# Intervals in which the samples do not resolve the motion, so that integrals have no meaning.
#
# If they resolve it, a body turns by less than TURN, and its displacement and its rotation about
# each of its axes agree with its velocities to a fraction:
#
#     x(t1) - x(t0) = (t1 - t0) (v(t0) + v(t1)) / 2 + O(dt^3)
#     2 (q(t0)^-1 q(t1))_xyz = (t1 - t0) (w(t0) + w(t1)) / 2 + O(dt^2)
#
# Each axis is compared by itself, since a thin rod may oscillate about its own axis while it turns
# little about the others.


PART = 0.2
"""Largest relative difference between displacement and integrated velocity."""

TURN = 0.5
"""Largest rotation between two samples [rad]."""

MOST = 0.1
"""Largest share of unresolved intervals, e.g. with impacts; above it the integrals are not used."""


class Resolution:
    """Finds the intervals between samples that do not resolve the motion of a body."""

    def __init__(self) -> None:
        self._last: tuple[np.ndarray, ...] | None = None

    def missed(self, block: SampleBlock) -> Flags:
        """Whether the interval up to each of the next samples is not resolved, for each body,
        shape (n, bodies); False at the first sample of all."""
        columns = block.t, block.position, block.linear_velocity, block.orientation
        columns = *columns, block.angular_velocity
        last, self._last = self._last, tuple(column[-1:] for column in columns)
        if last is None:
            last = tuple(column[:1] for column in columns)
        t, x, v, q, w = (np.append(*pair, 0) for pair in zip(last, columns, strict=True))
        dt = np.diff(t)[:, None]
        with np.errstate(all="ignore"):
            moved, expected = np.diff(x, axis=0), 0.5 * dt[..., None] * (v[1:] + v[:-1])
            noise = 1e-12 * np.abs(x[1:]).max(axis=0).max(axis=1)
            miss, way = norms(moved - expected), norms(moved) + norms(expected)
            turn = turned(q[:-1], q[1:], dt[..., None] * w[:-1], dt[..., None] * w[1:])
            # for a body at rest the whole displacement is rounding
            lost = ~(norms(w[1:]) * dt <= TURN) | ~(miss - noise <= PART * way)
            return lost | np.any(~(turn[0] - turn[2] <= PART * turn[1]), axis=2)


def turned(
    before: np.ndarray, after: np.ndarray, spin_before: np.ndarray, spin: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Difference between the rotation and the mean angular velocity times the interval, about each
    body axis [rad], beyond the commutator (Magnus 1954) and the sine of the angle; the sum of both
    sizes, (n, bodies, 3) each; and rounding. spin_before, spin: times the interval [rad]."""
    found = turn_between(before, after)
    expected = 0.5 * (spin_before + spin)
    both = norms(cross(spin_before, spin)) / 6.0 + norms(expected) ** 3 / 12.0
    miss = np.maximum(0.0, np.abs(found - expected) - both[..., None])
    return miss, np.abs(found) + np.abs(expected), np.full(1, 1e-12)
