# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Scales of error norms: bodies whose motion is small in SI units, or relative to others."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from rb_sim.catalogue.constraints.rows import CurveRow, LockRow, ParallelRow, PlaneRow, SlotRow
from rb_sim.mechanics.samples import Array, Indices
from rb_sim.mechanics.system import CONFIGURATION
from rb_sim.mechanics.systems.many_bodies import WIDTH, MultiBody
from rb_sim.numerics.vectors import conjugate, cross, quaternion_product, sub, unrotate

# One measure of a body's velocities: |(v_C, A w)| with A = I / (m R), R^2 = largest moment / m.
#
# It is |(p, J / R)| / m of momentum p and angular momentum J: of a sphere the speed that has the
# kinetic energy.  Each axis counts by what it does to the motion.  The spin of a thin rod about its
# axis may have most of the energy, and hardly turns the rod: with one length for all axes, or by
# energy, it would hide what happens to all else.
#
# That measure does not see what is wrong of the spin about such an axis, though the attitude is
# wrong by it: where that matters, a thin body is measured once more with A = R 1 (see
# `measures_of`).


Numbers = np.ndarray

OF_SYMMETRIC = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])
"""Where the elements of a tensor are among (xx, yy, zz, xy, xz, yz)."""


def spin_lengths(inertia: Numbers, mass: Numbers) -> Numbers:
    """A [m] of each body, body axes (N, 3, 3).

    inertia: about C, body axes (N, 3, 3); mass: (N,).
    """
    largest = np.linalg.norm(inertia, 2, axis=(1, 2))
    return inertia / np.sqrt(largest * mass)[:, None, None]


def lengths_of(bodies: Iterable[Any]) -> Numbers:
    """A [m] of the bodies of a scene, body axes (N, 3, 3)."""
    bodies = list(bodies)
    inertia = np.array([body.inertia for body in bodies])
    return spin_lengths(inertia, np.array([body.mass for body in bodies]))


THIN = 0.3
"""Smallest moment of inertia over the largest below which a body is thin: of another one the spin
about any axis counts by this share at least."""


class Measures(NamedTuple):
    """How the velocities of bodies are measured, M times in all: each once, thin ones twice."""

    lengths: Numbers
    """A [m], body axes (M, 3, 3)."""
    body: Numbers
    """index of the body, (M,)."""


def measures_of(bodies: Iterable[Any]) -> Measures:
    """The measures of the bodies of a scene: first that of each body by its momenta, then that of
    each thin one by R, which counts its spin about all axes alike."""
    lengths = lengths_of(bodies := list(bodies))
    sizes = np.linalg.eigvalsh(lengths)
    thin = np.flatnonzero(sizes[:, 0] < THIN * sizes[:, 2])
    alike = sizes[thin, 2, None, None] * np.eye(3)
    which = np.append(np.arange(len(bodies)), thin)
    return Measures(np.concatenate([lengths, alike]), which)


def by_lengths(lengths: Numbers, vectors: Numbers) -> Numbers:
    """A times vectors in body axes, shape (n, N, 3)."""
    return (lengths @ vectors[..., None])[..., 0]


def measured(v: Numbers, w: Numbers, lengths: Numbers) -> Numbers:
    """(v_C, A w) of bodies, shape (n, N, 6)."""
    return np.concatenate([v, by_lengths(lengths, w)], axis=2)


# How far coordinates that depend on each other go before they turn, by following the motion.
#
# What joints hold cannot be moved alone.  The motion is followed from its start in coarse steps,
# each beside two of half its length, until every group of coordinates has turned back or gone
# further than is small.  It is looked at for its size only: a tenth is enough.


Rate = Callable[[float, Array], Array]

TRUSTED = 0.1
"""Share of the way, and of the speed, by which two halves of a step may part from the whole; of
steps that are much too long one of both may agree by chance."""

MOST_TURNING_STEPS = 200
"""Steps tried, refused ones included, after which what has not turned counts as not small."""

SHORTER, LONGER = 0.2, 1.5
"""Factors of the next step after one that is refused, and after one that is taken."""

LINEAR_CHANGE = 1e-4
"""Change of the quickest coordinate over which what is seen is about linear."""

TURNED = 0.9
"""Share of its longest way from the start below which a group has turned back."""


class Group(NamedTuple):
    """Coordinates of one unit, and their speeds: where they begin and end in y."""

    places: slice
    speeds: slice


class Turn(NamedTuple):
    """The longest way of a group from its start, and its largest speed on it."""

    way: float
    speed: float
    turned_back: bool
    """whether it came back before it went as far as what is small."""


def whole_body(k: int) -> list[Group]:
    """The groups of a body whose coordinates begin at k: place and attitude."""
    return [
        Group(slice(k, k + 3), slice(k + 7, k + 10)),
        Group(slice(k + 3, k + 7), slice(k + 10, k + 13)),
    ]


def itself(y: Array) -> Array:
    """y itself: coordinates that need no projection."""
    return y


def turns_of(
    rate: Rate,
    y: Array,
    groups: Sequence[Group],
    small: float | Array,
    least: float,
    view: Callable[[Array], Array] = itself,
    tries: int = MOST_TURNING_STEPS,
) -> tuple[list[Turn], float]:
    """How far each group goes until all that move have turned, or gone as far as `small`; and the
    time that takes [s].

    small: of all or of each. least: of a group at rest. view: of y, what groups are coordinates of.
    """
    ways, speeds, turned = np.zeros((3, len(groups)))
    places, velocities = ends([g.places for g in groups]), ends([g.speeds for g in groups])
    first = view(y)
    now, time, h = y, 0.0, first_step(first, rate_seen(rate, y, view), groups, np.min(small))
    for _ in range(tries if np.isfinite(h) else 0):
        if h == 0.0:  # no step is small enough
            break
        with np.errstate(all="ignore"):  # steps that are much too long end nowhere
            halves, seen, parted = in_halves(rate, now, h, view)
            away, pace = sizes(seen - first, places), sizes(seen, velocities)
            doubt, doubted_pace = sizes(parted, places), sizes(parted, velocities)
        trusted = doubt <= TRUSTED * np.maximum(np.maximum(ways, away), least)
        trusted &= doubted_pace <= TRUSTED * np.maximum(np.maximum(speeds, pace), least / h)
        if not trusted.all():
            h *= SHORTER
            continue
        now, time, h = halves, time + h, LONGER * h
        ways, speeds = np.maximum(ways, away), np.maximum(speeds, pace)
        moving = (ways < small) & (ways > least)
        turned[moving & (away < TURNED * ways)] = 1.0
        if not (moving & (turned == 0.0)).any():
            break
    turns = zip(ways, speeds, (turned > 0.0) & (ways < small), strict=True)
    return [Turn(*parts) for parts in turns], time


def in_halves(
    rate: Rate, y: Array, h: float, view: Callable[[Array], Array]
) -> tuple[Array, Array, Array]:
    """y after two steps of half the length, what is seen of it, and what a whole step parts that
    by."""
    halves = step(rate, step(rate, y, 0.5 * h), 0.5 * h)
    seen = view(halves)
    return halves, seen, view(step(rate, y, h)) - seen


def rate_seen(rate: Rate, y: Array, view: Callable[[Array], Array]) -> Array:
    """About the rate of what is seen: its size is enough."""
    slope = rate(0.0, y)
    if view is itself:
        return slope
    size = float(np.abs(slope).max())
    h = LINEAR_CHANGE / size if size > 0.0 else 1.0
    return (view(y + h * slope) - view(y - h * slope)) / (2.0 * h)


def first_step(y: Array, slope: Array, groups: Sequence[Group], small: Any) -> float:
    """In which the quickest group would go straight as far as `small` [s]; infinite at rest."""
    velocities = ends([group.speeds for group in groups])
    speed, pull = (float(sizes(at, velocities).max(initial=0.0)) for at in (y, slope))
    small = float(small)
    steps = [small / speed] if speed > 0.0 else []
    steps += [(small / pull) ** 0.5] if pull > 0.0 else []
    return min(steps, default=np.inf)


def step(rate: Rate, y: Array, h: float) -> Array:
    """A step of the classical Runge-Kutta method, of a law that does not depend on the time."""
    a = rate(0.0, y)
    b = rate(0.0, y + 0.5 * h * a)
    c = rate(0.0, y + 0.5 * h * b)
    d = rate(0.0, y + h * c)
    return y + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)


def ends(parts: Sequence[slice]) -> Indices:
    """First and end of each part, one after the other."""
    return np.array([end for part in parts for end in (part.start, part.stop)], dtype=int)


def sizes(numbers: Array, parts: Indices) -> Array:
    """The Euclidean size of each part of some coordinates, whose `ends` are given."""
    with np.errstate(over="ignore"):
        squares = np.append(numbers * numbers, 0.0)  # a last part may end where they do
    return np.sqrt(np.add.reduceat(squares, parts)[::2])


# Motions of one body relative to another that are small against what both do together.
#
# Two bodies that drift at 1 m/s while a spring moves them apart by a micrometre: errors relative to
# where they are would leave that micrometre few digits.  Where a joint or an effect acts between
# two bodies, the motion of all is followed (`turning`) as the parent sees it,
#
#     R_A^T (p_B - p_A)    and    q_A^-1 q_B,
#
# and where that turns back within what is small, the errors of both bodies are held to it, however
# far they go together.  What joints hold together begins by little and ends by much, as the free
# end of a chain whose other end falls: there all pairs turn back, or none is held.


RESOLVED = 1e4
"""Roundings of where two bodies are, in their way from each other below which they keep their
places: what following the motion makes of rounding is about a hundred."""

MOST_RELATIVE_STEPS = 60
"""Steps tried."""

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
    found, time = turns_of(rate, y, groups, small, least, view, MOST_RELATIVE_STEPS)
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
    unmoved = Turn(1.0, 1.0, True)
    place = place if place.way > least else unmoved
    turn = turn if turn.way > least else unmoved
    if apart * turn.way > place.way:
        turn = Turn(place.way / apart, min(turn.speed, place.speed / apart), True)
    return place, turn


# Bodies whose motion is small in SI: what their coordinates' errors are to be relative to.
#
# An error is held to tolerance * max(1, |y_i|), which for a body that swings by a nanometre is all
# of its motion.  How far a body goes before it turns is found from the law itself, by moving it
# alone: it turns where the work of its acceleration has used up its speed,
#
#     v0^2 / 2 + integral of a . ds = 0.
#
# So are bodies of many looked at that no joint keeps from going straight (free ones, and those on a
# guide or a plane of the world), each by itself, whatever the others do. What joints hold is found
# by following the motion of all (`turning`). Only without commands, and where laws do not depend on
# the time; a body that does not turn within what is small is held to SI.


SMALL = 0.1
"""Way of a body [m] from which on it is held to SI."""

SMALL_TOGETHER = 1e-3
"""The same of what joints hold, and of angles [m, rad]."""

ROUNDINGS = 4.0 * float(np.finfo(float).eps)
"""Share of where a body is that is the least of its errors."""

HALF = 16.0
"""ROUNDINGS of a place in what is rounded away at most, half a unit in its last place; over fewer
than that a sum with other places may round to what it was."""

NEARBY = 1e-3
"""Share of the way over which an acceleration has no bend but its rounding."""

LOOKS = (0.6, 1.0, 1.5, 2.2)
"""Of the share: one rounding may be none by chance."""

LEAST = 1e-15
"""Way of a body [m] below which it is at rest."""

PER_DECADE = 8
"""Places at which the work is looked at."""

STRAIGHT = (SlotRow, CurveRow, PlaneRow, ParallelRow, LockRow)
"""Rows of joints to the world along which a body goes straight on, if at all; along a curve nearly
so, as far as a small motion goes."""

INSTANTS = (0.37, 1.7)
"""[s] at which an autonomous law gives what it gives at 0."""

_LAW = ctypes.CFUNCTYPE(None, ctypes.c_double, *[ctypes.c_void_p] * 3)


class Small:
    """floors, starts: (n,); the error of coordinate i is relative to max(floor, |y - start|).

    rounding: (n,), what rounding may make of a coordinate in a step, which is no error of it.
    drifting: whether a coordinate goes on with others, so that its way from there says nothing.
    """

    def __init__(self, n: int) -> None:
        self.floors, self.starts, self.rounding = np.ones(n), np.zeros(n), np.zeros(n)
        self.drifting = np.zeros(n, dtype=bool)
        self.absolute = np.zeros(n)
        """errors that the scene allows, where it says so."""
        self.bodies: set[int] = set()
        """held to their motion."""

    def hold(self, y: Array, group: Group, way: float, speed: float) -> None:
        """Make the errors of a group relative to its way from y and its speed."""
        floors, places, speeds = self.floors, group.places, group.speeds
        floors[places] = np.minimum(floors[places], way)
        self.starts[places] = y[places]
        self.rounding[places] = ROUNDINGS * np.abs(y[places])
        floors[speeds] = np.minimum(floors[speeds], speed)

    def hold_others(self, size: float) -> None:
        """Make the errors of what is held to SI relative to the size that the scene has."""
        self.floors[self.floors == 1.0] = size

    def within(self, tolerance: float) -> Array:
        """The floors with which this tolerance asks for no less than rounding leaves."""
        if not tolerance > 0.0:
            return np.minimum(1.0, self.floors)
        found = np.minimum(1.0, np.maximum(self.floors, self.rounding / tolerance))
        return np.where(self.absolute > 0.0, self.absolute / tolerance, found)

    def drift(self, held: Iterable[tuple[Group, Turn]]) -> None:
        """Take what is held for coordinates that go on together, as far as they like."""
        for group, _ in held:
            self.drifting[group.places] = self.drifting[group.speeds] = True

    def shares(self, tolerance: float) -> Array:
        """Share of its way from the start to which the error of a coordinate is relative: for what
        drifts as much as rounds off."""
        least = min(1.0, ROUNDINGS / tolerance) if tolerance > 0.0 else 1.0
        return np.where(self.drifting, least, 1.0)


def small_motions(system: Any, laws: Any, y: Array, inputs: Array) -> Small | None:
    """The bodies of the system that move by little from y on; None where there are none."""
    if not np.isfinite(y).all():
        return None
    rate = rate_of(laws, inputs)
    first = rate(0.0, y)
    if not all(np.array_equal(rate(t, y), first) for t in INSTANTS):
        return None
    small = Small(len(y))
    alone = straight(system)
    for body, way in zip(alone, ways_of(rate, y, system, alone), strict=True):
        if LEAST < way < SMALL:
            place = whole_body(WIDTH * body)[0]
            speed, pull = (float(np.linalg.norm(at[place.speeds])) for at in (y, first))
            pace = max(speed, (pull * way) ** 0.5)
            hold_all(small, rate, y, {body: [(place, Turn(way, pace, True))]}, way / pace)
    hold_together(small, rate, y, held_bodies(system, len(y)))
    if isinstance(system, MultiBody):
        pairs, time = held_to_parents(rate, y, system, small.bodies, SMALL, SMALL_TOGETHER)
        hold_all(small, rate, y, pairs, time)
        small.drift(moved for held in pairs.values() for moved in held)
    return small if small.bodies else None


def straight(system: Any) -> list[int]:
    """The bodies of many that no joint keeps from going straight."""
    if not isinstance(system, MultiBody):
        return []
    return sorted(set(range(system.bodies.shape[0])) - bent(system))


def bent(system: MultiBody) -> set[int]:
    """The bodies of many that joints hold otherwise."""
    return {
        body
        for placed in system.constraints
        if placed.parent >= 0 or not isinstance(placed.row, STRAIGHT)
        for body in (placed.body, placed.parent)
        if body >= 0
    }


def held_bodies(system: Any, n: int) -> dict[int, list[Group]]:
    """Of each body that is looked at in the motion of all: where its coordinates are."""
    if isinstance(system, MultiBody):
        return {body: whole_body(WIDTH * body) for body in sorted(bent(system))}
    first = CONFIGURATION[type(system)]
    places = [slice(0, first)] if first != 7 else [slice(0, 3), slice(3, 7)]
    speeds = [slice(first, n)] if n - first != 6 else [slice(first, first + 3), slice(first + 3, n)]
    return {0: [Group(p, speeds[min(i, len(speeds) - 1)]) for i, p in enumerate(places)]}


def hold_together(small: Small, rate: Rate, y: Array, bodies: dict[int, list[Group]]) -> None:
    """Hold the bodies to their motion that turn within little, place and attitude both."""
    groups = [group for body in bodies.values() for group in body]
    found, time = turns_of(rate, y, groups, SMALL_TOGETHER, LEAST)
    ahead, held = iter(found), {}
    for name, body in bodies.items():
        moved = [(group, turn) for group in body if (turn := next(ahead)).way > LEAST]
        if moved and all(turn.turned_back for _, turn in moved):
            held[name] = moved
    hold_all(small, rate, y, held, time)


def hold_all(
    small: Small, rate: Rate, y: Array, held: dict[int, list[tuple[Group, Turn]]], time: float
) -> None:
    """Hold bodies to what their coordinates go, on the way for so long [s]."""
    if not held:
        return
    small.bodies.update(held)
    noise = time * noise_of(rate, y, [pair for moved in held.values() for pair in moved])
    for moved in held.values():
        share = max(float(np.linalg.norm(noise[g.speeds])) / turn.way for g, turn in moved)
        for group, turn in moved:
            small.hold(y, group, turn.way, turn.speed)
            small.rounding[group.speeds] = share * turn.way


def noise_of(rate: Rate, y: Array, held: list[tuple[Group, Turn]]) -> Array:
    """What rounding makes of the rates: all that is bent in them over a small part of the ways, or
    over some roundings of where the coordinates are; and what a rounding of those changes, which is
    all that a law without noise of its own shows."""
    moved, rounded = np.zeros(len(y)), y.copy()
    for group, turn in held:
        places = y[group.places]
        moved[group.places] = np.maximum(NEARBY * turn.way, ROUNDINGS * np.abs(places))
        rounded[group.places] += ROUNDINGS * np.abs(places)
    noise = np.abs(rate(0.0, rounded) - rate(0.0, y)) / HALF
    for share in LOOKS:
        there, back = rate(0.0, y + share * moved), rate(0.0, y - share * moved)
        noise = np.maximum(noise, np.abs(there - 2.0 * rate(0.0, y) + back))
    return noise


def rate_of(laws: Any, inputs: Array) -> Rate:
    """dy/dt as a function of Python."""
    law = laws.rate
    plain = law if callable(law) else None
    compiled = None if plain else _LAW(law.address)

    def rate(t: float, y: Array) -> Array:
        out = np.zeros(len(y))
        if plain is not None:
            plain(t, y, inputs, out)
        else:
            assert compiled is not None
            compiled(t, y.ctypes.data, inputs.ctypes.data, out.ctypes.data)
        return out

    return rate


def ways_of(rate: Rate, y: Array, system: Any, bodies: list[int]) -> list[float]:
    """Of each body the longer of the ways along its speed and along its acceleration [m]; SMALL if
    no less. Bodies between which nothing acts are moved at once, so that what this costs grows as
    the scene, not as its square."""
    ways = dict.fromkeys(bodies, 0.0)
    for apart in that_do_not_act(system, bodies):
        places = np.array([np.arange(WIDTH * body, WIDTH * body + 3) for body in apart])
        for along in (y[places + 7], rate(0.0, y)[places + 7]):
            sizes = np.linalg.norm(along, axis=1)
            if (sizes > 0.0).any():
                directions = along / np.where(sizes > 0.0, sizes, 1.0)[:, None]
                found = np.where(sizes > 0.0, ways_along(rate, y, places, directions), 0.0)
                ways |= {b: max(ways[b], float(way)) for b, way in zip(apart, found, strict=True)}
    return list(ways.values())


def that_do_not_act(system: Any, bodies: list[int]) -> list[list[int]]:
    """The bodies in groups in which no effect acts between two."""
    acting = [{e.body, e.parent} for e in system.effects] if bodies else []
    beside: dict[int, set[int]] = {body: set() for body in bodies}
    for pair in acting:
        for body in pair & beside.keys():
            beside[body] |= pair
    groups: dict[int, int] = {}
    for body in bodies:
        taken = {groups[other] for other in beside[body] if other in groups}
        groups[body] = next(g for g in range(len(taken) + 1) if g not in taken)
    return [[body for body in bodies if groups[body] == g] for g in sorted(set(groups.values()))]


def ways_along(rate: Rate, y: Array, places: Indices, directions: Array) -> Array:
    """How far bodies go in their directions before they turn, moved all at once [m]. places: of
    their positions in y, (n, 3)."""

    def pulls(at: Array) -> Array:
        return (rate(0.0, at)[places + 7] * directions).sum(axis=1)

    left = 0.5 * (y[places + 7] * directions).sum(axis=1) ** 2
    place, pull = 0.0, pulls(y)
    ways, steps = np.full(len(places), SMALL), round(PER_DECADE * np.log10(SMALL / LEAST))
    going = np.ones(len(places), dtype=bool)
    for s in np.geomspace(LEAST, SMALL, steps + 1):
        moved = y.copy()
        moved[places] += s * directions
        there = pulls(moved)
        left += 0.5 * (pull + there) * (s - place)
        turned = going & ~(left > 0.0)
        ways[turned] = s
        going &= ~turned
        if not going.any():
            break
        place, pull = float(s), there
    return ways
