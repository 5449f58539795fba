"""Whether the header stamps of several sources are of one clock, told by when they were logged."""

from __future__ import annotations

import numpy as np

from rb_sim.bags.piece import Piece
from rb_sim.bags.transform_tree import is_static

APART = 0.5
"""[s]: a message is rarely logged so much later than another one of its instant."""
FIRST = 8
"""Readings of a source that are asked."""


class Clocks:
    """Follows by how much the log's time is ahead of each source's stamps."""

    def __init__(self) -> None:
        self._ahead: dict[str, float] = {}

    def add(self, piece: Piece) -> None:
        """The next readings; the first ones of a source tell."""
        if piece.source not in self._ahead and not is_static(piece.source):
            ahead = piece.log[:FIRST] - piece.t[:FIRST]
            self._ahead[piece.source] = float(np.median(ahead))

    @property
    def note(self) -> str:
        """A line where the clocks differ, with the two that do most; or ""."""
        if not self._ahead:
            return ""
        first = min(self._ahead, key=lambda source: self._ahead[source])
        last = max(self._ahead, key=lambda source: self._ahead[source])
        least, most = self._ahead[first], self._ahead[last]
        if most - least <= APART:
            return ""
        return (
            f"stamps of different clocks: those of {last} lie {most:.6g} s before the time of the "
            f"log, those of {first} {least:.6g} s: what happened at once is not side by side"
        )
