"""Impacts so close to each other that the step or the tolerance decides which is first.

Where two contacts of one body strike, the motion after them depends on their order by as much as
they strike.  How far both bodies may be from where they ought to be, over the speed of approach,
shifts the instant of each.  So far are they by

    sum of |x_h - x_h/2| and of |v_h - v_h/2| times the time      with steps of fixed length,
    tolerance times steps times (max(1, |p|) + scene's length)    with an adaptive method,

the scene's length being the arm of errors of angles.  Of the latter a tenth was seen in slides and
oscillations, and 0.6 at most, after a few steps; chaos goes far beyond it.

Where the loads pull at both, as on a box that clatters on a floor, another order sends them off at
another speed v, and back after 2 v / a: by 2 v^2 / a the motion differs until then.  It does not
where both orders end in the same velocities (`both_orders`).
"""

from __future__ import annotations

from rb_sim.contact.events.both_orders import apart_in_order
from rb_sim.contact.events.dense import write_lines
from rb_sim.contact.events.missed import SUM, WAY
from rb_sim.contact.events.touching import touches
from rb_sim.contact.geometry.rims_on_cylinders import ABSENT
from rb_sim.contact.system.bodies import line_of
from rb_sim.contact.system.levels import in_rigid_flight
from rb_sim.contact.system.touch import (
    CLOSED,
    COMPLIANT,
    GAP,
    GAP_RATE,
    GAP_RATE_BEFORE,
    NORMAL,
    POINT,
    SENSE,
)
from rb_sim.engine.systems.many_bodies import BODY, PARENT, state_of, vec
from rb_sim.maths.jit import inline
from rb_sim.maths.vectors import norm, sub

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
