"""What the order of two impacts makes of the velocities: u+ of c before i less u+ of i before c.

Each strikes with all that rests where its bodies touch, as in the motion, and so on in turns until
neither approaches.  Where they push along lines that do not know of each other, J_c M^-1 J_i^T = 0,
as of a smooth ball in a corner of 90 degrees, the order is of no account.
"""

from __future__ import annotations

import numpy as np

from rb_sim.contact.events.delassus import read_velocities
from rb_sim.contact.events.dense import write_lines
from rb_sim.contact.events.impacts import apply_impulses, impulses_of_strike
from rb_sim.contact.events.impulses import Velocities, along_lines
from rb_sim.contact.events.laws import SOLVED
from rb_sim.contact.events.touching import find_touching, speed_that_is_none
from rb_sim.contact.system.touch import GAP_RATE
from rb_sim.maths.jit import inline

TURNS = 20
"""Impacts of two contacts in turns that are followed; those of a longer series, which bounces that
lose little make, are taken to differ."""
UNKNOWN = 1e300
"""Speed by which the two orders differ where one of them has not been followed to its end [m/s]."""


@inline
def strike_one(system, room, t, y, c, other):
    """Let contact c strike at (t, y), of which the lines are written, with what rests; returns
    whether there are impulses. The `other` of two takes part if it rests."""
    rests = abs(system.touch[other, GAP_RATE]) <= speed_that_is_none(system)
    find_touching(system, room)
    room.taking_part[c] = 1
    room.taking_part[other] = 1 if rests else 0
    u, v = np.empty_like(room.free_accelerations), np.empty_like(room.line_rate)
    x = np.empty_like(room.line_rate)
    read_velocities(system, y, u)
    along_lines(system, room, u, v)
    solved = impulses_of_strike(system, room, Velocities(u, v), c, x) == SOLVED
    if solved:
        apply_impulses(system, room, t, y, x)
    return solved


@inline
def end_of_order(system, room, t, y, first, second, out):
    """Into `out` the velocities of all bodies after the impacts; returns whether they end."""
    state, still = y.copy(), speed_that_is_none(system)
    write_lines(system, t, state, room)
    c, other = first, second
    for _ in range(TURNS):
        if not strike_one(system, room, t, state, c, other):
            return False
        if system.touch[other, GAP_RATE] < -still:
            c, other = other, c
        elif not system.touch[c, GAP_RATE] < -still:
            read_velocities(system, state, out)
            return True
    return False


@inline
def apart_in_order(system, room, t, y, c, i):
    """By how much velocities differ in the two orders of contacts c and i, which strike at (t, y),
    a turn by the scene's length [m/s]; the lines are those of (t, y) again."""
    u, other = np.empty_like(room.free_accelerations), np.empty_like(room.free_accelerations)
    for k in range(system.touch.shape[0]):
        room.plastic[k], room.together[k] = 0, 0
    most = UNKNOWN
    ends = end_of_order(system, room, t, y, c, i, u)
    if ends and end_of_order(system, room, t, y, i, c, other):
        most = 0.0
        for b in range(system.bodies.shape[0]):
            way, turn = 0.0, 0.0
            for j in range(3):
                way += (u[6 * b + j] - other[6 * b + j]) ** 2
                turn += (u[6 * b + 3 + j] - other[6 * b + 3 + j]) ** 2
            most = max(most, way**0.5 + system.length * turn**0.5)
    write_lines(system, t, y, room)
    return most
