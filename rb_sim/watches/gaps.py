"""Intervals between samples so long that nobody knows what was in between."""

from __future__ import annotations

import numpy as np

from rb_sim.engine.samples import Array

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
