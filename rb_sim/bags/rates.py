"""Rates and gaps of a stream of times, in bounded memory."""

from __future__ import annotations

from typing import Any

import numpy as np

FIRST = 4096
"""Intervals whose median tells which others are gaps; the rate is the mean of the rest."""
LOST = 1.5
"""An interval longer than this many periods lacks a message."""
GAP = 2.5
"""An interval longer than this many periods is a gap: more than one message lacks."""
LONG = 10.0
"""An interval of more periods says nothing of the motion in it."""
KEPT = 20
"""Gaps that are kept one by one."""


class Rates:
    """Counts, rate, jitter and gaps of times [s] that come in pieces."""

    def __init__(self) -> None:
        self.count = 0
        self.first = self.last = np.nan
        self.longest = 0.0
        self.backwards = 0
        """times that are before the one before them."""
        self.gaps: list[tuple[float, float]] = []
        self.gap_count = 0
        self.lost = 0
        """single messages that lack."""
        self._sum = self._squares = 0.0
        self._regular = 0
        self._waiting: list[tuple[np.ndarray, np.ndarray]] = []
        self._waiting_count = 0
        self._period: float | None = None

    def add(self, t: np.ndarray) -> None:
        """The next times [s], in the order of the stream."""
        if not len(t):
            return
        steps = np.diff(t, prepend=self.last) if self.count else np.diff(t)
        starts = t[-len(steps) :] - steps if len(steps) else t[:0]
        if not self.count:
            self.first = float(t[0])
        self.count += len(t)
        self.last = float(t[-1])
        self.backwards += int((steps < 0).sum())
        if self._period is not None:
            self._judge(starts, steps)
            return
        self._waiting.append((starts, steps))
        self._waiting_count += len(steps)
        if self._waiting_count >= FIRST:
            self._settle()

    def _settle(self) -> None:
        steps = np.concatenate([s for _, s in self._waiting]) if self._waiting else np.empty(0)
        forward = steps[steps > 0]
        self._period = float(np.median(forward)) if len(forward) else 0.0
        waiting, self._waiting = self._waiting, []
        for starts, part in waiting:
            self._judge(starts, part)

    def _judge(self, starts: np.ndarray, steps: np.ndarray) -> None:
        period = self._period or 0.0
        self.longest = max(self.longest, float(steps.max(initial=0.0)))
        far = steps > GAP * period
        self.gap_count += int(far.sum())
        room = KEPT - len(self.gaps)
        self.gaps += list(zip(starts[far].tolist(), steps[far].tolist(), strict=True))[:room]
        single = (steps > LOST * period) & ~far
        self.lost += int(single.sum())
        near = steps[(steps > 0) & ~far & ~single] - period
        self._regular += len(near)
        self._sum += float(near.sum())
        self._squares += float(near @ near)

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers; times in seconds, rates in Hz."""
        if self._period is None:
            self._settle()
        period = self._period or 0.0
        mean = self._sum / self._regular if self._regular else 0.0
        spread = self._squares / self._regular - mean**2 if self._regular else 0.0
        return {
            "count": self.count,
            "first": None if np.isnan(self.first) else self.first,
            "last": None if np.isnan(self.last) else self.last,
            "rate": 1.0 / (period + mean) if period > 0 else None,
            "jitter": float(np.sqrt(max(0.0, spread))),
            "longest_gap": self.longest,
            "gaps": self.gap_count,
            "lost": self.lost,
            "first_gaps": [{"after": start, "seconds": step} for start, step in self.gaps],
            "backwards": self.backwards,
        }
