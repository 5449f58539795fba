"""Motion from poses alone: velocities and accelerations by a stated filter, and the wrench.

Positions and quaternions are differentiated by Savitzky and Golay's filter (1964): a polynomial of
order ORDER through WINDOW samples, evaluated at their middle. With the quaternion q, body to world,

    w = 2 vec(q' q*)      w' = 2 vec(q'' q*)      (world axes)
    F = m a_C             K = I w' + w x I w      (about the centre of mass C)
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.signal import savgol_filter

from rb_sim.bags.rates import GAP
from rb_sim.sinks.frames import cross, rotate

WINDOW = 9
ORDER = 5
FILTER = f"Savitzky-Golay, order {ORDER} through {WINDOW} samples"
UNEVEN = 1e-3
"""Of the period: samples less even than this are first laid on an even grid (linearly)."""


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
    p = position + rotate(q, center_of_mass)
    q = q / np.linalg.norm(q, axis=1, keepdims=True)
    turns = np.where(np.sum(q[1:] * q[:-1], axis=1) < 0, -1.0, 1.0)
    q = q * np.cumprod(np.concatenate([[1.0], turns]))[:, None]
    h = float((t[-1] - t[0]) / (len(t) - 1))
    even = t[0] + h * np.arange(len(t))
    if np.abs(even - t).max() > UNEVEN * h:
        p = np.stack([np.interp(even, t, column) for column in p.T], axis=1)
        q = np.stack([np.interp(even, t, column) for column in q.T], axis=1)
        t = even
    half = WINDOW // 2
    inner = slice(half, -half)

    def derivative(values: np.ndarray, order: int) -> np.ndarray:
        smooth: Any = savgol_filter(
            values, WINDOW, ORDER, deriv=order, delta=h, axis=0, mode="constant"
        )  # of which the ends, which this mode spoils, are left out
        return smooth[inner]

    return Motion(
        t[inner], derivative(p, 1), _spin(derivative(q, 1), q[inner]), derivative(p, 2),
        _spin(derivative(q, 2), q[inner]), p[inner], q[inner],
    )  # fmt: skip


def _spin(rate: np.ndarray, q: np.ndarray) -> np.ndarray:
    """2 vec(rate q*), shape (n, 3)."""
    u, v = rate[:, :3], q[:, :3]
    return 2.0 * (rate[:, 3:] * -v + q[:, 3:] * u - cross(u, v))


def inverse_dynamics(motion: Motion, body: Body) -> np.ndarray:
    """Total force and torque about C that the motion takes, world axes, shape (n, 6)."""
    q, inverse = motion.orientation, motion.orientation * np.array([-1.0, -1.0, -1.0, 1.0])

    def through_inertia(vector: np.ndarray) -> np.ndarray:
        return rotate(q, rotate(inverse, vector) @ body.inertia.T)

    torque = through_inertia(motion.turning) + cross(motion.spin, through_inertia(motion.spin))
    return np.hstack([body.mass * motion.acceleration, torque])


def momenta(motion: Motion, body: Body) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Kinetic energy (n,), linear and angular momentum about the world's origin (n, 3) each."""
    inverse = motion.orientation * np.array([-1.0, -1.0, -1.0, 1.0])
    w_B = rotate(inverse, motion.spin)
    own = rotate(motion.orientation, w_B @ body.inertia.T)
    linear = body.mass * motion.velocity
    energy = 0.5 * np.sum(linear * motion.velocity, axis=1) + 0.5 * np.sum(
        own * motion.spin, axis=1
    )
    return energy, linear, cross(motion.position, linear) + own
