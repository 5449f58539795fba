# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Handling of SIGINT, SIGTERM and SIGHUP: logs are finished during a run, temporary files removed
else."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, NoReturn

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

PATIENCE = 0.1
"""Time after which a signal counts as lost [s]."""


class BrokenOffError(BaseException):
    """Raised by a signal within `dropping`; not an Exception, so that no handler takes it for a
    failure."""


class TerminatedError(KeyboardInterrupt):
    """Raised for one of SIGNALS, like KeyboardInterrupt for Ctrl-C."""

    def __init__(self, number: int) -> None:
        self.number = number


@contextmanager
def terminable() -> Iterator[None]:
    """Context in which each of SIGNALS raises TerminatedError once, so that temporary folders and
    partial copies are removed.

    Handlers of others are kept; a process forked within it ends.
    """
    owner, before, alarm = os.getpid(), {}, signal.getsignal(signal.SIGALRM)
    nobodys = signal.SIG_DFL, signal.default_int_handler

    def take(number: int, _: FrameType | None) -> None:
        signal.signal(number, signal.SIG_DFL)
        if os.getpid() != owner:
            os.kill(os.getpid(), number)
        insist(number)
        raise TerminatedError(number)

    if threading.current_thread() is threading.main_thread():
        before = {n: signal.getsignal(n) for n in SIGNALS if signal.getsignal(n) in nobodys}
    for number in before:
        signal.signal(number, take)
    hook, sys.unraisablehook = sys.unraisablehook, quiet_of_signals
    try:
        yield
    finally:
        sys.unraisablehook = hook
        if before and signal.getsignal(signal.SIGALRM) != alarm:
            # a pending alarm would restart the timer, and end the process
            signal.signal(signal.SIGALRM, nothing)
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, alarm)
        for number, handler in before.items():
            signal.signal(number, handler)


def insist(number: int) -> None:
    """Raise TerminatedError every PATIENCE until it propagates.

    An exception raised within a callback of Python itself, as during an import, is lost, and the
    verb would run to its end.
    """

    def look(_: int, frame: FrameType | None) -> None:
        signal.setitimer(signal.ITIMER_REAL, PATIENCE)
        error = sys.exc_info()[1]
        while error is not None:
            if isinstance(error, TerminatedError):  # cleanup is in progress
                return
            error = error.__context__
        raise TerminatedError(number)

    signal.signal(signal.SIGALRM, look)
    signal.setitimer(signal.ITIMER_REAL, PATIENCE)


def nothing(_: int, __: FrameType | None) -> None:
    """Alarm handler that does nothing."""


def quiet_of_signals(lost: Any) -> None:
    """Report of unraisable exceptions as in Python, except for TerminatedError."""
    if lost.exc_type is not TerminatedError:
        sys.__unraisablehook__(lost)


ONE = 1.0
"""Time within which two signals count as one [s]: GNU timeout, ros2 launch and systemd signal a
process and then its group."""


class Interruption:
    """Context that handles the signals, except a SIGHUP that is ignored (nohup).

    A shell script starts background processes with SIGINT ignored; a SIGINT sent to them is handled
    nevertheless. While `logging` is set the first signal is only stored in `cause`, so that no sink
    is interrupted in a write. Before, and with a second signal more than ONE later, the process
    ends at once. Handlers raise an exception only inside `dropping`: compiler and recorder call
    back from foreign code, which loses it.

    early: message of the first signal while nothing is logged.
    """

    def __init__(self, early: str = "interrupted before the first step") -> None:
        self._early = early
        self.cause: signal.Signals | None = None
        self.logging = False
        self.left_over: Callable[[], str] = str
        """returns the state after a second signal, in words; "" if nothing is left over."""
        self.status: int | None = None
        """exit status of a finished run: a signal then ends the process with it, at once."""
        self._before: dict[signal.Signals, Any] = {}
        self._droppable = False
        self._first = 0.0
        """time of the first signal (time.monotonic) [s]."""

    def __enter__(self) -> Interruption:
        heard = [n for n in SIGNALS if n != signal.SIGHUP or signal.getsignal(n) != signal.SIG_IGN]
        self._before = {number: signal.signal(number, self._take) for number in heard}
        return self

    def __exit__(self, *_: object) -> None:
        self.hand_over()

    def hand_over(self) -> None:
        """Restore the previous signal handlers."""
        while self._before:
            signal.signal(*self._before.popitem())

    @property
    def exit_code(self) -> int:
        """Exit code as from a shell: 128 + the signal's number; 0 without one."""
        return 0 if self.cause is None else 128 + self.cause

    @contextmanager
    def dropping(self) -> Iterator[None]:
        """Context for work that takes seconds and can be dropped: a signal, also an earlier one,
        ends it with BrokenOffError."""
        if self.cause is not None:
            raise BrokenOffError
        self._droppable = True
        try:
            yield
        finally:
            self._droppable = False

    def _take(self, number: int, _: FrameType | None) -> None:
        if self.status is not None:
            os._exit(self.status)
        if again := self.cause is not None:
            if time.monotonic() - self._first < ONE:
                return
        else:
            self._first = time.monotonic()
        self.cause = signal.Signals(number)
        if not self.logging:
            self._leave(self._early)
        if again:
            self._leave(": ".join(filter(None, ("interrupted twice", self.left_over()))))
        if self._droppable:
            raise BrokenOffError

    def _leave(self, line: str) -> NoReturn:
        os.write(sys.__stderr__.fileno() if sys.__stderr__ else 2, f"{line}\n".encode())
        os._exit(self.exit_code)


def deafen() -> None:
    """Ignore SIGNALS from here on, at the end of the process: a signal during the shutdown of
    modules would change the exit status of a successful run."""
    if threading.current_thread() is threading.main_thread():
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)


EARLY = Interruption("interrupted")
"""Handler from the first import until a verb takes over: while the command line is parsed, typer
would end without a message or ignore Ctrl-C."""
