"""Bounces that have no end: which contacts strike and are at rest at once instead, and when the
series of their bounces would be over.

With e below 1 the times between bounces shrink by e each, and their sum is known from one of them.
"""

from __future__ import annotations

import math

from rb_sim.contact.events.notes import RESTS, note
from rb_sim.contact.events.room import Room
from rb_sim.contact.events.touching import speed_that_is_none, touches
from rb_sim.contact.system.accelerations import contact_accelerations
from rb_sim.contact.system.bodies import line_of
from rb_sim.contact.system.touch import CLOSED, GAP_RATE, RESTITUTION
from rb_sim.engine.systems.many_bodies import BODY, PARENT, PUSH
from rb_sim.maths.jit import inline

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


def forget_bounces(room: Room) -> None:
    """There have been none."""
    room.bounces[:] = 0
    room.rests[:] = math.inf


@inline
def acceleration_along(system, room, k):
    """Of line k, J du/dt plus what velocities give it [m/s^2], from the accelerations at hand."""
    s = room.line_bias[k]
    b, a = system.lines[k, BODY], system.lines[k, PARENT]
    for j in range(6):
        s += room.J[k, 6 * b + j] * system.bodies[b, PUSH + j]
    if a >= 0:
        for j in range(6):
            s += room.J[k, 6 * a + j] * system.bodies[a, PUSH + j]
    return s


@inline
def free_normal_acceleration(system, room, t, y, c):
    """Of the gap, with contact c open and the others as they are [m/s^2]."""
    mode = system.touch[c, CLOSED]
    system.touch[c, CLOSED] = 0.0
    contact_accelerations(system, t, y)
    system.touch[c, CLOSED] = mode
    return acceleration_along(system, room, line_of(system, c))


@inline
def is_low(system, room, t, y, c):
    """True if contact c falls from, or rises to, a height that is too low to tell."""
    fall = -free_normal_acceleration(system, room, t, y, c)
    height = 0.5 * system.touch[c, GAP_RATE] ** 2
    return fall > 0.0 and height < ZENO_HEIGHT * system.length * fall


@inline
def see_rest(room, c, t):
    """One more bounce of contact c tells that its series will be over at t."""
    change = abs(t - room.rests[c, LAST])
    if change <= room.rests[c, CHANGE]:
        room.rests[c, BEST], room.rests[c, CHANGE] = t, change
    room.rests[c, LAST] = t


@inline
def close_endless(system, room, t, y):
    """Contacts whose further bounces would all be over at once become plastic, and no others."""
    touch = system.touch
    for c in range(touch.shape[0]):
        room.plastic[c] = 0
        e, speed = touch[c, RESTITUTION], -touch[c, GAP_RATE]
        bounces = touches(system, c) and 0.0 < e < 1.0 and speed > speed_that_is_none(system)
        if not bounces or room.bounces[c] < ZENO_BOUNCES:
            continue
        fall = -free_normal_acceleration(system, room, t, y, c)
        if fall <= 0.0:
            continue
        see_rest(room, c, t + 2.0 * e * speed / (fall * (1.0 - e)))
        if 0.5 * (e * speed) ** 2 / fall < ZENO_HEIGHT * system.length:
            room.plastic[c] = 1
            note(room, room.rests[c, BEST], c, RESTS, (0.0, 0.0, 0.0))


@inline
def close_rocking(system, room, t, y):
    """Contacts that strike and part in turns, too low to tell, close together; returns whether
    there are any."""
    touch, still, count = system.touch, speed_that_is_none(system), 0
    low, struck = True, False
    for c in range(touch.shape[0]):
        room.together[c] = 0
        count += 1 if touches(system, c) else 0
    for c in range(touch.shape[0]):
        if count >= 2 and touches(system, c) and touch[c, GAP_RATE] < -still:
            struck = True
            low = low and is_low(system, room, t, y, c)
    if not struck:
        return False
    last = touch.shape[0]
    room.bounces[last] = room.bounces[last] + 1 if low else 0
    if room.bounces[last] <= ZENO_BOUNCES:
        return False
    for c in range(touch.shape[0]):
        if touches(system, c) and touch[c, GAP_RATE] < -still:
            note(room, t, c, RESTS, (0.0, 0.0, 0.0))
    any_together = False
    for c in range(touch.shape[0]):
        if touches(system, c) and is_low(system, room, t, y, c):
            room.together[c] = 1
            any_together = True
    return any_together


@inline
def count_bounces(room):
    """An impact has been: contacts that part after it have bounced once more, others rest."""
    for c in range(room.rests.shape[0]):
        if room.rebounding[c] == 1:
            room.bounces[c] += 1
        else:
            room.bounces[c] = 0
            for j in range(3):
                room.rests[c, j] = math.inf
