"""Motions of one body relative to another that are small against what both do together.

Two bodies that drift at 1 m/s while a spring moves them apart by a micrometre: errors relative to
where they are would leave that micrometre few digits.  Where a joint or an effect acts between two
bodies, the motion of all is followed (`turning`) as the parent sees it,

    R_A^T (p_B - p_A)    and    q_A^-1 q_B,

and where that turns back within what is small, the errors of both bodies are held to it, however
far they go together.
"""

from __future__ import annotations

import numpy as np

from rb_sim.engine.samples import Array
from rb_sim.engine.systems.many_bodies import WIDTH, MultiBody, state_of
from rb_sim.engine.turning import Group, Rate, Turn, turns_of, whole_body
from rb_sim.maths.vectors import conjugate, cross, quaternion_product, sub, unrotate

RESOLVED = 1e4
"""Roundings of where two bodies are, in their way from each other below which they keep their
places: what following the motion makes of rounding is about a hundred."""

MOST_PAIRS = 8
"""Pairs above which none is followed: the bodies of a chain move by more, and looking at each
would take longer than the run."""

MOST = 60
"""Steps tried."""


def pairs_of(system: MultiBody, but: set[int]) -> list[tuple[int, int]]:
    """(body, parent) of what acts between two bodies, neither of which is in `but`."""
    acting = (*system.effects, *system.constraints)
    found = {(a.body, a.parent) for a in acting if a.body >= 0 and a.parent >= 0}
    return sorted(pair for pair in found if not but & set(pair))


def seen_from_parents(y: Array, pairs: list[tuple[int, int]]) -> Array:
    """Of each pair the coordinates of the body as its parent sees it."""
    seen, numbers = [], y.tolist()
    for body, parent in pairs:
        p, q, v, w = state_of(numbers, body)
        p_A, q_A, v_A, w_A = state_of(numbers, parent)
        way = unrotate(q_A, sub(p, p_A))
        turn = quaternion_product(conjugate(q_A), q)
        speed = sub(unrotate(q_A, sub(v, v_A)), cross(w_A, way))
        seen += [*way, *turn, *speed, *sub(w, unrotate(turn, w_A))]
    return np.array(seen)


def held_to_parents(
    rate: Rate, y: Array, system: MultiBody, but: set[int], most: float
) -> tuple[dict[int, list[tuple[Group, Turn]]], float]:
    """Of each body in a pair that turns back before it has gone as far as `most` [m, rad] what its
    coordinates are to be held to, and the time that the longest takes [s]."""
    pairs = pairs_of(system, but)
    if not 0 < len(pairs) <= MOST_PAIRS:
        return {}, 0.0
    starts = range(0, WIDTH * len(pairs), WIDTH)
    groups = [group for k in starts for group in whole_body(k)]
    least = RESOLVED * float(np.finfo(float).eps) * max(1.0, float(np.abs(y).max()))

    def view(at: Array) -> Array:
        return seen_from_parents(at, pairs)

    found, time = turns_of(rate, y, groups, most, least, view, MOST)
    held: dict[int, list[tuple[Group, Turn]]] = {}
    for (body, parent), place, turn in zip(pairs, found[::2], found[1::2], strict=True):
        moved = [t for t in (place, turn) if t.way > least]
        if moved and all(t.turned_back for t in moved):
            k, a = WIDTH * body, WIDTH * parent
            apart = float(np.linalg.norm(y[k : k + 3] - y[a : a + 3]))
            sizes = of_pair(place, turn, least, apart)
            for one in (body, parent):
                held.setdefault(one, []).extend(zip(whole_body(WIDTH * one), sizes, strict=True))
    return held, time


def of_pair(place: Turn, turn: Turn, least: float, apart: float) -> tuple[Turn, Turn]:
    """What places and attitudes of a pair are held to: an error of an attitude turns what is seen
    of the other body, as far away as it is [m]."""
    still = Turn(1.0, 1.0, True)
    place = place if place.way > least else still
    turn = turn if turn.way > least else still
    if apart * turn.way > place.way:
        turn = Turn(place.way / apart, min(turn.speed, place.speed / apart), True)
    return place, turn
