"""What happened to the contacts, as the events of a run."""

from __future__ import annotations

from collections.abc import Sequence

from rb_sim.contact.events.notes import CLOSES, KINDS, OPENS
from rb_sim.contact.events.room import Room
from rb_sim.contact.scene.touching import ContactLaw
from rb_sim.engine.samples import ContactEvent

MOST_EVENTS = 100_000
"""That are kept at least."""


class Journal:
    """The events of a run, the earliest of very many forgotten."""

    def __init__(self, names: Sequence[str], laws: Sequence[ContactLaw]) -> None:
        self.names = names
        self.events: list[ContactEvent] = []
        self.forgotten = 0
        self._kinds = [
            tuple(
                law.closes if k == CLOSES else law.opens if k == OPENS else kind
                for k, kind in enumerate(KINDS)
            )
            for law in laws
        ]

    def note(self, t: float, c: int, kind: int) -> None:
        """One event of contact c without an impulse; kind: among KINDS."""
        told = self._kinds[c][kind]
        self._add(ContactEvent(float(t), self.names[c], told, (0.0, 0.0, 0.0)))

    def take(self, room: Room) -> None:
        """The events noted in the room, which is empty then."""
        for t, contact, kind, *impulse in room.notes[: int(room.written[0])].tolist():
            c = int(contact)
            name = self._kinds[c][int(kind)]
            self._add(ContactEvent(t, self.names[c], name, tuple(impulse)))
        room.written[0] = 0

    def _add(self, event: ContactEvent) -> None:
        self.events.append(event)
        if len(self.events) >= 2 * MOST_EVENTS:  # a node may run for ever
            del self.events[:MOST_EVENTS]
            self.forgotten += MOST_EVENTS
