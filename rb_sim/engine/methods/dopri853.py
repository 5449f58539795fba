"""Dormand-Prince method of order 8 with error estimates of orders 5 and 3.

Hairer, Norsett, Wanner I, section II.5 and the code DOP853; the coefficients are in
`dopri853_coefficients`.  Between grid points the state is found by one more step of the length
wanted, from the grid point before it: order 8 at every sample time, paid only where a sample is
asked for.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from rb_sim.engine.methods.method import attempt, first_step, increment, next_step
from rb_sim.engine.methods.runge_kutta import Tableau, embedded_runge_kutta, runge_kutta
from rb_sim.loops.methods import dopri853_coefficients as published
from rb_sim.loops.methods.dopri853 import OVERFLOWS
from rb_sim.maths.jit import inline

TABLEAU = Tableau(
    order=8,
    a=published.A,
    b=published.B,
    c=published.C,
    errors=(published.E5, published.E3),
)

step = runge_kutta(TABLEAU)
embedded_step = embedded_runge_kutta(TABLEAU)


class Dopri853(NamedTuple):
    """Fixed step [s]."""

    step: float


class AdaptiveDopri853(NamedTuple):
    """Step chosen so that the estimated local error stays within the tolerance."""

    tolerance: float
    """relative to max(1, |y_i|) of each coordinate."""
    largest_step: float
    """[s]."""


@increment.register(Dopri853)
def dopri853_increment(method, system, t, y, h, work):
    return step(system, t, y, h, work)


@increment.register(AdaptiveDopri853)
def adaptive_increment(method, system, t, y, h, work):
    """The increment of an attempt: one compiled step serves both, which halves the compile time."""
    dy, _, _ = embedded_step(system, t, y, h, work)
    return dy


@inline
def eighth_root(x):
    return math.sqrt(math.sqrt(math.sqrt(x)))


@inline
def combined(e5, e3, n):
    """The estimate of DOP853: e5^2 / sqrt(e5^2 + e3^2 / 100), root mean square over y."""
    if e5 == 0.0 and e3 == 0.0:
        return 0.0
    total = e5 + 0.01 * e3
    return e5 / math.sqrt(total * n) if total < OVERFLOWS else OVERFLOWS


@attempt.register(AdaptiveDopri853)
def dopri853_attempt(method, system, t, y, h, work):
    dy, e5, e3 = embedded_step(system, t, y, h, work)
    return dy, combined(e5, e3, len(y)) / method.tolerance


@next_step.register(AdaptiveDopri853)
def dopri853_next(method, h, error):
    if not math.isfinite(error):
        return False, 0.2 * h
    if error == 0.0:
        return True, min(6.0 * h, method.largest_step)
    factor = min(6.0, max(0.2, 0.9 / eighth_root(error)))
    return error <= 1.0, min(factor * h, method.largest_step)


@first_step.register(AdaptiveDopri853)
def dopri853_first(method, system, t, y, work):
    """A trial step of the largest length, cut by its own error estimate until that is finite."""
    h = method.largest_step
    for _ in range(60):
        _, error = attempt(method, system, t, y, h, work)
        if math.isfinite(error) and error <= 1.0:
            return h
        if math.isfinite(error):
            h *= min(0.5, max(0.01, 0.9 / eighth_root(error)))
        else:
            h *= 0.01
    return h
