"""What is done between the calls of the loop, compiled once for all scenes.

Tasks work on the tables of a system and the room for events, and are called by one address, since
each argument costs where Python calls.
"""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np

from rb_sim.compiler.marshal import address_of
from rb_sim.contact.events.next_event import begin_step
from rb_sim.contact.problem.bounces import EVENTS_AT_ONCE, time_of_flights
from rb_sim.contact.problem.delassus import read_velocities, write_lines
from rb_sim.contact.problem.event_workspace import (
    CHANGES,
    IMPACT,
    ROOM_LAYOUT,
    Room,
    note_changes,
    note_impulses,
    room_for,
    room_left,
    take_before,
)
from rb_sim.contact.problem.forces import answer_over
from rb_sim.contact.problem.impacts import NOTHING, STRUCK, apply_impulses, strike, strike_in_rounds
from rb_sim.contact.problem.modes import WHOLE, choose, may_share
from rb_sim.graph.machine import interpreted
from rb_sim.integrate.layout import held_at
from rb_sim.mechanics.contact.accelerations import contact_accelerations
from rb_sim.mechanics.contact.contact_bodies import TOUCH_DOWN, ContactBodies
from rb_sim.mechanics.samples import Array
from rb_sim.mechanics.system import settle
from rb_sim.mechanics.systems.multipliers import write_rows
from rb_sim.numerics.kernels import for_python, inline, pointer_to, view, where

(
    WRITE, LINES, ACCELERATE, SETTLE, BEGIN, ARRIVE, IMPACTS, STRIKE, APPLY, NOTE, CHOOSE,
    LEAVE, PASS, OVER,
) = range(14)  # fmt: skip
"""Tasks: write the lines of what is closed, or all of them as dense matrices; multipliers and
accelerations; bring y back to the manifold; begin a step; arrive at an event (keep the modes before
it, write all lines); rounds of impacts, or one of what the room names; add the impulses of the
room, or note them; choose the modes; leave (note what has changed, find the time within which
flights end); pass an event whole, where nothing but the laws is asked; impulses over a short
time.
"""
DONE, AT_IMPACTS, AT_MODES = range(3)
"""How far PASS has come: to the end, or to where more than the laws is asked."""

SYSTEM, ROOM, NUMBERS, STATE, DIGITS, LENGTH, TASK, FIRST, SECOND, THIRD, PLACES = range(11)
"""What a task is told: addresses of system, room, numbers, y and its low digits, how long y is, the
task and three integers that it takes."""
TIME, FOUND, MORE = range(3)
"""Numbers: t, and what a task gives: a number, and whether the laws alone decide."""
NO_DIGITS = np.zeros(0)


@inline
def pass_through(system, room, t, y, contact, fixed):
    """What PASS does after the touch-down of a contact: (how far it has come, time within which the
    flights that begin end)."""
    take_before(system, room)
    write_lines(system, t, y, room)
    status, _ = strike_in_rounds(system, room, t, y, 0, EVENTS_AT_ONCE, 0)
    if status != NOTHING:
        return AT_IMPACTS, math.inf
    if choose(system, room, t, y, (contact, TOUCH_DOWN)) != WHOLE or may_share(system, room):
        return AT_MODES, math.inf
    contacts = room.parted.shape[0]
    for c in range(contacts):
        if room.parted[c] == 1:
            return AT_MODES, math.inf
    if room_left(room) < CHANGES * contacts:
        return AT_MODES, math.inf
    note_changes(system, room, t)
    length, _ = time_of_flights(system, room, t, y, fixed)
    return DONE, length


@for_python
def do_task(places):
    """Do the task at (t, y); returns its status."""
    system, room = held_at(places, SYSTEM), held_at(places, ROOM)
    numbers, task = pointer_to(places, NUMBERS), places[TASK]
    t, y = numbers[TIME], view(pointer_to(places, STATE), 0, places[LENGTH])
    first, second, third = places[FIRST], places[SECOND], places[THIRD]
    status = 0
    if task == WRITE:
        write_rows(system, t, y)
    elif task == LINES:
        write_lines(system, t, y, room)
    elif task == ACCELERATE:
        contact_accelerations(system, t, y)
    elif task == SETTLE:
        write_rows(system, t, y)  # those of contacts that the modes open now, which are zero
        settle(system, t, y)
    elif task == BEGIN:
        begin_step(system, t, y, view(pointer_to(places, DIGITS), 0, places[LENGTH]))
    elif task == ARRIVE:
        take_before(system, room)
        write_lines(system, t, y, room)
    elif task == IMPACTS:
        status, n = strike_in_rounds(system, room, t, y, first, second, third)
        numbers[FOUND] = n
    elif task == STRIKE:
        status = strike(system, room, t, y, False)
        if status == STRUCK:
            note_impulses(system, room, t, IMPACT)
    elif task == APPLY:
        apply_impulses(system, room, t, y, room.impulses)
    elif task == NOTE:
        note_impulses(system, room, t, first)
    elif task == CHOOSE:
        status = choose(system, room, t, y, (first, second))
        numbers[MORE] = 1.0 if status == 0 and may_share(system, room) else 0.0
    elif task == LEAVE:
        note_changes(system, room, t)
        numbers[FOUND], status = time_of_flights(system, room, t, y, first == 1)
    elif task == PASS:
        status, numbers[FOUND] = pass_through(system, room, t, y, first, second == 1)
    else:
        u = np.empty_like(room.free_accelerations)
        read_velocities(system, y, u)
        status = answer_over(system, room, u, numbers[FOUND])
    return status


CALL = struct.Struct("=7q")
"""What stands from STATE on."""


class Tasks:
    """Tasks on the tables of a system, which must be in place as long.

    packed: the system as the loop has it; None: everything runs as plain Python, and compiles
    nothing.
    """

    def __init__(self, system: ContactBodies, packed: Any = None, room: Room | None = None) -> None:
        """room: that of the same contacts before, with what it remembers."""
        self.system = system
        self.room = room_for(system) if room is None else room
        self._numbers = np.zeros(3)
        self._plain = packed is None or interpreted()
        if packed is None or self._plain:
            self._places: Any = [system, self.room, self._numbers] + [0] * (PLACES - 3)
            return
        self._kept = packed, ROOM_LAYOUT.pack(self.room._asdict())
        self._table = np.zeros(PLACES, np.int64)
        self._table[:STATE] = [address_of(a) for a in (*self._kept, self._numbers)]
        self._told = memoryview(self._table.data).cast("B")[8 * STATE :]
        self._places = where(self._table)

    def __call__(
        self,
        task: int,
        t: float,
        y: Array,
        numbers: tuple[int, int, int] = (0, 0, 0),
        c: Array = NO_DIGITS,
    ) -> int:
        """The task at (t, y), which may change in place; c, the low digits of y, is read by BEGIN
        alone. Returns its status."""
        self._numbers[TIME] = t
        if self._plain:
            self._places[STATE:] = [y, c, len(y), task, *numbers]
            return do_task.function(self._places)
        at = address_of(y), address_of(c) if task == BEGIN else 0
        CALL.pack_into(self._told, 0, *at, len(y), task, *numbers)
        return do_task(self._places)

    def over(self, t: float, y: Array, duration: float) -> int:
        """The impulses of a short time, see `forces.answer_over`."""
        self._numbers[FOUND] = duration
        return self(OVER, t, y)

    @property
    def found(self) -> float:
        """The number that the last task has given."""
        return float(self._numbers[FOUND])

    @property
    def undecided(self) -> bool:
        """True where laws alone do not decide how contacts at rest share the load."""
        return bool(self._numbers[MORE])
