"""Real-time priority of the node's threads while samples are due at the wall clock's times.

Linux gives the processor to a thread of policy SCHED_FIFO at once, before all ordinary programs;
without it a sample that is due waits until another program's slice of some milliseconds is over.
ros2_control's controller manager does the same (its parameter `thread_priority`).
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

THREADS = Path("/proc/self/task")


def own_threads() -> list[int]:
    """Kernel's numbers of all threads of this process: the loop, the middleware's, the watches'."""
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
