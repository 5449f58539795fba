"""Rebounds that would create energy.

Newton's restitution along the normal and Coulomb's friction across it may together give more energy
than the impact has taken (Kane and Levinson 1985): friction works on the mean of the slips before
and after, which point in different directions.  There Poisson's law holds, as in `events.impulses`:
the push is 1 + e times what it is without a rebound; and none rebounds if that gives energy too.
Energy is that of the whole impact of a body: of several corners that strike at once some may gain
what others lose.
"""

from __future__ import annotations

import numpy as np

from rb_sim.contact.solvers.graph import LINES, rate_of
from rb_sim.contact.stepping.geometry import MOVES, NORMAL, triple
from rb_sim.contact.stepping.lines import speed_at
from rb_sim.contact.stepping.tables import COMPLIANT, RESTITUTION
from rb_sim.maths.jit import inline
from rb_sim.maths.vectors import dot

SECANTS = 3
"""Steps towards the rebound at which the push is Poisson's, which grows with it in straight
pieces."""
GAINS = 1e-5
"""Work of an impact, over impulse times speed of rebound, that creates energy; below is what the
solvers leave of it (1e-6 where the corners of a box press against each other by friction)."""
PUSH, SPEED, WITHOUT, WHOLE, REBOUND_WIDTH = range(5)
"""Of a rebound that creates energy: its push [N s] and speed [m/s] at the last try, the push
without a rebound, and Newton's speed; 0 of others."""


@inline
def still_of(room, i, c):
    """Speed along the normal of contact i, point c, at which its surfaces stay together."""
    return dot(triple(room.spots, c, NORMAL), triple(room.spots, c, MOVES))


@inline
def bounces(tables, c):
    """True of a point that rebounds, if it is struck."""
    return tables.laws[c, RESTITUTION] > 0.0 and tables.laws[c, COMPLIANT] == 0.0


@inline
def made_in(room, y, i, c):
    """(energy that friction makes at contact i, which is point c [J], that which its push makes
    [J], what its rebound takes [J]) in an impact; zeros where it does not rebound. y: before it."""
    b, a, k, across = room.ends[i, 0], room.ends[i, 1], LINES * i, 0.0
    rebound = room.targets[k] - still_of(room, i, c)
    if not rebound > 0.0 or not room.x[k] > 0.0:
        return 0.0, 0.0, 0.0
    for j in range(1, LINES):
        if room.x[k + j] != 0.0:
            mean = speed_at(room.rows, k + j, y, b, a) + rate_of(room.rows, k + j, room.u, b, a)
            across += room.x[k + j] * (0.5 * mean - room.targets[k + j])
    mean = speed_at(room.rows, k, y, b, a) + rate_of(room.rows, k, room.u, b, a)
    along = room.x[k] * (0.5 * mean - still_of(room, i, c))
    return across, along, room.x[k] * rebound


@inline
def creates(across, along, taken):
    """Whether friction makes energy that the push does not take."""
    return across > 0.0 and across + along > GAINS * taken


@inline
def add_to(total, body, made, taken):
    """Add the energies of one point to those of a body; -1: the surroundings."""
    if body >= 0:
        total[body, 0] += made
        total[body, 1] += taken


@inline
def gains(total, room, i):
    """Whether the impact of a body of contact i creates energy, over all points that it has."""
    b, a = room.ends[i, 0], room.ends[i, 1]
    return total[b, 0] > GAINS * total[b, 1] or (a >= 0 and total[a, 0] > GAINS * total[a, 1])


@inline
def some_rebound(tables, room, n):
    """Whether any contact rebounds in this step."""
    for i in range(n):
        c = room.active[i]
        if bounces(tables, c) and room.targets[LINES * i] > still_of(room, i, c):
            return True
    return False


@inline
def note_gains(tables, room, y, n, found):
    """Note the rebounds that create energy, and take them away; how many there are."""
    count, total = 0, np.zeros((tables.bodies.shape[0], 2))
    for i in range(n):
        if bounces(tables, room.active[i]):
            across, along, taken = made_in(room, y, i, room.active[i])
            add_to(total, room.ends[i, 0], across + along, taken)
            add_to(total, room.ends[i, 1], across + along, taken)
    for i in range(n):
        c, k = room.active[i], LINES * i
        found[i, WHOLE] = 0.0
        across, along, taken = made_in(room, y, i, c)
        if bounces(tables, c) and creates(across, along, taken) and gains(total, room, i):
            whole = room.targets[k] - still_of(room, i, c)
            found[i, PUSH], found[i, SPEED], found[i, WHOLE] = room.x[k], whole, whole
            room.targets[k] -= whole
            count += 1
    return count


@inline
def note_pushes(room, n, found, at):
    """Note the pushes: those WITHOUT a rebound, or as PUSH those of the last try."""
    for i in range(n):
        found[i, at] = room.x[LINES * i]


@inline
def aim_at_poisson(tables, room, n, found):
    """Rebounds at which pushes would be 1 + e times those without, by the last try."""
    for i in range(n):
        c, k = room.active[i], LINES * i
        if found[i, WHOLE] == 0.0:
            continue
        more = found[i, PUSH] - found[i, WITHOUT]
        wanted = tables.laws[c, RESTITUTION] * found[i, WITHOUT]
        speed = found[i, SPEED] * wanted / more if more > 0.0 else 0.0
        found[i, SPEED] = min(speed, found[i, WHOLE])
        room.targets[k] = still_of(room, i, c) + found[i, SPEED]
