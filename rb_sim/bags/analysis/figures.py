# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Extremes, RMS and spectrum of a stream of numbers, in bounded memory."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from rb_sim.bags.info import LONG, Rates
from rb_sim.bags.transforms import IMU, POSE, SCALAR, TWIST, WRENCH
from rb_sim.base.rounding import WRITTEN_ROUNDING
from rb_sim.io.sink import Envelope

# Units of what an analysis tells, by the names of its columns.


UNITS = {"x": "m", "y": "m", "z": "m", "vx": "m/s", "vy": "m/s", "vz": "m/s", "wx": "rad/s",
         "wy": "rad/s", "wz": "rad/s", "fx": "N", "fy": "N", "fz": "N", "tx": "N m", "ty": "N m",
         "tz": "N m", "ax": "m/s^2", "ay": "m/s^2", "az": "m/s^2", "Fx": "N", "Fy": "N", "Fz": "N",
         "Kx": "N m", "Ky": "N m", "Kz": "N m", "kinetic": "J", "Px": "N s", "Py": "N s",
         "Pz": "N s", "Lx": "N m s", "Ly": "N m s", "Lz": "N m s"}  # fmt: skip
SCALARS = {"energy": "J", "power": "W"}
"""Of the sources of a single number in bags of ours; those of others are topics, with a slash."""


def unit_of(source: str, column: str) -> str:
    """The unit of a column of a source, "" for a number without one or of an unknown one."""
    return SCALARS.get(source, "") if column == "value" else UNITS.get(column, "")


# Power densities of numbers that come in pieces, stretch by stretch, in bounded memory.
#
# Welch, The use of fast Fourier transform for the estimation of power spectra (1967): Hann window,
# no overlap, mean removed. No piece reaches across a gap, a clock that was set, or a motion that
# begins anew: the jump there would be reported as a spectrum of its own.


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


COLUMNS = {
    POSE: ("x", "y", "z", "qx", "qy", "qz", "qw"),
    TWIST: ("vx", "vy", "vz", "wx", "wy", "wz"),
    WRENCH: ("fx", "fy", "fz", "tx", "ty", "tz"),
    IMU: ("qx", "qy", "qz", "qw", "wx", "wy", "wz", "ax", "ay", "az"),
    SCALAR: ("value",),
}
"""What the numbers of each kind of readings are."""

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
            moves = self.spread > WRITTEN_ROUNDING * (self.size if sizes is None else sizes)
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


# How large the numbers of a unit are, all in all: what is far less is rounding.


RESIDUAL = "residual"
"""The source that is relative to the scene's scale, which is 1 therefore."""


def sizes_of(sources: Iterable[tuple[str, Figures]], length: float) -> dict[str, float]:
    """The largest absolute value of each unit.

    Bodies that reach r [m] from their origins, turn at w and take a force F move elsewhere at r w,
    and a torque of F r is of their size.  length: r.
    """
    sizes: dict[str, float] = {}
    for name, figures in sources:
        for column, size in zip(figures.names, figures.size.tolist(), strict=True):
            unit = unit_of(name, column)
            sizes[unit] = max(sizes.get(unit, 0.0), size)
    sizes["m"] = max(sizes.get("m", 0.0), length)
    sizes["m/s"] = max(sizes.get("m/s", 0.0), length * sizes.get("rad/s", 0.0))
    sizes["N m"] = max(sizes.get("N m", 0.0), length * sizes.get("N", 0.0))
    return sizes


def sizes_beside(name: str, figures: Figures, sizes: Mapping[str, float]) -> np.ndarray:
    """What each number of a source is small or large beside; those without a unit are compared with
    their own kind only: what one topic counts says nothing of another."""
    if name == RESIDUAL:
        return np.ones(len(figures.names))
    units = [unit_of(name, column) for column in figures.names]
    own = max((float(s) for s, u in zip(figures.size, units, strict=True) if not u), default=0.0)
    return np.array([sizes.get(unit, 0.0) if unit else own for unit in units])
