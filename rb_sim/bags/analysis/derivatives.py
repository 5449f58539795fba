# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Velocities, accelerations and wrenches from poses alone.

Positions and quaternions are differentiated by the filter of Savitzky and Golay (1964): a
polynomial of order ORDER through WINDOW samples, evaluated at the middle one. With the quaternion
q, body to world,

    w = 2 vec(q' q*)      w' = 2 vec(q'' q*)      (world axes)
    F = m a_C             K = I w' + w x I w      (about the centre of mass C)
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline, make_interp_spline
from scipy.ndimage import convolve1d
from scipy.signal import savgol_coeffs

from rb_sim.bags.info import GAP, LOST, after_gaps, between
from rb_sim.base.rounding import WRITTEN_ROUNDING
from rb_sim.numerics.rotations import conjugate, continuous, cross, product, rotate, unit

WINDOW = 9
ORDER = 5
FILTER = f"Savitzky-Golay, order {ORDER} through {WINDOW} samples"
UNEVEN = 2e-6
"""Deviation from even sampling, relative to the period h, above which samples are resampled by
a cubic spline. A stamp error e acts as a position error v e and an acceleration error 0.3 v e /
h^2."""
NORMAL = 0.6745
"""Median absolute value of a normal distribution with standard deviation 1."""
SLOW = 1e-3
"""[rad] per sample, below which the filter's error (1e-10 there) is less than rounding."""
FILL = 5
"""Order of the spline that fills in single lost samples: that of the filter."""
ALIKE = 0.1
"""Relative RMS difference between recorded twist and derivative of the poses, beyond their noise,
below which the twist is accepted as that derivative."""
SURE = 3.0
"""Standard deviations of noise allowed between the two."""
LOOKED_AT = 1024
"""Maximum number of samples of a stretch from which its noise is estimated."""


class Body(NamedTuple):
    """Mass properties; units and frames as in a scene file."""

    mass: float
    inertia: np.ndarray
    center_of_mass: np.ndarray


class Scatter(NamedTuple):
    """Standard deviations of noise, as the norm over the three components."""

    position: float = 0.0
    """[m]."""
    turn: float = 0.0
    """[rad]."""
    velocity: float = 0.0
    """[m/s]."""
    spin: float = 0.0
    """[rad/s]."""


class Motion(NamedTuple):
    """Motion of a body about its centre of mass C, world axes; arrays (n, 3) except t."""

    t: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    acceleration: np.ndarray
    turning: np.ndarray
    """angular acceleration."""
    position: np.ndarray
    orientation: np.ndarray
    """(n, 4)."""
    noise: tuple[float, float] = (0.0, 0.0)
    """standard deviations of acceleration [m/s^2] and angular acceleration [rad/s^2], as norms over
    the three components, from the scatter of the readings about the filter's polynomial."""
    scatter: Scatter = Scatter()
    """standard deviations of the poses and the velocities."""
    recorded: tuple[np.ndarray | None, np.ndarray | None] = (None, None)
    """recorded velocity and spin, unfiltered, if used instead of the derivative; else None."""


Jump = tuple[float, float]
"""A step back in time: the stamp before it and the one after it [s]."""


def pieces(t: np.ndarray) -> list[slice]:
    """Slices of t without a gap or a step back."""
    return between(after_gaps(t, GAP).tolist(), len(t))


def filled(t: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times and rows with single lost samples filled in by splines.

    rows: (n, m), quaternions in columns 3 to 6. A column with a NaN anywhere in a stretch is NaN in
    the samples filled in.
    """
    parts = []
    for part in pieces(t):
        own_t, own = t[part], rows[part]
        steps = np.diff(own_t)
        lost = np.flatnonzero(steps > LOST * np.median(steps)) if len(steps) > FILL else []
        if len(lost):
            own = own.copy()
            own[:, 3:7] = continuous(own[:, 3:7])
            at = 0.5 * (own_t[lost] + own_t[np.add(lost, 1)])
            known = np.isfinite(own).all(axis=0)
            made = np.full((len(at), own.shape[1]), np.nan)
            made[:, known] = make_interp_spline(own_t, own[:, known], k=FILL)(at)
            own_t = np.insert(own_t, np.add(lost, 1), at)
            own = np.insert(own, np.add(lost, 1), made, axis=0)
        parts.append((own_t, own))
    return np.concatenate([p for p, _ in parts]), np.concatenate([p for _, p in parts])


def differentiated(
    t: np.ndarray,
    position: np.ndarray,
    q: np.ndarray,
    center_of_mass: np.ndarray,
    twist: np.ndarray | None = None,
) -> Motion | None:
    """Motion of C in one stretch, without half a window at either end; None if it is too short.

    twist: recorded velocity of the origin and spin, body axes, (n, 6). Each of the two replaces the
    derivative of the poses if it agrees with it within noise and is less noisy.
    """
    if len(t) < WINDOW + 2:
        return None
    arm = rotate(q, center_of_mass)
    t, rows, h = even(t, position + arm, q, None if twist is None else _in_world(q, arm, twist))
    inner = slice(WINDOW // 2, -(WINDOW // 2))
    rate, bend = (_derivative(rows[:7], order, h)[:, inner].T for order in (1, 2))
    p, q = rows[:3, inner].T, rows[3:7, inner].T
    speeds = [rate[:, :3], _spin(rate[:, 3:], q)]
    changes = [bend[:, :3], _spin(bend[:, 3:], q)]
    sigma = _sigma(rows[:, :LOOKED_AT], h)
    scatter = [float(np.linalg.norm(sigma[:3])), 2.0 * float(np.linalg.norm(sigma[3:7]))]
    noise = [_gain(1, h) * x for x in scatter]
    noise_of_changes = [_gain(2, h) * x for x in scatter]
    taken: list[np.ndarray | None] = [None, None]
    for k in (0, 1) if twist is not None else ():
        part = slice(7 + 3 * k, 10 + 3 * k)
        own = _derivative(rows[part], 0, h)[:, inner].T
        own_noise = float(np.linalg.norm(sigma[part]))
        if _gain(0, h) * own_noise < noise[k] and _alike(own, speeds[k], noise[k]):
            speeds[k], changes[k] = own, _derivative(rows[part], 1, h)[:, inner].T
            noise[k], noise_of_changes[k] = _gain(0, h) * own_noise, _gain(1, h) * own_noise
            taken[k] = rows[part, inner].T
    return Motion(
        t[inner], speeds[0], speeds[1], changes[0], changes[1], p, q,
        (noise_of_changes[0], noise_of_changes[1]), Scatter(*scatter, *noise), (taken[0], taken[1]),
    )  # fmt: skip


def _in_world(q: np.ndarray, arm: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """Velocity of the centre of mass (at `arm` from the origin) and spin, world axes, (n, 6)."""
    q = unit(q)
    v, w = rotate(q, twist[:, :3]), rotate(q, twist[:, 3:])
    return np.hstack([v + cross(w, arm), w])


def _alike(own: np.ndarray, posed: np.ndarray, noise: float) -> bool:
    """Whether recorded velocities agree with those from the poses, whose noise is given."""
    apart, size = (float(np.mean(np.sum(x * x, axis=1))) for x in (own - posed, posed))
    return bool(own.any()) and apart <= ALIKE**2 * size + (SURE * noise) ** 2


def even(
    t: np.ndarray, position: np.ndarray, q: np.ndarray, more: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, float]:
    """Evenly spaced times, positions and quaternions at them (7, n), and their period [s].

    more: further columns, which become further rows. Rows, since filters run several times faster
    along rows than along columns.
    """
    q = continuous(unit(q))
    both = np.concatenate([position.T, q.T, *([] if more is None else [more.T])])
    h = float((t[-1] - t[0]) / (len(t) - 1))
    grid = t[0] + h * np.arange(len(t))
    if np.abs(grid - t).max() <= UNEVEN * h:
        return t, both, h
    return grid, np.ascontiguousarray(CubicSpline(t, both, axis=1)(grid)), h


def _derivative(rows: np.ndarray, order: int, h: float) -> np.ndarray:
    """Derivative along each row, sample period h; half a window at either end is invalid."""
    return convolve1d(rows, coefficients(order), axis=1, mode="constant") / h**order


def _sigma(rows: np.ndarray, h: float) -> np.ndarray:
    """Standard deviation of the noise of each row (m, n), from its scatter about the polynomial.

    By the median of the scatter, assuming a normal distribution: occasional impacts do not count.
    """
    rest = (_derivative(rows, 0, h) - rows)[:, WINDOW // 2 : -(WINDOW // 2)]
    own = 1.0 - coefficients(0)[WINDOW // 2]  # fraction of the noise's variance in the residual
    sigma = np.median(np.abs(rest), axis=1) / (NORMAL * np.sqrt(own))
    return np.where(sigma > WRITTEN_ROUNDING * np.abs(rows).max(axis=1), sigma, 0.0)


def _gain(order: int, h: float) -> float:
    """Ratio of the noise of a filtered derivative to that of the samples."""
    return float(np.linalg.norm(coefficients(order))) / h**order


@cache
def coefficients(order: int, polynomial: int = ORDER) -> np.ndarray:
    """Filter weights (WINDOW,) of a derivative, for a sample period of 1 and a polynomial of that
    order."""
    return savgol_coeffs(WINDOW, polynomial, deriv=order)


def _spin(rate: np.ndarray, q: np.ndarray) -> np.ndarray:
    """2 vec(rate q*), shape (n, 3)."""
    return 2.0 * product(rate, conjugate(q))[:, :3]


def error_at(turn: float) -> float:
    """Relative error of the filter's second derivative at `turn` [rad] of rotation per sample.

    From its frequency response; a quaternion oscillates at half the angle.
    """
    if turn < SLOW:
        return 0.0
    half, k = 0.5 * turn, np.arange(WINDOW) - WINDOW // 2
    return float(abs(1.0 + coefficients(2) @ np.cos(half * k) / half**2))


class Taken(NamedTuple):
    """Wrench, energy and momenta of the motion of one body, world axes."""

    wrench: np.ndarray
    """total force and torque about C, shape (n, 6)."""
    energy: np.ndarray
    """kinetic, shape (n,)."""
    linear: np.ndarray
    angular: np.ndarray
    """momentum, the angular one about the world's origin, shape (n, 3) each."""


def inverse_dynamics(motion: Motion, body: Body) -> Taken:
    """Wrench, energy and momenta of a motion."""
    q = motion.orientation

    def through_inertia(vector: np.ndarray) -> np.ndarray:
        return rotate(q, rotate(conjugate(q), vector) @ body.inertia.T)

    own, linear = through_inertia(motion.spin), body.mass * motion.velocity
    torque = through_inertia(motion.turning) + cross(motion.spin, own)
    energy = 0.5 * np.sum(linear * motion.velocity + own * motion.spin, axis=1)
    angular = cross(motion.position, linear) + own
    return Taken(np.hstack([body.mass * motion.acceleration, torque]), energy, linear, angular)
