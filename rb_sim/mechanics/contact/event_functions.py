"""Event functions of bodies in contact: positive while the modes hold, in natural units.

A contact has one of each kind, EVENT_FUNCTION_KINDS together: its gap while it is open and its
normal force while it is closed; of slip, rolling and spinning the distance of the force to its
bound at rest, the speed along the direction of before while it moves; and the pivot of a slipping
contact.  One that a contact does not have is FREE.
"""

from __future__ import annotations

import numpy as np

from rb_sim.catalogue.geometry.corners_and_rims import ABSENT
from rb_sim.mechanics.contact.accelerations import contact_accelerations
from rb_sim.mechanics.contact.contact_bodies import (
    EVENT_KINDS,
    FREE,
    JAMMED,
    JAMS,
    LIES_FLAT,
    LIFT_OFF,
    MOST_RANK,
    NUDGE,
    RANK,
    ROLL_BEGINS,
    ROLL_ENDS,
    SHARP,
    SLIP_BEGINS,
    SLIP_ENDS,
    SPIN_BEGINS,
    SPIN_ENDS,
    TOUCH_DOWN,
    keep,
    line_of,
)
from rb_sim.mechanics.contact.contact_kinematics import SLIDING, STUCK
from rb_sim.mechanics.contact.contact_table import (
    AT_JAM,
    AT_ROLL,
    AT_SLIP,
    AT_SPIN,
    BILATERAL,
    CLOSED,
    COMPLIANT,
    CREEPS,
    EVENT_FUNCTION_KINDS,
    EVENT_FUNCTIONS,
    GAP,
    GAP_RATE,
    LEAN_SIGN,
    NORMAL,
    NORMAL_FORCE,
    NORMAL_SIGN,
    PIVOT,
    RELATIVE_SPIN,
    ROLL,
    ROLL_DIRECTION,
    ROLL_RATE,
    ROLLING_ARM,
    SLIDE,
    SLIP,
    SLIP_DIRECTION,
    SLIP_RATE,
    SPIN,
    SPIN_SIGN,
    SPINNING_ARM,
    SPRING,
    STATIC,
)
from rb_sim.mechanics.systems.many_bodies import MULTIPLIERS, vec
from rb_sim.mechanics.systems.multibody import put_rates
from rb_sim.numerics.kernels import inline
from rb_sim.numerics.vectors import dot, scale, sub


@inline
def natural_force(system):
    return system.mass * system.speed * system.speed / system.length


@inline
def natural_turning(system):
    return system.speed / system.length / SHARP


@inline
def approach(system, c):
    """Event function of an open contact: positive while it does not touch, and as large as the gap,
    by which a look inside a step tells how far it may be off."""
    touch, level = system.touch, system.touch[c, GAP] / system.length
    if touch[c, LEAN_SIGN] == ABSENT:
        return FREE
    if touch[c, COMPLIANT] == 1.0 and level < 0.0:
        level = max(level, -touch[c, SPRING] / natural_force(system))
    return level


@inline
def slip_level(system, c, slip):
    return SHARP * dot(slip, vec(system.touch, c, SLIP_DIRECTION)) / system.speed


@inline
def rolling(touch, c):
    """Relative angular velocity across the normal: that about it, which the normal takes along as
    it turns, is no rolling."""
    turn, n = vec(touch, c, RELATIVE_SPIN), vec(touch, c, NORMAL)
    return sub(turn, scale(dot(turn, n), n))


@inline
def roll_level(system, c, roll):
    return dot(roll, vec(system.touch, c, ROLL_DIRECTION)) / natural_turning(system)


@inline
def tail(system, k):
    """Size of the multipliers of lines k and k + 1."""
    x, z = system.vectors[MULTIPLIERS, k], system.vectors[MULTIPLIERS, k + 1]
    return (x * x + z * z) ** 0.5


@inline
def push_events(system, c):
    """Event functions of the push and of the friction of a closed contact."""
    touch, k, force = system.touch, line_of(system, c), natural_force(system)
    normal = touch[c, NORMAL_FORCE]
    if touch[c, BILATERAL] == 0.0:
        touch[c, EVENT_FUNCTIONS] = normal / force
    else:
        if touch[c, SLIDE] == SLIDING and touch[c, STATIC] > 0.0:
            touch[c, EVENT_FUNCTIONS] = touch[c, NORMAL_SIGN] * normal / force
        normal = abs(normal)
    if touch[c, SLIDE] == STUCK and touch[c, STATIC] < 1e300:
        touch[c, EVENT_FUNCTIONS + AT_SLIP] = (
            touch[c, STATIC] * normal - tail(system, k + 1)
        ) / force
    elif touch[c, SLIDE] == SLIDING and touch[c, STATIC] > 0.0:
        if touch[c, CREEPS] == 0.0:
            touch[c, EVENT_FUNCTIONS + AT_SLIP] = slip_level(system, c, vec(touch, c, SLIP))
        if touch[c, COMPLIANT] == 0.0:
            touch[c, EVENT_FUNCTIONS + AT_JAM] = touch[c, PIVOT] - JAMMED
    turn, torque = vec(touch, c, RELATIVE_SPIN), force * system.length
    if touch[c, ROLL] == STUCK:
        level = touch[c, ROLLING_ARM] * normal - tail(system, k + 3)
        touch[c, EVENT_FUNCTIONS + AT_ROLL] = level / torque
    elif touch[c, ROLL] == SLIDING:
        touch[c, EVENT_FUNCTIONS + AT_ROLL] = roll_level(system, c, rolling(touch, c))
    if touch[c, SPIN] == STUCK:
        level = touch[c, SPINNING_ARM] * normal - abs(system.vectors[MULTIPLIERS, k + 5])
        touch[c, EVENT_FUNCTIONS + AT_SPIN] = level / torque
    elif touch[c, SPIN] == SLIDING:
        about = touch[c, SPIN_SIGN] * dot(turn, vec(touch, c, NORMAL))
        touch[c, EVENT_FUNCTIONS + AT_SPIN] = about / natural_turning(system)


@inline
def event_of(touch, c, i):
    """The kind of event at which the i-th event function of contact c vanishes."""
    if i == 0:
        return LIFT_OFF if touch[c, CLOSED] == 1.0 else TOUCH_DOWN
    if i == AT_SLIP:
        return SLIP_ENDS if touch[c, SLIDE] == SLIDING else SLIP_BEGINS
    if i == AT_ROLL:
        return ROLL_ENDS if touch[c, ROLL] == SLIDING else ROLL_BEGINS
    if i == AT_SPIN:
        return SPIN_ENDS if touch[c, SPIN] == SLIDING else SPIN_BEGINS
    return JAMS


@inline
def lowest_level(system):
    """(lowest, code) over all event functions, which are written into the table of contacts.

    After `contact_accelerations`.
    """
    touch, lowest, code = system.touch, FREE, -1
    for c in range(touch.shape[0]):
        for i in range(EVENT_FUNCTION_KINDS):
            touch[c, EVENT_FUNCTIONS + i] = FREE
        if touch[c, CLOSED] == 1.0:
            push_events(system, c)
            if abs(touch[c, LEAN_SIGN]) - 0.5 < lowest:
                lowest, code = abs(touch[c, LEAN_SIGN]) - 0.5, EVENT_KINDS * c + LIES_FLAT
        else:
            touch[c, EVENT_FUNCTIONS] = approach(system, c)
        for i in range(EVENT_FUNCTION_KINDS):
            if touch[c, EVENT_FUNCTIONS + i] < lowest:
                lowest, code = (
                    touch[c, EVENT_FUNCTIONS + i],
                    EVENT_KINDS * c + event_of(touch, c, i),
                )
    return lowest, code


@inline
def in_rigid_flight(touch, c):
    return touch[c, CLOSED] == 0.0 and touch[c, COMPLIANT] == 0.0


@inline
def level_rates(system, t, y):
    """Rates of the event functions at (t, y), shape (contacts, EVENT_FUNCTION_KINDS).

    After `contact_accelerations` and `lowest_level`; of the tables only that of the contacts is
    left as it was, with rates of slip and rolling in it.
    """
    touch = system.touch
    rates, least = np.zeros((touch.shape[0], EVENT_FUNCTION_KINDS)), FREE
    for c in range(touch.shape[0]):
        if in_rigid_flight(touch, c):
            rates[c, 0] = touch[c, GAP_RATE] / system.length
        else:
            for i in range(EVENT_FUNCTION_KINDS):
                least = min(least, touch[c, EVENT_FUNCTIONS + i])
    if least == FREE:
        return rates
    kept, nudge = touch.copy(), NUDGE * system.length / system.speed
    later = np.zeros_like(y)
    put_rates(system, y, later)
    for i in range(y.shape[0]):
        later[i] = y[i] + nudge * later[i]
    lines = system.lines
    most = lines[0, MOST_RANK]
    lines[0, MOST_RANK] = lines[0, RANK]  # off the manifold lines contradict each other
    contact_accelerations(system, t + nudge, later)
    lines[0, MOST_RANK] = most
    lowest_level(system)
    for c in range(touch.shape[0]):
        for i in range(EVENT_FUNCTION_KINDS):
            if not (i == 0 and in_rigid_flight(kept, c)):
                rates[c, i] = (touch[c, EVENT_FUNCTIONS + i] - kept[c, EVENT_FUNCTIONS + i]) / nudge
        slip = scale(1.0 / nudge, sub(vec(touch, c, SLIP), vec(kept, c, SLIP)))
        roll = scale(1.0 / nudge, sub(rolling(touch, c), rolling(kept, c)))
        for j in range(touch.shape[1]):
            touch[c, j] = kept[c, j]
        keep(touch, c, SLIP_RATE, slip)
        keep(touch, c, ROLL_RATE, roll)
    return rates
