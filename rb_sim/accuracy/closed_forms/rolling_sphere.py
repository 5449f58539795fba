"""Homogeneous sphere that rolls on a plane under a constant world wrench (LL 38, problem 1).

About the contact (I + m a^2) dw/dt = K + a n x F across the normal n, I dw_n/dt = K_n along it; so
w = w_0 + alpha t, and where w_0 is along alpha the sphere turns about one fixed direction.
"""

from __future__ import annotations

from typing import Any

from rb_sim.accuracy.closed_forms.exact import Exact
from rb_sim.accuracy.closed_forms.extended import (
    Array,
    Long,
    about,
    long,
    np,
    product,
    turned,
    unit,
    unturned,
)
from rb_sim.catalogue.effects.gravity import GravityRow
from rb_sim.catalogue.effects.wrench import WorldWrenchRow
from rb_sim.contact.geometry.shapes import SphereSurface
from rb_sim.engine.systems.rolling import RollingBody

CENTRE = (0.0, 0.0, 0.0)


def rolling_sphere(system: Any, y: Any) -> Exact | None:
    """The exact motion of a sphere that turns about a fixed direction, or None."""
    if not isinstance(system, RollingBody) or not is_homogeneous_sphere(system):
        return None
    wrench = constant_wrench(system)
    if wrench is None:
        return None
    force, torque = wrench
    surface: Any = system.surface
    n, a = long(system.normal), Long(surface.radius)
    n = n / np.sqrt(n @ n)
    mass, inertia = Long(system.body.mass), Long(system.body.inertia[0])
    moment = torque + a * np.cross(n, force)
    along = (torque @ n) * n
    alpha = (moment - (moment @ n) * n) / (inertia + mass * a * a) + along / inertia
    q0 = unit(long(y[3:7]))
    w0 = turned(q0, long(y[7:10]))
    largest = max(np.sqrt(alpha @ alpha), np.sqrt(w0 @ w0))
    if np.abs(np.cross(w0, alpha)).max() > 0:
        return None
    main = alpha if alpha @ alpha > 0 else w0
    axis = main / np.sqrt(main @ main) if largest > 0 else n
    p0 = long(y[0:3])

    def coordinates(times: Array) -> Array:
        t = long(times)
        angle = (w0 @ axis) * t + (alpha @ axis) * t * t / 2
        q = unit(product(about(axis, angle), q0))
        w = w0 + alpha * t[:, None]
        p = p0 + a * np.cross(angle[:, None] * axis, n)
        return np.concatenate([p, q, unturned(q, w)], axis=1).astype(float)

    return Exact("rolling sphere under a constant wrench; LL 38, problem 1", coordinates)


def is_homogeneous_sphere(system: RollingBody) -> bool:
    """Whether the centre of mass is the centre and all moments are equal."""
    surface, inertia = system.surface, system.body.inertia
    return (
        isinstance(surface, SphereSurface)
        and tuple(surface.centre_C) == CENTRE
        and len(set(inertia[:3])) == 1
        and not any(inertia[3:])
    )


def constant_wrench(system: RollingBody) -> tuple[Array, Array] | None:
    """Force at the centre and torque in world axes, or None where they are not constant."""
    force, torque = np.zeros(3, dtype=Long), np.zeros(3, dtype=Long)
    for row in system.effects:
        if isinstance(row, GravityRow):
            force = force + Long(system.body.mass) * long(row.acceleration_W)
        elif isinstance(row, WorldWrenchRow) and tuple(row.r_B) == CENTRE:
            force, torque = force + long(row.force_W), torque + long(row.torque_W)
        else:
            return None
    return force, torque
