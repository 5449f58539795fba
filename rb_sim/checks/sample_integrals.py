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
from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rb_sim.integrate.quadrature import GAP, SIGNED, SIZE, SUM, UNRESOLVED, Integral, Samples
from rb_sim.mechanics.samples import Array
from rb_sim.numerics.rotations import cross, norms, turn_between

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import SampleBlock, SampleLayout

# Intervals between samples so long that nobody knows what was in between.


LONG = 10.0
"""Times the usual interval, from which on one is a gap."""
EARLY = 1024
"""Intervals that tell which is the usual one."""


class Gaps:
    """Adds up the integral of |f| over the gaps of samples that come in pieces; bounded memory."""

    def __init__(self, columns: int) -> None:
        self._last: tuple[Array, Array] | None = None
        self._early: list[tuple[Array, Array]] = []
        """intervals, and integrals over them, as long as the usual one is not settled."""
        self.usual: float | None = None
        """the usual interval [s], once enough are known."""
        self._sum = np.zeros(columns)

    def add(self, t: Array, f: Array) -> None:
        """The next samples. t: shape (n,), increasing, n > 0; f: shape (n, columns)."""
        if self._last is not None:
            t, f = np.concatenate([self._last[0], t]), np.concatenate([self._last[1], f])
        self._last = t[-1:], f[-1:]
        steps = np.diff(t)
        if self.usual is not None:
            far = np.flatnonzero(steps > LONG * self.usual)
            if len(far):
                self._sum = self._sum + _sizes(steps, f, far).sum(axis=0)
        elif len(steps):
            self._early.append((steps, _sizes(steps, f, np.arange(len(steps)))))
            if sum(len(part) for part, _ in self._early) >= EARLY:
                self.usual, self._sum = _gaps_in(self._early)
                self._early.clear()

    def total(self) -> Array:
        """Of all gaps so far, shape (columns,)."""
        return _gaps_in(self._early)[1] if self._early else self._sum


def _sizes(steps: Array, f: Array, which: np.ndarray) -> Array:
    """Integrals of |f| over some of the intervals, shape (len(which), columns)."""
    return 0.5 * steps[which, None] * (np.abs(f[which]) + np.abs(f[which + 1]))


def _gaps_in(parts: list[tuple[Array, Array]]) -> tuple[float, Array]:
    """The usual interval, such that half of the time lies in shorter ones (those beside events are
    short, and may be many), and the sum of the integrals over those that are LONG."""
    steps = np.concatenate([part[0] for part in parts])
    sizes = np.concatenate([part[1] for part in parts])
    ordered = np.sort(steps)
    lengths = np.cumsum(ordered)
    usual = float(ordered[np.searchsorted(lengths, 0.5 * lengths[-1])])
    return usual, sizes[steps > LONG * usual].sum(axis=0)


# Integrals over the samples of a run, as they come: memory does not grow.


class Quadrature:
    """Integral of a sampled function, shape (columns,), by the cubics through four neighbours.

    Where the function breaks, the cubics of either side go up to there; see `integrate.quadrature`.
    """

    def __init__(self, columns: int) -> None:
        self.integral = Integral(columns)
        self._waiting: list[float] = []
        """breaks after the last sample so far."""

    def add(self, t: Array, f: Array, breaks: Sequence[float] = ()) -> None:
        """The next samples. t: shape (n,), increasing, any spacing; f: shape (n, columns).

        breaks: increasing, where f or its derivatives jump; a sample there counts as after it.
        """
        self.take(Samples(t, f), breaks)

    def take(
        self, samples: Samples, breaks: Sequence[float] = (), first: int = 0, stride: int = 1
    ) -> None:
        """As add, of every stride-th sample from `first` on."""
        waiting = [*self._waiting, *breaks] if breaks else self._waiting
        if samples.count > first:
            used = self.integral.take(samples, waiting, first, stride)
            waiting = waiting[used:] if used else waiting
        self._waiting = waiting

    def total(self) -> Array:
        """From the first to the last sample so far, shape (columns,)."""
        return self.integral.ended()[:, SUM]

    def unresolved(self) -> Array:
        """What the samples leave open of the parts of the integral beside breaks, beyond the
        samples of a piece, shape (columns,)."""
        return self.integral.ended()[:, UNRESOLVED]

    def followed_by(self, samples: Samples) -> Quadrature:
        """Another quadrature of these samples and the next ones."""
        after = copy(self)
        after.integral = self.integral.copy()
        after.take(samples)
        return after


class CheckedQuadrature:
    """A quadrature that also says what half the samples would have given."""

    def __init__(self, columns: int) -> None:
        self._columns = columns
        self._all, self._half = Quadrature(columns), Quadrature(columns)
        self._seen = 0
        self._gaps: Gaps | None = Gaps(columns)
        """of the first intervals, until it is known how long the usual one is."""
        self._early_gaps = np.zeros(columns)
        self._left_out: Samples | None = None
        """whose last is none of the half."""
        self._finished: tuple[Array, Array] | None = None
        """what `finish` gave, until more comes."""

    def add(self, t: Array, f: Array, breaks: Sequence[float] = ()) -> None:
        """The next samples, as in Quadrature."""
        if not len(t):
            return
        self._finished = None
        samples = Samples(t, f)
        self._all.take(samples, breaks)
        self._half.take(samples, breaks, self._seen % 2, 2)
        self._seen += len(t)
        self._left_out = None if self._seen % 2 else samples
        if self._gaps is not None:
            self._gaps.add(t, f)
            if self._gaps.usual is not None:
                self._all.integral.gaps_from(LONG * self._gaps.usual)
                self._early_gaps, self._gaps = self._gaps.total(), None

    def by_trapezoids(self) -> Array:
        """Integrals of the size and of the function so far, (columns, 2)."""
        return self._all.integral.columns[:, SIZE : SIGNED + 1]

    def finish(self) -> tuple[Array, Array]:
        """(integral, how much it changes with every other sample left out), each (columns,).

        Of two samples none can be left out, and half of them have a gap as all do: there all of the
        integral is in doubt. Beside a break half of them may be the same as all: see `unresolved`.
        """
        if self._finished is None:
            self._finished = self._taken_together()
        return self._finished

    def _taken_together(self) -> tuple[Array, Array]:
        total = self._all.total()
        if self._seen == 2:
            return total, np.abs(total)
        half = self._half if self._left_out is None else self._half.followed_by(self._left_out.last)
        gaps = self._early_gaps + self._all.integral.columns[:, GAP]
        if self._gaps is not None:
            gaps = self._gaps.total()
        return total, np.abs(total - half.total()) + gaps + self._all.unresolved()


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


class Resolutions:
    """The resolution of all bodies, and of those whose motion the work of loads hangs on.

    Samples that do not resolve a body in a spring tell the work of a drag on another one all the
    same, and with it whether energy is lost.
    """

    def __init__(self, layout: SampleLayout, names: list[str] | None) -> None:
        """names: of the bodies whose motion tells the power of all loads; None: it takes all."""
        self.of_all = self.at_work = Resolution()
        self._at_work: list[int] = []
        if names is not None and len(names) < len(layout.bodies):
            self._at_work = [layout.bodies.index(name) for name in names]
            self.at_work = Resolution()

    def add(self, block: SampleBlock) -> None:
        """The next samples."""
        self.of_all.add(block)
        if self._at_work:
            self.at_work.add(_of_bodies(block, self._at_work))


def _of_bodies(block: SampleBlock, bodies: list[int]) -> SampleBlock:
    """The samples with the motions of these bodies only; momenta stay those of all."""
    names = "position", "linear_velocity", "orientation", "angular_velocity"
    return replace(block, **{name: getattr(block, name)[:, bodies] for name in names})


class Resolution:
    """Counts the intervals between samples that do not resolve the motion."""

    def __init__(self) -> None:
        self._last: tuple[np.ndarray, ...] | None = None
        self._intervals = self._missed = self._turned = 0
        self._all: tuple[np.ndarray, np.ndarray] | None = None
        """Of each body, and of each of its axes: what the intervals miss of the way [m] and of the
        turn [rad], and these themselves, added up."""
        self.unseen = np.zeros(2)
        """Impulse [N s] and its moment [N m s] that the samples may not show: the change of both
        momenta over the intervals that miss much of the motion, as where a disk that falls nearly
        flat rises again within one."""

    @property
    def resolved(self) -> bool:
        """Whether integrals over the samples so far can be trusted: bodies turn little between two,
        and the velocities at the samples tell the ways between them."""
        if self._turned > MOST * self._intervals:
            return False
        if self._missed <= MOST * self._intervals or self._all is None:
            return True
        missed, way = self._all
        return bool((missed <= PART_OF_ALL * way).all())

    def add(self, block: SampleBlock) -> None:
        """The next samples."""
        columns = block.t, block.position, block.linear_velocity, block.orientation
        columns = *columns, block.angular_velocity, block.momentum, block.angular_momentum
        last, self._last = self._last, tuple(column[-1:] for column in columns)
        if last is not None:
            columns = tuple(np.append(*pair, 0) for pair in zip(last, columns, strict=True))
        t, x, v, q, w, *momenta = columns
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
            turn = norms(w[ends]) * dt
            spins = dt[..., None] * w[starts], dt[..., None] * w[ends]
            parts = [way, turned(q[starts], q[ends], *spins)]
            miss, size, bad = ends_of(parts)
            turn = turn.max(axis=1)
            fast = ~(turn <= TURN)
        lost = bad | fast
        # by much, not only by much of what little an interval near rest has
        hidden = (~(miss <= PART * size.max(axis=0))).any(axis=1)
        for k, p in enumerate(momenta):
            self.unseen[k] += stride * norms((p[ends] - p[starts])[lost & hidden]).sum()
        self._intervals += stride * len(bad)
        self._missed += stride * int(lost.sum())
        self._turned += stride * int(fast.sum())
        sums = stride * miss.sum(axis=0), stride * size.sum(axis=0)
        before = self._all or (0.0, 0.0)
        self._all = before[0] + sums[0], before[1] + sums[1]


def turned(
    before: np.ndarray, after: np.ndarray, spin_before: np.ndarray, spin: np.ndarray
) -> tuple[np.ndarray, ...]:
    """About each axis of each body what the mean of the spins, times the interval [rad], misses of
    the turn, more than turns about two axes make of each other (Magnus 1954) and a sine of its
    angle; both sizes; and what is rounding, in columns (n, 3 bodies)."""
    found = turn_between(before, after)
    expected = 0.5 * (spin_before + spin)
    both = norms(cross(spin_before, spin)) / 6.0 + norms(expected) ** 3 / 12.0
    miss = np.maximum(0.0, np.abs(found - expected) - both[..., None])
    size = np.abs(found) + np.abs(expected)
    flat = len(before), -1
    return miss.reshape(flat), size.reshape(flat), np.full(1, 1e-12)


def ends_of(parts: list[tuple[np.ndarray, ...]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(what is missed, sizes, whether an interval misses too much) of ways and turns together.

    Rounding is no part of what is missed: of a body that is held at rest it is all of the way.
    """
    miss = np.concatenate([np.maximum(0.0, miss - noise) for miss, _, noise in parts], axis=1)
    size = np.concatenate([size for _, size, _ in parts], axis=1)
    return miss, size, np.any(~(miss <= PART * size), axis=1)
