"""One motion on the times of another: interpolation, offset and drift between two clocks."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from rb_sim.bags.tracks import Track
from rb_sim.errors import RbSimError

FEW = 4
"""Samples below which nothing can be laid beside another motion."""
SEARCHED = 2000
"""Samples at most that the search for offset and drift looks at."""
SAME = 1e-9
"""[s]: times closer than this are the same instant."""


class Clocks(NamedTuple):
    """t_B = t_A + offset + drift (t_A - start)."""

    offset: float = 0.0
    """[s]."""
    drift: float = 0.0
    start: float = 0.0

    def of(self, t: np.ndarray) -> np.ndarray:
        """Times of A on the clock of B."""
        return t + self.offset + self.drift * (t - self.start)


class Interpolated:
    """A track as a function of time: cubic splines, exact at the samples themselves."""

    def __init__(self, track: Track) -> None:
        if len(track.t) < FEW:
            raise RbSimError(f"a motion of {len(track.t)} samples: must be at least {FEW}")
        self.track = track
        q = track.orientation
        turns = np.sign(np.sum(q[1:] * q[:-1], axis=1))
        self.q = q * np.cumprod(np.concatenate([[1.0], np.where(turns == 0, 1.0, turns)]))[:, None]
        self._position = CubicSpline(track.t, track.position)
        self._quaternion = CubicSpline(track.t, self.q)

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position (n, 3) and quaternion (n, 4) at times within the track."""
        same = self.same(t)
        if same is not None:
            return self.track.position[same], self.q[same]
        q = self._quaternion(t)
        return self._position(t), q / np.linalg.norm(q, axis=1, keepdims=True)

    def same(self, t: np.ndarray) -> np.ndarray | None:
        """Indices of the samples at these times, if each is one."""
        k = np.clip(np.searchsorted(self.track.t, t - SAME), 0, len(self.track.t) - 1)
        return k if np.all(np.abs(self.track.t[k] - t) <= SAME) else None

    def of(self, values: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Other values on the track's times, at the times t."""
        same = self.same(t)
        return values[same] if same is not None else CubicSpline(self.track.t, values)(t)


def angle_between(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Geodesic distance of two attitudes [rad], exact near 0 as well; shapes (n, 4)."""
    vector, scalar = _between(p, q)
    return 2.0 * np.arctan2(np.linalg.norm(vector, axis=1), np.abs(scalar))


def turn_between(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Twice the vector part of the turn from p to q, (n, 3): smooth where they agree."""
    vector, scalar = _between(p, q)
    return 2.0 * vector * np.where(scalar < 0, -1.0, 1.0)[:, None]


def _between(p: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    pv, pw, qv, qw = p[:, :3], p[:, 3:], q[:, :3], q[:, 3:]
    return pw * qv - qw * pv - np.cross(pv, qv), np.sum(p * q, axis=1)


def overlap(a: Track, b: Track, clocks: Clocks) -> np.ndarray:
    """Which samples of A lie within B."""
    t = clocks.of(a.t)
    return (t >= b.t[0] - SAME) & (t <= b.t[-1] + SAME)


def estimated(a: Track, b: Track) -> Clocks:
    """Offset and drift that lay B best onto A: position by its spread, attitude in radians.

    Where the motion repeats itself or stands still they are not determined; the least ones that
    the search finds are given.
    """
    shift = float(b.t[0] - a.t[0])
    stride = max(1, len(a.t) // SEARCHED)
    # times from the start of each: at 1.7e9 s a float tells no less than a quarter of a microsecond
    t, p, q = (a.t - a.t[0])[::stride], a.position[::stride], a.orientation[::stride]
    own = b.t - b.t[0]
    other = Interpolated(Track(own, b.position, b.orientation))
    scale = max(float(np.ptp(p, axis=0).max()), 1e-12)

    def misfit(x: np.ndarray) -> np.ndarray:
        at = np.clip(t + x[0] + x[1] * t, own[0], own[-1])
        position, orientation = other.at(at)
        turn = turn_between(orientation, q)
        return np.concatenate([(position - p).ravel() / scale, turn.ravel()])

    tries = [np.array([-shift, 0.0])] if overlap(a, b, Clocks()).mean() > 0.5 else []
    tries.append(np.array([_lag(a, b), 0.0]))
    # where a search along the clock ends depends on where it begins: the best of both
    found = [least_squares(misfit, x, x_scale=[1e-3, 1e-6]) for x in tries]
    best = min(found, key=lambda result: result.cost)
    return Clocks(shift + float(best.x[0]), float(best.x[1]), float(a.t[0]))


def _lag(a: Track, b: Track) -> float:
    """The offset, each from its start, at which the speeds are most alike (correlation's peak).

    Where one is a single sample they start together.
    """
    if min(len(a.t), len(b.t)) < 2:
        return 0.0
    step = max((a.t[-1] - a.t[0]) / SEARCHED, (b.t[-1] - b.t[0]) / SEARCHED, 1e-6)
    one, other = (_activity(track, step) for track in (a, b))
    correlation = np.correlate(other, one, mode="full")
    shift = int(np.argmax(correlation)) - (len(one) - 1)
    return float(shift * step)


def _activity(track: Track, step: float) -> np.ndarray:
    """Speed plus rate of turning on a grid, about its mean."""
    grid = np.arange(track.t[0], track.t[-1], step)
    dt = np.diff(track.t)
    speed = np.linalg.norm(np.diff(track.position, axis=0), axis=1) / dt
    speed = speed / max(float(speed.max()), 1e-12)
    turning = angle_between(track.orientation[1:], track.orientation[:-1]) / dt
    turning = turning / max(float(turning.max()), 1e-12)
    values = np.interp(grid, track.t[1:], speed + turning)
    return values - values.mean()
