# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Alignment of two recorded motions: interpolation in time, clock offset and clock drift."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline, make_interp_spline
from scipy.optimize import OptimizeResult, least_squares

from rb_sim.bags.info import after_gaps, between
from rb_sim.bags.tracks import Track
from rb_sim.base.errors import RbSimError
from rb_sim.base.rounding import WRITTEN_ROUNDING
from rb_sim.numerics.rotations import angle_between, continuous, norms, turn_between, unit

ALIGN = ("none", "first", "offset", "clock")
"""Ways to align the clocks of A and B: as recorded; equal first stamps; estimated offset; estimated
offset and drift."""
MOST_DRIFT = 1e-4
"""Largest clock drift that is estimated: quartz is accurate to 1e-4. A larger limit would let a
wrong motion be fitted by stretching its time."""
BENT = 0.5
"""Largest drift allowed when an estimated offset is checked: two different motions need different
offsets at their start and end."""
SURE = 3.0
"""Standard errors by which that drift must exceed MOST_DRIFT to mean that the motions differ."""
TOGETHER = 0.5
"""Fraction of the shorter motion that must overlap with the other one at every offset tried."""
FEW = 4
"""Minimum number of samples of a motion for interpolation."""
SEARCHED = 2000
"""Maximum number of samples used in the search for offset and drift."""
LEAST = 3
"""Minimum number of samples of a stretch (no gap, no restart) for interpolation between them."""
FAST = 2.0
"""[rad]: if a body turns by more between two samples, its attitude in between is unknown."""
NEAR = 3.0
"""Distance from a jump, in sample periods, within which the second search ignores samples."""

NEXT = 5
"""Order of the splines that are compared with cubic ones to estimate the interpolation error."""

Curve = Callable[[np.ndarray], np.ndarray]


class Clocks(NamedTuple):
    """Clock relation t_B = t_A + offset + drift (t_A - start); times in s."""

    offset: float = 0.0
    """[s]."""
    drift: float = 0.0
    start: float = 0.0
    drift_error: float = 0.0
    """Standard error of the drift, 0 if no drift was estimated."""
    offset_error: float = 0.0
    """Standard error of the offset [s], 0 if no offset was estimated."""

    def of(self, t: np.ndarray) -> np.ndarray:
        """Times on A's clock converted to B's clock [s]."""
        return t + self.offset + self.drift * (t - self.start)

    @property
    def back(self) -> Clocks:
        """The inverse relation, from B's clock to A's."""
        drift = 1.0 / (1.0 + self.drift) - 1.0
        return Clocks(-self.offset, drift, self.start + self.offset)


class Interpolated:
    """A track as a function of time: cubic splines, exact at the samples, one for each stretch
    without a gap or restart."""

    def __init__(self, track: Track) -> None:
        if len(track.t) < FEW:
            count = "1 sample" if len(track.t) == 1 else f"{len(track.t)} samples"
            raise RbSimError(f"a motion of {count} with increasing times: must be at least {FEW}")
        self.track = track
        self.q = continuous(track.orientation)
        self._poses = np.hstack([track.position, self.q])
        self._stretches = stretches(track)
        self._first = np.array([track.t[part.start] for part in self._stretches])
        self._last = np.array([track.t[part.stop - 1] for part in self._stretches])
        self._count = np.array([part.stop - part.start for part in self._stretches])

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position (n, 3) and quaternion (n, 4) at n times within the track."""
        both = self.of(self._poses, t)
        return both[:, :3], both[:, 3:] if self.same(t) is not None else unit(both[:, 3:])

    def uncertainty(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Estimated interpolation error of position [m] and attitude [rad], shape (n,) each.

        Difference between cubic splines and those of order NEXT. It equals the error if higher
        orders converge: below about 1.5 rad of turn, or 0.8 rad of an oscillation, between samples.
        Difference and error vanish at different instants, so the maximum over the sample interval
        and its two neighbours is taken; it is 0 at a sample.
        """
        if self.same(t) is not None:
            return np.zeros(len(t)), np.zeros(len(t))
        position, orientation = self.at(t)
        other = self.of(self._poses, t, _next)
        off = norms(other[:, :3] - position), angle_between(unit(other[:, 3:]), orientation)
        free = (self._turn[self._interval(t)] > FAST) & ~self._own(t)
        return self._around(off[0], t), np.where(free, np.pi, self._around(off[1], t))

    def uncertainty_of(self, values: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Estimated error of `of`, as a norm: of vectors (m, 3), shape (n,)."""
        other = self.of(values, t, _next)
        return self._around(norms(other - self.of(values, t)), t)

    def _around(self, off: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Maximum of `off` over the sample interval and its neighbours; at a sample its own."""
        after = np.searchsorted(self.track.t, t - WRITTEN_ROUNDING)
        most = np.zeros(len(self.track.t) + 3)
        np.maximum.at(most, after + 1, off)
        near = np.maximum(np.maximum(most[after], most[after + 1]), most[after + 2])
        return np.where(self._own(t), off, near)

    def _own(self, t: np.ndarray) -> np.ndarray:
        """Mask of the times that coincide with samples."""
        return np.abs(self.track.t[self._next(t)] - t) <= WRITTEN_ROUNDING

    def _next(self, t: np.ndarray) -> np.ndarray:
        """Index of the sample at or after each time, else of the last one."""
        after = np.searchsorted(self.track.t, t - WRITTEN_ROUNDING)
        return np.minimum(after, len(self.track.t) - 1)

    @cached_property
    def _turn(self) -> np.ndarray:
        """Rotation between successive samples [rad], shape (n - 1,).

        The larger of the change of attitude and, if known, the mean spin times the period, which
        counts whole turns."""
        turn, w = angle_between(self.q[1:], self.q[:-1]), self.track.angular_velocity
        if w is None:
            return turn
        speed = np.linalg.norm(w, axis=1)
        return np.maximum(turn, 0.5 * (speed[1:] + speed[:-1]) * np.diff(self.track.t))

    def _interval(self, t: np.ndarray) -> np.ndarray:
        """Index of the last sample not after each time."""
        last = len(self.track.t) - 2
        return np.clip(np.searchsorted(self.track.t, t, side="right") - 1, 0, last)

    @cached_property
    def _curves_of_poses(self) -> list[Curve]:
        """Splines of position and quaternion, cached for the search of the clocks."""
        return self._curves(self._poses, CubicSpline)

    def known(self, t: np.ndarray) -> np.ndarray:
        """Mask of the times within a stretch of at least LEAST samples, or at a sample."""
        k = self._stretch(t)
        within = (t >= self._first[k] - WRITTEN_ROUNDING) & (t <= self._last[k] + WRITTEN_ROUNDING)
        return within & ((self._count[k] >= LEAST) | self._own(t))

    def same(self, t: np.ndarray) -> np.ndarray | None:
        """Indices of the samples at these times; None unless every time is that of a sample."""
        return self._next(t) if self._own(t).all() else None

    def of(
        self, values: np.ndarray, t: np.ndarray, spline: Callable[..., Curve] = CubicSpline
    ) -> np.ndarray:
        """Values (m, k) at the track's samples, interpolated at the times t; between two stretches
        the last value before the gap."""
        same = self.same(t)
        if same is not None:
            return values[same]
        cached = values is self._poses and spline is CubicSpline
        curves = self._curves_of_poses if cached else self._curves(values, spline)
        found, of = np.empty((len(t), values.shape[1])), self._stretch(t)
        within = np.clip(t, self._first[of], self._last[of])
        for k in np.unique(of).tolist():
            found[of == k] = curves[k](within[of == k])
        return found

    def _curves(self, values: np.ndarray, spline: Callable[..., Curve]) -> list[Curve]:
        """One interpolating function of time for each stretch."""
        return [
            spline(self.track.t[part], values[part])
            if part.stop - part.start > 1
            else partial(_standing, values[part])
            for part in self._stretches
        ]

    def _stretch(self, t: np.ndarray) -> np.ndarray:
        """Index of the last stretch that starts at or before each time."""
        k = np.searchsorted(self._first, t + WRITTEN_ROUNDING, side="right") - 1
        return np.maximum(k, 0)


def _next(t: np.ndarray, values: np.ndarray) -> Curve:
    """Spline of order NEXT; linear if there are too few samples."""
    return make_interp_spline(t, values, k=NEXT if len(t) > NEXT else 1)


def _standing(values: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Constant function of time: the only sample of a stretch."""
    return np.repeat(values, len(t), axis=0)


def stretches(track: Track) -> list[slice]:
    """Slices of samples without a gap or restart in between."""
    return between([*track.anew, *after_gaps(track.t).tolist()], len(track.t))


def overlap(a: Track, b: Track, clocks: Clocks) -> np.ndarray:
    """Mask of the samples of A that lie within the time span of B."""
    t = clocks.of(a.t)
    return (t >= b.t[0] - WRITTEN_ROUNDING) & (t <= b.t[-1] + WRITTEN_ROUNDING)


def clocks_for(mode: str, a: Track, b: Track) -> Clocks:
    """Clock relation for a mode of ALIGN. Raises RbSimError for an unknown mode."""
    if mode == "none":
        return Clocks()
    if mode == "first":
        return Clocks(float(b.t[0] - a.t[0]))
    if mode not in ALIGN:
        raise RbSimError(f"--align: got {mode!r}; must be one of {', '.join(ALIGN)}")
    return estimated(a, b, MOST_DRIFT if mode == "clock" else 0.0)


def wanted_at_ends(a: Track, b: Track) -> list[Clocks]:
    """Best offsets at the first and the last instant of A, if they differ by more than clocks
    drift.

    Else an empty list. If they do, the motions differ, and one mean offset would hide by how much.
    """
    bent = estimated(a, b, BENT)
    if not abs(bent.drift) > MOST_DRIFT + SURE * bent.drift_error:
        return []
    span = float(a.t[-1] - a.t[0])
    return [Clocks(bent.offset), Clocks(bent.offset + bent.drift * span)]


def estimated(a: Track, b: Track, most_drift: float = 0.0) -> Clocks:
    """Least-squares clock offset, and drift up to `most_drift`, between A and B.

    The residuals are positions relative to A's extent and attitudes in rad. A periodic or resting
    motion does not determine them; the result is then the best local minimum found.
    """
    shift = float(b.t[0] - a.t[0])
    stride = max(1, len(a.t) // SEARCHED)
    # times from the start of each: at 1.7e9 s a double resolves only 0.24 microseconds
    t, p, q = (a.t - a.t[0])[::stride], a.position[::stride], a.orientation[::stride]
    own = b.t - b.t[0]
    other = Interpolated(Track(own, b.position, b.orientation, anew=b.anew))
    scale = max(float(np.ptp(p, axis=0).max()), 1e-12)
    long_a, long_b = float(a.t[-1] - a.t[0]), float(own[-1])
    shared = TOGETHER * min(long_a, long_b)
    low, high = shared - long_a, long_b - shared

    used = np.ones(len(t), bool)
    drifts = most_drift > 0.0

    def misfit(x: np.ndarray) -> np.ndarray:
        at = np.clip(t + x[0] + (x[1] * t if drifts else 0.0), own[0], own[-1])
        position, orientation = other.at(at)
        both = np.hstack([(position - p) / scale, turn_between(orientation, q)])
        return (both * used[:, None]).ravel()

    bounds = ([low - WRITTEN_ROUNDING], [high + WRITTEN_ROUNDING])
    if drifts:
        bounds = ([*bounds[0], -most_drift], [*bounds[1], most_drift])
    scales = [1e-3, 1e-6][: 2 if drifts else 1]

    def searched(x: np.ndarray) -> OptimizeResult:
        return least_squares(misfit, x, x_scale=scales, bounds=bounds)

    tries = [-shift] if overlap(a, b, Clocks()).mean() > TOGETHER else []
    tries += [_lag(a, b), 0.0]
    # the search finds local minima: take the best of several starts
    starts = [np.array([min(max(x, low), high), 0.0][: len(scales)]) for x in tries]
    best = min(map(searched, starts), key=lambda result: result.cost)
    x = best.x
    slower = 1.0 + (x[1] if drifts else 0.0)
    jumps = np.concatenate([_begun(a) - a.t[0], (_begun(b) - b.t[0] - x[0]) / slower])
    if len(jumps):  # the misfit is discontinuous at a jump: repeat without samples near it
        near = NEAR * max(float(np.median(np.diff(t))), float(np.median(np.diff(own))))
        used = np.abs(t[:, None] - jumps).min(axis=1) > near
        best = searched(x)
        x = best.x
    errors = _standard_errors(best)
    drift, drift_error = (float(x[1]), errors[1]) if drifts else (0.0, 0.0)
    return Clocks(shift + float(x[0]), drift, float(a.t[0]), drift_error, errors[0])


def _standard_errors(found: OptimizeResult) -> list[float]:
    """Standard errors of least-squares parameters; infinite if they are not determined."""
    freedom = max(1, len(found.fun) - len(found.x))
    normal = found.jac.T @ found.jac
    try:
        spread = np.diag(np.linalg.inv(normal))
    except np.linalg.LinAlgError:
        return [float("inf")] * len(found.x)
    return np.sqrt(np.maximum(2.0 * found.cost / freedom * spread, 0.0)).tolist()


def moved(track: Track, within: np.ndarray) -> float:
    """Fraction of a motion's path length (or rotation, if it stays in place) within the mask."""
    for steps in (
        np.linalg.norm(np.diff(track.position, axis=0), axis=1),
        angle_between(track.orientation[1:], track.orientation[:-1]),
    ):
        if steps.sum() > 0.0:
            return float(steps[within[1:] & within[:-1]].sum() / steps.sum())
    return 1.0


def _begun(track: Track) -> np.ndarray:
    """Times of the first samples after a gap or restart [s]."""
    return track.t[[part.start for part in stretches(track)[1:]]]


def _lag(a: Track, b: Track) -> float:
    """Offset between the two starts that maximises the correlation of the speeds [s]; 0 if a track
    has only one sample.
    """
    if min(len(a.t), len(b.t)) < 2:
        return 0.0
    step = max((a.t[-1] - a.t[0]) / SEARCHED, (b.t[-1] - b.t[0]) / SEARCHED, 1e-6)
    one, other = (_activity(track, step) for track in (a, b))
    correlation = np.correlate(other, one, mode="full")
    shift = int(np.argmax(correlation)) - (len(one) - 1)
    return float(shift * step)


def _activity(track: Track, step: float) -> np.ndarray:
    """Normalised speed plus angular speed on a uniform time grid, mean removed."""
    grid = np.arange(track.t[0], track.t[-1], step)
    dt = np.diff(track.t)
    dt[[part.start - 1 for part in stretches(track)[1:]]] = np.inf  # no speed across a jump
    speed = np.linalg.norm(np.diff(track.position, axis=0), axis=1) / dt
    speed = speed / max(float(speed.max()), 1e-12)
    turning = angle_between(track.orientation[1:], track.orientation[:-1]) / dt
    turning = turning / max(float(turning.max()), 1e-12)
    values = np.interp(grid, track.t[1:], speed + turning)
    return values - values.mean()
