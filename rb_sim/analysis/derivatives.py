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
from scipy.interpolate import CubicSpline
from scipy.ndimage import convolve1d
from scipy.signal import savgol_coeffs
from scipy.spatial.transform import Rotation

from rb_sim.bags.rates import GAP
from rb_sim.sinks.frames import cross, rotate

WINDOW = 9
ORDER = 5
FILTER = f"Savitzky-Golay, order {ORDER} through {WINDOW} samples"
UNEVEN = 2e-6
"""Of the period h: samples less even than this are first laid on an even grid by a cubic spline. A
stamp that is off by e counts as a pose off by v e, and as an acceleration off by 0.3 v e / h^2."""
NORMAL = 0.6745
"""Median of the absolute value of a normal distribution of standard deviation 1."""
ROUNDING = 1e-9
"""Of the size of a coordinate: scatter below is none."""
SLOW = 1e-3
"""[rad] a sample, below which rounding hides the error of the filter (1e-10 there)."""
LOOKED_AT = 1024
"""Samples of a stretch at most by whose scatter the noise is told."""


class Body(NamedTuple):
    """Mass properties. Units and frames as in a scene."""

    mass: float
    inertia: np.ndarray
    center_of_mass: np.ndarray


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
    components together, that follow from the poses' scatter about the filter's polynomial."""


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


def differentiated(
    t: np.ndarray, position: np.ndarray, q: np.ndarray, center_of_mass: np.ndarray
) -> Motion | None:
    """The motion of C in one stretch, without the half window at its ends; None if too short."""
    if len(t) < WINDOW + 2:
        return None
    t, rows, h = even(t, position + rotate(q, center_of_mass), q)
    inner = slice(WINDOW // 2, -(WINDOW // 2))
    rate, bend = (_derivative(rows, order, h)[:, inner].T for order in (1, 2))
    p, q = rows[:3, inner].T, rows[3:, inner].T
    return Motion(
        t[inner], rate[:, :3], _spin(rate[:, 3:], q), bend[:, :3], _spin(bend[:, 3:], q), p, q,
        _noise(rows[:, :LOOKED_AT], h),
    )  # fmt: skip


def even(
    t: np.ndarray, position: np.ndarray, q: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Times on an even grid, positions and quaternions there, (7, n), and its period [s].

    One row each: filters are several times faster along rows than along columns.
    """
    q = q / np.linalg.norm(q, axis=1, keepdims=True)
    turns = np.where(np.sum(q[1:] * q[:-1], axis=1) < 0, -1.0, 1.0)
    q = q * np.cumprod(np.concatenate([[1.0], turns]))[:, None]
    both = np.concatenate([position.T, q.T])
    h = float((t[-1] - t[0]) / (len(t) - 1))
    grid = t[0] + h * np.arange(len(t))
    if np.abs(grid - t).max() <= UNEVEN * h:
        return t, both, h
    return grid, np.ascontiguousarray(CubicSpline(t, both, axis=1)(grid)), h


def _derivative(rows: np.ndarray, order: int, h: float) -> np.ndarray:
    """Along each row of samples h apart; the half window at either end is of no use."""
    return convolve1d(rows, _coefficients(order), axis=1, mode="constant") / h**order


def _noise(rows: np.ndarray, h: float) -> tuple[float, float]:
    """Of the accelerations, from poses (7, n): what noise of the size of their scatter makes.

    The median of the scatter, as of a normal distribution: an impact now and then is no noise.
    """
    rest = (_derivative(rows, 0, h) - rows)[:, WINDOW // 2 : -(WINDOW // 2)]
    own = 1.0 - _coefficients(0)[WINDOW // 2]  # part of the noise's variance that is left over
    sigma = np.median(np.abs(rest), axis=1) / (NORMAL * np.sqrt(own))
    sigma = np.where(sigma > ROUNDING * np.abs(rows).max(axis=1), sigma, 0.0)
    gain = float(np.linalg.norm(_coefficients(2))) / h**2
    return gain * float(np.linalg.norm(sigma[:3])), 2.0 * gain * float(np.linalg.norm(sigma[3:]))


def velocity_noise(motion: Motion) -> tuple[float, float]:
    """Standard deviations of velocity [m/s] and spin [rad/s] that belong to a motion's noise."""
    h = float(motion.t[-1] - motion.t[0]) / max(1, len(motion.t) - 1)
    gain = h * float(np.linalg.norm(_coefficients(1)) / np.linalg.norm(_coefficients(2)))
    return gain * motion.noise[0], gain * motion.noise[1]


@cache
def _coefficients(order: int) -> np.ndarray:
    """The filter's weights for a period of 1."""
    return savgol_coeffs(WINDOW, ORDER, deriv=order)


def _spin(rate: np.ndarray, q: np.ndarray) -> np.ndarray:
    """2 vec(rate q*), shape (n, 3)."""
    u, v = rate[:, :3], q[:, :3]
    return 2.0 * (rate[:, 3:] * -v + q[:, 3:] * u - cross(u, v))


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
    turn = Rotation.from_quat(motion.orientation).as_matrix()
    back = turn.transpose(0, 2, 1)

    def through_inertia(vector: np.ndarray) -> np.ndarray:
        return _each(turn, _each(back, vector) @ body.inertia.T)

    own, linear = through_inertia(motion.spin), body.mass * motion.velocity
    torque = through_inertia(motion.turning) + cross(motion.spin, own)
    energy = 0.5 * np.sum(linear * motion.velocity + own * motion.spin, axis=1)
    angular = cross(motion.position, linear) + own
    return Taken(np.hstack([body.mass * motion.acceleration, torque]), energy, linear, angular)


def _each(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """The product of each of n matrices with its vector, shape (n, 3)."""
    return np.einsum("nij,nj->ni", matrices, vectors)
