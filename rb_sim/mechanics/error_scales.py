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
    inertia, mass = zip(*((body.inertia, body.mass) for body in bodies), strict=True)
    lengths = spin_lengths(np.array(inertia), np.array(mass))
    sizes = np.linalg.eigvalsh(lengths)
    thin = np.flatnonzero(sizes[:, 0] < THIN * sizes[:, 2])
    alike = sizes[thin, 2, None, None] * np.eye(3)
    which = np.append(np.arange(len(mass)), thin)
    return Measures(np.concatenate([lengths, alike]), which)


def measured(v: Numbers, w: Numbers, lengths: Numbers) -> Numbers:
    """(v_C, A w) of bodies, shape (n, N, 6)."""
    return np.concatenate([v, (lengths @ w[..., None])[..., 0]], axis=2)


# Bodies whose motion is small in SI units: scales to which their errors are relative.
#
# An error is limited to tolerance * max(1, |y_i|), which for a body that swings by a nanometre is
# the whole motion. The motion is followed from its start in coarse steps, each compared with two of
# half its length, until all coordinates have turned back or have moved further than a small motion;
# those that have turned back have errors relative to their amplitude. Only the amplitude is needed:
# a tenth is accurate enough. It is not found with commands, and for laws that depend on time. A
# free body on stiff springs may not turn back in the steps that are allowed: it is held to what it
# has moved by then; as it moves on, its distance from the start becomes the scale.
#
# Two bodies drift at 1 m/s while a spring moves them apart by a micrometre: errors relative to
# their positions would leave few digits of that micrometre. If a joint or an effect acts between
# two bodies, the motion is therefore followed as the parent sees it, too,
#
#     R_A^T (p_B - p_A)    and    q_A^-1 q_B,
#
# and if that turns back within a small distance, the errors of both bodies are relative to it,
# however far they move together. Bodies joined in a chain start with small motions and end with
# large ones, as the free end of a falling chain: there either all pairs turn back, or no pair is
# held.


Rate = Callable[[Array], Array]

SMALL = 0.1
"""Amplitude of a body, or of a pair [m, rad] from which on its errors are in SI units."""

SMALL_TOGETHER = 1e-3
"""The same limit for bodies in joints, and for the angles of a body [m, rad]."""

LEAST = 1e-15
"""Amplitude [m, rad] of a motion below which the body counts as at rest."""

RESOLVED = 1e4
"""The same in roundings of the coordinates, of a pair of all coordinates: following the motion
amplifies rounding about a hundred times."""

TRUSTED = 0.1
"""Difference of a step and its two halves, relative to the distance and the speed so far, up to
which the step is accepted; for steps that are much too long one of the two may agree by chance."""

MOST_STEPS = 100
"""Most steps, including rejected ones; coordinates that have not turned back by then do not count
as small."""

SHORTER, LONGER = 0.2, 1.5
"""Factors of the next step after a rejected and after an accepted one."""

TURNED = 0.5
"""Distance from the start, relative to the largest one, below which a group has turned back."""

ROUNDINGS = 4.0 * float(np.finfo(float).eps)
"""Smallest error of a position, relative to the position."""

HALF = 16.0
"""ROUNDINGS of a position in units of its rounding error, half a unit in the last place; a smaller
change may vanish in a sum with other positions."""

NEARBY = 1e-3
"""Fraction of the amplitude over which the curvature of an acceleration is only rounding."""

LOOKS = (0.6, 1.0, 1.5, 2.2)
"""Multiples of that fraction at which the noise is sampled: one sample may be zero by chance."""

INSTANTS = (0.37, 1.7)
"""Instants [s] at which an autonomous law gives the same as at 0."""

Pair = tuple[int, int]
"""(body, parent), by index."""

_LAW = ctypes.CFUNCTYPE(None, ctypes.c_double, *[ctypes.c_void_p] * 3)


class Group(NamedTuple):
    """Coordinates with a common unit, and their speeds, as slices of y or of pairs beside it."""

    places: slice
    speeds: slice
    small: float
    """amplitude from which on errors are in SI units."""
    least: float
    """amplitude of a group at rest."""


class Turn(NamedTuple):
    """Largest distance of a group from its start, and its largest speed."""

    way: float
    speed: float
    turned_back: bool
    """whether it turned back before it moved further than a small motion."""
    time: float
    """when it did, or when the motion was given up [s]."""


Held = dict[int, list[tuple[Group, Turn]]]
"""Groups of each body whose errors are relative to their amplitude."""


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

    def hold(self, y: Array, held: Held, noise: Array) -> None:
        """Make the errors of groups relative to their amplitudes and speeds; noise: of rates."""
        self.bodies.update(held)
        for moved in held.values():
            share = max(
                turn.time * float(np.linalg.norm(noise[g.speeds])) / turn.way for g, turn in moved
            )
            for group, turn in moved:
                places, speeds = group.places, group.speeds
                self.floors[places] = np.minimum(self.floors[places], turn.way)
                self.floors[speeds] = np.minimum(self.floors[speeds], turn.speed)
                self.starts[places] = y[places]
                self.rounding[places] = ROUNDINGS * np.abs(y[places])
                self.rounding[speeds] = share * turn.way

    def hold_others(self, size: float) -> None:
        """Make all errors still in SI units relative to the size of the scene."""
        self.floors[self.floors == 1.0] = size

    def within(self, tolerance: float) -> Array:
        """The floors for this tolerance, not below rounding."""
        if not tolerance > 0.0:
            return np.minimum(1.0, self.floors)
        found = np.minimum(1.0, np.maximum(self.floors, self.rounding / tolerance))
        return np.where(self.absolute > 0.0, self.absolute / tolerance, found)

    def shares(self, tolerance: float) -> Array:
        """Weight of the distance from the start in the error scale; for drifting coordinates only
        rounding."""
        least = min(1.0, ROUNDINGS / tolerance) if tolerance > 0.0 else 1.0
        return np.where(self.drifting, least, 1.0)


def small_motions(system: Any, laws: Any, y: Array, inputs: Array) -> Small | None:
    """Error scales of the bodies with small motions from y on; None if there are none."""
    if not np.isfinite(y).all():
        return None
    rate_at = rate_of(laws, inputs)
    slope = rate_at(0.0, y)
    if not all(np.array_equal(rate_at(t, y), slope) for t in INSTANTS):
        return None

    def rate(y: Array) -> Array:
        return rate_at(0.0, y)

    pairs, joints = pairs_of(system), joints_of(system)
    own = groups_of(system, y, {body for pair in joints for body in pair})
    least = resolved(np.append(y, 1.0))
    relative = []
    for k, pair in enumerate(pairs):
        most = SMALL_TOGETHER if pair in joints else SMALL
        place, turn = whole_body(len(y) + WIDTH * k)
        relative += [Group(*place, most, least), Group(*turn, most, least)]
    turns = iter(turns_of(rate, y, slope, [*sum(own.values(), []), *relative], pairs))
    held: Held = {}
    for body, groups in own.items():
        moved = [(g, turn) for g in groups if (turn := next(turns)).way > g.least]
        # a free body may go farther than it was followed: its distance counts as well
        small = [(g, t) for g, t in moved if t.turned_back or g.small == SMALL and t.way < SMALL]
        if small and (groups[0].small == SMALL or len(small) == len(moved)):
            held[body] = small
    back = {body for body, moved in held.items() if all(turn.turned_back for _, turn in moved)}
    seen = dict(zip(pairs, zip(turns, turns, strict=True), strict=True))
    together = held_to_parents(y, seen, joints, back, least)
    if not (held or together):
        return None
    scales = Small(len(y))
    scales.hold(y, held, noise_of(rate, y, slope, held, apart=True))
    scales.hold(y, together, noise_of(rate, y, slope, together, apart=False))
    for group, _ in sum(together.values(), []):
        scales.drifting[group.places] = scales.drifting[group.speeds] = True
    return scales


def groups_of(system: Any, y: Array, jointed: set[int]) -> dict[int, list[Group]]:
    """The coordinates of each body, as far as they have a common unit."""
    if not isinstance(system, MultiBody):
        n, first = len(y), CONFIGURATION[type(system)]
        places = [slice(0, first)] if first != 7 else [slice(0, 3), slice(3, 7)]
        speeds = [slice(first, n)]
        if n - first == 6:
            speeds = [slice(first, first + 3), slice(first + 3, n)]
        return {
            0: [
                Group(place, speeds[min(i, len(speeds) - 1)], SMALL_TOGETHER, resolved(y[place]))
                for i, place in enumerate(places)
            ]
        }
    groups = {}
    for body in range(system.bodies.shape[0]):
        place, turn = whole_body(WIDTH * body)
        small = SMALL_TOGETHER if body in jointed else SMALL
        groups[body] = [
            Group(*place, small, resolved(y[place[0]])),
            Group(*turn, SMALL_TOGETHER, resolved(y[turn[0]])),
        ]
    return groups


def resolved(coordinates: Array) -> float:
    """Smallest motion of these coordinates that is none of rounding."""
    rounding = float(np.finfo(float).eps) * float(np.abs(coordinates).max())
    return max(LEAST, RESOLVED * rounding)


def whole_body(k: int) -> list[tuple[slice, slice]]:
    """Places and speeds of position and attitude of a body with coordinates from k on."""
    return [
        (slice(k, k + 3), slice(k + 7, k + 10)),
        (slice(k + 3, k + 7), slice(k + 10, k + 13)),
    ]


def joints_of(system: Any) -> set[Pair]:
    """(body, parent) of the joints of a MultiBody; -1: the world."""
    if not isinstance(system, MultiBody):
        return set()
    return {(placed.body, placed.parent) for placed in system.constraints}


def pairs_of(system: Any) -> list[Pair]:
    """(body, parent) of joints and effects between two bodies of a MultiBody."""
    if not isinstance(system, MultiBody):
        return []
    acting = (*system.effects, *system.constraints)
    return sorted({(a.body, a.parent) for a in acting if a.body >= 0 and a.parent >= 0})


# Following the motion.


def turns_of(
    rate: Rate, y: Array, slope: Array, groups: Sequence[Group], pairs: Sequence[Pair]
) -> list[Turn]:
    """Amplitude of each group, of a motion until all that move have turned back or are not small.

    slope: rate at y. Groups select coordinates of y, and beyond them those of the pairs as their
    parents see them.
    """
    bodies, parents = np.array(pairs, dtype=int).reshape(-1, 2).T

    def view(at: Array) -> Array:
        return np.append(at, seen_from_parents(at, bodies, parents)) if pairs else at

    small, least = np.array([(group.small, group.least) for group in groups]).T
    places, velocities = ends([g.places for g in groups]), ends([g.speeds for g in groups])
    ways, speeds, turned = np.zeros((3, len(groups)))
    going = np.ones(len(groups), dtype=bool)
    first = view(y)
    now, time, h = y, 0.0, first_step(y, slope, groups)
    for _ in range(MOST_STEPS if np.isfinite(h) else 0):
        if h == 0.0:  # no step is small enough
            break
        with np.errstate(all="ignore"):  # steps that are much too long may overflow
            halves = step(rate, step(rate, now, 0.5 * h), 0.5 * h)
            seen = view(halves)
            parted = view(step(rate, now, h)) - seen
            away, pace = sizes(seen - first, places), sizes(seen, velocities)
            trusted = sizes(parted, places) <= TRUSTED * np.maximum(np.maximum(ways, away), least)
            least_pace = np.maximum(np.maximum(speeds, pace), least / h)
            trusted &= sizes(parted, velocities) <= TRUSTED * least_pace
        if not trusted[going].all():
            h *= SHORTER
            continue
        now, time, h = halves, time + h, LONGER * h
        ways[going], speeds[going] = np.maximum(ways, away)[going], np.maximum(speeds, pace)[going]
        turned[going & (ways > least) & (ways < small) & (away < TURNED * ways)] = time
        going &= (turned == 0.0) & (ways < small)
        if not (going & (ways > 0.0)).any():
            break
    back = turned > 0.0
    turns = zip(ways, speeds, back, np.where(back, turned, time), strict=True)
    return [Turn(*parts) for parts in turns]


def first_step(y: Array, slope: Array, groups: Sequence[Group]) -> float:
    """Time in which the fastest group of y would move by a small motion on a straight line [s];
    infinite at rest."""
    groups = [group for group in groups if group.speeds.stop <= len(y)]
    small = min(group.small for group in groups)
    velocities = ends([group.speeds for group in groups])
    speed, pull = (float(sizes(at, velocities).max(initial=0.0)) for at in (y, slope))
    steps = [small / speed] if speed > 0.0 else []
    steps += [(small / pull) ** 0.5] if pull > 0.0 else []
    return min(steps, default=np.inf)


def step(rate: Rate, y: Array, h: float) -> Array:
    """One step of the classical Runge-Kutta method for an autonomous law."""
    a = rate(y)
    b = rate(y + 0.5 * h * a)
    c = rate(y + 0.5 * h * b)
    d = rate(y + h * c)
    return y + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)


def ends(parts: Sequence[slice]) -> Indices:
    """Start and stop of each slice, in sequence."""
    return np.array([end for part in parts for end in (part.start, part.stop)], dtype=int)


def sizes(numbers: Array, parts: Indices) -> Array:
    """Euclidean norm of each part of some coordinates; parts: from `ends`."""
    with np.errstate(over="ignore"):
        squares = np.append(numbers * numbers, 0.0)  # a last part may end at the end
    return np.sqrt(np.add.reduceat(squares, parts)[::2])


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
    y: Array, turns: dict[Pair, tuple[Turn, Turn]], joints: set[Pair], but: set[int], least: float
) -> Held:
    """The bodies of pairs that turn back, but those that turn back on their own, and the amplitudes
    to which they are held."""
    held: Held = {}
    apart = {pair: seen for pair, seen in turns.items() if not but & set(pair)}
    for body, parent in that_turn_back(apart, joints, least):
        k, a = WIDTH * body, WIDTH * parent
        distance = float(np.linalg.norm(y[k : k + 3] - y[a : a + 3]))
        sizes = of_pair(*apart[body, parent], least, distance)
        for one in (body, parent):
            groups = [Group(*part, SMALL, least) for part in whole_body(WIDTH * one)]
            held.setdefault(one, []).extend(zip(groups, sizes, strict=True))
    return held


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
        if parent >= 0:
            above[top(body)] = top(parent)
    return {body: top(body) for body in list(above)}


def of_pair(place: Turn, turn: Turn, least: float, apart: float) -> tuple[Turn, Turn]:
    """Amplitudes to which position and attitude of a pair are held.

    An error of attitude displaces the view of the other body in proportion to the distance `apart`
    [m].
    """
    unmoved = Turn(1.0, 1.0, True, 0.0)
    place = place if place.way > least else unmoved
    turn = turn if turn.way > least else unmoved
    if apart * turn.way > place.way:
        turn = Turn(place.way / apart, min(turn.speed, place.speed / apart), True, turn.time)
    return place, turn


def noise_of(rate: Rate, y: Array, slope: Array, held: Held, apart: bool) -> Array:
    """Rounding noise of the rates, (n,); slope: rate at y.

    It is the largest second difference of the rates over a small fraction of the amplitudes, or
    over some roundings of the coordinates; and the change by one rounding of the coordinates, which
    is all that a law without noise shows. apart: every other body is moved the other way, so that
    those that act on each other do not go on together, as the bodies of a pair do.
    """
    moved, rounded = np.zeros(len(y)), y.copy()
    for body, groups in held.items():
        side = -1.0 if apart and body % 2 else 1.0
        for group, turn in groups:
            places = y[group.places]
            moved[group.places] = side * np.maximum(NEARBY * turn.way, ROUNDINGS * np.abs(places))
            rounded[group.places] += side * ROUNDINGS * np.abs(places)
    noise = np.abs(rate(rounded) - slope) / HALF
    for share in LOOKS:
        there, back = rate(y + share * moved), rate(y - share * moved)
        noise = np.maximum(noise, np.abs(there - 2.0 * slope + back))
    return noise


def rate_of(laws: Any, inputs: Array) -> Callable[[float, Array], Array]:
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
