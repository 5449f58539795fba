"""A short step of impulses over what the laws between forces and accelerations leave open.

Some motions change their contacts at every instant (corners that slip about a point that wanders,
a rod that Painleve's paradox leaves no force).  Between velocities and impulses the laws of contact
have a solution (Stewart and Trinkle 1996): over a length of time too short to matter, the loads act
as one impulse, and those of the contacts answer it.
"""

from __future__ import annotations

import numpy as np

from rb_sim.contact.events.dense import set_velocities, velocities
from rb_sim.contact.events.impacts import impulses_with
from rb_sim.contact.events.instant import Instant
from rb_sim.contact.system.accelerations import contact_power
from rb_sim.engine.samples import Array
from rb_sim.engine.systems.many_bodies import MULTIPLIERS, WIDTH
from rb_sim.maths.vectors import quaternion_rate


def leap(at: Instant, duration: float) -> Array | None:
    """Impulses of all lines [N s] over `duration` [s]; y becomes the state after it, off the
    manifold by the square of the duration.  Impulses and contact forces work on the mean velocity.
    None if the laws have no solution here either."""
    u = velocities(at.system, at.y)
    loaded = u + duration * at.lines.free
    touching = at.touching()
    v = at.lines.J @ loaded - at.lines.rate
    x = impulses_with(at, touching, v, {}, {})
    if x is None:
        return None
    p = at.lines.J.T @ x
    after = loaded + at.inverse_mass @ p
    u_mean = 0.5 * (u + after)
    work = float(p @ u_mean) + duration * power_of_given(at, u_mean)
    for i in range(at.system.bodies.shape[0]):
        mean = u_mean[6 * i : 6 * i + 6]
        q = slice(WIDTH * i + 3, WIDTH * i + 7)
        at.y[WIDTH * i : WIDTH * i + 3] += duration * mean[:3]
        at.y[q] += duration * np.array(quaternion_rate(tuple(at.y[q]), tuple(mean[3:])))
    set_velocities(at.system, at.y, after)
    at.y[WIDTH * at.system.bodies.shape[0]] += work
    at.t += duration
    return x


def power_of_given(at: Instant, u: Array) -> float:
    """Power of the forces of contacts that are among the loads (of compliant supports, and viscous
    ones) at the velocities u [W]."""
    y, multipliers = at.y.copy(), at.system.vectors[MULTIPLIERS].copy()
    set_velocities(at.system, y, u)
    at.system.vectors[MULTIPLIERS] = 0.0
    power = contact_power(at.system, y)
    at.system.vectors[MULTIPLIERS] = multipliers
    return float(power)
