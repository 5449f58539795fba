"""One turn of a program that takes turns with another, so that what else the machine does meets
both."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

ENOUGH = 2e-3
"""CPU time of one turn, in which a run is repeated [s]."""


def turn(start: Callable[[], object], go: Callable[[], object]) -> float:
    """CPU time of `go` [s], the lower quartile of one turn; `start` goes before each repeat.

    The least of them is now and then half of all others, where a virtual machine's clock has lost
    what it had counted.
    """
    took: list[float] = []
    while sum(took) < ENOUGH:
        start()
        begin = time.process_time()
        go()
        took.append(max(time.process_time() - begin, 1e-6))
    return statistics.quantiles(took, n=4)[0] if len(took) > 3 else min(took)
