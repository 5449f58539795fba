"""Which blocks of a run's samples are looked at closely, so that watching costs little of a run.

The first samples are all looked at. From there on every block adds to an account what a share of
its own making costs, and the account pays for looking closely at a block now and then, spread
evenly over the run. Costs are counted, not measured: the same run is looked at in the same places.
"""

from __future__ import annotations

FIRST = 2048
"""Samples at the beginning of a run that are all looked at closely."""

SHARE = 0.004
"""Of the cost of a run: what looking closely may cost after the first samples."""

SAMPLE = 100.0
"""Cost of a sample with its steps, at least, for each body and reaction beyond the first [ns]: a
heavy top takes 230 ns for its two, a free body 290."""

LOOK = 1e6
"""Cost of looking closely at a block, whatever its size [ns]; most is Python that the caches of
the processor have forgotten since the last look."""

EACH = 200.0
"""Cost of looking closely at a sample, for each body and reaction beyond the first [ns]."""


class Pace:
    """Keeps the account of a run. size: number of its bodies and reactions."""

    def __init__(self, size: int) -> None:
        self._size = float(size)
        self._samples, self._account = 0, 0.0

    def close(self, samples: int) -> bool:
        """Whether the next block, of so many samples, is to be looked at closely."""
        self._samples += samples
        if self._samples <= FIRST:
            return True
        self._account += SHARE * SAMPLE * self._size * samples
        price = LOOK + EACH * self._size * samples
        if self._account < price:
            return False
        self._account -= price
        return True
