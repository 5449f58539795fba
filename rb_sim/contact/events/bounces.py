"""Bounces that have no end: which contacts strike and are at rest at once instead, and when the
series of their bounces would be over.

With e below 1 the times between bounces shrink by e each, and their sum is known from one of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from rb_sim.contact.events.dense import ACCELERATE
from rb_sim.contact.events.instant import Instant
from rb_sim.contact.system.touch import CLOSED, GAP_RATE
from rb_sim.engine.systems.many_bodies import PUSH

ZENO_HEIGHT = 1e-11
"""Height of the next bounce, relative to the scene's length, below which a contact is closed: what
is left out of the motion is of that size, and the time of rest is known from the series."""
ZENO_BOUNCES = 3
"""Impacts in a row before one is taken to belong to an endless series."""

Note = Callable[[float, int, str], None]
"""note(t, contact, kind): tells an event."""


class Rest(NamedTuple):
    """When an endless series of bounces will be over [s], seen from its bounces so far."""

    last: float
    """from the last bounce."""
    best: float
    """where two bounces that follow each other agree best."""
    change: float
    """by how much they agree."""

    def seen(self, t: float) -> Rest:
        """With one more bounce, which tells t.

        Low bounces know it best where the fall changes; but rounding of the height, over their
        speed, is the larger the lower they are.
        """
        change = abs(t - self.last)
        if change <= self.change:
            return Rest(t, t, change)
        return Rest(t, self.best, self.change)


NO_REST = Rest(math.inf, math.inf, math.inf)


class Bounces:
    """The bounces in a row of every contact."""

    def __init__(self, contacts: int) -> None:
        self._counts = [0] * contacts
        self._rests = [NO_REST] * contacts
        self._low = 0

    def struck(self, rebound: tuple[int, ...]) -> None:
        """An impact has been, after which these contacts part."""
        for c in range(len(self._counts)):
            if c in rebound:
                self._counts[c] += 1
            else:
                self._counts[c], self._rests[c] = 0, NO_REST

    def over(self, at: Instant, note: Note) -> frozenset[int]:
        """Contacts whose further bounces would all be over at once: they strike without rebound."""
        touch, closing = at.system.touch, set()
        for c in at.touching():
            e, speed = at.laws[c].restitution, -float(touch[c, GAP_RATE])
            if not (0.0 < e < 1.0 and speed > at.still):
                continue
            if self._counts[c] < ZENO_BOUNCES:
                continue
            fall = -free_normal_acceleration(at, c)
            if fall <= 0.0:
                continue
            rest = self._rests[c].seen(at.t + 2.0 * e * speed / (fall * (1.0 - e)))
            self._rests[c] = rest
            if 0.5 * (e * speed) ** 2 / fall < ZENO_HEIGHT * at.system.length:
                closing.add(c)
                note(rest.best, c, "rests")
        return frozenset(closing)

    def rocking(self, at: Instant, note: Note) -> frozenset[int]:
        """Contacts that strike and part in turns, too low to tell: they close together."""
        touch, touching = at.system.touch, at.touching()
        struck = [c for c in touching if touch[c, GAP_RATE] < -at.still]
        if not struck or len(touching) < 2:
            return frozenset()
        self._low = self._low + 1 if all(is_low(at, c) for c in struck) else 0
        if self._low <= ZENO_BOUNCES:
            return frozenset()
        for c in struck:
            note(at.t, c, "rests")
        return frozenset(c for c in touching if is_low(at, c))


def is_low(at: Instant, c: int) -> bool:
    """True if contact c falls from, or rises to, a height that is too low to tell."""
    fall = -free_normal_acceleration(at, c)
    if fall <= 0.0:
        return False
    return 0.5 * float(at.system.touch[c, GAP_RATE]) ** 2 / fall < ZENO_HEIGHT * at.system.length


def free_normal_acceleration(at: Instant, c: int) -> float:
    """Of the gap, with contact c open and the others as they are [m/s^2]."""
    mode = at.system.touch[c, CLOSED]
    at.system.touch[c, CLOSED] = 0.0
    at.call(ACCELERATE, at.t, at.y)
    u = at.system.bodies[:, PUSH : PUSH + 6].reshape(-1)
    at.system.touch[c, CLOSED] = mode
    k = at.first[c]
    return float(at.lines.J[k] @ u + at.lines.bias[k])
