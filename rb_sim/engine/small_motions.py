"""Bodies whose motion is small in SI: what their coordinates' errors are to be relative to.

An error is held to tolerance * max(1, |y_i|), which for a body that swings by a nanometre is all of
its motion.  How far a body goes before it turns is found from the law itself, by moving it alone:
it turns where the work of its acceleration has used up its speed,

    v0^2 / 2 + integral of a . ds = 0.

So are bodies of many looked at that no joint keeps from going straight (free ones, and those on a
guide or a plane of the world), each by itself, whatever the others do. What joints hold is found by
following the motion of all (`turning`). Only without commands, and where laws do not depend on the
time; a body that does not turn within what is small is held to SI.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from typing import Any

import numpy as np

from rb_sim.catalogue.constraints.curve_row import CurveRow
from rb_sim.catalogue.constraints.rows import LockRow, ParallelRow, PlaneRow, SlotRow
from rb_sim.engine.relative_motions import held_to_parents
from rb_sim.engine.samples import Array, Indices
from rb_sim.engine.system import CONFIGURATION
from rb_sim.engine.systems.many_bodies import WIDTH, MultiBody
from rb_sim.engine.turning import Group, Rate, Turn, turns_of, whole_body

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
"""Lines of joints to the world along which a body goes straight on, if at all; along a curve nearly
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
        least = self.rounding / tolerance if tolerance > 0.0 else 0.0
        return np.minimum(1.0, np.maximum(self.floors, least))

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
