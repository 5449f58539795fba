"""What is done between the calls of the loop, compiled once for all scenes.

Tasks work on the tables of a system and the workspace for events, and are called by one address,
since each argument costs where Python calls.
"""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np

from rb_sim.compiler.marshal import address_of
from rb_sim.contact.events.search import begin_step
from rb_sim.contact.problem.assembly import answer_over, write_lines
from rb_sim.contact.problem.bounces import AT_ONCE, time_of_flights
from rb_sim.contact.problem.event_workspace import (
    CHANGES,
    IMPACT,
    WORKSPACE_LAYOUT,
    Workspace,
    note_changes,
    note_impulses,
    take_before,
    workspace_for,
    workspace_left,
)
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
it, write all lines); rounds of impacts, or one of what the workspace names; add the impulses of the
room, or note them; choose the modes; leave (note what has changed, find the time within which
flights end); pass an event whole, where nothing but the laws is asked; impulses over a short
time.
"""
DONE, AT_IMPACTS, AT_MODES = range(3)
"""How far PASS has come: to the end, or to where more than the laws is asked."""

SYSTEM, WORKSPACE, NUMBERS, STATE, DIGITS, LENGTH, TASK, FIRST, SECOND, THIRD, PLACES = range(11)
"""Arguments of a task: addresses of system, workspace, numbers, y and its low digits, how long y
is, the task and three integers that it takes."""
TIME, FOUND, MORE = range(3)
"""Numbers: t, and what a task gives: a number, and whether the laws alone decide."""
NO_DIGITS = np.zeros(0)


@inline
def pass_through(system, workspace, t, y, contact, fixed):
    """What PASS does after the touch-down of a contact: (how far it has come, time within which the
    flights that begin end)."""
    take_before(system, workspace)
    write_lines(system, t, y, workspace)
    status, _ = strike_in_rounds(system, workspace, t, y, 0, AT_ONCE, 0)
    if status != NOTHING:
        return AT_IMPACTS, math.inf
    if choose(system, workspace, t, y, (contact, TOUCH_DOWN)) != WHOLE or may_share(
        system, workspace
    ):
        return AT_MODES, math.inf
    contacts = workspace.parted.shape[0]
    for c in range(contacts):
        if workspace.parted[c] == 1:
            return AT_MODES, math.inf
    if workspace_left(workspace) < CHANGES * contacts:
        return AT_MODES, math.inf
    note_changes(system, workspace, t)
    length, _ = time_of_flights(system, workspace, t, y, fixed)
    return DONE, length


@for_python
def do_task(places):
    """Do the task at (t, y); returns its status."""
    system, workspace = held_at(places, SYSTEM), held_at(places, WORKSPACE)
    numbers, task = pointer_to(places, NUMBERS), places[TASK]
    t, y = numbers[TIME], view(pointer_to(places, STATE), 0, places[LENGTH])
    first, second, third = places[FIRST], places[SECOND], places[THIRD]
    status = 0
    if task == WRITE:
        write_rows(system, t, y)
    elif task == LINES:
        write_lines(system, t, y, workspace)
    elif task == ACCELERATE:
        contact_accelerations(system, t, y)
    elif task == SETTLE:
        write_rows(system, t, y)  # those of contacts that the modes open now, which are zero
        settle(system, t, y)
    elif task == BEGIN:
        begin_step(system, t, y, view(pointer_to(places, DIGITS), 0, places[LENGTH]))
    elif task == ARRIVE:
        take_before(system, workspace)
        write_lines(system, t, y, workspace)
    elif task == IMPACTS:
        status, n = strike_in_rounds(system, workspace, t, y, first, second, third)
        numbers[FOUND] = n
    elif task == STRIKE:
        status = strike(system, workspace, t, y, False)
        if status == STRUCK:
            note_impulses(system, workspace, t, IMPACT)
    elif task == APPLY:
        apply_impulses(system, workspace, t, y, workspace.impulses)
    elif task == NOTE:
        note_impulses(system, workspace, t, first)
    elif task == CHOOSE:
        status = choose(system, workspace, t, y, (first, second))
        numbers[MORE] = 1.0 if status == 0 and may_share(system, workspace) else 0.0
    elif task == LEAVE:
        note_changes(system, workspace, t)
        numbers[FOUND], status = time_of_flights(system, workspace, t, y, first == 1)
    elif task == PASS:
        status, numbers[FOUND] = pass_through(system, workspace, t, y, first, second == 1)
    else:
        status = answer_over(system, workspace, y, numbers[FOUND])
    return status


CALL = struct.Struct("=7q")
"""What stands from STATE on."""


class Tasks:
    """Tasks on the tables of a system, which must be in place as long.

    packed: the system as the loop has it; None: everything runs as plain Python, and compiles
    nothing.
    """

    def __init__(
        self, system: ContactBodies, packed: Any = None, workspace: Workspace | None = None
    ) -> None:
        """workspace: that of the same contacts before, with what it remembers."""
        self.system = system
        self.workspace = workspace_for(system) if workspace is None else workspace
        self._numbers = np.zeros(3)
        self._plain = packed is None or interpreted()
        if packed is None or self._plain:
            self._places: Any = [system, self.workspace, self._numbers] + [0] * (PLACES - 3)
            return
        self._kept = packed, WORKSPACE_LAYOUT.pack(self.workspace._asdict())
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
