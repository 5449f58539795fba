"""States at single instants of a run, and beside the events of its contacts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from operator import index
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rb_sim.base.errors import RbSimError
from rb_sim.mechanics.samples import Array, ContactEvent
from rb_sim.trajectory.record import ByName

if TYPE_CHECKING:
    from rb_sim.trajectory.record import Record

NEAR = 256.0
"""Roundings of the end time within which a sample lies beside an event."""


@dataclass(frozen=True)
class State:
    """State at one instant: columns as in Trajectory, one row each."""

    t: float
    position: Mapping[str, Array]
    orientation: Mapping[str, Array]
    linear_velocity: Mapping[str, Array]
    angular_velocity: Mapping[str, Array]


class EventState(NamedTuple):
    """What happened to a contact, and the states just before and after it."""

    event: ContactEvent
    before: State
    after: State


def state_of(run: Record, sample: int) -> State:
    """The state at that sample of the run. Raises RbSimError where there is none such."""
    count = len(run)
    try:
        found = -count <= index(sample) < count
    except TypeError:
        found = False
    if not found:
        raise RbSimError(
            f"state: got {sample!r}; must be a whole number from {-count} to {count - 1}"
        )
    columns = ("position", "orientation", "linear_velocity", "angular_velocity")
    block, bodies = run.block, run.layout.bodies

    def rows(name: str) -> Mapping[str, Array]:
        values = getattr(block, name)[sample]
        return ByName("body", {body: values[i] for i, body in enumerate(bodies)})

    return State(float(run.t[sample]), **{name: rows(name) for name in columns})


def beside(run: Record, event: ContactEvent) -> EventState:
    """The event with the states of the samples just before and just after it.

    Raises RbSimError where no samples lie there.
    """
    near = NEAR * np.spacing(max(abs(float(run.t[-1])), abs(event.t)))
    after = int(np.searchsorted(run.t, event.t, side="right"))
    before = int(np.searchsorted(run.t, event.t, side="left")) - 1
    if after == len(run.t):
        after -= 1
    before = max(before, 0)
    rows = (before, after) if run.t[before] > 0.0 or event.t > near else (0, 0)
    if any(abs(run.t[row] - event.t) > near for row in rows):
        raise RbSimError(
            f"no samples just before and after the event at t = {event.t:.9g} s: "
            "use Simulation.run(events=True)"
        )
    return EventState(event, state_of(run, rows[0]), state_of(run, rows[1]))
