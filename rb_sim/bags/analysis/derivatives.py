# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Motion from poses alone: velocities and accelerations by a stated filter, and the wrench.

Positions and quaternions are differentiated by Savitzky and Golay's filter (1964): a polynomial of
order ORDER through WINDOW samples, evaluated at their middle. With the quaternion q, body to world,

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

from rb_sim.bags.info import GAP, LOST
from rb_sim.base.rounding import WRITTEN_ROUNDING
from rb_sim.numerics.rotations import conjugate, continuous, cross, product, rotate, unit

WINDOW = 9
ORDER = 5
FILTER = f"Savitzky-Golay, order {ORDER} through {WINDOW} samples"
UNEVEN = 2e-6
"""Of the period h: samples less even than this are first laid on an even grid by a cubic spline. A
stamp that is off by e counts as a pose off by v e, and as an acceleration off by 0.3 v e / h^2."""
NORMAL = 0.6745
"""Median of the absolute value of a normal distribution of standard deviation 1."""
SLOW = 1e-3
"""[rad] a sample, below which rounding hides the error of the filter (1e-10 there)."""
FILL = 5
"""Order of the spline that gives single lost samples: that of the filter."""
ALIKE = 0.1
"""Recorded twist less the derivative of the poses, of the latter, beyond their noise (RMS): below
this it is their derivative."""
SURE = 3.0
"""Standard deviations of noise that may lie between both."""
LOOKED_AT = 1024
"""Samples of a stretch at most from whose scatter the noise is estimated."""


class Body(NamedTuple):
    """Mass properties. Units and frames as in a scene."""

    mass: float
    inertia: np.ndarray
    center_of_mass: np.ndarray


class Scatter(NamedTuple):
    """Standard deviations of noise, all three components together."""

    position: float = 0.0
    """[m]."""
    turn: float = 0.0
    """[rad]."""
    velocity: float = 0.0
    """[m/s]."""
    spin: float = 0.0
    """[rad/s]."""


class Motion(NamedTuple):
    """World axes, about the centre of mass C; each of shape (n, 3) but t."""

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
    """standard deviations of the acceleration [m/s^2] and the angular one [rad/s^2], all three
    components together, that follow from the readings' scatter about the filter's polynomial."""
    scatter: Scatter = Scatter()
    """the same of the poses, and of the velocities."""
    recorded: tuple[np.ndarray | None, np.ndarray | None] = (None, None)
    """velocity and spin of a recorded twist as they were read, where they are taken."""


Jump = tuple[float, float]
"""A step back: the stamp before and the one after [s]."""


def pieces(t: np.ndarray) -> list[slice]:
    """The stretches of t without a gap or a step back."""
    if len(t) < 2:
        return [slice(0, len(t))]
    steps = np.diff(t)
    period = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    cuts = np.flatnonzero((steps <= 0) | (steps > GAP * period)) + 1
    edges = [0, *cuts.tolist(), len(t)]
    return [slice(a, b) for a, b in zip(edges, edges[1:], strict=False)]


def filled(t: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """With the single samples that lack, by splines; rows: (n, m), in columns 3 to 6 quaternions.

    A column that is not known throughout a stretch is not known there.
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
    """The motion of C in one stretch, without the half window at its ends; None if too short.

    twist: recorded velocity of the origin and spin, in the body's axes, (n, 6). Each of both is
    taken instead of the derivative of the poses if it is that but for noise, and less noisy.
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
    """Velocity of the centre of mass, `arm` from the origin, and spin, world axes."""
    q = unit(q)
    v, w = rotate(q, twist[:, :3]), rotate(q, twist[:, 3:])
    return np.hstack([v + cross(w, arm), w])


def _alike(own: np.ndarray, posed: np.ndarray, noise: float) -> bool:
    """Whether recorded velocities are those of the poses, which have this noise."""
    apart, size = (float(np.mean(np.sum(x * x, axis=1))) for x in (own - posed, posed))
    return bool(own.any()) and apart <= ALIKE**2 * size + (SURE * noise) ** 2


def even(
    t: np.ndarray, position: np.ndarray, q: np.ndarray, more: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, float]:
    """Times on an even grid, positions and quaternions there, (7, n), and its period [s].

    more: other columns, whose rows follow. One row each: filters are several times faster along
    rows than along columns.
    """
    q = continuous(unit(q))
    both = np.concatenate([position.T, q.T, *([] if more is None else [more.T])])
    h = float((t[-1] - t[0]) / (len(t) - 1))
    grid = t[0] + h * np.arange(len(t))
    if np.abs(grid - t).max() <= UNEVEN * h:
        return t, both, h
    return grid, np.ascontiguousarray(CubicSpline(t, both, axis=1)(grid)), h


def _derivative(rows: np.ndarray, order: int, h: float) -> np.ndarray:
    """Along each row of samples h apart; the half window at either end is of no use."""
    return convolve1d(rows, _coefficients(order), axis=1, mode="constant") / h**order


def _sigma(rows: np.ndarray, h: float) -> np.ndarray:
    """Standard deviation of the noise of each row (m, n), by its scatter about the polynomial.

    The median of the scatter, as of a normal distribution: an impact now and then is no noise.
    """
    rest = (_derivative(rows, 0, h) - rows)[:, WINDOW // 2 : -(WINDOW // 2)]
    own = 1.0 - _coefficients(0)[WINDOW // 2]  # part of the noise's variance that is left over
    sigma = np.median(np.abs(rest), axis=1) / (NORMAL * np.sqrt(own))
    return np.where(sigma > WRITTEN_ROUNDING * np.abs(rows).max(axis=1), sigma, 0.0)


def _gain(order: int, h: float) -> float:
    """Noise of a derivative by the filter, of that of the samples."""
    return float(np.linalg.norm(_coefficients(order))) / h**order


def velocity_noise(motion: Motion) -> tuple[float, float]:
    """Standard deviations of velocity [m/s] and spin [rad/s] of a motion."""
    return motion.scatter.velocity, motion.scatter.spin


@cache
def _coefficients(order: int) -> np.ndarray:
    """The filter's weights for a period of 1."""
    return savgol_coeffs(WINDOW, ORDER, deriv=order)


def _spin(rate: np.ndarray, q: np.ndarray) -> np.ndarray:
    """2 vec(rate q*), shape (n, 3)."""
    return 2.0 * product(rate, conjugate(q))[:, :3]


def error_at(turn: float) -> float:
    """Relative error of a second derivative where the body turns by `turn` [rad] a sample.

    The filter's response to an oscillation beside the exact one; a quaternion turns by half.
    """
    if turn < SLOW:
        return 0.0
    half, k = 0.5 * turn, np.arange(WINDOW) - WINDOW // 2
    return float(abs(1.0 + _coefficients(2) @ np.cos(half * k) / half**2))


class Taken(NamedTuple):
    """What a motion of one body takes, world axes."""

    wrench: np.ndarray
    """total force and torque about C, shape (n, 6)."""
    energy: np.ndarray
    """kinetic, shape (n,)."""
    linear: np.ndarray
    angular: np.ndarray
    """momentum, the angular one about the world's origin, shape (n, 3) each."""


def inverse_dynamics(motion: Motion, body: Body) -> Taken:
    """The wrench, energy and momenta of a motion."""
    q = motion.orientation

    def through_inertia(vector: np.ndarray) -> np.ndarray:
        return rotate(q, rotate(conjugate(q), vector) @ body.inertia.T)

    own, linear = through_inertia(motion.spin), body.mass * motion.velocity
    torque = through_inertia(motion.turning) + cross(motion.spin, own)
    energy = 0.5 * np.sum(linear * motion.velocity + own * motion.spin, axis=1)
    angular = cross(motion.position, linear) + own
    return Taken(np.hstack([body.mass * motion.acceleration, torque]), energy, linear, angular)
