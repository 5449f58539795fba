# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Simulated time against the wall clock: absolute deadlines, so that delays do not add up."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterable
from pathlib import Path

# Real-time priority of the node's threads while samples are due at the wall clock's times.
#
# Linux gives the processor to a thread of policy SCHED_FIFO at once, before all ordinary programs;
# without it a sample that is due waits until another program's slice of some milliseconds is over.
# ros2_control's controller manager does the same (its parameter `thread_priority`).


THREADS = Path("/proc/self/task")


def own_threads() -> list[int]:
    """Kernel's numbers of all threads of this process: the loop, the middleware's, the checks'."""
    return [int(thread.name) for thread in THREADS.iterdir()]


class Priority:
    """Raises the threads that there are, and puts them back.

    level: of SCHED_FIFO, 1 to 99; 0 leaves the threads as they are. What a raised thread starts
    (threads, processes) is not raised.
    """

    def __init__(self, level: int) -> None:
        self.refusal = ""
        """the line that says why the threads could not be raised; empty if nothing stood there."""
        self._level = level
        self._before: dict[int, tuple[int, int]] = {}
        """policy and priority of each raised thread."""

    def __str__(self) -> str:
        return f"{self._level} (SCHED_FIFO)" if self._before else "ordinary"

    def raised(self, wanted: bool) -> None:
        """Raise the threads, or put them back."""
        if wanted and self._level and not self._before and not self.refusal:
            self._raise(own_threads())
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
        # the flag stays: only the privileged may take it off again
        os.sched_setscheduler(thread, policy | os.SCHED_RESET_ON_FORK, os.sched_param(level))


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
