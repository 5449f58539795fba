"""The way of a point in pieces, so that a viewer can show what lies behind it and no more."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rb_sim.engine.samples import Array

PIECES = 2048
"""After so many the pieces become twice as long, so that a long run stays small."""

SHORTEST = 0.002
"""Of the size of the scene; first length of a piece."""


class Trail:
    """Cuts the way into pieces of at least a certain length. size: of the scene [m]."""

    def __init__(self, size: float) -> None:
        self._shortest = SHORTEST * size
        self._piece: list[list[float]] = []
        self._length = 0.0
        self._made = 0

    def add(self, position: Array) -> tuple[NDArray[np.intp], list[list[list[float]]]]:
        """The next positions, shape (n, 3); (rows at which a piece ended, its points)."""
        rows, pieces = [], []
        for row, point in enumerate(position.tolist()):
            if self._piece:
                self._length += float(np.linalg.norm(np.subtract(point, self._piece[-1])))
            self._piece.append(point)
            if self._length > self._shortest:
                rows.append(row)
                pieces.append(self._piece)
                self._piece, self._length = [point], 0.0
                self._made += 1
                if self._made % PIECES == 0:
                    self._shortest *= 2.0
        return np.array(rows, dtype=np.intp), pieces
