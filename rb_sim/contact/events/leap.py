"""A short step of impulses over what the laws between forces and accelerations leave open.

Some motions change their contacts at every instant (corners that slip about a point that wanders,
a slip whose direction turns faster than it grows, a rod that Painleve's paradox leaves no force).
Between velocities and impulses the laws of contact have a solution (Stewart and Trinkle 1996): over
a length of time too short to matter, the loads act as one impulse, and those of the contacts answer
it.
"""

from __future__ import annotations

import numpy as np

from rb_sim.contact.events.dense import SETTLE, set_velocities, velocities
from rb_sim.contact.events.instant import Instant
from rb_sim.contact.events.modes import Bounds, force_problem, is_pressed, open_contact
from rb_sim.contact.system.accelerations import contact_power
from rb_sim.contact.system.terms import NONE, SLIDING, STUCK
from rb_sim.contact.system.touch import CLOSED, GAP, ROLL, SLIDE, SPIN
from rb_sim.engine.samples import Array
from rb_sim.engine.systems.many_bodies import MULTIPLIERS, WIDTH
from rb_sim.maths.vectors import quaternion_rate

Moved = tuple[set[int], set[int], set[int]]
"""Contacts that slip, roll and spin over the support."""
WAYS = (SLIDE, ROLL, SPIN)


def leap(at: Instant, duration: float) -> Array | None:
    """Impulses of all lines [N s] over `duration` [s]; y becomes the state after it, off the
    manifold by the square of the duration, and the table has the modes that it ends in.  Impulses
    and contact forces work on the mean velocity.  None if the laws have no solution here either."""
    touching = at.touching()
    pressed = [c for c in range(len(at.laws)) if is_pressed(at, c)]
    moved = what_moves(at, (*touching, *pressed))
    for c in (*touching, *pressed):
        rest_if_it_may(at, c)
    at.refresh()
    found = impulses_over(at, duration, touching, pressed, moved)
    if found is None:
        return None
    x, used = found
    u = velocities(at.system, at.y)
    p = at.lines.W[used].T @ x
    after = u + duration * at.lines.free + at.inverse_mass @ p
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
    impulses = np.zeros(len(at.lines.J))
    impulses[used] = x
    for c in touching:
        if impulses[at.first[c]] == 0.0:
            open_contact(at, c)
    return impulses


def what_moves(at: Instant, contacts: tuple[int, ...]) -> Moved:
    """Contacts that move over their support, in each of its three ways."""
    slow = at.still / at.system.length
    return (
        {c for c in contacts if at.slip_speed(c) > at.still},
        {c for c in contacts if at.turning(c)[0] > slow},
        {c for c in contacts if abs(at.turning(c)[1]) > slow},
    )


def rest_if_it_may(at: Instant, c: int) -> None:
    """Close contact c, at rest in each way in which its law has a rest."""
    touch, law = at.system.touch, at.laws[c]
    touch[c, CLOSED] = 1.0
    touch[c, SLIDE] = STUCK if law.static > 0.0 else SLIDING
    touch[c, ROLL] = STUCK if law.rolling_arm > 0.0 else NONE
    touch[c, SPIN] = STUCK if law.spinning_arm > 0.0 else NONE


def impulses_over(
    at: Instant, duration: float, touching: list[int], pressed: list[int], moved: Moved
) -> tuple[Array, list[int]] | None:
    """(impulses, their lines) over `duration`, all contacts closed and at rest in the table; those
    that move at its end slide in the table then."""
    u = velocities(at.system, at.y)
    while True:
        problem, used, kinds = force_problem(at, touching, pressed, *moved)
        n, J, rate = len(used), at.lines.J[used], at.lines.rate[used]
        problem.b[:n] += (J @ u - rate) / duration
        problem.terms[:n] += (np.abs(J) @ np.abs(u) + np.abs(rate)) / duration
        solution = problem.solve(at.compiled)
        if solution is None:
            return None
        sliding = moving_at_end(at, duration * solution.w, kinds)
        if sliding <= {(mode, c) for mode, some in zip(WAYS, moved, strict=True) for c in some}:
            break  # none that had been at rest, and has its static bound, moves
        for mode, c in sliding:
            moved[WAYS.index(mode)].add(c)
    for mode, c in sliding:
        at.system.touch[c, mode] = SLIDING
    return duration * solution.x[:n], used


def moving_at_end(at: Instant, w: Array, kinds: Bounds) -> set[tuple[int, int]]:
    """(mode, contact) of all that has a velocity in w."""
    found = set()
    for c, items in kinds.items():
        for mode, item in items:
            still = at.still if mode == SLIDE else at.still / at.system.length
            if float(np.linalg.norm(w[list(item.lines)])) > still:
                found.add((mode, c))
    return found


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
    power = contact_power(at.system, y)
    at.system.vectors[MULTIPLIERS] = multipliers
    return float(power)
