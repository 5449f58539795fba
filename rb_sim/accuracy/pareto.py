"""The cheapest setting for each error: Pareto front and decades."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from rb_sim.accuracy.ladder import Accuracy, Rung


def front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Indices of the points (error, cost) that no other point beats in both, by falling error."""
    order = sorted(range(len(points)), key=lambda i: (points[i][1], points[i][0]))
    kept: list[int] = []
    for i in order:
        error, cost = points[i]
        if math.isfinite(error) and math.isfinite(cost):
            if not kept or error < points[kept[-1]][0]:
                kept.append(i)
    return kept


class Decade(NamedTuple):
    """The cheapest way to keep one error."""

    error: float
    best: Rung | None
    """None: nothing reaches it."""
    factors: dict[str, float]
    """cost over the best, by ladder that reaches the error."""


def decades(accuracy: Accuracy, first: int = -1, last: int = -15) -> list[Decade]:
    """For each decade of pose error down to the floor: the cheapest setting, others' factors.

    The last line has no setting: that error is below the floor, or nothing reached it.
    """
    table = []
    for exponent in range(first, last - 1, -1):
        error = 10.0**exponent
        if error < accuracy.reference.floor:
            table.append(Decade(error, None, {}))
            break
        cheapest = {
            ladder.name: rung
            for ladder in accuracy.ladders
            if (rung := cheapest_within(ladder.rungs, error)) is not None
        }
        if not cheapest:
            table.append(Decade(error, None, {}))
            break
        best = min(cheapest.values(), key=lambda rung: rung.cost)
        factors = {name: rung.cost / best.cost for name, rung in cheapest.items()}
        table.append(Decade(error, best, factors))
    return table


def cheapest_within(rungs: Sequence[Rung], error: float) -> Rung | None:
    """The cheapest rung whose pose error keeps `error`."""
    able = [rung for rung in rungs if rung.errors.pose <= error and math.isfinite(rung.cost)]
    return min(able, key=lambda rung: rung.cost, default=None)
