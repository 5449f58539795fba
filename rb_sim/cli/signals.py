"""SIGINT, SIGTERM, SIGHUP: finish what is logged while a scene runs; else leave nothing behind."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, NoReturn

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class BrokenOffError(BaseException):
    """A signal ended work that could be dropped. Not an Exception: no except on the way takes it
    for a failure."""


class TerminatedError(KeyboardInterrupt):
    """SIGTERM or SIGHUP, as what Ctrl-C raises."""

    def __init__(self, number: int) -> None:
        self.number = number


@contextmanager
def terminable() -> Iterator[None]:
    """SIGTERM and SIGHUP raise TerminatedError, once: folders that are kept for a while and half
    copies are removed as after Ctrl-C. Handlers of others stay; a process forked meanwhile ends."""
    owner, numbers = os.getpid(), []

    def take(number: int, _: FrameType | None) -> None:
        signal.signal(number, signal.SIG_DFL)
        if os.getpid() != owner:
            os.kill(os.getpid(), number)
        raise TerminatedError(number)

    if threading.current_thread() is threading.main_thread():
        numbers = [n for n in SIGNALS[1:] if signal.getsignal(n) is signal.SIG_DFL]
    for number in numbers:
        signal.signal(number, take)
    try:
        yield
    finally:
        for number in numbers:
            signal.signal(number, signal.SIG_DFL)


class Interruption:
    """Takes the signals over for the time of a `with` block, but those ignored (nohup).

    While `logging` is set the first signal is only noted in `cause`, so that no sink is left in
    the middle of a write. Before, and with a second signal, the process ends at once. No exception
    is raised from a handler, but inside `dropping`: compiler and recorder call back from foreign
    code, which loses it.

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

    def __enter__(self) -> Interruption:
        heard = [number for number in SIGNALS if signal.getsignal(number) != signal.SIG_IGN]
        self._before = {number: signal.signal(number, self._take) for number in heard}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

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
        again = self.cause is not None
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
