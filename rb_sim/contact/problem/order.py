"""Impacts whose order a step or tolerance decides, and those that it may miss."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rb_sim.catalogue.geometry.corners_and_rims import ABSENT
from rb_sim.contact.events.grid import add_increment, copy, finite, increment
from rb_sim.contact.problem.delassus import read_velocities, write_lines
from rb_sim.contact.problem.event_workspace import (
    TOUCHING,
    find_touching,
    speed_that_is_none,
    touches,
)
from rb_sim.contact.problem.forces import SOLVED
from rb_sim.contact.problem.impacts import (
    Velocities,
    along_lines,
    apply_impulses,
    impulses_of_strike,
)
from rb_sim.contact.solvers.graph import copy_rows
from rb_sim.integrate.layout import AT, DY, address
from rb_sim.integrate.quadrature import cubic_at, cubic_minimum
from rb_sim.mechanics.contact.contact_bodies import line_of
from rb_sim.mechanics.contact.contact_table import (
    CLOSED,
    COMPLIANT,
    GAP,
    GAP_RATE,
    GAP_RATE_BEFORE,
    LEVELS_BEFORE,
    NORMAL,
    POINT,
    SENSE,
    SLOPES_BEFORE,
)
from rb_sim.mechanics.contact.event_functions import in_rigid_flight
from rb_sim.mechanics.contact.near_flat_rims import turned_by_rounding
from rb_sim.mechanics.system import settle
from rb_sim.mechanics.systems.many_bodies import BODY, PARENT, WIDTH, state_of, vec
from rb_sim.numerics.kernels import call_law, inline, part, pointer
from rb_sim.numerics.vectors import norm, sub

# What steps of fixed length miss of the motion between events: each beside its two halves.
#
# As `step_probe` of scenes without contacts, but in the loop: only there the modes and directions
# are those that the step had.  After the first ones one of EVERY steps is looked at, and counted
# for all of them; the first ones after an event are all looked at, and counted for themselves, for
# a bounce may be over in two steps of a run and change more than all the others.


SUM, LARGEST, WORST_SHARE, WORST_TIME, WAY, LENGTHS = range(6)
"""Columns by body: what steps miss of v = (v_C, A w), |v_h - v_h/2| or, where that is more,
`speed_to_come`, added up, and the largest |v| [m/s]; the largest of the former over the change of v
in its step, of steps that matter, and its time [s]; what steps miss of places, a turn by the
scene's length, added up [m]; from here on A by rows (see engine.velocities) [m]."""
MISSED_WIDTH = LENGTHS + 9
ALL, EVERY = 100, 97
"""Steps of a run that are all looked at; of those after them, one of so many, which costs as much
as two steps more. A prime, so that it meets a periodic motion at all its phases."""

AFTER_EVENT = 2
"""First steps after an event, which are all looked at."""

MATTERS = 3e-3
"""Share of the largest velocity, or of the scene's speed, that a step has to miss for its share of
the change to count. Below it lie motions that are nearly uniform, and change by less than they
err, and the first instants of a slip; above it, of 150 runs of random scenes, ends that are wrong
by 1e-3 and more."""


@inline
def weight(counted, steps):
    """For how many steps the next one stands, after as many, `steps` of them since the last event;
    0: it is not looked at."""
    if counted < ALL or steps < AFTER_EVENT:
        return 1
    return EVERY if counted % EVERY == 0 else 0


@inline
def speed_apart(y, other, b, missed):
    """|(dv, A dw)| of body b between two states; `other` all zeros: its speed."""
    total = 0.0
    for i in range(3):
        dv = y[WIDTH * b + 7 + i] - other[WIDTH * b + 7 + i]
        turned = 0.0
        for j in range(3):
            dw = y[WIDTH * b + 10 + j] - other[WIDTH * b + 10 + j]
            turned += missed[b, LENGTHS + 3 * i + j] * dw
        total += dv * dv + turned * turned
    return total**0.5


@inline
def way_apart(y, other, b, length):
    """How far the places of body b are apart in two states, a turn by the length [m]."""
    way, turn = 0.0, 0.0
    for i in range(3):
        way += (y[WIDTH * b + i] - other[WIDTH * b + i]) ** 2
    for i in range(3, 7):
        turn += (y[WIDTH * b + i] - other[WIDTH * b + i]) ** 2
    return way**0.5 + 2.0 * length * turn**0.5


@inline
def rates_of_both(method, system, t, y, other, mixed, work):
    """Write dy/dt at y, and at y with the places of bodies as in `other`, to two rows of `work`."""
    n = y.shape[0]
    room = pointer(work)
    copy(mixed, y)
    for b in range(system.bodies.shape[0]):
        for i in range(7):
            mixed[WIDTH * b + i] = other[WIDTH * b + i]
    call_law(method.rate, t, pointer(y), address(system), part(room, DY * n))
    call_law(method.rate, t, pointer(mixed), address(system), part(room, AT * n))


@inline
def speed_to_come(work, h, b, n, missed):
    """h |a_h - a_h/2| of body b: what the error of the places makes of its velocities in the next
    step, of the rates in `work`.

    A spring that is met at rest and left at rest turns all that a step misses into an error of
    places: the velocities at its end are right to the next order.
    """
    room = pointer(work)
    return h * speed_apart(part(room, DY * n), part(room, AT * n), b, missed)


@inline
def note_missed(method, system, grid, before, work, missed, stands_for):
    """Add what the last step has missed to the table `missed`, by body.

    before: the table of contacts from which the step began; that of its end is left as it was.
    """
    after = system.touch.copy()
    copy_rows(system.touch, before)
    y, c, nothing = copy(np.empty_like(grid.y0), grid.y0), grid.c0.copy(), np.zeros_like(grid.y0)
    h = 0.5 * (grid.t1 - grid.t0)
    for k in range(2):
        increment(method, system, grid.t0 + k * h, y, h, work)
        add_increment(y, c, work)
        settle(system, grid.t0 + (k + 1) * h, y)
    if finite(y):
        rates_of_both(method, system, grid.t1, grid.y1, y, c, work)
    copy_rows(system.touch, after)
    if not finite(y):
        return
    for b in range(missed.shape[0]):
        apart = speed_apart(grid.y1, y, b, missed)
        apart = max(apart, speed_to_come(work, 2.0 * h, b, y.shape[0], missed))
        missed[b, SUM] += stands_for * apart
        missed[b, WAY] += stands_for * way_apart(grid.y1, y, b, system.length)
        size = speed_apart(grid.y1, nothing, b, missed)
        missed[b, LARGEST] = max(missed[b, LARGEST], size)
        change = speed_apart(y, grid.y0, b, missed)
        if apart <= MATTERS * max(missed[b, LARGEST], system.speed):
            continue
        if apart > missed[b, WORST_SHARE] * change and change > 0.0:
            missed[b, WORST_SHARE], missed[b, WORST_TIME] = apart / change, grid.t0


# What the order of two impacts makes of the velocities: u+ of c before i less u+ of i before c.
#
# Each strikes with all that rests where its bodies touch, as in the motion, and so on in turns
# until neither approaches.  Where they push along lines that do not know of each other, J_c M^-1
# J_i^T = 0, as of a smooth ball in a corner of 90 degrees, the order is of no account.


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


# Impacts so close to each other that the step or the tolerance decides which is first.
#
# Where two contacts of one body strike, the motion after them depends on their order by as much as
# they strike.  How far both bodies may be from where they ought to be, over the speed of approach,
# shifts the instant of each.  So far are they by
#
#     sum of |x_h - x_h/2| and of |v_h - v_h/2| times the time      with steps of fixed length,
#     tolerance times steps times (max(1, |p|) + scene's length)    with an adaptive method,
#
# the scene's length being the arm of errors of angles.  Of the latter a tenth was seen in slides
# and oscillations, and 0.6 at most, after a few steps; chaos goes far beyond it.
#
# Where the loads pull at both, as on a box that clatters on a floor, another order sends them off
# at another speed v, and back after 2 v / a: by 2 v^2 / a the motion differs until then.  It does
# not where both orders end in the same velocities (`both_orders`).


ALIKE = 1e-9
"""Distance of two unit normals that are those of one plane."""
MAGNIFIED = 10.0
"""Times that by which errors have moved bodies already, which what follows from the order has to
exceed to be told; a motion that is not chaotic magnifies errors by as much."""


HALVES = 2.0
"""Times what a step is off its two halves that it is off the motion, at first order; at higher ones
it is little more than once."""


@inline
def allowed_way(system, y, b, allowed):
    """How far the tolerance lets body b be from where it ought to be [m]."""
    return allowed * (max(1.0, norm(state_of(y, b).p_WC)) + system.length)


@inline
def missed_way(missed, b, elapsed):
    """How far steps of fixed length may have taken body b from where it ought to be in the time
    since the start [m]; missed: see `missed`."""
    return HALVES * missed[b, WAY] + elapsed * missed[b, SUM]


@inline
def far_of(system, far, y, b, allowed):
    """How far body b may be from where it ought to be [m]."""
    return far[b] + allowed_way(system, y, b, allowed)


@inline
def error_of(system, far, y, c, allowed):
    """By how much the gap of contact c may be wrong [m]; far: of each body, by fixed steps [m]."""
    k = line_of(system, c)
    error = far_of(system, far, y, system.lines[k, BODY], allowed)
    if system.lines[k, PARENT] >= 0:
        error += far_of(system, far, y, system.lines[k, PARENT], allowed)
    return error


@inline
def held_beside(system, c):
    """A contact of the same two bodies that holds rigidly with the normal of contact c, as another
    point on the same plane does; -1 for none."""
    touch, k, found = system.touch, line_of(system, c), -1
    for i in range(touch.shape[0]):
        m = line_of(system, i)
        same = system.lines[m, BODY] == system.lines[k, BODY]
        same = same and system.lines[m, PARENT] == system.lines[k, PARENT]
        holds = touch[i, CLOSED] == 1.0 and touch[i, COMPLIANT] == 0.0
        if i != c and same and holds:
            if norm(sub(vec(touch, i, NORMAL), vec(touch, c, NORMAL))) < ALIKE:
                found = i
    return found


@inline
def error_beside(system, far, y, c, i, allowed):
    """By how much the gap of contact c may be wrong [m] where contact i holds: by the angles alone,
    at the arm between both."""
    k, touch = line_of(system, c), system.touch
    angle = allowed + far[system.lines[k, BODY]] / system.length
    if system.lines[k, PARENT] >= 0:
        angle += allowed + far[system.lines[k, PARENT]] / system.length
    return angle * norm(sub(vec(touch, c, POINT), vec(touch, i, POINT)))


@inline
def shares_a_body(system, c, i):
    """True if a body is part of both contacts; the world is none."""
    k, m = line_of(system, c), line_of(system, i)
    b, a = system.lines[k, BODY], system.lines[k, PARENT]
    other, parent = system.lines[m, BODY], system.lines[m, PARENT]
    return b == other or b == parent or (a >= 0 and (a == other or a == parent))


@inline
def matters(touch, c, i, speed, span, error):
    """True if another order of contacts c and i, at this speed, moves bodies by more than errors
    do; span: of the step that has ended [s], from whose start on their approaches have changed."""
    change = min(
        touch[c, GAP_RATE_BEFORE] - touch[c, GAP_RATE],
        touch[i, GAP_RATE_BEFORE] - touch[i, GAP_RATE],
    )
    return 2.0 * speed * speed * span > MAGNIFIED * error * change


@inline
def may_be_first(system, room, y, c, i, allowed):
    """By how much the gaps of contacts c, which strikes, and i may be wrong together [m], if i may
    as well have struck before it; 0 if not."""
    touch = system.touch
    if i == c or not in_rigid_flight(touch, i) or touches(system, i):
        return 0.0
    if touch[i, SENSE] == ABSENT or not touch[i, GAP_RATE] < 0.0 or not shares_a_body(system, c, i):
        return 0.0
    error = error_of(system, room.far, y, c, allowed)
    other = error_of(system, room.far, y, i, allowed)
    later = touch[i, GAP] / -touch[i, GAP_RATE]
    close = later < error / -touch[c, GAP_RATE] + other / -touch[i, GAP_RATE]
    return error + other if close else 0.0


@inline
def speed_in_doubt(system, room, t, y, c, span, allowed, alone):
    """The speed [m/s] at which contact c strikes at (t, y), or that of another contact of one of
    its bodies which may as well have come before it, or by which the two orders differ, whichever
    is least; 0 where there is none.

    span: of the step that ends there [s]. allowed: by the tolerance, to all steps until then.
    alone: impacts are taken one by one, whose orders are not compared.
    """
    write_lines(system, t, y, room)
    touch, most = system.touch, 0.0
    if not touch[c, GAP_RATE] < 0.0:
        return most
    for i in range(touch.shape[0]):
        speed = min(-touch[c, GAP_RATE], -touch[i, GAP_RATE])
        if speed <= most:
            continue
        error = may_be_first(system, room, y, c, i, allowed)
        if error > 0.0 and matters(touch, c, i, speed, span, error):
            if not alone:
                speed = min(speed, apart_in_order(system, room, t, y, c, i))
            if speed > most and matters(touch, c, i, speed, span, error):
                most = speed
    return most


# Impacts that the step or the tolerance may have missed: a gap came near zero and grew again.
#
# A gap that dips to g and bends by a at its least is wrong by no more than e (see `order`).  Where
# g < e the surfaces may as well have met, at a speed of up to sqrt(2 a (e - g)): missed, an impact
# leaves the motion wrong by as much from there on, which is far more than the e of places.  Where
# the nearest face changes there, as for a corner that passes an edge, they meet at the speed of the
# gap. Where another point of the same plane holds, as of a rim that rolls nearly flat, e is of
# angles.


SPEED, TIME, PUSHED, BEGAN, NOT_TAKEN, LAG, LAG_TIME, ROUNDED, ROUNDED_TIME = range(9)
GRAZES_WIDTH = 9
"""Columns by contact: largest speed of an impact that may have been missed [m/s], its time [s]; of
a slip that is lost in errors (see `slow_slips`) friction since then [N s], the body's speed then
[m/s], what friction has not taken since [J]; the largest share of that speed, its time [s]; the
largest angle [rad] by which rounding has turned the lean of a rim (see `swings`), its time [s]."""


class Doubts(NamedTuple):
    """How far bodies may be from where they ought to be at a step, and what that leaves open."""

    grazes: Any
    """(contacts, GRAZES_WIDTH)."""
    missed: Any
    """what steps of fixed length miss, by body, see `missed`."""
    elapsed: float
    """time since the start [s]."""
    allowed: float
    """by the tolerance, to all steps so far; 0 of steps of fixed length."""


@inline
def error_of_gap(system, doubts, y, c):
    """By how much the gap of contact c may be wrong, in lengths of the scene; 0 where a dip of it
    in the step is not one in flight."""
    touch = system.touch
    if not in_rigid_flight(touch, c) or touch[c, LEVELS_BEFORE] <= TOUCHING:
        return 0.0
    if touch[c, SENSE] == ABSENT or not touch[c, SLOPES_BEFORE] < 0.0:
        return 0.0
    far = np.empty(doubts.missed.shape[0])
    for b in range(far.shape[0]):
        far[b] = missed_way(doubts.missed, b, doubts.elapsed)
    error, held = error_of(system, far, y, c, doubts.allowed), held_beside(system, c)
    if held >= 0:
        error = min(error, error_beside(system, far, y, c, held, doubts.allowed))
    return error / system.length


@inline
def speed_of_dip(a, ra, b, rb, width, error):
    """Speed, in lengths of the scene, at which what dips as the cubic and is wrong by `error` may
    have met zero; 0 where it does not come so near.

    It bends by what its rate changes by: the cubic of a step of Euler's method, whose places and
    velocities are of different instants, bends otherwise.
    """
    s = cubic_minimum(a, ra, b, rb, width) if error > 0.0 else -1.0
    if not s > 0.0:
        return 0.0
    least, _ = cubic_at(a, ra, b, rb, width, s)
    bend = (rb - ra) / width
    return (2.0 * bend * (error - least)) ** 0.5 if least < error else 0.0


@inline
def note_graze(system, doubts, c, t, speed, error):
    """Keep the speed, in lengths of the scene, if it is the largest of the contact so far, and more
    than what velocities are wrong by where places are by `error`."""
    strikes = speed * system.length
    if strikes > max(doubts.grazes[c, SPEED], error * system.speed):
        doubts.grazes[c, SPEED], doubts.grazes[c, TIME] = strikes, t


@inline
def note_rounded_leans(system, doubts, t):
    """Note how far rounding turns the leans of rims that hardly miss flat, in the step from t."""
    for c in range(system.touch.shape[0]):
        turned = turned_by_rounding(system.touch, c)
        if turned > doubts.grazes[c, ROUNDED]:
            doubts.grazes[c, ROUNDED], doubts.grazes[c, ROUNDED_TIME] = turned, t
