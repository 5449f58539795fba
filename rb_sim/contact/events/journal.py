"""What happened to the contacts, as the events of a run: told from the modes before and after."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rb_sim.contact.events.instant import Instant
from rb_sim.contact.scene.touching import ContactLaw
from rb_sim.contact.system.terms import SLIDING, STUCK
from rb_sim.contact.system.touch import AHEAD, CLOSED, ROLL, SLIDE, SPIN
from rb_sim.engine.samples import Array, ContactEvent
from rb_sim.engine.systems.many_bodies import BODY

MOST_EVENTS = 100_000
"""That are kept at least."""
TOLD = (
    ("slide", "slips", "sticks"),
    ("roll", "rolls", "stops rolling"),
    ("spin", "spins", "stops spinning"),
)
"""Kinds of friction and what their two modes are called in events."""


class Snapshot(NamedTuple):
    """The modes of all contacts."""

    closed: Array
    slide: Array
    roll: Array
    spin: Array
    ahead: Array


def snapshot_of(touch: Array) -> Snapshot:
    """The modes that the table of contacts has."""
    now = touch[:, : AHEAD + 3].copy()
    closed, slide, roll, spin = (now[:, mode] for mode in (CLOSED, SLIDE, ROLL, SPIN))
    return Snapshot(closed, slide, roll, spin, now[:, AHEAD : AHEAD + 3])


class Journal:
    """The events of a run, the earliest of very many forgotten."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names = names
        self.events: list[ContactEvent] = []
        self.forgotten = 0

    def note(self, t: float, c: int, kind: str, impulse: Array | None = None) -> None:
        """One event of contact c; impulse: BY it ON its body, world axes [N s]."""
        x, y, z = (0.0, 0.0, 0.0) if impulse is None else impulse
        value = (float(x), float(y), float(z))
        self.events.append(ContactEvent(float(t), self.names[c], kind, value))
        if len(self.events) >= 2 * MOST_EVENTS:  # a node may run for ever
            del self.events[:MOST_EVENTS]
            self.forgotten += MOST_EVENTS

    def note_impulses(self, at: Instant, impulses: Array, kind: str) -> None:
        """One event for each contact that takes part; impulses: of every line."""
        sizes = np.abs(impulses).tolist()
        none = 1e-9 * max(sizes)
        for c in range(len(at.laws)):
            k = at.first[c]
            if max(sizes[k : k + 3]) > none:
                b = int(at.system.lines[k, BODY])
                force = at.lines.J[k : k + 3, 6 * b : 6 * b + 3].T @ impulses[k : k + 3]
                self.note(at.t, c, kind, force)

    def tell(self, t: float, laws: Sequence[ContactLaw], before: Snapshot, now: Snapshot) -> None:
        """Note what opened, closed, slipped and stuck."""
        for c, law in enumerate(laws):
            if before.closed[c] != now.closed[c]:
                self.note(t, c, law.closes if now.closed[c] else law.opens)
            if not now.closed[c]:
                continue
            bounds = (law.static, law.rolling_arm, law.spinning_arm)
            for (name, moves, rests), bound in zip(TOLD, bounds, strict=True):
                was, mode = getattr(before, name)[c], getattr(now, name)[c]
                if bound > 0.0 and was != mode:
                    self.note(t, c, rests if mode == STUCK else moves)
            turned = float(before.ahead[c] @ now.ahead[c]) < 0.0
            if law.static > 0.0 and before.slide[c] == now.slide[c] == SLIDING and turned:
                self.note(t, c, "reverses")
