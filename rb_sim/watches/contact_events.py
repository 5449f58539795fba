"""What happened to the contacts of a run, counted and summed up."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array, ContactEvent

FIRST_EVENTS = 10
"""Events that a summary lists."""


class Events:
    """What happened to the contacts of a run, in bounded memory."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}
        self._first: list[ContactEvent] = []
        self._impulses: dict[str, Array] = {}

    def add(self, events: tuple[ContactEvent, ...]) -> None:
        """The next events."""
        self._first += events[: FIRST_EVENTS - len(self._first)]
        for event in events:
            self._counts[event.kind] = self._counts.get(event.kind, 0) + 1
            if any(event.impulse):
                before = self._impulses.get(event.contact, np.zeros(3))
                self._impulses[event.contact] = before + event.impulse

    def as_dict(self) -> dict[str, Any]:
        """For JSON: events by kind, the first of them, and the sum of impulses [N s] by contact."""
        return {
            "events": dict(self._counts),
            "first_events": [
                {"t": e.t, "contact": e.contact, "kind": e.kind, "impulse": list(e.impulse)}
                for e in self._first
            ],
            "impulses": {name: sum_.tolist() for name, sum_ in self._impulses.items()},
        }
