"""The open chunk of a bag as it would be if it ended now, so that a killed process loses little.

Where chunks ended by the clock, equal runs would give different files. So a chunk ends by its size
alone, and what waits in the open one stands at the end of the file as a draft, which any reader of
unfinished files takes for a chunk; the next chunk is written over it.
"""

from __future__ import annotations

import time
from collections.abc import Callable

PERIOD = 0.5
"""[s] of wall time that a message waits for the next draft."""


class Draft:
    """Says when one is due. clock: gives wall time [s]."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._since: float | None = None

    def wait(self) -> None:
        """A message waits in the open chunk."""
        if self._since is None:
            self._since = self._clock()

    def clear(self) -> None:
        """None waits any more: the chunk has ended, or a draft was written."""
        self._since = None

    @property
    def due(self) -> bool:
        """True if a message has waited for PERIOD."""
        return self._since is not None and self._clock() - self._since >= PERIOD
