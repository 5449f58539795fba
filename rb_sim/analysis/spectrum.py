"""Power densities of numbers that come in pieces, stretch by stretch, in bounded memory.

Welch, The use of fast Fourier transform for the estimation of power spectra (1967): Hann window, no
overlap, mean removed. No piece reaches across a gap, a clock that was set, or a motion that begins
anew: the jump there would be told as a spectrum of its own.
"""

from __future__ import annotations

import numpy as np

from rb_sim.bags.rates import LONG

SEGMENT = 2048
"""Samples of one piece."""
SHORTEST = 64
"""Samples of which, where no stretch has those of a piece, a spectrum is still taken."""
BACK = 2.0
"""Periods: stamps that step back by more end a stretch, and so does an interval that is LONG."""
WINDOW = np.hanning(SEGMENT)


class Spectrum:
    """Of m numbers."""

    def __init__(self, m: int) -> None:
        self._waiting = self._rest = np.empty((m, 0))
        """samples of the stretch that no piece has taken, and the most that an earlier one left."""
        self._power: np.ndarray | None = None
        """sum of the pieces' powers; none before the first: a bag may have thousands of topics."""
        self._segments = 0
        self._period: float | None = None
        self._last: float | None = None

    def add(self, t: np.ndarray, columns: np.ndarray) -> None:
        """The next values, shape (m, n), at times t [s]."""
        steps = np.diff(t, prepend=t[0] if self._last is None else self._last)
        self._last = float(t[-1])
        if self._period is None and (steps > 0.0).any():
            self._period = float(np.median(steps[steps > 0.0]))
        period = self._period or np.inf
        if steps.max() <= LONG * period and steps.min() >= -BACK * period:
            self._take(columns)
            return
        cuts = np.flatnonzero((steps > LONG * period) | (steps < -BACK * period))
        for k, part in enumerate(np.split(columns, cuts, axis=1)):
            if k:
                self.begin_anew()
            self._take(part)

    def begin_anew(self) -> None:
        """What comes is another motion."""
        if self._waiting.shape[1] > self._rest.shape[1]:
            self._rest = self._waiting
        self._waiting = self._waiting[:, :0]

    def density(self, rate: float) -> tuple[np.ndarray, np.ndarray] | None:
        """Frequencies [Hz] and one-sided density [unit^2/Hz], shape (k, m), of `rate` samples a
        second; of the longest stretch where none has a whole piece; None if that is too short."""
        power, segments, window = self._power, self._segments, WINDOW
        if power is None:
            longest = max(self._waiting, self._rest, key=lambda rest: rest.shape[1])
            count = longest.shape[1]
            if count < SHORTEST:
                return None
            segments, window = 1, np.hanning(count)
            parts = longest - longest.mean(axis=1, keepdims=True)
            power = np.abs(np.fft.rfft(parts * window, axis=1)) ** 2
        density = 2.0 * power.T / (segments * rate * (window @ window))
        return np.fft.rfftfreq(len(window), 1.0 / rate), density

    def _take(self, columns: np.ndarray) -> None:
        columns = np.concatenate([self._waiting, columns], axis=1)
        count = columns.shape[1] // SEGMENT
        whole, self._waiting = columns[:, : count * SEGMENT], columns[:, count * SEGMENT :].copy()
        if not count:
            return
        parts = whole.reshape(len(columns), count, SEGMENT)
        parts = (parts - parts.mean(axis=2, keepdims=True)) * WINDOW
        spectrum = np.fft.rfft(parts, axis=2)
        spectrum *= spectrum.conj()
        power = spectrum.real.sum(axis=1)
        self._power = power if self._power is None else self._power + power
        self._segments += count
