"""Impacts: u+ = u- + M^-1 J^T x, all contacts at once.

Newton's restitution v_n+ = -e v_n- where the contact pushes, and Coulomb's law between impulse and
slip after it; if that would create energy, Poisson's two phases instead, and if they do too, no
rebound (Glocker, Set-Valued Force Laws, 2001).  Or one contact after the other, the fastest first,
as elastic bodies that are hard and touch at single points do (Newton's cradle).
"""

from __future__ import annotations

import math

import numpy as np

from rb_sim.contact.events.bounces import close_endless, close_rocking, count_bounces
from rb_sim.contact.events.delassus import (
    inverse_mass_times,
    momentum_of,
    read_velocities,
)
from rb_sim.contact.events.dense import write_lines
from rb_sim.contact.events.impulses import (
    Rule,
    Velocities,
    along_lines,
    gains_energy,
    impulses_with,
    newton_impulses,
    poisson_impulses,
)
from rb_sim.contact.events.laws import NOT_FINITE, SOLVED, UNSOLVED
from rb_sim.contact.events.notes import (
    AMBIGUOUS,
    IMPACT,
    OF_ROUND,
    note,
    note_impulses,
    room_left,
)
from rb_sim.contact.events.touching import find_touching, slip_speed, speed_that_is_none
from rb_sim.contact.system.bodies import line_of
from rb_sim.contact.system.touch import (
    CLOSED,
    GAP_RATE,
    RESTITUTION,
    STATIC,
)
from rb_sim.engine.systems.many_bodies import WIDTH
from rb_sim.maths.jit import inline

NOTHING, STRUCK, NO_IMPULSES, OVERFLOWN, GOES_ON, ENDLESS = range(6)
"""What rounds of impacts come to: nothing approaches; something was struck; the laws have no
solution; numbers that are not finite; there are more rounds to come; all have been."""
TIED = 1e-9
"""Part of the speed of the fastest contact by which another may be slower and is as fast: rounding
would choose between the two corners of an edge that lands, and the body go the one or other way."""


@inline
def must_stop_slipping(system, c):
    """A perfectly rough contact that has just come to be, does not part, and slips."""
    touch, still = system.touch, speed_that_is_none(system)
    stays = touch[c, CLOSED] == 1.0 and touch[c, GAP_RATE] <= still
    return touch[c, STATIC] == math.inf and stays and slip_speed(system, c) > still


@inline
def apply_impulses(system, room, t, y, x):
    """Add the impulses to the velocities, and their work to that of the contacts."""
    u, p = np.empty_like(room.free_accelerations), np.empty_like(room.free_accelerations)
    du = np.empty_like(u)
    read_velocities(system, y, u)
    momentum_of(system, room.J, x, p)
    inverse_mass_times(system, p, du)
    work = 0.0
    for i in range(system.bodies.shape[0]):
        for j in range(6):
            k = 6 * i + j
            y[WIDTH * i + 7 + j] = u[k] + du[k]
            work += p[k] * (u[k] + 0.5 * du[k])
    y[WIDTH * system.bodies.shape[0]] += work
    write_lines(system, t, y, room)


@inline
def impulses_of_strike(system, room, before, fastest, x):
    """Into x the impulses of what takes part, by the first of the rules that has some and gains no
    energy."""
    touch, contacts = system.touch, system.touch.shape[0]
    rebound, none, any_together = np.zeros(contacts), np.zeros(contacts), False
    room.undetermined[0] = 0.0
    for c in range(contacts):
        any_together = any_together or room.together[c] == 1
        if room.taking_part[c] == 1 and room.plastic[c] == 0:
            if before.v[line_of(system, c)] < 0.0:
                rebound[c] = touch[c, RESTITUTION]
    status = UNSOLVED
    if any_together:
        status = impulses_with(system, room, before, Rule(none, none, True, False), x)
    if status == UNSOLVED and not touch[fastest, GAP_RATE] < -speed_that_is_none(system):
        status = impulses_with(system, room, before, Rule(none, none, False, True), x)
    if status == UNSOLVED:
        status = newton_impulses(system, room, before, rebound, x)
    if status == UNSOLVED or (status == SOLVED and gains_energy(system, room, before.u, x)):
        status = poisson_impulses(system, room, before, rebound, x)
        if status == UNSOLVED or (status == SOLVED and gains_energy(system, room, before.u, x)):
            status = newton_impulses(system, room, before, none, x)
    return status


@inline
def strike(system, room, t, y, alone):
    """Let what approaches strike; returns NOTHING, STRUCK, NO_IMPULSES or OVERFLOWN.

    `room.plastic`: contacts without rebound; `room.together`: touching ones that do not part
    either; alone: only the contact that approaches fastest, and those as fast. The impulses go into
    the room, and `room.rebounding` becomes 1 for contacts that separate after it.
    """
    touch, still = system.touch, speed_that_is_none(system)
    fastest, strikes = find_touching(system, room), False
    for c in range(touch.shape[0]):
        if room.taking_part[c] == 1:
            approaches = touch[c, GAP_RATE] < -still
            strikes = strikes or approaches or must_stop_slipping(system, c)
    if not strikes:
        return NOTHING
    if alone and touch[fastest, GAP_RATE] < -still:
        for c in range(touch.shape[0]):
            as_fast = touch[c, GAP_RATE] <= (1.0 - TIED) * touch[fastest, GAP_RATE]
            room.taking_part[c] = 1 if room.taking_part[c] == 1 and as_fast else 0
    u, v = np.empty_like(room.free_accelerations), np.empty_like(room.line_rate)
    read_velocities(system, y, u)
    along_lines(system, room, u, v)
    x = room.impulses
    status = impulses_of_strike(system, room, Velocities(u, v), fastest, x)
    if status == NOT_FINITE:
        return OVERFLOWN
    if status == UNSOLVED:
        return NO_IMPULSES
    if room.undetermined[0] > 0.0:
        note(room, t, fastest, AMBIGUOUS, (0.0, 0.0, 0.0))
        if room.undetermined[0] > room.undetermined[1]:
            room.undetermined[1] = room.undetermined[0]
            room.undetermined[2], room.undetermined[3] = t, fastest
    apply_impulses(system, room, t, y, x)
    read_velocities(system, y, u)
    along_lines(system, room, u, v)
    for c in range(touch.shape[0]):
        parts = room.taking_part[c] == 1 and v[line_of(system, c)] > still
        room.rebounding[c] = 1 if parts else 0
    return STRUCK


@inline
def strike_in_rounds(system, room, t, y, first, last, single):
    """Rounds of impacts from the first on until nothing approaches; an endless series of bounces is
    closed. single: so many rounds strike one contact at a time.

    Returns (what it comes to, the next round); GOES_ON where there is no room for more notes.
    """
    contacts = system.touch.shape[0]
    for n in range(first, last):
        if room_left(room) < OF_ROUND * contacts + 1:
            return GOES_ON, n
        close_endless(system, room, t, y)
        rocks = close_rocking(system, room, t, y)
        for c in range(contacts):
            if 0 < single <= n or room.together[c] == 1:  # no end: what it leaves is taken together
                room.plastic[c] = 1
        status = strike(system, room, t, y, n < single and not rocks)
        if status != STRUCK:
            return status, n
        note_impulses(system, room, t, IMPACT)
        count_bounces(room)
    return ENDLESS, last
