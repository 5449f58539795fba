# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Extremes, RMS and spectrum of a stream of values, in bounded memory."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from rb_sim.bags.info import LONG, Rates
from rb_sim.bags.transforms import IMU, POSE, SCALAR, TWIST, WRENCH
from rb_sim.base.rounding import WRITTEN_ROUNDING, related
from rb_sim.io.sink import Envelope

# Units by column name.


UNITS = {"x": "m", "y": "m", "z": "m", "vx": "m/s", "vy": "m/s", "vz": "m/s", "wx": "rad/s",
         "wy": "rad/s", "wz": "rad/s", "fx": "N", "fy": "N", "fz": "N", "tx": "N m", "ty": "N m",
         "tz": "N m", "ax": "m/s^2", "ay": "m/s^2", "az": "m/s^2", "Fx": "N", "Fy": "N", "Fz": "N",
         "Kx": "N m", "Ky": "N m", "Kz": "N m", "kinetic": "J", "Px": "N s", "Py": "N s",
         "Pz": "N s", "Lx": "N m s", "Ly": "N m s", "Lz": "N m s"}  # fmt: skip
SCALARS = {"energy": "J", "power": "W"}
"""Units of rb_sim's single-value sources; other sources are topic names, with a slash."""


def unit_of(source: str, column: str) -> str:
    """Unit of a column of a source; "" if dimensionless or unknown."""
    return SCALARS.get(source, "") if column == "value" else UNITS.get(column, "")


# Power spectral density of a stream of values, in bounded memory.
#
# Welch, The use of fast Fourier transform for the estimation of power spectra (1967): Hann window,
# no overlap, mean removed. No segment spans a gap, a clock step, or a restart: the jump there would
# add a spectrum of its own.


SEGMENT = 2048
"""Samples per segment."""
SHORTEST = 64
"""Minimum number of samples for a spectrum if no stretch has a whole segment."""
BACK = 2.0
"""A step back in time by more than this many periods, or a LONG interval, ends a stretch."""
WINDOW = np.hanning(SEGMENT)


class Spectrum:
    """Power spectral densities of m columns."""

    def __init__(self, m: int) -> None:
        self._waiting = self._rest = np.empty((m, 0))
        """samples of the stretch not yet in a segment; the longest earlier remainder."""
        self._power: np.ndarray | None = None
        """sum of the segments' powers; allocated late: a bag may have thousands of topics."""
        self._segments = 0
        self._period: float | None = None
        self._last: float | None = None

    def add(self, t: np.ndarray, columns: np.ndarray) -> None:
        """Append values, shape (m, n), at times t [s]."""
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
        """Mark a restart: later values belong to another motion."""
        if self._waiting.shape[1] > self._rest.shape[1]:
            self._rest = self._waiting
        self._waiting = self._waiting[:, :0]

    def density(self, rate: float) -> tuple[np.ndarray, np.ndarray] | None:
        """Frequencies [Hz] and one-sided density [unit^2/Hz], (k, m), at sample rate `rate`.

        Without a whole segment that of the longest stretch; None if it is shorter than SHORTEST."""
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
"""Columns of each kind of readings."""

CURVE = 1500
"""Maximum number of points of a plotted curve; twice that as lower and upper envelope."""


class Figures:
    """Statistics of one source with columns `names`: values of shape (n, m) at times [s]."""

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
        """index of its first component."""
        self._attitude: np.ndarray | None = None

    def add(self, t: np.ndarray, values: np.ndarray) -> None:
        """Append values; those whose time goes back are counted but not plotted."""
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
        """Values with the sign of each quaternion chosen nearest to the one before: q and -q are
        the same attitude."""
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
        """Mark a restart: later values belong to another motion, and no spectrum spans it."""
        self._spectrum.begin_anew()

    @property
    def moves(self) -> bool:
        """Whether any column varies."""
        return bool((self.spread > 0.0).any())

    @property
    def size(self) -> np.ndarray:
        """Largest absolute value of each column; 0 before the first value."""
        size = np.maximum(np.abs(self._low), np.abs(self._high))
        return np.where(np.isfinite(size), size, 0.0)

    @property
    def spread(self) -> np.ndarray:
        """Largest minus least value of each column; 0 before the first value."""
        spread = self._high - self._low
        return np.where(np.isfinite(spread), spread, 0.0)

    def curves(self) -> tuple[np.ndarray, np.ndarray]:
        """Times and values to plot."""
        return self._envelope.curves()

    def spectrum(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Frequencies [Hz] and one-sided density [unit^2/Hz], shape (k, m); None if too short."""
        rate = self.rates.as_dict()["rate"]
        return None if rate is None else self._spectrum.density(rate)

    def as_dict(self, sizes: np.ndarray | None = None) -> dict[str, Any]:
        """Plain numbers. sizes: reference magnitude of each column; None: its own maximum."""
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


# Reference magnitude of each unit; values many orders smaller are rounding.


RESIDUAL = "residual"
"""Source that is already relative to the scene's scale, so that its reference magnitude is 1."""


KINDS = {"rad/s": "spin", "m/s": "speed", "N": "force", "N m": "torque", "W": "power"}


def sizes_of(sources: Iterable[tuple[str, Figures]], length: float) -> dict[str, float]:
    """Reference magnitude of each unit. length: reach of the bodies from their origins [m]."""
    sizes: dict[str, float] = {}
    for name, figures in sources:
        for column, size in zip(figures.names, figures.size.tolist(), strict=True):
            unit = unit_of(name, column)
            sizes[unit] = max(sizes.get(unit, 0.0), size)
    sizes["m"] = max(sizes.get("m", 0.0), length)
    found = related({kind: sizes.get(unit, 0.0) for unit, kind in KINDS.items()}, length)
    return sizes | {unit: found[kind] for unit, kind in KINDS.items()}


def sizes_beside(name: str, figures: Figures, sizes: Mapping[str, float]) -> np.ndarray:
    """Reference magnitude of each column of a source.

    Columns without a unit are compared only within their source: counts of different topics are
    unrelated."""
    if name == RESIDUAL:
        return np.ones(len(figures.names))
    units = [unit_of(name, column) for column in figures.names]
    own = max((float(s) for s, u in zip(figures.size, units, strict=True) if not u), default=0.0)
    return np.array([sizes.get(unit, 0.0) if unit else own for unit in units])
