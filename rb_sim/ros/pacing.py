# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Pacing by the wall clock with absolute deadlines, so that delays do not accumulate."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterable
from pathlib import Path

# Real-time priority of the node's threads while the run is paced by the wall clock.
#
# Linux runs a SCHED_FIFO thread at once, before all ordinary threads; without it a due sample waits
# for the end of another program's time slice of some milliseconds. The controller manager of
# ros2_control does the same (parameter `thread_priority`).


THREADS = Path("/proc/self/task")


class Priority:
    """Raises the priority of the present threads, and restores it.

    level: SCHED_FIFO priority, 1 to 99; 0 leaves the threads unchanged. Threads and processes
    started by a raised thread are not raised.
    """

    def __init__(self, level: int) -> None:
        self.refusal = ""
        """line with the reason why the threads could not be raised; else ""."""
        self._level = level
        self._before: dict[int, tuple[int, int]] = {}
        """policy and priority of each raised thread."""

    def __str__(self) -> str:
        return f"{self._level} (SCHED_FIFO)" if self._before else "ordinary"

    def raised(self, wanted: bool) -> None:
        """Raise the priority of the threads, or restore it."""
        if wanted and self._level and not self._before and not self.refusal:
            # kernel ids of all threads of this process: the loop, the middleware, the checks
            self._raise([int(thread.name) for thread in THREADS.iterdir()])
        elif not wanted:
            self._put_back()

    def _raise(self, threads: Iterable[int]) -> None:
        for thread in threads:
            try:
                before = os.sched_getscheduler(thread), os.sched_getparam(thread).sched_priority
                self._set(thread, os.SCHED_FIFO, self._level)
            except ProcessLookupError:  # it has ended
                continue
            except OSError as error:
                reason = os.strerror(error.errno or 0).lower()
                self.refusal = (
                    f"thread_priority {self._level}: {reason} (see `ulimit -r`, or CAP_SYS_NICE);"
                    " samples wait for other programs"
                )
                self._put_back()
                return
            self._before[thread] = before

    def _put_back(self) -> None:
        before, self._before = self._before, {}
        for thread, (policy, level) in before.items():
            try:
                self._set(thread, policy & ~os.SCHED_RESET_ON_FORK, level)
            except OSError:  # it has ended
                continue

    def _set(self, thread: int, policy: int, level: int) -> None:
        # keep the flag, since removing it needs privileges
        os.sched_setscheduler(thread, policy | os.SCHED_RESET_ON_FORK, os.sched_param(level))


MAX_LAG = 0.25
"""[s] of wall-clock delay that a late loop makes up; the rest is dropped."""
OVERRUN = ("catch_up", "slip")
"""Reaction to delay: catch up, up to MAX_LAG, or let simulated time fall behind."""
HURRY, BURST = 2.0, 5
"""A late loop runs at most at this multiple of its pace, except for bursts of so many samples:
subscribers typically keep the last ten messages, and would lose some of a longer burst."""
WAY = 0.4
"""Fraction of the time to the next sample in which the loop does nothing but wait."""
OVERLOAD, RECOVERY = 0.8, 5.0
"""A loop that drops MAX_LAG, at once or in parts, while its process computes for this fraction of
the time, is overloaded; it is tested again after so many seconds."""
SLICE = 0.02
"""[s] between checks for signals and services while waiting."""


class Pacer:
    """Determines when a sample is due. Wall-clock times are those of time.monotonic [s]."""

    def __init__(self, real_time_factor: float, overrun: str = "catch_up") -> None:
        self.overruns = 0
        """number of samples more than one period late."""
        self.slips = 0
        """number of times that delay was dropped."""
        self.slipped = 0.0
        """total dropped delay [s] of wall-clock time."""
        self._overrun = overrun
        self._factor = real_time_factor
        self._origin = (0.0, time.monotonic())
        self._judge_from_here()
        self._free = -math.inf
        """when a whole burst is allowed again [s]."""
        self._overloaded = -math.inf
        """when the last overload was detected [s]."""

    @property
    def keeps_up(self) -> bool:
        """False while the computation is slower than the requested pace."""
        return time.monotonic() - self._overloaded > RECOVERY

    def restart(self, t: float, real_time_factor: float) -> None:
        """Make time t [s] due now, with this factor from here on (0: as fast as possible)."""
        if real_time_factor != self._factor:
            self._free = -math.inf  # the old value is for another pace
        self._factor = real_time_factor
        self._origin = (t, time.monotonic())
        self._judge_from_here()

    def _due(self, t: float) -> float:
        """Wall-clock time at which simulated time t [s] is due."""
        t_0, wall_0 = self._origin
        return wall_0 + (t - t_0) / self._factor

    def left(self, t: float) -> float:
        """Wall-clock time until time t is due [s]; <= 0 if it is due, or without pacing."""
        return self._due(t) - time.monotonic() if self._factor else 0.0

    def give_way(self, t: float) -> None:
        """Sleep for a part of the time until simulated time t is due, if any is left.

        Subscribers may need this core to take the last sample, and have no real-time priority: work
        directly after a sample would delay it for them.
        """
        if (left := self.left(t)) > 0.0:
            time.sleep(min(WAY * left, SLICE))

    def wait(self, t: float, period: float, between: Callable[[], bool]) -> bool:
        """Sleep until time t is due. False if `between` or a restart ended the wait.

        period: simulated time between samples [s]. between: called every SLICE while t is not due
        (it may take long); returns False to end the wait.
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
        """Register an overload if the computation, and not other processes, took the time."""
        began, computed, _ = self._judged
        if time.process_time() - computed > OVERLOAD * (now - began):
            self._overloaded = now
        self._judge_from_here()

    def _judge_from_here(self) -> None:
        self._judged = (time.monotonic(), time.process_time(), self.slipped)
        """start of the interval over which overload is judged: wall-clock time, CPU time of the
        process, and dropped delay [s]."""
