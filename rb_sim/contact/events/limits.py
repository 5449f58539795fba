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
        normals: Array = at.system.contact_table[here, NORMAL : NORMAL + 3]
        other = np.flatnonzero(normals @ normals[0] < ALIKE)
        if len(other):
            raise SimulationError(
                f"contacts {names[here[0]]} and {names[here[other[0]]]} of one body have different "
                f"normals at t = {at.t:.9g} s (corners on an edge): {TOOL}"
            )


# Laws of friction that have no motion at all in some states: which, and the line that says so.
#
# Perfectly rough closed contacts may not slip.
#
# No force of theirs is bounded, so that a slip ends in an impact at once.  A support that gives way
# knows no impacts, and a contact that would have to pull to keep from slipping has no motion at
# all.


def slipping_rough(at: Instant) -> list[int]:
    """Perfectly rough contacts that are closed and slip, in the modes of the table."""
    table, rough = (
        at.system.contact_table,
        [c for c, law in enumerate(at.laws) if law.static == math.inf],
    )
    return [c for c in rough if table[c, CLOSED] == 1.0 and table[c, SLIDE] == SLIDING]


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
    """Raise SimulationError: a viscous contact's drag, which does not wait for a normal force,
    lifts its body off, and without it the body falls back."""
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
    table, unit = system.contact_table, system.length / system.speed
    apart = law.compliant and table[c, CLOSED] == 0.0
    if apart and law.drags and table[c, EVENT_RATES_BEFORE] * unit < -HELD_DOWN:
        refuse_drag(t, names[c])


# Rims that lie flat: which of their points hold them.
#
# A rim that lies on a plane is held at a few points (see
# rb_sim.catalogue.geometry.corners_and_rims); where it begins to tip, or falls, one of them has to
# be the point that it tips over.


AIMED = 1e-8
"""Angle [rad] between the wanted and the present direction of the first contact point of a flat
rim up to which the point stays where it is."""
BORNE = 1e-6
"""Distance of the centre of pressure of a flat rim from its middle, in radii, below which its
direction is not used."""
SLOW = 1e-7
"""Rate of tilting of a flat rim, in natural units, up to which the centre of pressure decides
where its first contact point is; above, the direction of tilting does."""


class Rim(NamedTuple):
    """What tells one rim on a plane from another."""

    body: int
    plane: tuple
    """its centre and the plane, in their bodies."""
    alone: bool
    """it touches with one point only."""


Rims = dict[int, Rim]
"""By contact, of those that are points of a rim on a plane."""


def rims_of(system: ContactBodies) -> Rims:
    """The contacts that are points of a rim on a plane, by their numbers."""
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
    """Those that touch with the rim flat."""
    if not rims:
        return []
    table = at.system.contact_table
    return [
        c for c in at.touching() if c in rims and np.linalg.norm(table[c, AXIS : AXIS + 3]) < FLAT
    ]


def aim_under_the_load(at: Instant, rims: Rims) -> bool:
    """Let each rim that lies, and hardly turns, have a point beyond the middle of what it bears, or
    would bear if all its points held it; False if it has."""
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
    """Raise SimulationError where a rim that touches with its lowest point alone lies flat.

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
