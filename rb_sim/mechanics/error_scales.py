# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Scales of error norms: bodies with small motions in SI units, absolute or relative to others."""

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

# Norm of a body's velocities: |(v_C, A w)| with A = I / (m R), R^2 = largest moment / m.
#
# It is |(p, J / R)| / m of momentum p and angular momentum J; for a sphere it is the speed with the
# same kinetic energy. Each axis is weighted by its effect on the motion. The spin of a thin rod
# about its axis may have most of the energy and hardly turns the rod: with one length for all axes,
# or by energy, it would hide all other errors. This norm does not see errors of the spin about such
# an axis, although they make the attitude wrong: where that matters, a thin body is measured a
# second time with A = R 1 (see `measures_of`).


Numbers = np.ndarray

OF_SYMMETRIC = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])
"""Index of each element of a tensor among (xx, yy, zz, xy, xz, yz)."""


def spin_lengths(inertia: Numbers, mass: Numbers) -> Numbers:
    """A [m] of each body in the velocity norm |(v_C, A w)|, body axes (N, 3, 3).

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
"""Ratio of the smallest to the largest moment of inertia below which a body is thin; for other
bodies the spin about any axis has at least this weight."""


class Measures(NamedTuple):
    """Velocity norms of bodies, M in total: one for each body, two for a thin one."""

    lengths: Numbers
    """A [m], body axes (M, 3, 3)."""
    body: Numbers
    """index of the body, (M,)."""


def measures_of(bodies: Iterable[Any]) -> Measures:
    """Velocity norms of a scene: one by momenta for each body, then one with A = R 1 for each thin
    body."""
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


# Amplitude of coordinates that depend on each other, found by following the motion.
#
# Coordinates in joints cannot be varied one by one. The motion is followed from its start in coarse
# steps, each compared with two of half its length, until every group of coordinates has turned back
# or has moved further than a small motion. Only the amplitude is needed: a tenth is accurate
# enough.


Rate = Callable[[float, Array], Array]

TRUSTED = 0.1
"""Difference of a step and its two halves, relative to the distance and the speed so far, up to
which the step is accepted; for steps that are much too long one of the two may agree by chance."""

MOST_TURNING_STEPS = 200
"""Most steps, including rejected ones; coordinates that have not turned by then do not count as
small."""

SHORTER, LONGER = 0.2, 1.5
"""Factors of the next step after a rejected and after an accepted one."""

LINEAR_CHANGE = 1e-4
"""Change of the fastest coordinate over which the view is about linear."""

TURNED = 0.9
"""Distance from the start, relative to the largest one, below which a group has turned back."""


class Group(NamedTuple):
    """Coordinates with a common unit, and their speeds, as slices of y."""

    places: slice
    speeds: slice


class Turn(NamedTuple):
    """Largest distance of a group from its start, and its largest speed."""

    way: float
    speed: float
    turned_back: bool
    """whether it turned back before it moved further than a small motion."""


def whole_body(k: int) -> list[Group]:
    """Groups of a body with coordinates from k on: position and attitude."""
    return [
        Group(slice(k, k + 3), slice(k + 7, k + 10)),
        Group(slice(k + 3, k + 7), slice(k + 10, k + 13)),
    ]


def itself(y: Array) -> Array:
    """y itself: the view for coordinates that need no projection."""
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
    """Amplitude of each group until all that move have turned back or moved by `small`; duration
    [s].

    small: for all groups or for each. least: amplitude of a group at rest. view: function of y
    whose components the groups select.
    """
    ways, speeds, turned = np.zeros((3, len(groups)))
    places, velocities = ends([g.places for g in groups]), ends([g.speeds for g in groups])
    first = view(y)
    now, time, h = y, 0.0, first_step(first, rate_seen(rate, y, view), groups, np.min(small))
    for _ in range(tries if np.isfinite(h) else 0):
        if h == 0.0:  # no step is small enough
            break
        with np.errstate(all="ignore"):  # steps that are much too long may overflow
            halves, seen, parted = in_halves(rate, now, h, view)
            away, pace = sizes(seen - first, places), sizes(seen, velocities)
            uncertainty, uncertain_pace = sizes(parted, places), sizes(parted, velocities)
        trusted = uncertainty <= TRUSTED * np.maximum(np.maximum(ways, away), least)
        trusted &= uncertain_pace <= TRUSTED * np.maximum(np.maximum(speeds, pace), least / h)
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
    """(y after two steps of half the length, its view, difference of the view after a whole
    step)."""
    halves = step(rate, step(rate, y, 0.5 * h), 0.5 * h)
    seen = view(halves)
    return halves, seen, view(step(rate, y, h)) - seen


def rate_seen(rate: Rate, y: Array, view: Callable[[Array], Array]) -> Array:
    """Approximate rate of the view; only its magnitude is used."""
    slope = rate(0.0, y)
    if view is itself:
        return slope
    size = float(np.abs(slope).max())
    h = LINEAR_CHANGE / size if size > 0.0 else 1.0
    return (view(y + h * slope) - view(y - h * slope)) / (2.0 * h)


def first_step(y: Array, slope: Array, groups: Sequence[Group], small: Any) -> float:
    """Time in which the fastest group would move by `small` on a straight line [s]; infinite at
    rest."""
    velocities = ends([group.speeds for group in groups])
    speed, pull = (float(sizes(at, velocities).max(initial=0.0)) for at in (y, slope))
    small = float(small)
    steps = [small / speed] if speed > 0.0 else []
    steps += [(small / pull) ** 0.5] if pull > 0.0 else []
    return min(steps, default=np.inf)


def step(rate: Rate, y: Array, h: float) -> Array:
    """One step of the classical Runge-Kutta method for an autonomous law."""
    a = rate(0.0, y)
    b = rate(0.0, y + 0.5 * h * a)
    c = rate(0.0, y + 0.5 * h * b)
    d = rate(0.0, y + h * c)
    return y + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)


def ends(parts: Sequence[slice]) -> Indices:
    """Start and stop of each slice, in sequence."""
    return np.array([end for part in parts for end in (part.start, part.stop)], dtype=int)


def sizes(numbers: Array, parts: Indices) -> Array:
    """Euclidean norm of each part of some coordinates; parts: from `ends`."""
    with np.errstate(over="ignore"):
        squares = np.append(numbers * numbers, 0.0)  # a last part may end at the end
    return np.sqrt(np.add.reduceat(squares, parts)[::2])


# Motions of one body relative to another that are small against their common motion.
#
# Two bodies drift at 1 m/s while a spring moves them apart by a micrometre: errors relative to
# their positions would leave few digits of that micrometre. If a joint or an effect acts between
# two bodies, the motion is followed (see `turns_of`) as the parent sees it,
#
#     R_A^T (p_B - p_A)    and    q_A^-1 q_B,
#
# and if that turns back within a small distance, the errors of both bodies are relative to it,
# however far they move together. Bodies joined in a chain start with small motions and end with
# large ones, as the free end of a falling chain: there either all pairs turn back, or no pair is
# held.


RESOLVED = 1e4
"""Relative displacement of a pair, in roundings of the bodies' positions, below which the pair
counts as unmoved: following the motion amplifies rounding about a hundred times."""

MOST_RELATIVE_STEPS = 60
"""Most steps for relative motions."""

Pair = tuple[int, int]
"""(body, parent), by index."""


def pairs_of(system: MultiBody, but: set[int]) -> list[Pair]:
    """(body, parent) of joints and effects between two bodies, neither of which is in `but`."""
    acting = (*system.effects, *system.constraints)
    found = {(a.body, a.parent) for a in acting if a.body >= 0 and a.parent >= 0}
    return sorted(pair for pair in found if not but & set(pair))


def seen_from_parents(y: Array, bodies: Indices, parents: Indices) -> Array:
    """Coordinates of the body of each pair relative to its parent, (13 per pair,)."""
    columns = y.reshape(-1, WIDTH).T
    p, q, v, w = parts_of(columns[:, bodies])
    p_A, q_A, v_A, w_A = parts_of(columns[:, parents])
    way = unrotate(q_A, sub(p, p_A))
    turn = quaternion_product(conjugate(q_A), q)
    speed = sub(unrotate(q_A, sub(v, v_A)), cross(w_A, way))
    return np.stack((*way, *turn, *speed, *sub(w, unrotate(turn, w_A))), axis=1).ravel()


def parts_of(columns: Array) -> tuple[Array, Array, Array, Array]:
    """p, q, v and w of bodies, one body per column."""
    return columns[:3], columns[3:7], columns[7:10], columns[10:]


def held_to_parents(
    rate: Rate, y: Array, system: MultiBody, but: set[int], most: float, joined: float
) -> tuple[dict[int, list[tuple[Group, Turn]]], float]:
    """Groups and amplitudes to which the bodies of pairs that turn back are held, and the longest
    duration [s].

    A pair is held if it turns back within `most` [m, rad], or within `joined` for bodies connected
    by joints.
    """
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
    """Pairs that move and turn back; pairs in joints only if all pairs of the same joined bodies
    do."""
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
    """For each body in a joint, a representative of all bodies connected with it by joints."""
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
    """Amplitudes to which position and attitude of a pair are held.

    An error of attitude displaces the view of the other body in proportion to the distance `apart`
    [m].
    """
    unmoved = Turn(1.0, 1.0, True)
    place = place if place.way > least else unmoved
    turn = turn if turn.way > least else unmoved
    if apart * turn.way > place.way:
        turn = Turn(place.way / apart, min(turn.speed, place.speed / apart), True)
    return place, turn


# Bodies whose motion is small in SI units: scales to which their errors are relative.
#
# An error is limited to tolerance * max(1, |y_i|), which for a body that swings by a nanometre is
# the whole motion. The amplitude of a body follows from the law itself, by moving the body alone:
# it turns back where the work of its acceleration has used up its kinetic energy,
#
#     v0^2 / 2 + integral of a . ds = 0.
#
# This is done for each body that can move straight (free ones, and those on a guide or a plane of
# the world), independently of the others. The amplitude of bodies in joints is found by following
# the motion of all (see `turns_of`). Only without commands and for laws that do not depend on time;
# a body that does not turn back within a small distance keeps SI units.


SMALL = 0.1
"""Amplitude of a body [m] from which on its errors are in SI units."""

SMALL_TOGETHER = 1e-3
"""The same limit for bodies in joints, and for angles [m, rad]."""

ROUNDINGS = 4.0 * float(np.finfo(float).eps)
"""Smallest error of a position, relative to the position."""

HALF = 16.0
"""ROUNDINGS of a position in units of its rounding error, half a unit in the last place; a smaller
change may vanish in a sum with other positions."""

NEARBY = 1e-3
"""Fraction of the amplitude over which the curvature of an acceleration is only rounding."""

LOOKS = (0.6, 1.0, 1.5, 2.2)
"""Multiples of that fraction at which the noise is sampled: one sample may be zero by chance."""

LEAST = 1e-15
"""Amplitude of a body [m] below which it is at rest."""

PER_DECADE = 8
"""Number of positions per decade at which the work is evaluated."""

STRAIGHT = (SlotRow, CurveRow, PlaneRow, ParallelRow, LockRow)
"""Rows of joints to the world that allow straight motion only, if any; along a curve approximately,
for a small motion."""

INSTANTS = (0.37, 1.7)
"""Instants [s] at which an autonomous law gives the same as at 0."""

_LAW = ctypes.CFUNCTYPE(None, ctypes.c_double, *[ctypes.c_void_p] * 3)


class Small:
    """Scales of the error norm: the error of coordinate i is relative to max(floor, |y - start|).

    floors, starts: (n,). rounding: (n,), possible rounding of a coordinate in a step, which does
    not count as an error. drifting: whether a coordinate moves on together with others, so that its
    distance from the start is not a scale.
    """

    def __init__(self, n: int) -> None:
        self.floors, self.starts, self.rounding = np.ones(n), np.zeros(n), np.zeros(n)
        self.drifting = np.zeros(n, dtype=bool)
        self.absolute = np.zeros(n)
        """absolute errors given in the scene; 0 if none is given."""
        self.bodies: set[int] = set()
        """indices of the bodies with errors relative to their motion."""

    def hold(self, y: Array, group: Group, way: float, speed: float) -> None:
        """Make the errors of a group relative to its amplitude `way` and its speed."""
        floors, places, speeds = self.floors, group.places, group.speeds
        floors[places] = np.minimum(floors[places], way)
        self.starts[places] = y[places]
        self.rounding[places] = ROUNDINGS * np.abs(y[places])
        floors[speeds] = np.minimum(floors[speeds], speed)

    def hold_others(self, size: float) -> None:
        """Make all errors still in SI units relative to the size of the scene."""
        self.floors[self.floors == 1.0] = size

    def within(self, tolerance: float) -> Array:
        """The floors for this tolerance, not below rounding."""
        if not tolerance > 0.0:
            return np.minimum(1.0, self.floors)
        found = np.minimum(1.0, np.maximum(self.floors, self.rounding / tolerance))
        return np.where(self.absolute > 0.0, self.absolute / tolerance, found)

    def drift(self, held: Iterable[tuple[Group, Turn]]) -> None:
        """Mark these groups as coordinates that drift together without a limit."""
        for group, _ in held:
            self.drifting[group.places] = self.drifting[group.speeds] = True

    def shares(self, tolerance: float) -> Array:
        """Weight of the distance from the start in the error scale; for drifting coordinates only
        rounding."""
        least = min(1.0, ROUNDINGS / tolerance) if tolerance > 0.0 else 1.0
        return np.where(self.drifting, least, 1.0)


def small_motions(system: Any, laws: Any, y: Array, inputs: Array) -> Small | None:
    """Error scales of the bodies with small motions from y on; None if there are none."""
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
    """Bodies of a MultiBody whose joints allow straight motion."""
    if not isinstance(system, MultiBody):
        return []
    return sorted(set(range(system.bodies.shape[0])) - bent(system))


def bent(system: MultiBody) -> set[int]:
    """Bodies of a MultiBody with joints that do not allow straight motion."""
    return {
        body
        for placed in system.constraints
        if placed.parent >= 0 or not isinstance(placed.row, STRAIGHT)
        for body in (placed.body, placed.parent)
        if body >= 0
    }


def held_bodies(system: Any, n: int) -> dict[int, list[Group]]:
    """Groups of each body whose amplitude is found by following the motion of all."""
    if isinstance(system, MultiBody):
        return {body: whole_body(WIDTH * body) for body in sorted(bent(system))}
    first = CONFIGURATION[type(system)]
    places = [slice(0, first)] if first != 7 else [slice(0, 3), slice(3, 7)]
    speeds = [slice(first, n)] if n - first != 6 else [slice(first, first + 3), slice(first + 3, n)]
    return {0: [Group(p, speeds[min(i, len(speeds) - 1)]) for i, p in enumerate(places)]}


def hold_together(small: Small, rate: Rate, y: Array, bodies: dict[int, list[Group]]) -> None:
    """Hold each body to its motion if both position and attitude turn back within a small
    amplitude."""
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
    """Make the errors of bodies relative to their amplitudes; time: duration of the motion [s]."""
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
    """Rounding noise of the rates, (n,).

    It is the largest second difference of the rates over a small fraction of the amplitudes, or
    over some roundings of the coordinates; and the change by one rounding of the coordinates, which
    is all that a law without noise shows.
    """
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
    """dy/dt as a Python function of (t, y)."""
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
    """Amplitude of each body [m], the larger one along its velocity and its acceleration; at most
    SMALL.

    Bodies between which no effect acts are moved together, so that the cost is linear in their
    number.
    """
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
    """The bodies in groups such that no effect acts between two of one group."""
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
    """Distances at which bodies turn back when moved along their directions, all at once [m].

    places: indices of their positions in y, (n, 3).
    """

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
