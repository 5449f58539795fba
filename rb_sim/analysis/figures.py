"""Extremes, RMS and spectrum of a stream of numbers, in bounded memory."""

from __future__ import annotations

from typing import Any

import numpy as np

from rb_sim.analysis.spectrum import Spectrum
from rb_sim.bags.piece import IMU, POSE, SCALAR, TWIST, WRENCH
from rb_sim.bags.rates import Rates
from rb_sim.sinks.decimate import Envelope

COLUMNS = {
    POSE: ("x", "y", "z", "qx", "qy", "qz", "qw"),
    TWIST: ("vx", "vy", "vz", "wx", "wy", "wz"),
    WRENCH: ("fx", "fy", "fz", "tx", "ty", "tz"),
    IMU: ("qx", "qy", "qz", "qw", "wx", "wy", "wz", "ax", "ay", "az"),
    SCALAR: ("value",),
}
"""What the numbers of each kind of readings are."""

ROUNDING = 1e-9
"""Of the size of a number: what changes by less has no frequency."""
CURVE = 1500
"""Points at most of a curve in the report, twice that with its lower and upper edge."""


class Figures:
    """Follows one source: values of shape (n, m) at times [s]."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self.names = names
        self.rates = Rates()
        m = len(names)
        self._low, self._high = np.full(m, np.inf), np.full(m, -np.inf)
        self._sum, self._squares = np.zeros(m), np.zeros(m)
        self._spectrum = Spectrum(m)
        self._envelope = Envelope(m, CURVE)
        self._last = -np.inf
        self._quaternion = names.index("qx") if "qx" in names else None
        """place of the first of its four numbers."""
        self._attitude: np.ndarray | None = None

    def add(self, t: np.ndarray, values: np.ndarray) -> None:
        """The next values; those whose time goes back are counted but not drawn."""
        self.rates.add(t)
        values = self._on_one_side(values)
        columns = np.ascontiguousarray(values.T)  # several times faster than along the rows
        self._low = np.minimum(self._low, columns.min(axis=1))
        self._high = np.maximum(self._high, columns.max(axis=1))
        self._sum += columns.sum(axis=1)
        self._squares += np.einsum("mn,mn->m", columns, columns)
        if not (t[0] > self._last and (t[1:] > t[:-1]).all()):
            forward = t > np.maximum.accumulate(np.concatenate([[self._last], t]))[:-1]
            later, drawn = t[forward], values[forward]
        else:
            later, drawn = t, values
        if len(later):
            self._last = float(later[-1])
            self._envelope.add(later, drawn)
        self._spectrum.add(t, columns)

    def _on_one_side(self, values: np.ndarray) -> np.ndarray:
        """The values with the sign of each quaternion that is nearest to the one before: q and -q
        are one attitude, and a sign that changes on the way is no motion."""
        if self._quaternion is None:
            return values
        at = slice(self._quaternion, self._quaternion + 4)
        q = values[:, at]
        before = np.concatenate([q[:1] if self._attitude is None else self._attitude, q[:-1]])
        signs = np.cumprod(np.where((q * before).sum(axis=1) < 0.0, -1.0, 1.0))
        if (signs < 0.0).any():
            values = values.copy()
            values[:, at] *= signs[:, None]
        self._attitude = values[-1:, at].copy()
        return values

    def begin_anew(self) -> None:
        """What comes is another motion: no spectrum reaches across that."""
        self._spectrum.begin_anew()

    @property
    def moves(self) -> bool:
        """Whether a number is not the same throughout."""
        return bool((self.spread > 0.0).any())

    @property
    def size(self) -> np.ndarray:
        """Largest absolute value of each number; 0 before the first."""
        size = np.maximum(np.abs(self._low), np.abs(self._high))
        return np.where(np.isfinite(size), size, 0.0)

    @property
    def spread(self) -> np.ndarray:
        """Largest less least value of each number; 0 before the first."""
        spread = self._high - self._low
        return np.where(np.isfinite(spread), spread, 0.0)

    def curves(self) -> tuple[np.ndarray, np.ndarray]:
        """Times and values to draw."""
        return self._envelope.curves()

    def spectrum(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Frequencies [Hz] and one-sided density [unit^2/Hz], shape (k, m); None if too short."""
        rate = self.rates.as_dict()["rate"]
        return None if rate is None else self._spectrum.density(rate)

    def as_dict(self, sizes: np.ndarray | None = None) -> dict[str, Any]:
        """Plain numbers. sizes: beside which each number is small or large; None: its own size."""
        count = max(1, self.rates.count)
        found = self.spectrum()
        peaks = None
        if found is not None:
            frequency, density = found
            moves = self.spread > ROUNDING * (self.size if sizes is None else sizes)
            peaks = [float(frequency[1 + np.argmax(column[1:])]) if moved else None
                     for column, moved in zip(density.T, moves, strict=True)]  # fmt: skip
        values = {
            name: {
                "least": float(self._low[k]),
                "largest": float(self._high[k]),
                "mean": float(self._sum[k] / count),
                "rms": float(np.sqrt(self._squares[k] / count)),
                "peak_frequency": None if peaks is None else peaks[k],
            }
            for k, name in enumerate(self.names)
        }
        return {**self.rates.as_dict(), "values": values}
