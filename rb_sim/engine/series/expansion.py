"""Taylor series derived by hand, in variables that suit the motion better than its coordinates.

Every other system gets the series of its graph (`graph.series`); a system registers one here where
that is at least 1.3 times cheaper (`python -m benchmarks.series`).

The coefficients follow from the equations by recurrences, x_(n+1) = (right side)_n / (n + 1), where
a product of two series is their convolution (Jorba & Zou, Experimental Mathematics 14, 2005,
section 2).  Each system writes its own, with the products that its equations have and no others.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from rb_sim.maths.jit import dispatch, inline

SUITS: dict[type, Callable[[Any], bool]] = {}
"""For each class of system with such a series: whether its constants and effects have one too."""


def has_series(system: Any) -> bool:
    """Whether this compiled system has a series derived by hand."""
    suits = SUITS.get(type(system))
    return suits is not None and suits(system)


LARGEST_ORDER = 40


@inline
def bounded(order):
    return int(min(max(order, 4.0), LARGEST_ORDER))


@inline
def quadratic_order(tolerance):
    """Order for a series whose cost is its square (convolutions).

    The terms fall like (h / radius)^n. The products alone would have least work per time at
    h = radius / e^2, that is at 1 - ln(tolerance)/2 (Jorba & Zou); five more terms pay for what a
    step costs beside them, on each of the six shipped scenes.
    """
    return bounded(math.ceil(6.0 - 0.5 * math.log(tolerance)))


@inline
def linear_order(tolerance):
    """Order for a series whose cost is proportional to it: longer ones pay."""
    return bounded(math.ceil(8.0 - 0.6 * math.log(tolerance)))


@dispatch
def plan(system, tolerance):
    """(number of series that `expand` writes, their order for a relative tolerance)."""


@dispatch
def expand(system, t, y, order, room):
    """Write the series of the motion from (t, y) into room (series, order + 1).

    Returns the sizes of the terms of order `order` - 1 and `order`: the largest coefficient of any
    coordinate i, relative to max(1, |y_i|).
    """


@dispatch
def evaluate(system, t, y, order, room, h):
    """dy at t + h from the series that `expand` wrote."""
