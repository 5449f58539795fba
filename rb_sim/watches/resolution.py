"""Whether samples resolve a motion, so that integrals over them mean something.

    x(t1) - x(t0) = (t1 - t0) (v(t0) + v(t1)) / 2 + O(dt^3)

holds to a fraction where they do; a body that turns by much between two samples is not resolved.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleBlock

PART = 0.2
"""Share of the way that the trapezoid of the velocities may miss."""

TURN = 0.5
"""Angle between two samples [rad]."""

MOST = 0.02
"""Share of the intervals that may be unresolved: impacts and other jumps."""


class Resolution:
    """Counts the intervals between samples that do not resolve the motion."""

    def __init__(self) -> None:
        self._last: tuple[float, np.ndarray, np.ndarray] | None = None
        self._intervals = self._missed = 0

    @property
    def resolved(self) -> bool:
        """Whether integrals over the samples so far can be trusted."""
        return self._missed <= MOST * self._intervals

    def add(self, block: SampleBlock) -> None:
        """The next samples."""
        t, x, v = block.t, block.position, block.linear_velocity
        if self._last is not None:
            t0, x0, v0 = self._last
            t, x, v = np.append(t0, t), np.append(x0[None], x, 0), np.append(v0[None], v, 0)
        self._last = float(block.t[-1]), block.position[-1], block.linear_velocity[-1]
        if len(t) < 2:
            return
        dt = np.diff(t)[:, None]
        way = np.linalg.norm(np.diff(x, axis=0), axis=2)
        mean = 0.5 * (v[1:] + v[:-1])
        with np.errstate(all="ignore"):
            miss = np.linalg.norm(np.diff(x, axis=0) - dt[..., None] * mean, axis=2)
            size = way + dt * np.linalg.norm(mean, axis=2)
            noise = 1e-12 * np.abs(x[1:]).max(axis=2)
            bad = (~(miss <= PART * size + noise)).any(axis=1)
            spin = np.linalg.norm(block.angular_velocity, axis=2).max(axis=1)
            bad[-len(spin) :] |= ~(spin[-len(bad) :] * dt[-len(spin) :, 0] <= TURN)
        self._intervals += len(bad)
        self._missed += int(bad.sum())
