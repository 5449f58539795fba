"""Shares of the reactions that a rest does not determine: within every bound, and away from it.

Contacts that hold more than is needed share the load in many ways, x = x0 + Z y, Z the states of
self-stress.  The kernel takes the least x; where that would pull, or rub beyond its bound, though
another would not, it is given the self-stress to keep: that of the largest margin (see
rb_sim.statics.admissible).  As long as there is one with a margin, nothing gives.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rb_sim.contact.events.decompositions import require_finite, singular_values
from rb_sim.contact.events.held import find_held
from rb_sim.contact.events.instant import Instant
from rb_sim.contact.events.left_open import note_shares
from rb_sim.contact.system.bodies import SHARES
from rb_sim.contact.system.terms import STUCK
from rb_sim.contact.system.touch import CLOSED, ROLL, SIDE, SLIDE, SPIN, SPRING
from rb_sim.engine.samples import Array
from rb_sim.maths.rank import JUDGED_BY_CONTACT, split

LEAST_MARGIN = 1e-11
"""Margin, relative to the largest reaction, that is none: here something gives."""


class Reactions(NamedTuple):
    """x = x0 + Z y on the lines that hold, over the unit of force."""

    held: list[int]
    least: Array
    self_stress: Array
    unit: float


def share_load(at: Instant, recent: bool = False) -> bool:
    """Choose the self-stress of the contacts at rest and write it into the system's table.

    recent: take the widest margin even where the least reactions will do.  False if there is none
    to choose, or no reactions within all bounds: then the least ones stand.
    """
    at.system.vectors[SHARES] = 0.0
    reactions = reactions_of(at)
    if reactions is None:
        return False
    from rb_sim.maths.cone_program import moderate, widest

    cones, none = cones_of(at, reactions), np.zeros(reactions.self_stress.shape[1])
    if not recent and cones.admits(none):
        note_shares(at, reactions, cones, none)
        return True
    best = widest(cones).y
    if cones.slack(best).min() < LEAST_MARGIN:
        return False
    y = moderate(cones, best).y
    note_shares(at, reactions, cones, y)
    x = reactions.least + reactions.self_stress @ y
    at.system.vectors[SHARES, reactions.held] = reactions.unit * x
    return True


def reactions_of(at: Instant) -> Reactions | None:
    """All reactions that keep what rests at rest; None if there is just one, or no contact."""
    count = find_held(at.system, at.room)
    if count == at.first[0]:
        return None
    held, room = at.room.used[:count].tolist(), at.room
    A = room.J[held] @ at.inverse_mass @ room.W[held].T
    b = room.J[held] @ room.free_accelerations + room.line_bias[held]
    of = f"the reactions at rest at t = {at.t:.9g} s"
    require_finite(of, A, b)
    u, s, vt = singular_values(A, of)
    found = split(u, s, vt, JUDGED_BY_CONTACT)
    if found.rank == len(held):
        return None
    x = -found.least(b)
    unit = float(np.abs(x).max()) or 1.0
    return Reactions(held, x / unit, found.null, unit)


def cones_of(at: Instant, reactions: Reactions):  # type: ignore[no-untyped-def]
    """The bounds of all contacts that hold, each measured as a normal force, on y."""
    from rb_sim.maths.cones import Cones

    touch, where = at.system.touch, {k: i for i, k in enumerate(reactions.held)}
    x, z, freedom = reactions.least, reactions.self_stress, reactions.self_stress.shape[1]
    linear, round_ = [], []

    def line(k: int) -> tuple[float, Array]:
        return float(x[where[k]]), z[where[k]]

    for c, law in enumerate(at.laws):
        if touch[c, CLOSED] == 0.0:
            continue
        k = at.first[c]
        if law.compliant:
            push = float(touch[c, SPRING]) / reactions.unit, np.zeros(freedom)
        else:
            side = float(touch[c, SIDE]) if law.bilateral else 1.0
            push = side * line(k)[0], side * line(k)[1]
            linear += [] if law.bilateral else [push]
        for mode, bound, tails in (
            (SLIDE, law.static, (k + 1, k + 2)),
            (ROLL, law.rolling_arm, (k + 3, k + 4)),
        ):
            if touch[c, mode] == STUCK and math.isfinite(bound):
                h, g = zip(
                    push, *((v / bound, w / bound) for v, w in map(line, tails)), strict=True
                )
                round_.append((h, g))
        if touch[c, SPIN] == STUCK:
            v, w = line(k + 5)
            for sign in (1.0, -1.0):
                s = sign / law.spinning_arm
                linear.append((push[0] + s * v, push[1] + s * w))
    return Cones(
        np.array([h for h, _ in linear]),
        np.array([g for _, g in linear]).reshape(-1, freedom),
        np.array([h for h, _ in round_]).reshape(-1, 3),
        np.array([g for _, g in round_]).reshape(-1, 3, freedom),
    )
