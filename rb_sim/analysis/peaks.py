"""How far the largest acceleration of a motion is off that a filter makes of its poses.

A polynomial of order ORDER through WINDOW samples flattens a peak of few samples. How much, one of
order NEXT through the same samples tells: by how much both differ is the error of the first where
that of the second is much smaller. It is asked at the largest acceleration only, which the extremes
of the wrench belong to.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import savgol_coeffs

from rb_sim.analysis.derivatives import ORDER, ROUNDING, WINDOW, Motion

NEXT = ORDER + 2
"""Order of the polynomial beside which that of the filter is laid."""
TOLD = 0.01
"""Of the largest acceleration: an error from which on it is told."""
SURE = 5.0
"""Standard deviations of what noise makes of the difference, below which it tells nothing."""
UNITS = ("m/s^2", "rad/s^2")
NAMES = ("acceleration", "angular_acceleration")
HALF = WINDOW // 2
BETWEEN = savgol_coeffs(WINDOW, NEXT, deriv=2) - savgol_coeffs(WINDOW, ORDER, deriv=2)
"""Weights of the samples in the difference of both second derivatives, for a period of 1."""
OF_NOISE = float(np.linalg.norm(BETWEEN) / np.linalg.norm(savgol_coeffs(WINDOW, ORDER, deriv=2)))
"""What noise makes of the difference, of what it makes of the acceleration."""


class Peaks:
    """Follows the largest acceleration of C and the largest angular one of a body."""

    def __init__(self) -> None:
        self._size = [0.0, 0.0]
        self._off: list[float | None] = [None, None]
        """None where it is not told from noise or rounding, or lies beside an end of the poses."""

    def look(
        self, motion: Motion, squares: Sequence[np.ndarray], kept: np.ndarray, h: float
    ) -> None:
        """The next motion, h apart [s].

        squares: of its accelerations and its angular ones, (n,) each; kept: the samples that mean
        anything, (n,).
        """
        for j in (0, 1):
            of_kept = np.where(kept, squares[j], 0.0)
            k = int(np.argmax(of_kept))
            size = float(np.sqrt(of_kept[k]))
            if size > self._size[j]:
                self._size[j], self._off[j] = size, _off(motion, j, k, h)

    @property
    def note(self) -> str:
        """What is off, where it is worth a word; or ""."""
        parts = [
            f"{off:.2g} of {size:.3g} {unit}"
            for off, size, unit in zip(self._off, self._size, UNITS, strict=True)
            if off is not None and off > TOLD * size
        ]
        if not parts:
            return ""
        return (
            "its motion has peaks of few samples, which the filter makes other than they are: its "
            f"largest accelerations are off by about {' and '.join(parts)}"
        )

    def as_dict(self) -> dict[str, dict[str, float | None]]:
        """Plain numbers [m/s^2, rad/s^2]."""
        return {
            name: {"largest": size, "off": off}
            for name, size, off in zip(NAMES, self._size, self._off, strict=True)
        }


def _off(motion: Motion, j: int, k: int, h: float) -> float | None:
    """How far the acceleration (j = 0) or the angular one (1) is off at sample k."""
    if not HALF <= k < len(motion.t) - HALF:
        return None
    gain, rows = ((1.0, motion.position), (2.0, motion.orientation))[j]
    near = rows[k - HALF : k + HALF + 1]
    off = gain * float(np.linalg.norm(BETWEEN @ near)) / h**2
    rounding = gain * ROUNDING * float(np.abs(near).max() * np.linalg.norm(BETWEEN)) / h**2
    return off if off > max(SURE * OF_NOISE * motion.noise[j], rounding) else None
