"""Taylor's method: the series of the motion itself, to an order that follows from the tolerance."""

from __future__ import annotations

import math

from rb_sim.loops.compiled import SeriesStep

LEAST_ORDER, LARGEST_ORDER = 4, 40


def order(tolerance: float) -> int:
    """The order for a local tolerance.

    The terms fall like (h / radius)^n.  The products alone would have least work per time at
    h = radius / e^2, that is at 1 - ln(tolerance)/2 (Jorba & Zou 2005); eight or nine more terms
    pay for what a step costs beside them, on the shipped scenes.
    """
    return min(max(math.ceil(9.5 - 0.5 * math.log(tolerance)), LEAST_ORDER), LARGEST_ORDER)


taylor = SeriesStep(order)
