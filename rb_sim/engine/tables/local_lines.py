"""The lines between a body and its parent: what the elimination over tables takes of them.

Functions are as in `local`: first a thing, the time, then fields.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rb_sim.catalogue.constraints.rows import BIAS, COUNT, ERROR, HOLONOMIC, RATE, ROW_WIDTH
from rb_sim.catalogue.types import Placed
from rb_sim.engine.systems.many_bodies import arms, fill_all, state_of
from rb_sim.engine.systems.multipliers import coupling, inverse_mass_times
from rb_sim.engine.tables.local import alone
from rb_sim.graph.functions import maximum

BARRED = 1e300
"""Added to that with which a pivot is compared, of a line that gets no multiplier."""


class Rows:
    """The lines of a node, written."""

    def __init__(self, thing: Any, t: Any, states: Any) -> None:
        body, parent, rows, self.hubs, self.barred = thing
        self.sides = 1 if parent is None else 2
        self.system = alone(body, *(() if parent is None else (parent,)))
        counts = [COUNT[type(row)] for row in rows]
        self.first = [sum(counts[:k]) for k in range(len(counts) + 1)]
        self.n = self.first[-1]
        self.system.rows = np.zeros((self.n, ROW_WIDTH), dtype=object)
        self.system.first_row = self.first
        placed = tuple(Placed(row, 0, -1 if parent is None else 1) for row in rows)
        y = [x for state in states for x in state]
        fill_all(placed, t, self.system, y, 0)
        self.states = [state_of(y, side) for side in range(self.sides)]
        self.rows = rows

    def column(self, name: int) -> list[Any]:
        return list(self.system.rows[:, name])

    def gradient(self, side: int) -> list[Any]:
        """G on one body by lines, 6 n numbers."""
        return self.system.rows[:, 6 * side : 6 * side + 6].ravel().tolist()

    def responses(self, side: int) -> list[Any]:
        """M^-1 G^T by lines, 6 n numbers."""
        made = []
        for k in range(self.n):
            force, turn = inverse_mass_times(self.system, side, k, 6 * side)
            made += [*force, *turn]
        return made

    def matrix(self) -> list[Any]:
        """G M^-1 G^T over the bodies that are no hubs, packed."""
        return self._over([side for side in range(self.sides) if not self.hubs[side]])

    def _over(self, sides: list[int]) -> list[Any]:
        made: list[Any] = [0.0] * (self.n * (self.n + 1) // 2)
        for side in sides:
            place = 0
            for i in range(self.n):
                force, turn = inverse_mass_times(self.system, side, i, 6 * side)
                for j in range(i + 1):
                    share = coupling(self.system.rows, j, 6 * side, force, turn)
                    made[place] = made[place] + share
                    place += 1
        return made

    def diagonal(self) -> list[Any]:
        """The diagonal elements with which pivots are compared; lines on hubs alone count as if the
        hubs were free."""
        own = [side for side in range(self.sides) if not self.hubs[side]]
        packed = self._over(own or list(range(self.sides)))
        found = [packed[i * (i + 3) // 2] for i in range(self.n)]
        return [a + b for a, b in zip(found, self.barred, strict=True)] if self.barred else found

    def on(self, velocities: Any) -> list[Any]:
        """G v for v = (linear, angular) of each side; None counts as rest."""
        return [
            sum(
                coupling(self.system.rows, k, 6 * side, v[:3], v[3:])
                for side, v in enumerate(velocities)
                if v is not None
            )
            for k in range(self.n)
        ]

    def blocks(self, right: list[Any]) -> list[Any]:
        """All that the elimination takes: D, right side with the diagonal, G and M^-1 G^T."""
        made = [self.matrix(), [*right, *self.diagonal()]]
        for side in range(self.sides):
            made.append(self.gradient(side))
        for side in range(self.sides):
            if not self.hubs[side]:
                made.append(self.responses(side))
        return made

    def speeds(self) -> list[Any]:
        """(v_C, w) of each side."""
        return [(*state.v_WC, *state.w_WB_B) for state in self.states]


def _sides(thing: Any) -> int:
    return 1 if thing[1] is None else 2


def accelerated(thing: Any, t: Any, *fields: Any) -> list[Any]:
    """Blocks of G du/dt = -bias; fields: states, then accelerations of those that are no hubs."""
    count = _sides(thing)
    rows = Rows(thing, t, fields[:count])
    free = iter(fields[count:])
    pushes = [None if thing[3][side] else next(free) for side in range(count)]
    right = [-(b + s) for b, s in zip(rows.column(BIAS), rows.on(pushes), strict=True)]
    return rows.blocks(right)


def sampled(thing: Any, t: Any, *fields: Any) -> list[Any]:
    """As `accelerated`; then the rates and the worst violation (last field: that so far)."""
    *given, balance, scales = fields
    made = accelerated(thing, t, *given)
    rows = Rows(thing, t, given[: _sides(thing)])
    arm = arms(rows.rows, scales[0])
    slips = zip(rows.on(rows.speeds()), rows.column(RATE), arm, strict=True)
    worst = balance[0]
    for error, holonomic, at in zip(rows.column(ERROR), rows.column(HOLONOMIC), arm, strict=True):
        worst = maximum(worst, abs(error) * holonomic * at / scales[0])
    for moved, rate, at in slips:
        worst = maximum(worst, abs(moved - rate) * at / scales[1])
    return [*made, rows.column(RATE), [worst]]


def displaced(thing: Any, t: Any, *fields: Any) -> list[Any]:
    """Blocks of G dq = -g; then the worst error. Last fields: that so far, the arm of angles."""
    *states, (worst,), (length,) = fields
    rows = Rows(thing, t, states)
    errors = rows.column(ERROR)
    for error, arm in zip(errors, arms(rows.rows, length), strict=True):
        worst = maximum(worst, abs(error) * arm)
    return [*rows.blocks([-error for error in errors]), [worst]]


def slipping(thing: Any, t: Any, *states: Any) -> list[Any]:
    """Blocks of G du = b - G u."""
    rows = Rows(thing, t, states)
    return rows.blocks(slips_of(rows))


def slips_of(rows: Rows) -> list[Any]:
    """b - G u."""
    moved = rows.on(rows.speeds())
    return [rate - s for rate, s in zip(rows.column(RATE), moved, strict=True)]


def slips(thing: Any, t: Any, *states: Any) -> list[Any]:
    """b - G u alone."""
    return [slips_of(Rows(thing, t, states))]


def worst_gap(thing: Any, t: Any, *fields: Any) -> list[Any]:
    """The worst position error. Last fields: that so far, and the arm of angles."""
    *states, (worst,), (length,) = fields
    rows = Rows(thing, t, states)
    errors = zip(rows.column(ERROR), rows.column(HOLONOMIC), arms(rows.rows, length), strict=True)
    for error, holonomic, arm in errors:
        if holonomic != 0.0:
            worst = maximum(worst, abs(error) * arm)
    return [[worst]]
