"""How long a run will take, from what it has cost so far: told when it is long, ended when endless.

A run that begins with a stiff transient is slow at first only, and one whose body comes to roll at
1e9 rad/s is fast at first only. The estimate therefore takes the fastest of the paces between the
last looks, and a run is given up only where all of them say so for some time.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable

from rb_sim.maths.own_time import own_time

EFFORT = 5.0
"""Time after which the first estimate is made [s]."""

LONG = 600.0
"""Estimated time from which on a user is told of it [s]."""

ENDLESS = 365.25 * 86400.0
"""Estimated time from which on a run is given up [s]: nobody waits for a year."""

PATIENCE = 3
"""Efforts that a run is given to become faster before it is given up; as many paces are known."""

ADVICE = "try a larger step or tolerance, a lower rate, or a shorter duration"

UNITS = ((86400.0 * 365.25, "years"), (86400.0, "days"), (3600.0, "hours"), (60.0, "minutes"))


class Forecast:
    """Follows the simulated time of a run of `duration` [s].

    tell: called once, in one line, with the estimate of a run that will take long.
    effort, most: instead of EFFORT and ENDLESS. wall: time after which the run is ended in any case
    [s]. clock: gives the time that is spent [s]; None: the wall's, but compiling says nothing about
    the pace and counts for `wall` only.
    """

    def __init__(
        self,
        duration: float,
        tell: Callable[[str], None] | None = None,
        *,
        effort: float | None = None,
        most: float = ENDLESS,
        wall: float = math.inf,
        clock: Callable[[], float] | None = None,
        advice: str = ADVICE,
    ) -> None:
        self.given_up = ""
        """why the run was ended, in one line; "" while it may go on."""
        self._advice = advice
        self._duration, self._tell, self._most = duration, tell, most
        self._clock, self._wall_clock = clock or own_time, clock or time.monotonic
        self._wall_began, self._wall = self._wall_clock(), wall
        self._effort = EFFORT if effort is None else effort
        self._began = self._looked = self._clock()
        self._reached = 0.0
        self._paces: deque[float] = deque(maxlen=PATIENCE)

    def goes_on(self, t: float) -> bool:
        """Called now and then with the simulated time since the start [s]: whether to go on."""
        now = self._clock()
        spent = now - self._began
        waited = self._wall_clock() - self._wall_began
        over = waited >= self._wall
        if self.given_up or (now - self._looked < self._effort and not over):
            return not self.given_up
        self._paces.append((t - self._reached) / max(now - self._looked, 1e-9))
        pace = max(self._paces)
        left = (self._duration - t) / pace if pace > 0.0 else math.inf
        self._looked, self._reached = now, t
        if over:
            self.given_up = f"ended after {waited:.3g} s of wall time: {self._said(t, left)}"
        elif left > self._most and spent >= PATIENCE * self._effort:
            self.given_up = f"given up after {spent:.0f} s: {self._said(t, left)}"
        elif left > LONG and self._tell is not None:
            self._tell(self._said(t, left))
            self._tell = None
        return not self.given_up

    def _said(self, t: float, left: float) -> str:
        return (
            f"the run is at t = {t:.3g} s of {self._duration:.6g} s and would go on "
            f"{in_words(left)} at this pace; {self._advice}"
        )


def in_words(seconds: float) -> str:
    """A time in the largest unit of which it has more than one."""
    if not math.isfinite(seconds):
        return "for ever"
    for size, unit in UNITS:
        if seconds >= size:
            return f"for {seconds / size:.3g} {unit}"
    return f"for {seconds:.0f} seconds"
