"""The grid of steps of bodies in contact: where an integration stands."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np


class Grid(NamedTuple):
    """Where the integration stands: the last step goes from t0 to t1; states are arrays."""

    origin: float
    """time at which the grid starts [s]."""
    steps: int
    rejected: int
    t0: float
    y0: Any
    c0: Any
    """what compensated summation has still to add to y0."""
    t1: float
    y1: Any
    c1: Any
    h: float
    """adaptive methods: step to try next, 0 before the first [s]."""
    y: Any
    """state at the time last asked for."""
    c: Any


def start_grid(t: float, y: Any, c: Any = None) -> Grid:
    """A grid that starts at (t, y); c: the low digits of y, left out: none."""
    c = np.zeros_like(y) if c is None else c
    return Grid(t, 0, 0, t, y.copy(), c.copy(), t, y.copy(), c.copy(), 0.0, y.copy(), c.copy())
