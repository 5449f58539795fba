"""Whether poses are in other units than metres: what falls freely tells it.

A body on which only weight acts takes 9.81 m/s^2 in one direction; where its acceleration stays at
a hundred or a thousand times that, the poses are in centimetres or millimetres.
"""

from __future__ import annotations

import numpy as np

from rb_sim.analysis.derivatives import Motion

GRAVITY = 9.80665
"""[m/s^2], standard."""
UNITS = {100.0: "cm", 1000.0: "mm"}
NEAR = 0.02
"""Of gravity: within that an acceleration is one of a fall (gravity itself differs by 0.3 %)."""
EVEN = 0.2
"""Scatter of the acceleration within a block, of its mean, up to which it is one acceleration."""
BLOCK = 16
"""Samples of a block."""
LEAST = 2
"""Blocks of a fall below which it tells nothing."""
ALONG = 0.99
"""Length of the mean of the directions of all falls, from which on they are one."""


class Fall:
    """Looks for falls in the motion of one source of poses."""

    def __init__(self) -> None:
        self._count = dict.fromkeys(UNITS, 0)
        self._along = {factor: np.zeros(3) for factor in UNITS}

    def look(self, motion: Motion) -> None:
        """The next motion."""
        n = len(motion.t) // BLOCK
        blocks = motion.acceleration[: n * BLOCK].reshape(n, BLOCK, 3)
        mean = blocks.mean(axis=1)
        size = np.linalg.norm(mean, axis=1)
        scatter = np.sqrt(np.mean(np.sum((blocks - mean[:, None]) ** 2, axis=2), axis=1))
        even = scatter < EVEN * size
        for factor in UNITS:
            falls = even & (np.abs(size / (factor * GRAVITY) - 1.0) < NEAR)
            self._count[factor] += int(falls.sum())
            self._along[factor] += (mean[falls] / size[falls, None]).sum(axis=0)

    @property
    def note(self) -> str:
        """Which other unit they are in, as it seems; or ""."""
        for factor, unit in UNITS.items():
            count = self._count[factor]
            if count >= LEAST and np.linalg.norm(self._along[factor]) > ALONG * count:
                return (
                    f"falls at {factor * GRAVITY:.0f} m/s^2, {factor:.0f} times gravity: are its "
                    f"poses in {unit}?"
                )
        return ""
