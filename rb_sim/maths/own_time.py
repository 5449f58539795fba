"""Wall time without that of compiling: what a run costs, not what its first use does."""

from __future__ import annotations

import threading
import time

from rb_sim.maths.jit import on_compilation


class _Compiling(threading.local):
    """Time that a thread has spent in compiling [s]; compilations begin inside others."""

    def __init__(self) -> None:
        self.total, self.since, self.depth = 0.0, 0.0, 0

    def begin(self) -> None:
        if self.depth == 0:
            self.since = time.monotonic()
        self.depth += 1

    def end(self) -> None:
        self.depth -= 1
        if self.depth == 0:
            self.total += time.monotonic() - self.since


_COMPILING = _Compiling()
_LISTENING = on_compilation(_COMPILING.begin, _COMPILING.end)
_LISTENING.__enter__()  # for good: it costs nothing where nothing is compiled


def own_time() -> float:
    """As `time.monotonic`, but it stands still while the calling thread compiles [s].

    Called where nothing compiles: a compilation that never ended was broken off by a signal.
    """
    if _COMPILING.depth:
        _COMPILING.depth = 1
        _COMPILING.end()
    return time.monotonic() - _COMPILING.total
