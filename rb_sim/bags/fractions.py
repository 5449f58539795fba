"""Stamps whose `nanosec` holds microseconds or milliseconds, recognised by the times of the log.

Such a stamp leaves each second by a thousandth or a millionth of what passes: the steps between
stamps are so many times shorter than those between the times at which they were logged.
"""

from __future__ import annotations

import numpy as np

from rb_sim.bags.piece import Piece

NANO = 1_000_000_000
UNITS = {1_000: "microseconds", 1_000_000: "milliseconds"}
"""Nanoseconds in the unit that `nanosec` holds."""
LEAST = 8
"""Readings of a source by which it is decided."""
NEAR = 4.0
"""Times by which steps of the log may differ from those of the stamps in their unit."""


class Fractions:
    """Gives stamps their nanoseconds; `notes` names the sources that hold another unit."""

    def __init__(self) -> None:
        self._factor: dict[str, int] = {}
        self.notes: list[str] = []

    def learn(self, pieces: list[Piece]) -> None:
        """Decide by the first readings of each source."""
        known: dict[str, list[Piece]] = {}
        for piece in pieces:
            if piece.source not in self._factor:
                known.setdefault(piece.source, []).append(piece)
        for source, parts in known.items():
            stamp, log = (np.concatenate([getattr(p, name) for p in parts])
                          for name in ("stamp", "log"))  # fmt: skip
            if len(stamp) < LEAST:
                continue
            self._factor[source] = factor = _factor(stamp, log)
            if factor > 1:
                self.notes.append(f"{source}: nanosec of its stamps holds {UNITS[factor]}, by the "
                                  "times of the log: taken as such")  # fmt: skip

    def mended(self, piece: Piece) -> Piece:
        """The readings with stamps in nanoseconds."""
        self.learn([piece])
        factor = self._factor.get(piece.source, 1)
        if factor == 1:
            return piece
        whole, part = np.divmod(piece.stamp, NANO)
        stamp = whole * NANO + part * factor
        return piece._replace(stamp=stamp, t=stamp * 1e-9)


def _factor(stamp: np.ndarray, log: np.ndarray) -> int:
    """How many nanoseconds one of `nanosec` is: 1, or as in UNITS."""
    steps, logged = np.diff(stamp), np.diff(log)
    if not ((steps > 0).any() and (logged > 0).any()):
        return 1
    ratio = float(np.median(logged[logged > 0]) * NANO / np.median(steps[steps > 0]))
    most = int((stamp % NANO).max())
    for factor in UNITS:
        if most * factor < NANO and factor / NEAR < ratio < factor * NEAR:
            return factor
    return 1
