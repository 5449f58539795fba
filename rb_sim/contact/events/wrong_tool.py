"""Where event-driven motion is the wrong tool: said in one line that names time stepping."""

from __future__ import annotations

from collections import deque

import numpy as np

from rb_sim.contact.events.instant import Instant
from rb_sim.contact.geometry.pairs import BallOnSolid
from rb_sim.contact.system.bodies import ContactBodies
from rb_sim.contact.system.touch import NORMAL
from rb_sim.engine.samples import Array
from rb_sim.errors import SimulationError

TOOL = "event-driven is the wrong tool here, set simulation.method to time_stepping"
"""What a line ends with."""
ALIKE = 1.0 - 1e-6
"""Cosine between normals of one pair of bodies from which on they are the same."""
STALLED_EVENTS, STALLED_TIME = 2000, 1e-3
"""So many events within so short a time (natural units) are no motion any more: leaps, which pass
what changes without end, would have passed a longer time after a tenth of them."""


class Progress:
    """Sees that a run advances from event to event. unit: the scene's time [s]."""

    def __init__(self, unit: float) -> None:
        self._times: deque[float] = deque(maxlen=STALLED_EVENTS)
        self._shortest = STALLED_TIME * unit

    def add(self, t: float, contact: str) -> None:
        """One more event at t [s]; SimulationError if time has hardly gone on during the last."""
        self._times.append(t)
        span = t - self._times[0]
        if len(self._times) == STALLED_EVENTS and span < self._shortest:
            raise SimulationError(
                f"{STALLED_EVENTS} events in the last {span:.2g} s at t = {t:.9g} s (the last of "
                f"contact {contact}): {TOOL}"
            )


Pairs = tuple[tuple[int, ...], ...]
"""Contacts of the points of one body with another's own box or cylinder, by pair of bodies."""


def pairs_of_solids(system: ContactBodies) -> Pairs:
    """Of all bodies that touch with several points."""
    pairs: dict[tuple[int, int], list[int]] = {}
    for c, one in enumerate(one for group in system.contacts for one in group):
        if isinstance(one.row.pair, BallOnSolid):
            pairs.setdefault((one.body, one.parent), []).append(c)
    return tuple(tuple(pair) for pair in pairs.values() if len(pair) > 1)


def refuse_edges(at: Instant, pairs: Pairs, names: tuple[str, ...]) -> None:
    """Raise SimulationError where two convex bodies touch at points with several normals.

    A plane parts two convex bodies that touch, and its normal is that of all their points; where
    points have others they lie on an edge of the support, and rounding chooses between its faces.
    """
    if not pairs:
        return
    touching = set(at.touching())
    for pair in pairs:
        here = [c for c in pair if c in touching]
        if len(here) < 2:
            continue
        normals: Array = at.system.touch[here, NORMAL : NORMAL + 3]
        other = np.flatnonzero(normals @ normals[0] < ALIKE)
        if len(other):
            raise SimulationError(
                f"contacts {names[here[0]]} and {names[here[other[0]]]} touch one body with two "
                f"normals at t = {at.t:.9g} s, as corners on an edge do: {TOOL}"
            )
