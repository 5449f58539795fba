"""Pieces of a run: kernel calls short enough that signals and progress are seen in between."""

from __future__ import annotations

import time
from collections.abc import Callable

PIECE = 0.05
"""Wall time of a piece, about [s]."""

FIRST_PIECE = 1e-6
"""Of the duration: what a simulated second costs is not known yet."""

MOST_GROWTH = 8.0
"""From one piece to the next."""

Watch = Callable[[float], bool]
"""Told the simulated time [s]; says whether the run is to go on."""


class Watcher:
    """Asks `watch` between pieces and learns how much simulated time fits into one."""

    def __init__(self, watch: Watch, duration: float) -> None:
        self._watch = watch
        self._span = self._shortest = FIRST_PIECE * duration
        self._began = 0.0
        self.stopped = False

    def end_of_piece(self, now: float) -> float:
        """Where the piece that starts `now` should end; both in simulated time [s]."""
        self._began = time.perf_counter()
        return now + self._span

    def goes_on(self, now: float) -> bool:
        """Called at the end of a piece."""
        took = max(time.perf_counter() - self._began, 1e-9)
        self._span = max(self._shortest, self._span * min(MOST_GROWTH, PIECE / took))
        self.stopped = not self._watch(now)
        return not self.stopped
