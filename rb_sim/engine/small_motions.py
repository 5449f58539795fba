"""Bodies whose motion is small in SI: what their coordinates' errors are to be relative to.

An error is held to tolerance * max(1, |y_i|), which for a body that swings by a nanometre is all of
its motion.  How far a body goes before it turns is found from the law itself, by moving it alone:
it turns where the work of its acceleration has used up its speed,

    v0^2 / 2 + integral of a . ds = 0.

Only bodies without commands are looked at that no joint keeps from going straight (free ones, and
those on a guide or a plane of the world), and laws that do not depend on the time; a body
that does not turn within SMALL is not small.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np

from rb_sim.catalogue.constraints.rows import CurveRow, LockRow, ParallelRow, PlaneRow, SlotRow
from rb_sim.engine.samples import Array
from rb_sim.engine.systems.many_bodies import WIDTH, MultiBody

SMALL = 0.1
"""Way of a body [m] from which on it is held to SI."""

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

Rate = Callable[[float, Array], Array]


class Small:
    """floors, starts: (n,); the error of coordinate i is relative to max(floor, |y - start|)."""

    def __init__(self, floors: Array, starts: Array) -> None:
        self.floors, self.starts = floors, starts


def small_motions(system: Any, laws: Any, y: Array, inputs: Array) -> Small | None:
    """The bodies of the system that move by little from y on; None where there are none."""
    if not isinstance(system, MultiBody):
        return None
    held = {
        body
        for placed in system.constraints
        if placed.parent >= 0 or not isinstance(placed.row, STRAIGHT)
        for body in (placed.body, placed.parent)
    }
    free = [b for b in range(len(y) // WIDTH) if b not in held]
    if not free or not np.isfinite(y).all():
        return None
    rate = rate_of(laws, inputs)
    first = rate(0.0, y)
    if not all(np.array_equal(rate(t, y), first) for t in INSTANTS):
        return None
    floors, starts = np.ones(len(y)), np.zeros(len(y))
    for body in free:
        way = way_of(rate, y, body)
        if LEAST < way < SMALL:
            k = WIDTH * body
            speed = np.linalg.norm(y[k + 7 : k + 10])
            pull = np.linalg.norm(first[k + 7 : k + 10])
            floors[k : k + 3], starts[k : k + 3] = way, y[k : k + 3]
            floors[k + 7 : k + 10] = min(1.0, max(float(speed), float(pull * way) ** 0.5))
    return Small(floors, starts) if (floors < 1.0).any() else None


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


def way_of(rate: Rate, y: Array, body: int) -> float:
    """The longer of the ways along its speed and along its acceleration [m]; SMALL if no less."""
    k = WIDTH * body
    velocity, acceleration = y[k + 7 : k + 10], rate(0.0, y)[k + 7 : k + 10]
    ways = [0.0]
    for direction in (velocity, acceleration):
        size = float(np.linalg.norm(direction))
        if size > 0.0:
            ways.append(way_along(rate, y, k, direction / size))
    return max(ways)


def way_along(rate: Rate, y: Array, k: int, direction: Array) -> float:
    """How far the body whose coordinates begin at k goes in this direction before it turns [m]."""
    left = 0.5 * float(y[k + 7 : k + 10] @ direction) ** 2
    place, pull = 0.0, float(rate(0.0, y)[k + 7 : k + 10] @ direction)
    steps = round(PER_DECADE * np.log10(SMALL / LEAST))
    for s in np.geomspace(LEAST, SMALL, steps + 1):
        moved = y.copy()
        moved[k : k + 3] += s * direction
        there = float(rate(0.0, moved)[k + 7 : k + 10] @ direction)
        left += 0.5 * (pull + there) * (s - place)
        if not left > 0.0:
            return float(s)
        place, pull = float(s), there
    return SMALL
