# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Pieces of a run: kernel calls short enough that signals and progress are seen in between."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.base.errors import RbSimError, SimulationError
from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.mechanics.samples import Array
from rb_sim.motion.motion import nothing
from rb_sim.numerics.kernels import own_time

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array
    from rb_sim.motion.motion import Motion


# At which instants a run is sampled.


MOST_SAMPLES = 2**53
"""Of one run: beyond, sample times are no longer distinct numbers."""

BESIDE = 64.0
"""Distance of the samples beside an event, in roundings of the run's end."""


def is_finite(value: Any) -> bool:
    """Whether it is a finite number; False of what is none."""
    try:
        return math.isfinite(value)
    except (TypeError, OverflowError):
        return False


def samples_at_rate(duration: float, rate: float) -> int:
    """How many samples at `rate` [Hz] lie within `duration` [s], the start included.

    Raises RbSimError where their times are no longer distinct numbers.
    """
    if not duration * rate < MOST_SAMPLES:
        raise RbSimError(f"got {duration:g} s at {rate:g} Hz; must be fewer than 2^53 samples")
    return math.floor(duration * rate * (1.0 + COMPUTED_ROUNDING) + COMPUTED_ROUNDING) + 1


def instants_at_rate(start: float, duration: float, rate: float) -> Array:
    """Every 1/rate [s] from `start` on, and the end."""
    count, end = samples_at_rate(duration, rate), start + duration
    times = np.minimum(start + np.arange(count) / rate, end)
    if end - (start + (count - 1) / rate) > COMPUTED_ROUNDING / rate:
        times = np.append(times, end)
    return times


def instants_given(at: Sequence[float] | Array, now: float) -> Array:
    """The instants that a caller names, checked. now: the present time [s]."""
    allowed = f"at: must be increasing finite numbers, from the present time {now:g} s on"
    try:
        times: Any = np.array(at, dtype=float)
    except (TypeError, ValueError):
        raise RbSimError(f"{allowed}; got {at!r}") from None
    if times.ndim != 1 or not len(times):
        raise RbSimError(f"{allowed}; got {'none' if times.size == 0 else 'no list of numbers'}")
    if not np.isfinite(times).all():
        raise RbSimError(f"{allowed}; got {times[~np.isfinite(times)][0]}")
    wrong = np.flatnonzero(np.diff(times, prepend=np.nextafter(now, -np.inf)) <= 0.0)
    if len(wrong):
        before = f" after {times[wrong[0] - 1]:g}" if wrong[0] else ""
        raise RbSimError(f"{allowed}; got {times[wrong[0]]:g}{before}")
    return times


def instants_beside(events: Sequence[float], start: float, end: float) -> Array:
    """Just before and just after each event, within the run from `start` to `end` [s]."""
    if not events:
        return np.empty(0)
    apart = BESIDE * np.spacing(end)
    found = np.array(events)
    beside = np.concatenate([found - apart, found + apart])
    return np.unique(beside[(beside > start) & (beside < end)])


# How long a run will take, from what it has cost so far: said if long, ended if endless.
#
# A run that begins with a stiff transient is slow at first only, and one whose body comes to roll
# at 1e9 rad/s is fast at first only. The estimate therefore takes the fastest of the paces between
# the last looks, and a run is given up only if all of them say so for some time. The first look
# alone says nothing: laws are traced and loops are loaded before it.


EFFORT = 5.0
"""Time after which the first estimate is made [s]."""

LONG = 600.0
"""Estimated time from which on it is reported [s]."""

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
            self.given_up = f"ended after {waited:.3g} s of wall-clock time: {self._said(t, left)}"
            return False
        if left > LONG and self._tell is not None and len(self._paces) > 1:
            self._tell(self._said(t, left))
            self._tell = None
        if left > self._most and spent >= PATIENCE * self._effort:
            self.given_up = f"given up after {spent:.0f} s: {self._said(t, left)}"
        return not self.given_up

    def _said(self, t: float, left: float) -> str:
        return (
            f"the run is at t = {t:.3g} s of {self._duration:.6g} s and would take "
            f"{in_words(left)} more at this pace; {self._advice}"
        )


def in_words(seconds: float) -> str:
    """A time in the largest unit of which it has more than one."""
    if not math.isfinite(seconds):
        return "infinite time"
    for size, unit in UNITS:
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.0f} seconds"


PIECE = 0.05
"""Wall time of a piece, about [s]."""

FIRST_PIECE = 1e-6
"""Of the duration: what a simulated second costs is not known yet."""

MOST_GROWTH = 8.0
"""From one piece to the next."""

NONE = np.empty(0)

Watch = Callable[[float], bool]
"""Gets the simulated time [s]; returns whether the run is to go on."""


@dataclass(frozen=True)
class Limits:
    """What the way to the next sample may cost; beyond it SimulationError says that it stalls."""

    steps: float = math.inf
    """steps between two samples."""
    wall_time: float = math.inf
    """[s] between two samples; compiling is not counted."""


NO_LIMITS = Limits()


class WatchEndedError(Exception):
    """The watch asked to end; the motion is at its last sample and can go on from there."""


class Watcher:
    """Asks `watch` between pieces, learns how much simulated time fits into one, and sees that the
    motion advances: no sample may cost more than `limits`."""

    def __init__(
        self,
        motion: Motion,
        watch: Watch | None,
        duration: float,
        limits: Limits = NO_LIMITS,
        *,
        in_pieces: bool = True,
    ) -> None:
        """duration: simulated time of the whole run [s], from which the first piece is taken.
        in_pieces: let the kernel end for the watch's sake; else it is asked where it ends anyway.
        """
        self._motion, self._watch, self._limits = motion, watch, limits
        self._span = self._shortest = FIRST_PIECE * duration
        self._began = self._asked = time.perf_counter()
        self._since = own_time()
        self._times, self._reached, self._steps = NONE, 0, 0
        self.stopped = False
        self.in_pieces = in_pieces and watch is not None
        """whether the kernel is to end for the watch's sake."""

    def carry(self, times: Array, out: Array | None) -> bool:
        """Carry the motion to the times and sample there into the rows of `out`; False if the watch
        ended it.

        Raises SimulationError if it cannot go on, or costs more than the limits.
        """
        motion = self._motion
        self._times, self._reached, self._steps = times, 0, motion.steps
        self._since = own_time()
        motion.watch = self.look
        try:
            if self.in_pieces and out is not None:
                self._carry_in_pieces(times, out)
            else:
                motion.run_to(times, out)
        except WatchEndedError:
            return False
        finally:
            motion.watch = nothing
        return not self.stopped

    def _carry_in_pieces(self, times: Array, out: Array) -> None:
        """As run_to of the motion, but only as long as the watch says; the steps are the same."""
        motion, done = self._motion, 0
        while done < len(times):
            self._began = time.perf_counter()
            target = motion.time + self._span
            upto = int(np.searchsorted(times, target, side="right"))
            if upto > done:
                motion.run_to(times[done:upto], out[done:upto])
                done = upto
            else:
                motion.run_to([target])
            if not self._goes_on(motion.time):
                break

    def _goes_on(self, now: float) -> bool:
        """Called at the end of a piece."""
        self._asked = time.perf_counter()
        took = max(self._asked - self._began, 1e-9)
        self._span = max(self._shortest, self._span * min(MOST_GROWTH, PIECE / took))
        self.stopped = self._watch is not None and not self._watch(now)
        return not self.stopped

    def still(self) -> bool:
        """Whether the watch says to go on, asked when a run has failed and something is tried."""
        return self._watch is None or self._watch(self._motion.time)

    def look(self) -> None:
        """Called inside a piece, between calls of the kernel and at events.

        Raises WatchEndedError if the watch says so, SimulationError beyond a limit.
        """
        motion, now = self._motion, own_time()
        reached = int(np.searchsorted(self._times, motion.time, side="right"))
        if reached != self._reached:
            self._reached, self._steps, self._since = reached, motion.steps, now
        steps, waited = motion.steps - self._steps, now - self._since
        if steps > self._limits.steps or waited > self._limits.wall_time:
            raise SimulationError(stalled(motion, steps, waited))
        now = time.perf_counter()
        if self._watch is not None and now - self._asked >= PIECE:
            self._asked = now
            if not self._watch(motion.frontier[0]):
                self.stopped = True
                raise WatchEndedError


def stalled(motion: Motion, steps: int, waited: float) -> str:
    """Why a motion that no longer advances is given up, in one line."""
    t, h = motion.frontier
    return (
        f"the motion no longer advances: {steps} steps ({waited:.1f} s) from t = "
        f"{motion.time:.9g} s reached t = {t:.9g} s; the step is {h:.2g} s"
    )
