"""One growing time for readings whose stamps go back: a clock that was set, a looped bag."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rb_sim.engine.samples import Array

APART = 1000.0
"""Between the stretches before and after a jump on the growing time [s]; sources may reach the
jump at instants that differ by less."""
MOST_TOLD = 3


class _Jump(NamedTuple):
    """The time of all sources goes back."""

    source: str
    """the one that showed it first."""
    old: float
    new: float
    """its last stamp before and its first one after [s]."""
    offset: float
    """growing time less stamp from here on [s]."""
    border: float
    """on the growing time [s]; what comes later is after the jump."""


class GrowingTime:
    """Turns the stamps of several sources into one time that never goes back.

    The n-th jump back of every source is the same jump. What is joined across no gap is not joined
    across a jump either, as APART lies between.
    """

    def __init__(self) -> None:
        self._jumps: list[_Jump] = []
        self._count: dict[str, int] = {}
        self._latest: dict[str, float] = {}

    def jump(self, source: str, old: float, new: float) -> None:
        """The stamps of a source go back from `old` to `new` [s]."""
        count = self._count[source] = self._count.get(source, 0) + 1
        if count > len(self._jumps):
            before = self._offset(count - 1)
            offset = before + old - new + APART
            self._jumps.append(_Jump(source, old, new, offset, old + before + 0.5 * APART))

    def of(self, source: str, t: Array) -> Array:
        """The growing time of stamps of a source, all after its last jump."""
        return t + self._offset(self._count.get(source, 0))

    def found(self, source: str, t: Array, late: float) -> Array:
        """As `of`, where the jumps are to be found: steps back by more than `late` [s]."""
        parts, latest = [], self._latest.get(source, -np.inf)
        while len(t):
            highest = np.maximum.accumulate(np.append(latest, t))
            jump = int(np.argmax(np.append(highest[:-1] - t > late, True)))
            parts.append(self.of(source, t[:jump]))
            latest, t = float(highest[jump]), t[jump:]
            if len(t):
                self.jump(source, latest, float(t[0]))
                latest = float(t[0])
        self._latest[source] = latest
        return np.concatenate(parts) if parts else t

    def stamps(self, t: Array) -> Array:
        """The stamps of instants of the growing time."""
        count = np.searchsorted([jump.border for jump in self._jumps], t, side="right")
        return t - np.array([0.0, *(jump.offset for jump in self._jumps)])[count]

    def notes(self) -> list[str]:
        """A line for each jump, the first few of them."""
        lines = [
            f"{jump.source}: time goes back from {jump.old:.6g} s to {jump.new:.6g} s: the balance "
            "ends there and begins anew"
            for jump in self._jumps[:MOST_TOLD]
        ]
        more = len(self._jumps) - len(lines)
        return [*lines, f"and so {more} times more"] if more else lines

    def _offset(self, count: int) -> float:
        return self._jumps[count - 1].offset if count else 0.0
