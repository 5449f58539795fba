"""One turn of a program that takes turns with another, so that what else the machine does meets
both."""

from __future__ import annotations

import time
from collections.abc import Callable

ENOUGH = 2e-3
"""CPU time of one turn, in which a run is repeated [s]."""


def turn(start: Callable[[], object], go: Callable[[], object]) -> float:
    """Least CPU time of `go` [s] in one turn; `start` goes before each."""
    least, spent = float("inf"), 0.0
    while spent < ENOUGH:
        start()
        begin = time.process_time()
        go()
        took = time.process_time() - begin
        least, spent = min(least, took), spent + max(took, 1e-6)
    return least
