"""Rims that lie flat: which of their points hold them.

A rim that lies on a plane is held at a few points (see
rb_sim.catalogue.geometry.corners_and_rims); where it begins to tip, or falls, one of them has to
be the point that it tips over.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rb_sim.base.errors import SimulationError
from rb_sim.catalogue.geometry.corners_and_rims import FLAT, RimOnPlane
from rb_sim.contact.events.instant import Instant
from rb_sim.contact.events.tasks import ACCELERATE
from rb_sim.mechanics.contact.contact_bodies import LIES_FLAT, ContactBodies
from rb_sim.mechanics.contact.contact_table import (
    AXIS,
    CLOSED,
    LEAN_BEFORE,
    LOW,
    NORMAL,
    NORMAL_FORCE,
    POINT,
    RELATIVE_SPIN,
    SPIN_SIGN,
)
from rb_sim.mechanics.samples import Array
from rb_sim.mechanics.systems.many_bodies import BODY, state_of
from rb_sim.numerics.vectors import unrotate

AIMED = 1e-8
"""Angle [rad] by which the point that it tips over may be missed."""
BORNE = 1e-6
"""Distance of what a rim bears from its middle, in radii, that is none."""
SLOW = 1e-7
"""Turning, in natural units, at which what it bears counts more."""


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
    touch = at.system.touch
    return [
        c for c in at.touching() if c in rims and np.linalg.norm(touch[c, AXIS : AXIS + 3]) < FLAT
    ]


def aim_under_the_load(at: Instant, rims: Rims) -> bool:
    """Let each rim that lies, and hardly turns, have a point beyond the middle of what it bears, or
    would bear if all its points held it; False if it has."""
    if not rims:
        return False
    touch, aims = at.system.touch, {}
    slow = SLOW * at.system.speed / at.system.length
    down = [c for c in lying(at, rims) if np.linalg.norm(falling(at, c)) <= slow]
    modes = touch[:, CLOSED : SPIN_SIGN + 1].copy()
    groups = [[c for c in down if rims[c] == rim] for rim in {rims[c] for c in down}]
    borne = [points for points in groups if touch[points, CLOSED].any()]
    for points in borne:
        first = next(c for c in points if touch[c, CLOSED] == 1.0)
        touch[points, CLOSED : SPIN_SIGN + 1] = touch[first, CLOSED : SPIN_SIGN + 1]
    if not borne:
        return False
    at.call(ACCELERATE, at.t, at.y)
    for points in borne:
        push, off = touch[points, NORMAL_FORCE], touch[points, POINT : POINT + 3]
        off = off - off.mean(axis=0)
        most = float(np.abs(push).sum() * np.abs(off).max())
        middle = push @ off / most if most > 0.0 else np.zeros(3)
        aims |= {c: middle for c in points}
    touch[:, CLOSED : SPIN_SIGN + 1] = modes
    at.refresh()
    return aim(at, aims, BORNE)


def aim_where_it_turns(at: Instant, rims: Rims) -> bool:
    """The same where it turns to; False if it has a point there, or rests."""
    turns = {c: falling(at, c) for c in lying(at, rims)}
    return aim(at, turns, at.still / at.system.length)


def letting_go(at: Instant, rims: Rims) -> frozenset[int]:
    """Points of rims that tip, which keep their first point alone, or the one opposite."""
    if not rims:
        return frozenset()
    closed, going = at.system.touch[:, CLOSED] == 1.0, set()
    down = lying(at, rims)
    for rim in {rims[c] for c in down}:
        points = [c for c in down if rims[c] == rim]
        held = [c for c in points if closed[c]]
        end = next((c for c in (points[0], points[len(points) // 2]) if closed[c]), None)
        if len(held) < len(points) and held not in ([], [end]):
            going |= set(points) - {end}
    return frozenset(going)


def falling(at: Instant, c: int) -> Array:
    """Where the rim of contact c goes down as it turns, by its rate: turn x n."""
    touch = at.system.touch
    return np.cross(touch[c, RELATIVE_SPIN : RELATIVE_SPIN + 3], touch[c, NORMAL : NORMAL + 3])


def aim(at: Instant, towards: dict[int, Array], least: float) -> bool:
    """Let the first point of each rim, or the one opposite, lie in the direction `towards` it."""
    touch, moved = at.system.touch, False
    for c, direction in towards.items():
        size = float(np.linalg.norm(direction))
        if size <= least:
            continue
        q = state_of(at.y, int(at.system.lines[at.first[c], BODY])).q_WB
        low = np.array(unrotate(q, tuple(direction / size)))
        if np.linalg.norm(np.cross(low, touch[c, LOW : LOW + 3])) > AIMED:
            touch[c, LEAN_BEFORE : LEAN_BEFORE + 3], moved = low, True
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
