"""Taylor's method: the series of the motion itself, to an order that follows from the tolerance.

Jorba & Zou, A software package for the numerical integration of ODEs by means of high-order Taylor
methods, Experimental Mathematics 14 (2005): an order that grows with -ln(tolerance), so that the
work per time is least, and a step for which the last two terms of the series are within the
tolerance.  The step is known before it is taken, so hardly any is rejected.  Near round-off the
order is about 20 and a step spans a good part of the radius of convergence: far fewer steps than a
Runge-Kutta method needs.

The series is that of the traced law (`graph.taylor`), of a few systems in other variables than
their coordinates (`mechanics.taylor_variables`); the step is `integrate.taylor_steps`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from rb_sim.numerics.kernels import SeriesStep

# Taylor's method: the series of the motion itself, to an order that follows from the tolerance.


LEAST_ORDER, LARGEST_ORDER = 4, 40


def order(tolerance: float) -> int:
    """The order for a local tolerance.

    The terms fall like (h / radius)^n.  The products alone would have least work per time at
    h = radius / e^2, that is at 1 - ln(tolerance)/2 (Jorba & Zou 2005); eight or nine more terms
    pay for what a step costs beside them, on the shipped scenes.
    """
    return min(max(math.ceil(9.5 - 0.5 * math.log(tolerance)), LEAST_ORDER), LARGEST_ORDER)


taylor = SeriesStep(order)


class AdaptiveTaylor(NamedTuple):
    """Order and step chosen so that the last two terms of the series stay within the tolerance."""

    tolerance: float
    """relative to max(1, |y_i|) of each coordinate."""
    largest_step: float
    """[s]."""
