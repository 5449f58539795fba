"""What ends at an instant in a motion of bodies in contact: impacts, slips that jam, leaps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rb_sim.contact.events import tasks
from rb_sim.contact.events.chatter import EVENTS_AT_ONCE, Chatter
from rb_sim.contact.events.choice import OF
from rb_sim.contact.events.decompositions import not_finite
from rb_sim.contact.events.impacts import (
    ENDLESS,
    GOES_ON,
    NO_IMPULSES,
    NOTHING,
    OVERFLOWN,
)
from rb_sim.contact.events.instant import Instant
from rb_sim.contact.events.jams import impulses_of_jam, least_lifted
from rb_sim.contact.events.journal import Journal
from rb_sim.contact.events.leap import bring_back, leap
from rb_sim.contact.events.lying import (
    aim_where_it_turns,
    rims_of,
)
from rb_sim.contact.events.notes import JAMS, LEAPS
from rb_sim.contact.events.rough import (
    refuse_rough,
)
from rb_sim.contact.events.stepping import EventStepping
from rb_sim.contact.events.wrong_tool import TOOL
from rb_sim.contact.scene.touching import ContactLaw
from rb_sim.contact.system.bodies import (
    NEAR_JAM,
)
from rb_sim.contact.system.touch import (
    CLOSED,
)
from rb_sim.engine.samples import Array
from rb_sim.errors import SimulationError, StepTooLargeError
from rb_sim.scene.compiled import Compiled

IMPACTS_AT_ONCE = 20
"""Impacts one by one at an instant, for each contact, that are taken to have no end."""


class StrikingMotion(EventStepping):
    """As EventStepping, with what happens at one instant of it."""

    laws: Sequence[ContactLaw]
    _journal: Journal
    _chatter: Chatter

    def __init__(self, compiled: Compiled, method: Any) -> None:
        self.names = compiled.layout.contacts
        self.rims = rims_of(compiled.system)
        super().__init__(compiled, method)

    def _instant(self, t: float, y: Array) -> Instant:
        return Instant(self.laws, self._call, t, y, tasks.ARRIVE)

    def _strike(self, instant: Instant) -> None:
        """Impacts until nothing approaches; an endless series of bounces is closed."""
        single = IMPACTS_AT_ONCE * len(self.laws) if self.compiled.one_by_one else 0
        n, last, status = 0, single + EVENTS_AT_ONCE, GOES_ON
        while status != NOTHING:
            aim_where_it_turns(instant, self.rims)
            to = min(n + 1, last) if self.rims else last  # rims aim anew before each round
            status = self._call(tasks.IMPACTS, instant.t, instant.y, (n, to, single))
            n = int(self._call.found)
            self._journal.take(instant.room)
            self._refuse_impacts(instant, status, n >= last)

    def _refuse_impacts(self, instant: Instant, status: int, over: bool) -> None:
        """Raise SimulationError where impacts have no impulses, or no end."""
        if status == OVERFLOWN:
            raise not_finite(OF)
        if status == NO_IMPULSES:
            raise SimulationError(
                f"no impulses satisfy the laws of impact and friction at t = {instant.t:.9g} s"
            )
        if status == ENDLESS and over:
            text = f"impacts without end at t = {instant.t:.9g} s"
            if self._fixed:  # bodies may be where only a step too long can have taken them
                raise StepTooLargeError(f"{text} in steps of {self.method.step:g} s")
            raise SimulationError(text)

    def _stop_at_once(self, instant: Instant) -> None:
        """One impact without rebound."""
        instant.room.plastic[:], instant.room.together[:] = 1, 0
        status = self._call(tasks.STRIKE, instant.t, instant.y)
        self._journal.take(instant.room)
        self._refuse_impacts(instant, status, False)

    def _jam(self, instant: Instant, c: int | None) -> None:
        """Painleve: the slip of contact c (or of whichever jams) stops at once, in an impact."""
        for i in range(len(self.laws)) if c is None else (c,):
            touch = self.system.touch
            if touch[i, CLOSED] and instant.effective_pivot(i) < NEAR_JAM:
                x = impulses_of_jam(instant, i)
                if x is None:
                    break
                instant.apply(x)
                self._call(tasks.NOTE, instant.t, instant.y, (JAMS, 0, 0))
                self._journal.take(instant.room)
                return
        rough = [i for i in instant.touching() if math.isinf(self.laws[i].static)]
        if c is None and rough:
            refuse_rough(instant, rough[0], self.names)
        hardly = c is not None and instant.slip_speed(c) <= self.system.still
        # compliant contacts that stick may find no forces either, and touch nothing rigidly
        near = instant.touching() or np.flatnonzero(self.system.touch[:, CLOSED] == 1.0).tolist()
        if (c is None or hardly) and near and self._leapt_over(instant, near[0]):
            return
        if c is None and near and not instant.touching():
            raise SimulationError(
                f"no forces of friction are found where {self.names[near[0]]} and others give way "
                f"and hardly slip at t = {instant.t:.9g} s: {TOOL}"
            )
        c = least_lifted(instant) if c is None else c
        name = "" if c is None else f" of {self.names[c]}"
        raise SimulationError(
            f"Painleve's paradox at t = {instant.t:.9g} s: no force{name} keeps to its law of "
            "friction, nor does an impact stop the slip"
        )

    def _leapt_over(self, instant: Instant, c: int) -> bool:
        """Move the instant on by a time too short to matter, over which impulses answer the loads;
        longer if it has just been done.  False if the laws have no impulses either."""
        t, length = instant.t, self._chatter.length_of_leap(instant.t)
        if leap(instant, length) is None:
            return False
        bring_back(instant)
        self._journal.note(t, c, LEAPS)
        self._chatter.leapt(t + length, length)
        return True
