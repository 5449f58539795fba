"""Motions of one body relative to another that are small against what both do together.

Two bodies that drift at 1 m/s while a spring moves them apart by a micrometre: errors relative to
where they are would leave that micrometre few digits.  Where a joint or an effect acts between two
bodies, the motion of all is followed (`turning`) as the parent sees it,

    R_A^T (p_B - p_A)    and    q_A^-1 q_B,

and where that turns back within what is small, the errors of both bodies are held to it, however
far they go together.  What joints hold together begins by little and ends by much, as the free end
of a chain whose other end falls: there all pairs turn back, or none is held.
"""

from __future__ import annotations

import numpy as np

from rb_sim.engine.samples import Array, Indices
from rb_sim.engine.systems.many_bodies import MASS, WIDTH, MultiBody
from rb_sim.engine.turning import Group, Rate, Turn, turns_of, whole_body
from rb_sim.maths.vectors import conjugate, cross, quaternion_product, sub, unrotate

RESOLVED = 1e4
"""Roundings of where two bodies are, in their way from each other below which they keep their
places: what following the motion makes of rounding is about a hundred."""

MOST = 60
"""Steps tried."""


PARTING = 1e-9
"""Change of a distance [m/s, m/s^2], over the speeds or accelerations of the two bodies, at or
below which they keep it, as numbers of ten digits have it."""

ROUNDED = 64.0 * float(np.finfo(float).eps)
"""What is not told from rounding of an acceleration, as a share of the largest force on one of two
bodies over the mass of the other: joints push a light body by what rounds off on a heavy one. Of a
speed, as a share of the scene's, where joints hold both bodies at rest."""
SCATTERED = 32.0
"""Times what accelerations change by where coordinates are rounded otherwise, below which they are
not told from rounding: of loads that joints take up."""

Pair = tuple[int, int]
"""A body and its parent."""


def pairs_of(system: MultiBody, but: set[int]) -> list[Pair]:
    """(body, parent) of what acts between two bodies, neither of which is in `but`."""
    acting = (*system.effects, *system.constraints)
    found = {(a.body, a.parent) for a in acting if a.body >= 0 and a.parent >= 0}
    return sorted(pair for pair in found if not but & set(pair))


def seen_from_parents(y: Array, bodies: Indices, parents: Indices) -> Array:
    """Of each pair the coordinates of the body as its parent sees it, one pair after the other."""
    columns = y.reshape(-1, WIDTH).T
    p, q, v, w = parts_of(columns[:, bodies])
    p_A, q_A, v_A, w_A = parts_of(columns[:, parents])
    way = unrotate(q_A, sub(p, p_A))
    turn = quaternion_product(conjugate(q_A), q)
    speed = sub(unrotate(q_A, sub(v, v_A)), cross(w_A, way))
    return np.stack((*way, *turn, *speed, *sub(w, unrotate(turn, w_A))), axis=1).ravel()


def parts_of(columns: Array) -> tuple[Array, Array, Array, Array]:
    """p, q, v and w of bodies, side by side."""
    return columns[:3], columns[3:7], columns[7:10], columns[10:]


def parting(rate: Rate, y: Array, system: MultiBody) -> tuple[Pair, ...]:
    """The pairs whose distance d = |p| changes: d' = e . v, d'' = e . a + (v . v - d'^2) / d."""
    pairs = pairs_of(system, set())
    if not pairs or not np.isfinite(y).all():
        return ()
    bodies, parents = np.array(pairs).T
    at, slope = y.reshape(-1, WIDTH), rate(0.0, y).reshape(-1, WIDTH)
    p, v = (at[bodies, k : k + 3] - at[parents, k : k + 3] for k in (0, 7))
    pulls = slope[:, 7:10]
    a = pulls[bodies] - pulls[parents]
    with np.errstate(all="ignore"):
        d = np.linalg.norm(p, axis=1)
        e = p / d[:, None]
        along = (e * v).sum(axis=1)
        across = ((v * v).sum(axis=1) - along**2) / d
        spread = PARTING * sum_of_sizes(at[:, 7:10], bodies, parents)
        gone = np.abs(along) > np.maximum(spread, ROUNDED * system.speed)
        bends = sum_of_sizes(pulls, bodies, parents) + across
        pushes = system.bodies[:, MASS] * np.linalg.norm(pulls, axis=1)
        lighter = np.minimum(system.bodies[bodies, MASS], system.bodies[parents, MASS])
        rounded = ROUNDED * np.maximum(pushes[bodies], pushes[parents]) / lighter
        rounded = np.maximum(rounded, scatter(rate, y, slope)[np.array(pairs)].sum(axis=1))
        bent = np.abs((e * a).sum(axis=1) + across)
        gone |= bent > np.maximum(PARTING * bends, rounded)
    return tuple(pair for pair, moves in zip(pairs, gone, strict=True) if moves)


def scatter(rate: Rate, y: Array, slope: Array) -> Array:
    """What is not told from rounding of the acceleration of each body at y [m/s^2], (bodies,)."""
    found = np.zeros(len(slope))
    for every in (2, 3, 5):
        ways = np.where(np.arange(len(y)) % every, 1.0, -1.0)
        other = rate(0.0, y * (1.0 + 2.0 * np.finfo(float).eps * ways)).reshape(-1, WIDTH)
        found = np.maximum(found, np.linalg.norm((other - slope)[:, 7:10], axis=1))
    return SCATTERED * found


def sum_of_sizes(vectors: Array, bodies: Indices, parents: Indices) -> Array:
    sizes = np.linalg.norm(vectors, axis=1)
    return sizes[bodies] + sizes[parents]


def held_to_parents(
    rate: Rate, y: Array, system: MultiBody, but: set[int], most: float, joined: float
) -> tuple[dict[int, list[tuple[Group, Turn]]], float]:
    """Of each body in a pair that turns back before it has gone as far as `most` [m, rad] what its
    coordinates are to be held to, and the time that the longest takes [s].

    joined: what `most` is where joints hold both together."""
    pairs = pairs_of(system, but)
    if not pairs:
        return {}, 0.0
    bodies, parents = np.array(pairs).T
    starts = range(0, WIDTH * len(pairs), WIDTH)
    groups = [group for k in starts for group in whole_body(k)]
    least = RESOLVED * float(np.finfo(float).eps) * max(1.0, float(np.abs(y).max()))

    def view(at: Array) -> Array:
        return seen_from_parents(at, bodies, parents)

    joints = {(c.body, c.parent) for c in system.constraints if c.parent >= 0}
    small = np.array([joined if pair in joints else most for pair in pairs for _ in range(2)])
    found, time = turns_of(rate, y, groups, small, least, view, MOST)
    held: dict[int, list[tuple[Group, Turn]]] = {}
    turns = dict(zip(pairs, zip(found[::2], found[1::2], strict=True), strict=True))
    for body, parent in that_turn_back(turns, joints, least):
        k, a = WIDTH * body, WIDTH * parent
        apart = float(np.linalg.norm(y[k : k + 3] - y[a : a + 3]))
        sizes = of_pair(*turns[body, parent], least, apart)
        for one in (body, parent):
            held.setdefault(one, []).extend(zip(whole_body(WIDTH * one), sizes, strict=True))
    return held, time


def that_turn_back(
    turns: dict[Pair, tuple[Turn, Turn]], joints: set[Pair], least: float
) -> list[Pair]:
    """The pairs that move and turn back; of those on joints where all turn back that joints hold
    together with them."""
    moved = {pair: [t for t in seen if t.way > least] for pair, seen in turns.items()}
    back = {pair for pair, seen in moved.items() if all(t.turned_back for t in seen)}
    island = held_together(joints)
    loose = {island[pair[0]] for pair in joints & (turns.keys() - back)}
    return [
        pair
        for pair, seen in moved.items()
        if seen and pair in back and not (pair in joints and island[pair[0]] in loose)
    ]


def held_together(joints: set[Pair]) -> dict[int, int]:
    """Of each body on a joint one that stands for all that joints hold together with it."""
    above: dict[int, int] = {}

    def top(body: int) -> int:
        while above.setdefault(body, body) != body:
            above[body] = above[above[body]]
            body = above[body]
        return body

    for body, parent in joints:
        above[top(body)] = top(parent)
    return {body: top(body) for body in list(above)}


def of_pair(place: Turn, turn: Turn, least: float, apart: float) -> tuple[Turn, Turn]:
    """What places and attitudes of a pair are held to: an error of an attitude turns what is seen
    of the other body, as far away as it is [m]."""
    still = Turn(1.0, 1.0, True)
    place = place if place.way > least else still
    turn = turn if turn.way > least else still
    if apart * turn.way > place.way:
        turn = Turn(place.way / apart, min(turn.speed, place.speed / apart), True)
    return place, turn
