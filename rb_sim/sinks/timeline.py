"""A time that never goes back, for logs of a simulation that may be reset."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array


class Timeline:
    """Simulated time that goes on from where it was when the simulation was set back."""

    def __init__(self) -> None:
        self._last: float | None = None
        self._offset = 0.0

    @property
    def offset(self) -> float:
        """What is added to times by now [s]."""
        return self._offset

    def follow(self, t: Array) -> Array:
        """The times `t` [s] of the next samples, shifted so that they never decrease."""
        if not len(t):
            return t
        steps = np.diff(t, prepend=t[0] if self._last is None else self._last)
        offsets = self._offset + np.cumsum(np.maximum(0.0, -steps))
        self._last, self._offset = float(t[-1]), float(offsets[-1])
        return t + offsets
