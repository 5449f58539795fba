"""How a support moves that is no body of the scene: at rest, or as prescribed.

`carrier` gives the support's state at time t, its acceleration and angular acceleration (world
axes), and 1 where it is driven: what it then does to the body is work from outside.
"""

from __future__ import annotations

from typing import NamedTuple

from rb_sim.catalogue.types import BodyState, Vec3
from rb_sim.numerics.kernels import dispatch
from rb_sim.numerics.vectors import add, cos, cross, norm, rotate, scale, sin, sub


class Resting(NamedTuple):
    """The parent itself: a body of the scene, or the world at rest."""


class Turntable(NamedTuple):
    """Turns about an axis through a point at a constant rate."""

    point: Vec3
    """world [m]."""
    spin: Vec3
    """angular velocity, world [rad/s]."""


class Shaken(NamedTuple):
    """Shifted by amplitude sin(frequency t + phase)."""

    amplitude: Vec3
    """world [m]."""
    frequency: float
    """angular [rad/s]."""
    phase: float


@dispatch
def carrier(motion, t, A):
    """(state of the support, its acceleration, its angular acceleration, driven)."""


@carrier.register(Resting)
def resting(motion, t, A):
    return A, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0


@carrier.register(Turntable)
def turntable(motion, t, A):
    rate = norm(motion.spin)
    half = 0.5 * rate * t
    s = sin(half) / rate if rate > 0.0 else 0.0
    q = (s * motion.spin[0], s * motion.spin[1], s * motion.spin[2], cos(half))
    arm = rotate(q, motion.point)
    p = sub(motion.point, arm)
    v = cross(motion.spin, sub(p, motion.point))
    a = cross(motion.spin, v)
    # the spin is along the axis of turn: the same in the world's and the support's axes
    return BodyState(p, q, v, motion.spin), a, (0.0, 0.0, 0.0), 1.0


@carrier.register(Shaken)
def shaken(motion, t, A):
    w = motion.frequency
    s, c = sin(w * t + motion.phase), cos(w * t + motion.phase)
    state = BodyState(
        add((0.0, 0.0, 0.0), scale(s, motion.amplitude)),
        (0.0, 0.0, 0.0, 1.0),
        scale(w * c, motion.amplitude),
        (0.0, 0.0, 0.0),
    )
    return state, scale(-w * w * s, motion.amplitude), (0.0, 0.0, 0.0), 1.0
