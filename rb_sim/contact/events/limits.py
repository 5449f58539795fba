"""Limits of event-driven contact: laws without a motion, scenes for time stepping."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from rb_sim.base.errors import SimulationError
from rb_sim.catalogue.contacts.touching import ContactLaw
from rb_sim.catalogue.geometry.pairs import BallOnSolid
from rb_sim.contact.events.instant import Instant
from rb_sim.contact.problem.bounces import HELD_DOWN
from rb_sim.mechanics.contact.contact_bodies import ContactBodies
from rb_sim.mechanics.contact.contact_kinematics import SLIDING
from rb_sim.mechanics.contact.contact_table import CLOSED, EVENT_RATES_BEFORE, NORMAL, SLIDE
from rb_sim.mechanics.samples import Array

# Where event-driven motion is the wrong tool: said in one line that names time stepping.


TOOL = "use simulation.method time_stepping for this scene"
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
                f"contacts {names[here[0]]} and {names[here[other[0]]]} of one body have different "
                f"normals at t = {at.t:.9g} s (corners on an edge): {TOOL}"
            )


# Laws of friction that have no motion at all in some states: which, and the line that says so.
#
# Perfectly rough contacts that push may not slip.
#
# No force of theirs is bounded, so that a slip ends in an impact at once.  A support that gives way
# knows no impacts, and a contact that would have to pull to keep from slipping has no motion at
# all.


def slipping_rough(at: Instant) -> list[int]:
    """Perfectly rough contacts that are closed and slip, in the modes of the table."""
    touch, rough = at.system.touch, [c for c, law in enumerate(at.laws) if law.static == math.inf]
    return [c for c in rough if touch[c, CLOSED] == 1.0 and touch[c, SLIDE] == SLIDING]


def refuse_rough(at: Instant, c: int, names: Sequence[str]) -> None:
    """Raise SimulationError: nothing keeps the perfectly rough contact c from slipping."""
    if at.laws[c].compliant:
        raise SimulationError(
            f"perfectly rough contact {names[c]} slips on a compliant support at t = {at.t:.9g} s, "
            "which no force stops at once: give it coulomb friction"
        )
    raise SimulationError(
        f"perfectly rough contact {names[c]} would have to pull or to slip at t = {at.t:.9g} s: "
        "give it coulomb friction or make it bilateral"
    )


def refuse_drag(t: float, name: str) -> None:
    """Raise SimulationError: a viscous contact's drag, which does not wait for a push, lifts its
    body off, and without it the body falls back."""
    raise SimulationError(
        f"viscous contact {name} can neither stay closed nor open at t = {t:.9g} s: its "
        "drag, which "
        "does not depend on the normal force, lifts the body; set friction.per_normal or use "
        "regularised friction"
    )


def refuse_to_be_dragged_off(
    system: ContactBodies, law: ContactLaw, t: float, c: int, names: Sequence[str]
) -> None:
    """Raise SimulationError where a contact with a damper, which its drag has just lifted off,
    would push again at once: at the start of the step, apart, its event function falls."""
    touch, unit = system.touch, system.length / system.speed
    apart = law.compliant and touch[c, CLOSED] == 0.0
    if apart and law.drags and touch[c, EVENT_RATES_BEFORE] * unit < -HELD_DOWN:
        refuse_drag(t, names[c])
