"""Body on a fixed axis under gravity: the pendulum's elliptic functions.

theta'' = -W^2 sin theta with theta from the direction of gravity, W^2 = m g r / J.  With
k^2 = sin^2(theta_0/2) + theta'_0^2 / (4 W^2): swings sin(theta/2) = k sn(W t + u, k^2) for k < 1,
turns over theta/2 = am(k W t + u, 1/k^2) for k > 1 (Whittaker, Analytical Dynamics, section 44).
"""

from __future__ import annotations

from typing import Any

from rb_sim.accuracy.closed_forms.elliptic import argument, jacobi, quarter_period
from rb_sim.accuracy.closed_forms.exact import Exact
from rb_sim.accuracy.closed_forms.extended import Array, Long, long, np, tensor, unturned
from rb_sim.accuracy.closed_forms.parabola import gravity_of, only_gravity
from rb_sim.engine.systems.fixed_axis import FixedAxisBody

SEPARATRIX = 1e-15
"""|1 - k^2| below which the motion is not told from the separatrix."""


def pendulum(system: Any, y: Any) -> Exact | None:
    """The exact motion about a fixed axis under gravity alone, or None."""
    if not isinstance(system, FixedAxisBody) or not only_gravity(system.effects):
        return None
    frequency2, down = law(system)
    relative = about_hanging(Long(y[0]) - down, Long(y[1]), frequency2)
    if relative is None:
        return None
    motion = shifted(relative, down)

    def coordinates(times: Array) -> Array:
        return np.stack(motion(long(times)), axis=1).astype(float)

    return Exact("pendulum, Jacobi elliptic functions; Whittaker 44", coordinates)


PI = 4 * np.arctan(Long(1))


def about_hanging(theta: Long, speed: Long, frequency2: Long) -> Any:
    """motion(t) -> (theta, theta') of theta'' = -frequency2 sin theta; None near the separatrix."""
    if frequency2 == 0:
        return uniform(theta, speed)
    whole = 2 * PI * np.round(theta / (2 * PI))
    W, half = np.sqrt(frequency2), (theta - whole) / 2
    m1 = (np.cos(half) - speed / (2 * W)) * (np.cos(half) + speed / (2 * W))  # 1 - k^2
    if abs(m1) < SEPARATRIX:
        return None
    relative = swing(half, speed, W, m1) if m1 > 0 else turning(half, speed, W, m1)
    return shifted(relative, whole)


def law(system: FixedAxisBody) -> tuple[Long, Long]:
    """(W^2, the angle phi at which C hangs along gravity)."""
    n = long(system.axis_B)
    n = n / np.sqrt((n * n).sum())
    rho = long(system.rho)
    g = unturned(long(system.q_0), gravity_of(system.effects))
    mass = Long(system.body.mass)
    about_A = tensor(system.body.inertia) + mass * ((rho @ rho) * np.eye(3) - np.outer(rho, rho))
    arm, pull = rho - (rho @ n) * n, g - (g @ n) * n
    size = np.sqrt((arm @ arm) * (pull @ pull))
    down = np.arctan2(n @ np.cross(arm, pull), arm @ pull)
    return mass * size / (n @ about_A @ n), down


def uniform(angle: Long, speed: Long) -> Any:
    return lambda t: (angle + speed * t, speed + 0 * t)


def shifted(motion: Any, by: Long) -> Any:
    def moved(t: Array) -> tuple[Array, Array]:
        angle, speed = motion(t)
        return angle + by, speed

    return moved


def swing(half: Long, speed: Long, W: Long, m1: Long) -> Any:
    """k < 1: theta and theta' over time."""
    k = np.sqrt(np.sin(half) ** 2 + (speed / (2 * W)) ** 2)
    if k == 0:
        return uniform(Long(0), Long(0))
    start = argument(np.sin(half) / k, speed / (2 * W * k), m1)

    def motion(t: Array) -> tuple[Array, Array]:
        sn, cn, dn = jacobi(W * t + start, m1)
        return 2 * np.arctan2(k * sn, dn), 2 * k * W * cn

    return motion


def turning(half: Long, speed: Long, W: Long, m1: Long) -> Any:
    """k > 1: theta (not wrapped) and theta' over time."""
    k = np.sqrt(np.sin(half) ** 2 + (speed / (2 * W)) ** 2)
    side = np.sign(speed)
    rest = -m1 / (k * k)  # 1 - 1/k^2
    K = quarter_period(rest)
    start = argument(side * np.sin(half), np.cos(half), rest)

    def motion(t: Array) -> tuple[Array, Array]:
        u = k * W * t + start
        sn, cn, dn = jacobi(u, rest)
        wrapped = np.arctan2(sn, cn)
        turns = np.round((u * PI / (2 * K) - wrapped) / (2 * PI))
        return side * 2 * (wrapped + 2 * PI * turns), side * 2 * k * W * dn

    return motion
