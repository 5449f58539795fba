"""Whether samples resolve a motion, so that integrals over them mean something.

    x(t1) - x(t0) = (t1 - t0) (v(t0) + v(t1)) / 2 + O(dt^3)

holds to a fraction where they do; a body that turns by much between two samples is not resolved.
Where a body hardly moves the fraction says little, and where a coarse method parts positions from
velocities it is not the samples' fault: what all intervals miss is held against the whole way, too.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

import numpy as np

from rb_sim.sinks.frames import norms

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleBlock

PART = 0.2
"""Share of the way that the trapezoid of the velocities may miss."""

PART_OF_ALL = 0.1
"""Share of the whole way of a body that all its intervals together may miss."""

TURN = 0.5
"""Angle between two samples [rad]."""

FAR_TURN = 1.0
"""Angle between two samples up to which every other one, too, tells what goes round twice in a turn
of the body, as the power of a force may, from what stands still: it goes on by 4 rad [rad]."""

DOUBTS, FAR_DOUBTS = 10.0, 30.0
"""Times what leaving out every other sample changes an integral by, that it may be wrong by: where
bodies turn by less than TURN between samples, and by less than FAR_TURN."""

MOST = 0.02
"""Share of the intervals that may be unresolved: impacts and other jumps."""

MANY = 256
"""Intervals of one block from which on every fourth stands for all."""


class Resolution:
    """Counts the intervals between samples that do not resolve the motion."""

    def __init__(self) -> None:
        self._last: tuple[float, np.ndarray, np.ndarray] | None = None
        self._intervals = self._missed = self._turned = self._turned_far = 0
        self._all: tuple[np.ndarray, np.ndarray] | None = None
        """Of each body: what its intervals miss and their way, added up [m]."""

    @property
    def resolved(self) -> bool:
        """Whether integrals over the samples so far can be trusted."""
        return self._turned <= MOST * self._intervals and self._follows

    @property
    def _follows(self) -> bool:
        """Whether the velocities at the samples tell the ways between them, but for turning."""
        if self._missed <= MOST * self._intervals or self._all is None:
            return True
        missed, way = self._all
        return bool((missed <= PART_OF_ALL * way).all())

    @property
    def doubts(self) -> float:
        """Times what leaving out every other sample changes an integral over the samples so far by,
        that it may be wrong by; infinite where nothing is known of its error."""
        if self.resolved:
            return DOUBTS
        most = MOST * self._intervals
        return FAR_DOUBTS if self._turned_far <= most and self._follows else inf

    def leave_out(self) -> None:
        """Samples follow that do not come to `add`."""
        self._last = None

    def add(self, block: SampleBlock) -> None:
        """The next samples."""
        t, x, v, w = block.t, block.position, block.linear_velocity, block.angular_velocity
        if self._last is not None:
            t0, x0, v0 = self._last
            t, x, v = np.append(t0, t), np.append(x0[None], x, 0), np.append(v0[None], v, 0)
            w = np.append(w[:1], w, 0)
        self._last = float(block.t[-1]), block.position[-1], block.linear_velocity[-1]
        if len(t) < 2:
            return
        stride = 1 if len(t) <= MANY else 4
        ends, starts = slice(1, None, stride), slice(0, -1, stride)
        dt = (t[ends] - t[starts])[:, None]
        with np.errstate(all="ignore"):
            moved = x[ends] - x[starts]
            expected = 0.5 * dt[..., None] * (v[ends] + v[starts])
            size = norms(moved) + norms(expected)
            miss = norms(moved - expected)
            noise = 1e-12 * np.abs(x[ends]).max(axis=0).max(axis=1)
            bad = (~(miss <= PART * size + noise)).any(axis=1)
            spin = norms(w[ends]).max(axis=1)
            turn = spin * dt[:, 0]
            fast = ~(turn <= TURN)
        self._intervals += stride * len(bad)
        self._missed += stride * int((bad | fast).sum())
        self._turned += stride * int(fast.sum())
        self._turned_far += stride * int((~(turn <= FAR_TURN)).sum())
        sums = stride * miss.sum(axis=0), stride * size.sum(axis=0)
        before = self._all or (0.0, 0.0)
        self._all = before[0] + sums[0], before[1] + sums[1]
