"""Changes of contacts that follow each other as if without end, and what is done about them.

Where rounding chooses between rest and slip over and over, friction at its very bound is taken to
hold a little more; other changes without impacts are leapt over (see leap).
"""

from __future__ import annotations

import math
from collections import deque

from rb_sim.contact.system.bodies import SLIP_BEGINS, SLIP_ENDS, TOUCH_DOWN

SHORT_SLIPS = 6
"""Slips over before they have moved anything, with none between that outlasts a leap, after
which friction is taken to be at its very bound."""
GRIP, FIRMER = 1e-9, 4.0
"""Part by which friction at its very bound is then taken to hold more, and what that grows by where
it is not enough: rounding must not choose between rest and slip over and over."""
FIRMEST = 1e-6
"""Part beyond which friction is never taken to hold more: up to it rounding has been in the way,
beyond it slips end at once for another reason, and a firmer hold would be another law."""
EVENTS_AT_ONCE = 50
"""Changes at one instant, or within DENSE, that are taken to have no end."""
DENSE, LONGEST_LEAP = 1e-6, 1e-3
"""A time too short to matter, and the longest that is leapt over; natural units."""

AT_ONCE = 1e-12
"""Share of the time, or of 1 s before, within which two changes are at one instant."""


def at_one_instant(t: float) -> float:
    """Two changes near t are at one instant where no more than this lies between them [s]."""
    return AT_ONCE * max(1.0, abs(t))


class Chatter:
    """The changes of a run so far, as far as they tell those without end.

    unit: the scene's natural time [s].
    """

    def __init__(self, unit: float) -> None:
        self.grip = 0.0
        """part by which friction holds more at rest than it is given."""
        self._short = DENSE * unit
        self._longest = LONGEST_LEAP * unit
        self._count, self._last = 0, -math.inf
        self._slipped, self._short_slips = -math.inf, 0
        self._changes: deque[float] = deque(maxlen=EVENTS_AT_ONCE)
        self._leapt = (-math.inf, 0.0)

    def at_once(self, t: float) -> bool:
        """Count a change at t; True where too many are at one instant."""
        near = t - self._last <= at_one_instant(t)
        self._count = self._count + 1 if near else 0
        self._last = t
        return self._count > EVENTS_AT_ONCE

    def holds_firmer(self, t: float, kind: int) -> bool:
        """True where slips begin and end without a motion, and `grip` has grown for it."""
        if kind == SLIP_BEGINS:
            self._slipped = t
        if kind != SLIP_ENDS:
            return False
        lasted = t - self._slipped
        if lasted < self._short:
            self._short_slips += 1
        elif lasted > self._longest:  # between the two rounding may have let it slip as well
            self._short_slips = 0
        if self._short_slips < SHORT_SLIPS:
            return False
        self._short_slips = 0
        firmer = FIRMER * self.grip if self.grip else GRIP
        if firmer > FIRMEST:
            return False
        self.grip = firmer
        return True

    def is_dense(self, t: float, kind: int) -> bool:
        """True where changes without impact follow each other as fast as if without end."""
        if kind == TOUCH_DOWN:
            return False
        self._changes.append(t)
        full = len(self._changes) == self._changes.maxlen
        return full and t - self._changes[0] < self._short

    def length_of_leap(self, t: float) -> float:
        """A time too short to matter [s]; longer if one has just been leapt over."""
        end, length = self._leapt
        return min(4.0 * length, self._longest) if t - end < 10.0 * length else self._short

    def leapt(self, end: float, length: float) -> None:
        """A time of this length, to its end, has been leapt over [s]."""
        self._leapt = (end, length)
        self._changes.clear()
        self._count = 0
