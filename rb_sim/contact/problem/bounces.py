"""Series of impacts without end: bounces closed at once, chatter, flights between."""

from __future__ import annotations

import math
from collections import deque

from rb_sim.contact.problem.event_workspace import (
    RESTS,
    TOUCHING,
    Workspace,
    note,
    speed_that_is_none,
    touches,
)
from rb_sim.mechanics.contact.accelerations import contact_accelerations
from rb_sim.mechanics.contact.contact_bodies import line_of
from rb_sim.mechanics.contact.contact_table import CLOSED, DRAGS, GAP, GAP_RATE, RESTITUTION
from rb_sim.mechanics.systems.many_bodies import BODY, PARENT, PUSH
from rb_sim.numerics.kernels import inline

# Changes of contacts that follow each other as if without end, and what is done about them.
#
# They are leapt over (see `instant.leap`).


AT_ONCE = 50
"""Rounds of impacts at one instant that are taken to have no end."""
CHANGES_IN_LEAP = 10
"""Changes within DENSE that are taken to have no end."""
DENSE, LONGEST_LEAP = 1e-6, 1e-3
"""A time too short to matter, and the longest that is leapt over; natural units."""


class Chatter:
    """The changes of a run so far, as far as they tell those without end.

    unit: the scene's natural time [s].
    """

    def __init__(self, unit: float) -> None:
        self._short = DENSE * unit
        self._longest = LONGEST_LEAP * unit
        self._changes: deque[float] = deque(maxlen=CHANGES_IN_LEAP)
        self._leapt = (-math.inf, 0.0)

    def is_endless(self, t: float) -> bool:
        """Count a change at t; True where changes follow each other as if without end."""
        self._changes.append(t)
        full = len(self._changes) == CHANGES_IN_LEAP
        return full and t - self._changes[0] < self._short

    def length_of_leap(self, t: float) -> float:
        """A time too short to matter [s]; longer if one has just been leapt over."""
        end, length = self._leapt
        return min(4.0 * length, self._longest) if t - end < 10.0 * length else self._short

    def leapt(self, end: float, length: float) -> None:
        """A time of this length, to its end, has been leapt over [s]."""
        self._leapt = (end, length)
        self._changes.clear()


# Bounces that have no end: which contacts strike and are at rest at once instead, and when the
# series of their bounces would be over.
#
# With e below 1 the times between bounces shrink by e each, and their sum is known from one of
# them.


ZENO_HEIGHT = 1e-11
"""Height of the next bounce, relative to the scene's length, below which a contact is closed: what
is left out of the motion is of that size, and the time of rest is known from the series."""
ZENO_BOUNCES = 3
"""Impacts in a row before one is taken to belong to an endless series."""
LAST, BEST, CHANGE = range(3)
"""Columns of `rests`: when a series will be over [s] seen from the last bounce, where two bounces
that follow each other agree best, and by how much they agree.

Low bounces know it best where the fall changes; but rounding of the height, over their speed, is
the larger the lower they are."""


def forget_bounces(workspace: Workspace) -> None:
    """There have been none."""
    workspace.bounces[:] = 0
    workspace.rests[:] = math.inf


@inline
def acceleration_along(system, workspace, k):
    """Of line k, J du/dt plus what velocities give it [m/s^2], from the accelerations at hand."""
    s = workspace.line_bias[k]
    b, a = system.lines[k, BODY], system.lines[k, PARENT]
    for j in range(6):
        s += workspace.J[k, 6 * b + j] * system.bodies[b, PUSH + j]
    if a >= 0:
        for j in range(6):
            s += workspace.J[k, 6 * a + j] * system.bodies[a, PUSH + j]
    return s


@inline
def free_normal_acceleration(system, workspace, t, y, c):
    """Of the gap, with contact c open and the others as they are [m/s^2]."""
    mode = system.touch[c, CLOSED]
    system.touch[c, CLOSED] = 0.0
    contact_accelerations(system, t, y)
    system.touch[c, CLOSED] = mode
    return acceleration_along(system, workspace, line_of(system, c))


@inline
def is_low(system, workspace, t, y, c):
    """True if contact c falls from, or rises to, a height that is too low to tell."""
    fall = -free_normal_acceleration(system, workspace, t, y, c)
    height = 0.5 * system.touch[c, GAP_RATE] ** 2
    return fall > 0.0 and height < ZENO_HEIGHT * system.length * fall


@inline
def see_rest(workspace, c, t):
    """One more bounce of contact c tells that its series will be over at t."""
    change = abs(t - workspace.rests[c, LAST])
    if change <= workspace.rests[c, CHANGE]:
        workspace.rests[c, BEST], workspace.rests[c, CHANGE] = t, change
    workspace.rests[c, LAST] = t


@inline
def close_endless(system, workspace, t, y):
    """Contacts whose further bounces would all be over at once become plastic, and no others."""
    touch = system.touch
    for c in range(touch.shape[0]):
        workspace.plastic[c] = 0
        e, speed = touch[c, RESTITUTION], -touch[c, GAP_RATE]
        bounces = touches(system, c) and 0.0 < e < 1.0 and speed > speed_that_is_none(system)
        if not bounces or workspace.bounces[c] < ZENO_BOUNCES:
            continue
        fall = -free_normal_acceleration(system, workspace, t, y, c)
        if fall <= 0.0:
            continue
        see_rest(workspace, c, t + 2.0 * e * speed / (fall * (1.0 - e)))
        if 0.5 * (e * speed) ** 2 / fall < ZENO_HEIGHT * system.length:
            workspace.plastic[c] = 1
            note(workspace, workspace.rests[c, BEST], c, RESTS, (0.0, 0.0, 0.0))


@inline
def close_rocking(system, workspace, t, y):
    """Contacts that strike and part in turns, too low to tell, close together; returns whether
    there are any."""
    touch, still, count = system.touch, speed_that_is_none(system), 0
    low, struck = True, False
    for c in range(touch.shape[0]):
        workspace.together[c] = 0
        count += 1 if touches(system, c) else 0
    for c in range(touch.shape[0]):
        if count >= 2 and touches(system, c) and touch[c, GAP_RATE] < -still:
            struck = True
            low = low and is_low(system, workspace, t, y, c)
    if not struck:
        return False
    last = touch.shape[0]
    workspace.bounces[last] = workspace.bounces[last] + 1 if low else 0
    if workspace.bounces[last] <= ZENO_BOUNCES:
        return False
    for c in range(touch.shape[0]):
        if touches(system, c) and touch[c, GAP_RATE] < -still:
            note(workspace, t, c, RESTS, (0.0, 0.0, 0.0))
    any_together = False
    for c in range(touch.shape[0]):
        if touches(system, c) and is_low(system, workspace, t, y, c):
            workspace.together[c] = 1
            any_together = True
    return any_together


@inline
def count_bounces(workspace):
    """An impact has been: contacts that part after it have bounced once more, others rest."""
    for c in range(workspace.rests.shape[0]):
        if workspace.rebounding[c] == 1:
            workspace.bounces[c] += 1
        else:
            workspace.bounces[c] = 0
            for j in range(3):
                workspace.rests[c, j] = math.inf


# Flights that an instant begins: how long they may be.


HELD_DOWN = 1e-6
"""Acceleration towards the support, in natural units, with which a contact that has just been left
would be pressed again at once."""
LANDED = 2.4
"""Times to the top of a flight after which it is over, also where its fall changes a little."""
LOW = 1e-10
"""Height of a flight, relative to the scene's length, which rounding of the gap may hide."""


@inline
def time_of_flights(system, workspace, t, y, fixed):
    """(time within which the flights that begin here have to be looked at [s], inf where there are
    none; 0, or 1 + a contact whose drag lifts off what falls back at once).

    A flight is to end within it.  One that is so low that rounding may hide it has to be cut at
    its top, as any where steps are fixed.
    """
    touch, length, dragged = system.touch, math.inf, 0
    near, natural = TOUCHING * system.length, system.speed**2 / system.length
    contact_accelerations(system, t, y)
    for c in range(touch.shape[0]):
        if touch[c, CLOSED] != 0.0 or abs(touch[c, GAP]) > near:
            continue
        fall = -acceleration_along(system, workspace, line_of(system, c))
        rise = touch[c, GAP_RATE]
        if fall > 0.0 and rise > speed_that_is_none(system):
            hidden = fixed or 0.5 * rise * rise < LOW * fall * system.length
            length = min(length, (1.0 if hidden else LANDED) * rise / fall)
        elif touch[c, DRAGS] == 1.0 and fall > HELD_DOWN * natural and dragged == 0:
            dragged = 1 + c
    return length, dragged
