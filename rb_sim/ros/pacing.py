"""Simulated time against the wall clock: absolute deadlines, so that delays do not add up."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

MAX_LAG = 0.25
"""[s] of wall time that a late loop tries to make up; what is beyond that is given up."""
OVERRUN = ("catch_up", "slip")
"""What a late loop does: hurry, up to MAX_LAG, or keep the period and let simulated time slip."""
HURRY, BURST = 2.0, 5
"""A late loop goes at most so many times its pace, but for so many samples at once: subscribers
keep the last ten, say, may be late as well, and would lose what comes in a longer burst."""
WAY = 0.4
"""Of the time to the next sample, before which the loop does nothing but wait."""
OVERLOAD, RECOVERY = 0.8, 5.0
"""A loop that gives up MAX_LAG, at once or bit by bit, where its process computed for so much of
the time cannot keep up; so many seconds [s] later it is given another chance."""
SLICE = 0.02
"""[s] between looks at signals and services while waiting."""


class Pacer:
    """Says when a sample is due. Wall times are those of time.monotonic [s]."""

    def __init__(self, real_time_factor: float, overrun: str = "catch_up") -> None:
        self.overruns = 0
        """samples that were more than one period late."""
        self.slips = 0
        """times that lateness was given up, so that simulated time slipped against the wall."""
        self.slipped = 0.0
        """by how much in all [s] of wall time."""
        self._overrun = overrun
        self._factor = real_time_factor
        self._origin = (0.0, time.monotonic())
        self._judge_from_here()
        self._free = -math.inf
        """when a whole burst is allowed again [s]."""
        self._overloaded = -math.inf
        """when it was last seen that it cannot keep up [s]."""

    @property
    def keeps_up(self) -> bool:
        """False while what is asked for is more than can be computed in the time."""
        return time.monotonic() - self._overloaded > RECOVERY

    def restart(self, t: float, real_time_factor: float) -> None:
        """Simulated time t [s] is now; from here on at this factor (0: as fast as possible)."""
        if real_time_factor != self._factor:
            self._free = -math.inf  # it was of another pace
        self._factor = real_time_factor
        self._origin = (t, time.monotonic())
        self._judge_from_here()

    def _due(self, t: float) -> float:
        """Wall time of simulated time t [s]."""
        t_0, wall_0 = self._origin
        return wall_0 + (t - t_0) / self._factor

    def left(self, t: float) -> float:
        """Wall time until simulated time t is due [s]; not above 0 where it is, or none is."""
        return self._due(t) - time.monotonic() if self._factor else 0.0

    def give_way(self, t: float) -> None:
        """Sleep for a part of the time until simulated time t is due, if any is left.

        Who waits for the last sample may wait for this thread's core, too, and has no real-time
        priority: what this thread does at once behind a sample makes that sample late for them.
        """
        if (left := self.left(t)) > 0.0:
            time.sleep(min(WAY * left, SLICE))

    def wait(self, t: float, period: float, between: Callable[[], bool]) -> bool:
        """Sleep until simulated time t is due. False: `between` asked to stop waiting, or it was
        restarted, so that t is due at another time.

        period: simulated time between samples [s]. between: called every SLICE, and never where t
        is due, since it may take long; returns False to end the wait.
        """
        if self._factor == 0.0:
            return True
        origin = self._origin
        pace, due = period / self._factor, self._due(t)
        apart = pace / HURRY
        begins = max(due, self._free - (BURST - 1) * apart)
        while (left := begins - time.monotonic()) > 0.0:
            time.sleep(min(left, SLICE))
            if left > SLICE and not (between() and self._origin is origin):
                return False
        now = begins - left
        self._free = max(self._free, now) + apart
        behind = now - due
        late = behind > pace
        if late:
            self.overruns += 1
        if behind > MAX_LAG or (late and self._overrun == "slip"):
            self.slips += 1
            self.slipped += behind
            self._origin = (t, time.monotonic())
            if self.slipped - self._judged[2] > MAX_LAG:
                self._note_overload(now)
        return True

    def _note_overload(self, now: float) -> None:
        """Whether it was the computing that took the time, not somebody else."""
        began, computed, _ = self._judged
        if time.process_time() - computed > OVERLOAD * (now - began):
            self._overloaded = now
        self._judge_from_here()

    def _judge_from_here(self) -> None:
        self._judged = (time.monotonic(), time.process_time(), self.slipped)
        """since when it is judged whether it keeps up: the wall's time, what the process had
        computed and what had been given up by then [s]."""
