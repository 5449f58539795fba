"""Taylor's method: the series of the motion itself, to an order that follows from the tolerance.

Jorba & Zou, A software package for the numerical integration of ODEs by means of high-order Taylor
methods, Experimental Mathematics 14 (2005): an order that grows with -ln(tolerance), so that the
work per time is least, and a step for which the last two terms of the series are within the
tolerance.  The step is known before it is taken, so hardly any is rejected.  Near round-off the
order is about 20 and a step spans a good part of the radius of convergence: far fewer steps than a
Runge-Kutta method needs.

The series is that of the traced law (`graph.series`), of a few systems in other variables than
their coordinates (`engine.series`); the step is `loops.series`.
"""

from __future__ import annotations

from typing import NamedTuple


class AdaptiveTaylor(NamedTuple):
    """Order and step chosen so that the last two terms of the series stay within the tolerance."""

    tolerance: float
    """relative to max(1, |y_i|) of each coordinate."""
    largest_step: float
    """[s]."""
