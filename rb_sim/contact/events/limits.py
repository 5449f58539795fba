# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Limits of event-driven contact: laws without a motion, scenes for time stepping, flat rims."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rb_sim.base.errors import SimulationError
from rb_sim.catalogue.contact import ContactLaw
from rb_sim.catalogue.geometry.corners_and_rims import FLAT, RimOnPlane
from rb_sim.catalogue.geometry.pairs import BallOnSolid
from rb_sim.contact.events.instant import ACCELERATE, Instant
from rb_sim.contact.impacts import HELD_DOWN
from rb_sim.mechanics.contact.contact_bodies import (
    AXIS,
    CLOSED,
    EVENT_RATES_BEFORE,
    LEAN_BEFORE,
    LIES_FLAT,
    LOW,
    NORMAL,
    NORMAL_FORCE,
    POINT,
    RELATIVE_SPIN,
    SLIDE,
    SPIN_SIGN,
    ContactBodies,
)
from rb_sim.mechanics.contact.contact_kinematics import SLIDING
from rb_sim.mechanics.samples import Array
from rb_sim.mechanics.systems.many_bodies import BODY, state_of
from rb_sim.numerics.vectors import unrotate

# Scenes for which event-driven motion is not suited: errors that advise time stepping.


TOOL = "use simulation.method time_stepping for this scene"
ALIKE = 1.0 - 1e-6
"""Cosine between two normals of a pair of bodies above which they are equal."""
STALLED_EVENTS, STALLED_TIME = 2000, 1e-3
"""A run has stalled if it has this number of events within this time (natural units)."""


class Progress:
    """Checks that a run advances between events. unit: the scene's time [s]."""

    def __init__(self, unit: float) -> None:
        self._times: deque[float] = deque(maxlen=STALLED_EVENTS)
        self._shortest = STALLED_TIME * unit

    def add(self, t: float, contact: str) -> None:
        """Add an event at t [s]. Raises SimulationError if the run has stalled."""
        self._times.append(t)
        span = t - self._times[0]
        if len(self._times) == STALLED_EVENTS and span < self._shortest:
            raise SimulationError(
                f"{STALLED_EVENTS} events in the last {span:.2g} s at t = {t:.9g} s (the last of "
                f"contact {contact}): {TOOL}"
            )


Pairs = tuple[tuple[int, ...], ...]
"""For each pair of bodies, the contacts of points of one with the box or cylinder of the other."""


def pairs_of_solids(system: ContactBodies) -> Pairs:
    """The pairs with more than one contact."""
    pairs: dict[tuple[int, int], list[int]] = {}
    for c, one in enumerate(one for group in system.contacts for one in group):
        if isinstance(one.row.pair, BallOnSolid):
            pairs.setdefault((one.body, one.parent), []).append(c)
    return tuple(tuple(pair) for pair in pairs.values() if len(pair) > 1)


def refuse_edges(at: Instant, pairs: Pairs, names: tuple[str, ...]) -> None:
    """Raise SimulationError if two convex bodies touch at points with different normals.

    A plane separates two convex bodies that touch, and its normal is that of all their points.
    Points with other normals lie on an edge of the support, where rounding chooses the face.
    """
    if not pairs:
        return
    touching = set(at.touching())
    for pair in pairs:
        here = [c for c in pair if c in touching]
        if len(here) < 2:
            continue
        normals: Array = at.system.contact_table[here, NORMAL : NORMAL + 3]
        other = np.flatnonzero(normals @ normals[0] < ALIKE)
        if len(other):
            raise SimulationError(
                f"contacts {names[here[0]]} and {names[here[other[0]]]} of one body have different "
                f"normals at t = {at.t:.9g} s (corners on an edge): {TOOL}"
            )


# States in which friction laws allow no motion.
#
# A closed perfectly rough contact cannot slip: its friction is unbounded, and a slip ends at once
# in an impact. A compliant support has no impacts, and a contact that would have to pull to prevent
# a slip allows no motion.


def slipping_rough(at: Instant) -> list[int]:
    """Closed perfectly rough contacts that slip by the modes of the table."""
    table, rough = (
        at.system.contact_table,
        [c for c, law in enumerate(at.laws) if law.static == math.inf],
    )
    return [c for c in rough if table[c, CLOSED] == 1.0 and table[c, SLIDE] == SLIDING]


def refuse_rough(at: Instant, c: int, names: Sequence[str]) -> None:
    """Raise SimulationError: no force prevents the slip of the perfectly rough contact c."""
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
    """Raise SimulationError: the drag of a viscous contact, which is independent of the normal
    force, lifts the body, and without the drag the body falls back."""
    raise SimulationError(
        f"viscous contact {name} can neither stay closed nor open at t = {t:.9g} s: its "
        "drag, which "
        "does not depend on the normal force, lifts the body; set friction.per_normal or use "
        "regularised friction"
    )


def refuse_to_be_dragged_off(
    system: ContactBodies, law: ContactLaw, t: float, c: int, names: Sequence[str]
) -> None:
    """Raise SimulationError if a compliant contact that its drag has just opened would close again
    at once: its event function falls at the start of the step."""
    table, unit = system.contact_table, system.length / system.speed
    apart = law.compliant and table[c, CLOSED] == 0.0
    if apart and law.drags and table[c, EVENT_RATES_BEFORE] * unit < -HELD_DOWN:
        refuse_drag(t, names[c])


# Contact points of flat rims.
#
# A rim that lies on a plane has a few contact points (catalogue/geometry/corners_and_rims). When it
# begins to tip, or falls, one of them must be the point that it tips over.


AIMED = 1e-8
"""Angle [rad] between the wanted and the present direction of the first contact point of a flat
rim up to which the point is not moved."""
BORNE = 1e-6
"""Distance of the centre of pressure of a flat rim from its middle, in radii, below which its
direction is not used."""
SLOW = 1e-7
"""Rate of tilting of a flat rim, in natural units, up to which the centre of pressure decides
where its first contact point is; above, the direction of tilting does."""


class Rim(NamedTuple):
    """Identity of a rim on a plane."""

    body: int
    plane: tuple
    """its centre and the plane, in the axes of their bodies."""
    alone: bool
    """whether it has only one contact point."""


Rims = dict[int, Rim]
"""Contact -> its rim, for contacts that are points of a rim on a plane."""


def rims_of(system: ContactBodies) -> Rims:
    """The contacts that are points of a rim on a plane."""
    placed = [one for group in system.contacts for one in group]
    return {
        c: Rim(
            one.body,
            (one.parent, one.row.pair.centre_C, one.row.pair[6:]),
            one.row.pair.alone == 1.0,
        )
        for c, one in enumerate(placed)
        if isinstance(one.row.pair, RimOnPlane)
    }


def lying(at: Instant, rims: Rims) -> list[int]:
    """Contacts that touch and whose rim lies flat."""
    if not rims:
        return []
    table = at.system.contact_table
    return [
        c for c in at.touching() if c in rims and np.linalg.norm(table[c, AXIS : AXIS + 3]) < FLAT
    ]


def aim_under_the_load(at: Instant, rims: Rims) -> bool:
    """Move the first contact point of each flat rim at rest towards its centre of pressure, with
    all its points closed; returns whether any was moved."""
    if not rims:
        return False
    table, aims = at.system.contact_table, {}
    slow = SLOW * at.system.speed / at.system.length
    down = [c for c in lying(at, rims) if np.linalg.norm(falling(at, c)) <= slow]
    modes = table[:, CLOSED : SPIN_SIGN + 1].copy()
    groups = [[c for c in down if rims[c] == rim] for rim in {rims[c] for c in down}]
    borne = [points for points in groups if table[points, CLOSED].any()]
    for points in borne:
        first = next(c for c in points if table[c, CLOSED] == 1.0)
        table[points, CLOSED : SPIN_SIGN + 1] = table[first, CLOSED : SPIN_SIGN + 1]
    if not borne:
        return False
    at.call(ACCELERATE, at.t, at.y)
    for points in borne:
        normal_force, off = table[points, NORMAL_FORCE], table[points, POINT : POINT + 3]
        off = off - off.mean(axis=0)
        most = float(np.abs(normal_force).sum() * np.abs(off).max())
        middle = normal_force @ off / most if most > 0.0 else np.zeros(3)
        aims |= {c: middle for c in points}
    table[:, CLOSED : SPIN_SIGN + 1] = modes
    at.refresh()
    return aim(at, aims, BORNE)


def aim_where_it_turns(at: Instant, rims: Rims) -> bool:
    """The same where it turns to; False if it has a point there, or rests."""
    turns = {c: falling(at, c) for c in lying(at, rims)}
    return aim(at, turns, at.velocity_tolerance / at.system.length)


def falling(at: Instant, c: int) -> Array:
    """Where the rim of contact c goes down as it turns, by its rate: turn x n."""
    table = at.system.contact_table
    return np.cross(table[c, RELATIVE_SPIN : RELATIVE_SPIN + 3], table[c, NORMAL : NORMAL + 3])


def aim(at: Instant, towards: dict[int, Array], least: float) -> bool:
    """Let the first point of each rim, or the one opposite, lie in the direction `towards` it."""
    table, moved = at.system.contact_table, False
    for c, direction in towards.items():
        size = float(np.linalg.norm(direction))
        if size <= least:
            continue
        q = state_of(at.y, int(at.system.row_table[at.first[c], BODY])).q_WB
        low = np.array(unrotate(q, tuple(direction / size)))
        if np.linalg.norm(np.cross(low, table[c, LOW : LOW + 3])) > AIMED:
            table[c, LEAN_BEFORE : LEAN_BEFORE + 3], moved = low, True
    if moved:
        at.refresh()
    return moved


def refuse_to_lie(
    at: Instant, rims: Rims, names: Sequence[str], code: tuple[int, int] | None
) -> None:
    """Raise SimulationError if a rim with only one contact point lies flat.

    code: (contact, kind) of the event that led here.
    """
    flat = [c for c in lying(at, rims) if rims[c].alone]
    if code is not None and code[1] == LIES_FLAT and code[0] in rims:
        flat = [code[0]]
    if flat:
        name = names[flat[0]]
        raise SimulationError(
            f"the rim of contact {name} lies flat at t = {at.t:.9g} s, which one contact point "
            f"cannot represent: set constraints.{name}.lies_flat to true"
        )
