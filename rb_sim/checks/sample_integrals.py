"""Integrals over the samples of a run, as they come, in bounded memory."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from rb_sim.integrate.quadrature import GAP, SIGNED, SIZE, SUM, UNTOLD, Integral, Samples
from rb_sim.mechanics.samples import Array

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

    def untold(self) -> Array:
        """What the samples leave open of the parts of the integral beside breaks, beyond the
        samples of a piece, shape (columns,)."""
        return self.integral.ended()[:, UNTOLD]

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
        integral is in doubt. Beside a break half of them may be the same as all: see `untold`.
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
        return total, np.abs(total - half.total()) + gaps + self._all.untold()
