"""Whether one of two motions is in other units than metres: where it is the other one, enlarged."""

from __future__ import annotations

import numpy as np

UNITS = {100.0: "cm", 1000.0: "mm"}
NEAR = 0.1
"""Of the larger motion: what the smaller one, enlarged, leaves of it at most (RMS)."""


def unit_note(a: np.ndarray, b: np.ndarray) -> str:
    """A line where positions b are those of a a hundred or a thousand times, or the other way
    round, each about its mean; shapes (n, 3). Else ""."""
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    for (one, small), (two, large) in ((("A", a), ("B", b)), (("B", b), ("A", a))):
        size = np.linalg.norm(large)
        for factor, unit in UNITS.items():
            if size > 0.0 and np.linalg.norm(large - factor * small) < NEAR * size:
                times = f"{factor:.0f} times those of {one}"
                return f"the positions of {two} are {times}: is {two} in {unit}?"
    return ""
