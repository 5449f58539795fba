"""Ctrl-C while numba compiles: LLVM calls Python back, and what is raised in there is lost."""

from __future__ import annotations

import ctypes
import signal

import numba
import pytest

from rb_sim.cli.interrupt import answered
from rb_sim.maths import jit as _loads_numba  # noqa: F401

lost_interrupt = ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(signal.SIGINT))
"""SIGINT within a call of C back into Python: ctypes prints the exception and goes on."""


def next_one(x: int) -> int:
    return x + 1


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_interrupt_that_was_lost_ends_the_compilation() -> None:
    compiled = False
    with pytest.raises(KeyboardInterrupt), answered():
        lost_interrupt()
        numba.njit(next_one)(1)
        compiled = True
    assert not compiled
    assert numba.njit(next_one)(1) == 2, "afterwards it compiles again"


def test_any_other_interrupt_comes_at_once_and_the_handler_is_put_back() -> None:
    with pytest.raises(KeyboardInterrupt), answered():
        signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_whoever_answers_himself_is_left_alone() -> None:
    heard: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: heard.append(number))
    try:
        with answered():
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)
    assert heard == [signal.SIGINT]
