"""What steps of fixed length miss of the motion between events: each beside its two halves.

As `step_probe` of scenes without contacts, but in the loop: only there the modes and directions are
those that the step had.  After the first ones one of EVERY steps is looked at, and counted for all
of them; the first ones after an event are all looked at, and counted for themselves, for a bounce
may be over in two steps of a run and change more than all the others.
"""

from __future__ import annotations

import numpy as np

from rb_sim.contact.events.grid import add_increment, copy, finite, increment
from rb_sim.contact.solvers.arrays import copy_rows
from rb_sim.engine.system import settle
from rb_sim.engine.systems.many_bodies import WIDTH
from rb_sim.loops.compiled import call_law, part, pointer
from rb_sim.loops.rows import AT, DY
from rb_sim.loops.tables import address
from rb_sim.maths.jit import inline

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
