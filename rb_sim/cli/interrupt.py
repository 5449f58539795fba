"""Ctrl-C ends a command also while numba compiles."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, NoReturn


@contextmanager
def answered() -> Iterator[None]:
    """Inside, an interrupt that is lost while numba compiles comes again as it goes on compiling.

    LLVM calls Python while it writes machine code, and what is raised in there, ctypes prints and
    forgets: a command that compiles for minutes was deaf to a Ctrl-C that came just then. Nothing
    is changed where somebody else answers SIGINT, or ignores it.
    """
    mine = threading.current_thread() is threading.main_thread()
    if not mine or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    with ExitStack() as until:

        def take(number: int, frame: Any) -> None:
            if "rb_sim.maths.jit" in sys.modules:
                from rb_sim.maths.jit import on_compilation

                until.enter_context(on_compilation(interrupt, interrupt))
            interrupt()

        signal.signal(signal.SIGINT, take)
        until.callback(signal.signal, signal.SIGINT, signal.default_int_handler)
        yield


def interrupt() -> NoReturn:
    """Raise KeyboardInterrupt."""
    raise KeyboardInterrupt
