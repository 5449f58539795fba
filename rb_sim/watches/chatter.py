"""Whether a contact chatters: opens and closes so often that its events say nothing any more."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rb_sim.finding import Finding

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleBlock

MOST_EVENTS_PER_SAMPLE = 50.0
CHATTER = 1000
"""Events, all in all and on average between two samples, that say: a contact chatters."""


class Chatter:
    """Counts the events of each contact of a run."""

    def __init__(self) -> None:
        self._events: dict[str, int] = {}
        self._end = 0.0

    def add(self, block: SampleBlock) -> None:
        """The next samples, at least one."""
        self._end = float(block.t[-1])
        for event in block.events:
            self._events[event.contact] = self._events.get(event.contact, 0) + 1

    def found(self, samples: int) -> Finding | None:
        """The finding after so many samples of the run, if a contact chatters."""
        if not self._events:
            return None
        name, count = max(self._events.items(), key=lambda item: item[1])
        mean = count / samples
        if not (count > CHATTER and mean > MOST_EVENTS_PER_SAMPLE):
            return None
        advice = "the contact chatters: try method time_stepping"
        what = "number of events between two samples"
        return Finding("events", self._end, mean, MOST_EVENTS_PER_SAMPLE, what, name, advice)
