"""A short step of impulses over what the laws between forces and accelerations leave open.

Some motions change their contacts at every instant (corners that slip about a point that wanders,
a slip whose direction turns faster than it grows, a rod that Painleve's paradox leaves no force).
Between velocities and impulses the laws of contact have a solution (Stewart and Trinkle 1996): over
a length of time too short to matter, the loads act as one impulse, and those of the contacts answer
it.
"""

from __future__ import annotations

import numpy as np

from rb_sim.contact.events.dense import set_velocities, velocities
from rb_sim.contact.events.forces import CANDIDATE, PRESSED
from rb_sim.contact.events.instant import Instant
from rb_sim.contact.events.laws import SOLVED
from rb_sim.contact.events.tasks import SETTLE
from rb_sim.contact.events.touching import turn_that_is_none, turning
from rb_sim.contact.system.accelerations import power_of_contacts
from rb_sim.contact.system.terms import NONE, SLIDING, STUCK
from rb_sim.contact.system.touch import CLOSED, GAP, ROLL, SLIDE, SPIN
from rb_sim.engine.samples import Array
from rb_sim.engine.systems.many_bodies import MULTIPLIERS, WIDTH
from rb_sim.maths.vectors import norm, quaternion_rate


def leap(at: Instant, duration: float) -> Array | None:
    """Impulses of all lines [N s] over `duration` [s]; y becomes the state after it, off the
    manifold by the square of the duration, and the table has the modes that it ends in.  Impulses
    and contact forces work on the mean velocity.  None if the laws have no solution here either."""
    touching, touch = at.touching(), at.system.touch
    pressed = [c for c, law in enumerate(at.laws) if law.compliant and touch[c, CLOSED] == 1.0]
    at.room.taking_part[:] = 0
    at.room.taking_part[touching], at.room.taking_part[pressed] = CANDIDATE, PRESSED
    at.room.moved[:] = 0
    for c in (*touching, *pressed):
        at.room.moved[c] = what_moves(at, c)
        rest_if_it_may(at, c)
    at.refresh()
    if at.call.over(at.t, at.y, duration) != SOLVED:
        return None
    u = velocities(at.system, at.y)
    impulses = at.room.impulses.copy()
    p = at.room.W.T @ impulses
    after = u + duration * at.room.free_accelerations + at.inverse_mass @ p
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
    for c in touching:
        if impulses[at.first[c]] == 0.0:
            touch[c, [CLOSED, SLIDE, ROLL, SPIN]] = NONE
    return impulses


def what_moves(at: Instant, c: int) -> tuple[bool, bool, bool]:
    """Whether contact c moves over its support, in each of its three ways."""
    across, about = turning(at.system, c)
    slow = turn_that_is_none(at.system)
    return at.slip_speed(c) > at.still, norm(across) > slow, abs(about) > slow


def rest_if_it_may(at: Instant, c: int) -> None:
    """Close contact c, at rest in each way in which its law has a rest."""
    touch, law = at.system.touch, at.laws[c]
    touch[c, CLOSED] = 1.0
    touch[c, SLIDE] = STUCK if law.static > 0.0 else SLIDING
    touch[c, ROLL] = STUCK if law.rolling_arm > 0.0 else NONE
    touch[c, SPIN] = STUCK if law.spinning_arm > 0.0 else NONE


def bring_back(at: Instant) -> None:
    """Bring the state after a leap back to the manifold of its modes, and apart what overlaps."""
    at.refresh()
    touch, u = at.system.touch, velocities(at.system, at.y)
    under = [c for c in at.touching() if touch[c, CLOSED] == 0.0 and touch[c, GAP] < 0.0]
    if under:
        touch[under, CLOSED] = 1.0
        at.call(SETTLE, at.t, at.y)
        set_velocities(at.system, at.y, u)
        touch[under, CLOSED] = 0.0
    at.call(SETTLE, at.t, at.y)
    at.refresh()


def power_of_given(at: Instant, u: Array) -> float:
    """Power of the forces of contacts that are among the loads (of compliant supports, and viscous
    ones) at the velocities u [W]."""
    y, multipliers = at.y.copy(), at.system.vectors[MULTIPLIERS].copy()
    set_velocities(at.system, y, u)
    at.system.vectors[MULTIPLIERS] = 0.0
    power = power_of_contacts(at.system, y)
    at.system.vectors[MULTIPLIERS] = multipliers
    return float(power)
