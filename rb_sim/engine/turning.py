"""How far coordinates that depend on each other go before they turn, by following the motion.

What joints hold cannot be moved alone.  The motion is followed from its start in coarse steps, each
beside two of half its length, until every group of coordinates has turned back or gone further than
is small.  It is looked at for its size only: a tenth is enough.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from rb_sim.engine.samples import Array, Indices

Rate = Callable[[float, Array], Array]

TRUSTED = 0.1
"""Share of the way, and of the speed, by which two halves of a step may part from the whole; of
steps that are much too long one of both may agree by chance."""

MOST = 200
"""Steps tried, refused ones included, after which what has not turned counts as not small."""

SHORTER, LONGER = 0.2, 1.5
"""Factors of the next step after one that is refused, and after one that is taken."""

NEARBY = 1e-4
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
    return y


def turns_of(
    rate: Rate,
    y: Array,
    groups: Sequence[Group],
    small: float | Array,
    least: float,
    view: Callable[[Array], Array] = itself,
    tries: int = MOST,
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
    h = NEARBY / size if size > 0.0 else 1.0
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
