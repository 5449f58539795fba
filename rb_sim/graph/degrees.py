"""Which operations of dy/dt = f(t, y) are polynomials in time along any motion, of what degree.

A coordinate whose rate has degree d has degree d + 1: what turns at a constant rate of its spin,
falls, or follows a guide is known before the motion is.  All else has degree infinity.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Any

from rb_sim.graph.symbols import Symbol

PASSES = 3
"""Times that the coordinates' degrees are found anew from their rates': of constant, linear and
quadratic rates.  A sum of more terms gains little by ending early."""


def degrees(
    outputs: Sequence[Any], nodes: Iterable[Symbol], moving: Collection[int]
) -> Callable[[Symbol], float]:
    """The degree of each of `nodes`, the operations in the order of their values.

    outputs: dy/dt. moving: the numbers of the operations that depend on t or y.
    """
    of_y: list[float] = [math.inf] * len(outputs)
    found: dict[int, float] = {}

    def degree(x: Any) -> float:
        return found[x.number] if isinstance(x, Symbol) and x.number in moving else 0

    ordered = [x for x in nodes if x.number in moving]
    for _ in range(PASSES):
        for x in ordered:
            found[x.number] = _degree(x, of_y, degree)
        before, of_y = of_y, [1 + degree(output) for output in outputs]
        if of_y == before:
            break
    return degree


def _degree(x: Symbol, of_y: Sequence[float], degree: Callable[[Any], float]) -> float:
    """The degree of an operation from those of its operands."""
    if x.op == "t":
        return 1
    if x.op == "y":
        return of_y[x.operands[0]]
    if x.op in ("floor", "call", "item"):  # constant but for jumps, at which steps end
        return 0
    if x.op in ("add", "sub", "neg", "fabs"):
        return max(map(degree, x.operands))
    if x.op in ("select", "rarely"):
        return max(map(degree, x.operands[1:]))
    if x.op == "mul":
        return sum(map(degree, x.operands))
    if x.op == "div" and degree(x.operands[1]) == 0:
        return degree(x.operands[0])
    return math.inf
