# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""SIGINT, SIGTERM, SIGHUP: finish what is logged while a scene runs; else leave nothing behind."""

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
"""Time after which a signal is seen to have been lost [s]."""


class BrokenOffError(BaseException):
    """A signal ended work that could be dropped. Not an Exception: no except on the way takes it
    for a failure."""


class TerminatedError(KeyboardInterrupt):
    """One of SIGNALS, as what Ctrl-C raises."""

    def __init__(self, number: int) -> None:
        self.number = number


@contextmanager
def terminable() -> Iterator[None]:
    """Each of SIGNALS raises TerminatedError, once: folders that are kept for a while and half
    copies are removed. Handlers of others stay; a process forked meanwhile ends."""
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
            # one that is under way would set the timer again, and end the process then
            signal.signal(signal.SIGALRM, nothing)
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, alarm)
        for number, handler in before.items():
            signal.signal(number, handler)


def insist(number: int) -> None:
    """Raise TerminatedError again every PATIENCE until it is on its way: one that is raised while a
    callback of Python's own runs, such as those with which modules are imported, is lost, and the
    verb went on to its end as if nobody had asked for it."""

    def look(_: int, frame: FrameType | None) -> None:
        signal.setitimer(signal.ITIMER_REAL, PATIENCE)
        error = sys.exc_info()[1]
        while error is not None:
            if isinstance(error, TerminatedError):  # something cleans up
                return
            error = error.__context__
        raise TerminatedError(number)

    signal.signal(signal.SIGALRM, look)
    signal.setitimer(signal.ITIMER_REAL, PATIENCE)


def nothing(_: int, __: FrameType | None) -> None:
    """What an alarm does that nobody waits for any more."""


def quiet_of_signals(lost: Any) -> None:
    """Tells of exceptions that are lost, as Python does, but not of a signal's."""
    if lost.exc_type is not TerminatedError:
        sys.__unraisablehook__(lost)


ONE = 1.0
"""[s] within which two signals are one: GNU timeout, ros2 launch and systemd signal a process and
then its group."""


class Interruption:
    """Takes the signals over for the time of a `with` block, but a SIGHUP that is ignored (nohup).
    A shell script that starts a process by `&` has SIGINT ignored for it: who sends one means it.

    While `logging` is set the first signal is only noted in `cause`, so that no sink is left in
    the middle of a write. Before, and with a second signal more than ONE later, the process ends at
    once. No exception is raised from a handler, but inside `dropping`: compiler and recorder call
    back from foreign code, which loses it.

    early: what the first signal says while nothing is logged.
    """

    def __init__(self, early: str = "interrupted before the first step") -> None:
        self._early = early
        self.cause: signal.Signals | None = None
        self.logging = False
        self.left_over: Callable[[], str] = str
        """what a second signal leaves, in words; "": nothing."""
        self.status: int | None = None
        """exit status of a run that is over: a signal ends the process with it, at once."""
        self._before: dict[signal.Signals, Any] = {}
        self._droppable = False
        self._first = 0.0
        """when the first signal came (time.monotonic) [s]."""

    def __enter__(self) -> Interruption:
        heard = [n for n in SIGNALS if n != signal.SIGHUP or signal.getsignal(n) != signal.SIG_IGN]
        self._before = {number: signal.signal(number, self._take) for number in heard}
        return self

    def __exit__(self, *_: object) -> None:
        self.hand_over()

    def hand_over(self) -> None:
        """Give the signals back to whoever had them."""
        while self._before:
            signal.signal(*self._before.popitem())

    @property
    def exit_code(self) -> int:
        """As a shell gives it: 128 + the signal's number; 0 without one."""
        return 0 if self.cause is None else 128 + self.cause

    @contextmanager
    def dropping(self) -> Iterator[None]:
        """Work that takes seconds and that nobody misses: the first signal, even one that came
        before, ends it with BrokenOffError."""
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
    """Ignore SIGNALS from here on, where the process ends: taking modules down takes a while, and a
    signal in it would end with a status of its own what has ended well."""
    if threading.current_thread() is threading.main_thread():
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)


EARLY = Interruption("interrupted")
"""Takes the signals from the first import on until a verb does, while the command line is read:
what reads it takes Ctrl-C for an end without a word, or does not take it at all."""
