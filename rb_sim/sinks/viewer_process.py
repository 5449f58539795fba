"""The process of a Rerun viewer, which does not outlive us."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from types import FrameType
from typing import Any

FATAL = (signal.SIGTERM, signal.SIGHUP)
"""Would end us without a word to the viewer. SIGINT is an exception by itself."""


@contextlib.contextmanager
def viewer_process(command: Sequence[str], **options: Any) -> Iterator[subprocess.Popen[Any]]:
    """A viewer; ended with what it started when the block is left, by a signal too."""
    with _signals_as_exits():
        # a group of its own: the command is a wrapper, and the viewer its child
        process = subprocess.Popen(command, start_new_session=True, **options)
        try:
            yield process
        finally:
            _end_group(process)


@contextlib.contextmanager
def _signals_as_exits() -> Iterator[None]:
    """SystemExit where a signal would end the process at once; other handlers stay."""
    numbers: list[signal.Signals] = []
    if threading.current_thread() is threading.main_thread():
        numbers = [n for n in FATAL if signal.getsignal(n) is signal.SIG_DFL]
    for number in numbers:
        signal.signal(number, _leave)
    try:
        yield
    finally:
        for number in numbers:
            signal.signal(number, signal.SIG_DFL)


def _leave(number: int, _: FrameType | None) -> None:
    sys.exit(128 + number)


def _end_group(process: subprocess.Popen[Any]) -> None:
    """End the process and its children, whether or not it has gone already itself."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        try:
            os.killpg(process.pid, number)
            process.wait(timeout=5)
        except (ProcessLookupError, subprocess.TimeoutExpired):
            continue
    process.wait()
