"""Taylor's method: the series of the motion itself, to an order that follows from the tolerance.

Jorba & Zou, A software package for the numerical integration of ODEs by means of high-order Taylor
methods, Experimental Mathematics 14 (2005): an order that grows with -ln(tolerance), so that the
work per time is least, and a step for which the last two terms of the series are within the
tolerance.  The step is known before it is taken, so hardly any is rejected.  Near round-off the
order is about 20 and a step spans a good part of the radius of convergence: far fewer steps than a
Runge-Kutta method needs.

The series is that of the traced law (`graph.series`), the step `loops.series`.  What is below the
class serves the few systems whose series is derived by hand (`engine.series`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rb_sim.engine.methods.method import increment
from rb_sim.engine.series.expansion import evaluate, expand, plan
from rb_sim.maths.jit import inline


class AdaptiveTaylor(NamedTuple):
    """Order and step chosen so that the last two terms of the series stay within the tolerance."""

    tolerance: float
    """relative to max(1, |y_i|) of each coordinate."""
    largest_step: float
    """[s]."""


@inline
def step_within(method, order, before, last):
    """The step at which the term of order `order` - 1 or `order` reaches the tolerance [s].

    A series without these terms ends before them: the step is the largest.
    """
    h = method.largest_step
    if last > 0.0:
        h = min(h, (method.tolerance / last) ** (1.0 / order))
    if before > 0.0:
        h = min(h, (method.tolerance / before) ** (1.0 / (order - 1)))
    return h


@inline
def expansion(method, system, t, y):
    """(order, coefficients, longest step [s]) at (t, y)."""
    series, order = plan(system, method.tolerance)
    room = np.empty((series, order + 1))
    before, last = expand(system, t, y, order, room)
    return order, room, step_within(method, order, before, last)


@increment.register(AdaptiveTaylor)
def taylor_increment(method, system, t, y, h, work):
    order, room, _ = expansion(method, system, t, y)
    return evaluate(system, t, y, order, room, h)
