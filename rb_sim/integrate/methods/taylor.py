# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Taylor's method: the series of the motion itself, to an order that follows from the tolerance.

Jorba & Zou, A software package for the numerical integration of ODEs by means of high-order Taylor
methods, Experimental Mathematics 14 (2005): an order that grows with -ln(tolerance), so that the
work per time is least, and a step for which the last two terms of the series are within the
tolerance.  The step is known before it is taken, so hardly any is rejected.  Near round-off the
order is about 20 and a step spans a good part of the radius of convergence: far fewer steps than a
Runge-Kutta method needs.

The series is that of the traced law (`graph.taylor`), of a few systems in other variables than
their coordinates (`mechanics.taylor_variables`); the step is `integrate.methods.taylor`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from rb_sim.base.rounding import SUM_ROUNDING
from rb_sim.integrate.layout import DY, size_of
from rb_sim.numerics.kernels import SeriesStep, call_law, helper, part

# Steps along the Taylor series of the motion: how long they may be, and the state at their end.
#
# Jorba & Zou, Experimental Mathematics 14 (2005): the step is that for which the last two terms of
# the series are within the tolerance; it is known before it is taken.  What the last terms cannot
# tell is looked at afterwards: the slope of the series at the end must be dy/dt there, and no event
# may have changed its sign on the way.  A step that fails is shortened; its series stays.
#
# The root of a square is such an event: where a body turns round on a line its speed is |v|, and
# the series of it is v, which is negative from there on.  A drag |v| v that is leapt over twice has
# the right slope again.  A step may end a little beyond the zero, though, where the slope tells
# whether it matters: nearer to it the series has nothing left but rounding.
#
# The series may be that of other variables z than the coordinates y: a law gives z at the start of
# a step, and another the change of y from that of z.


SERIES_SIZES = 8
ORDERS, COORDINATES_AT, WIDTH, EVENTS, EVENTS_AT, COUNT, VARIABLES_AT, ROOTS = range(SERIES_SIZES)
"""Places in `sizes`: highest order; in the workspace of the series the first row, numbers of a row,
events, where their values at order 0 are; how many variables have a series, and where they are if
they are not the coordinates: y, then z, then the change of z; how many of the events, the first of
them, are roots."""

LOOKS = 16
"""Parts of a step within which the change of sign of an event is found."""

LEAST_LOOK = 2.0**-24
"""Part of a step below which an event that comes near zero is not looked at: what is missed is in
the square of it, 4e-15 of how far the event goes in the step."""


MISFIT = 300.0
"""Times the tolerance by which slope times step may miss: the first term left out counts as often
as its order, and the series may fall slowly."""

MOST_EXPONENT = 700.0
"""Steps beyond e to this power are as long as may be."""

NOISE = 1e-13
"""The same relative to the slope itself: rounding."""


@helper
def variables(begin, sizes, n, t, y, p, workspace):
    """The variables that have a series, at the start of a step."""
    if not begin:
        return y
    at = part(workspace, sizes[VARIABLES_AT])
    for m in range(n):
        at[m] = y[m]
    call_law(begin, t, y, p, part(at, n))
    return part(at, n)


@helper
def of_coordinates(end, sizes, n, t, p, workspace, work):
    """Turn the change of the variables, in DY, into that of the coordinates."""
    if not end:
        return
    at, dy, first = part(workspace, sizes[VARIABLES_AT]), part(work, DY * n), n + sizes[COUNT]
    for m in range(sizes[COUNT]):
        at[first + m] = dy[m]
    call_law(end, t, at, p, dy)


@helper
def of_variable(own, n, y, work, m):
    """The size to which the error of m is relative.

    own: of variables of their own, of which there may be more than n.
    """
    return max(1.0, abs(y[m])) if own else size_of(n, y, work, m)


@helper
def longest(own, sizes, setting_tolerance, largest, n, y, workspace, work):
    """The step for which the last two terms are within the tolerance [s]; NaN if they are not
    finite."""
    order = sizes[ORDERS]
    rows = part(workspace, sizes[COORDINATES_AT])
    last = part(rows, (order - 1) * sizes[WIDTH])
    before = part(rows, (order - 2) * sizes[WIDTH])
    most, more = 0.0, 0.0
    total = 0.0
    for m in range(sizes[COUNT]):
        size = 1.0 / of_variable(own, n, y, work, m)
        most = max(most, abs(last[m]) * size)
        more = max(more, abs(before[m]) * size)
        total += last[m] + before[m]
    if not math.isfinite(total):
        return math.nan
    exponent = math.inf
    if most > 0.0:
        exponent = math.log(setting_tolerance / most) / order
    if more > 0.0:
        exponent = min(exponent, math.log(setting_tolerance / more) / (order - 1))
    return min(largest, math.exp(exponent)) if exponent < MOST_EXPONENT else largest


@helper
def evaluate(add, sizes, h, workspace, dy):
    """dy becomes y(h) - y(0), and the numbers after it dy/dt(h); of the variables."""
    call_law(add, h, part(workspace, sizes[COORDINATES_AT]), workspace, dy)


@helper
def event(sizes, h, i, workspace):
    """The event function i after h; its coefficients lie after those of the variables."""
    value = 0.0
    at = sizes[COORDINATES_AT] + sizes[COUNT] + i
    for k in range(sizes[ORDERS] - 1, 0, -1):
        value = h * (workspace[at + (k - 1) * sizes[WIDTH]] + value)
    return workspace[sizes[EVENTS_AT] + i] + value


@helper
def bend(sizes, h, i, workspace):
    """A bound of h^2 |e''| of the event function i on the whole step h: of the sums of the terms'
    absolute values."""
    value = 0.0
    at = sizes[COORDINATES_AT] + sizes[COUNT] + i
    for k in range(sizes[ORDERS] - 1, 1, -1):
        value = h * (abs(workspace[at + (k - 1) * sizes[WIDTH]]) * k * (k - 1) + value)
    return h * value


@helper
def leaving(sizes, h, i, workspace):
    """The part of h after which the event function i, zero at its start, is beyond rounding."""
    while abs(event(sizes, 0.5 * h, i, workspace)) > SUM_ROUNDING:
        h *= 0.5
    return h


@helper
def before_events(sizes, h, workspace):
    """The part of h before which no event changes its sign, a root but in its last part.

    Over a part d of it an event function is off its chord by no more than (d/h)^2 bend / 8: where
    its ends are further from zero, on the same side, it has no zero between them.
    """
    free = h
    for i in range(sizes[EVENTS]):
        before = workspace[sizes[EVENTS_AT] + i]
        if before == 0.0:  # the law may be that of the side which the motion leaves
            free = min(free, leaving(sizes, h, i, workspace))
            continue
        bound, at, d = 0.125 * bend(sizes, h, i, workspace), 0.0, 1.0
        while at < 1.0 and h * at < free:
            d = min(d, 1.0 - at)
            value = event(sizes, h * (at + d), i, workspace)
            changes = (value < 0.0 < before) or (before < 0.0 < value)
            surely = min(abs(value), abs(before)) > bound * d * d
            if i < sizes[ROOTS] and d <= 1.0 / LOOKS and (changes or not surely):
                free = min(free, h * (at + d))
                break
            if changes and d <= 1.0 / LOOKS:
                free = min(free, h * at)
                break
            if not changes and (surely or d <= LEAST_LOOK):
                at, before, d = at + d, value, 2.0 * d
            else:
                d *= 0.5
    return free


@helper
def agrees(own, rate, tolerance, sizes, n, t, h, y, p, work):
    """Whether the slope of the series at the end t of a step is dy/dt there; y: the variables.

    In DY and behind it what `evaluate` wrote.
    """
    count, dy = sizes[COUNT], part(work, DY * n)
    slope, at, true = part(dy, count), part(dy, 2 * count), part(dy, 3 * count)
    for m in range(count):
        at[m] = y[m] + dy[m]
    call_law(rate, t, at, p, true)
    for m in range(count):
        off = h * abs(true[m] - slope[m])
        size = of_variable(own, n, y, work, m)
        allowed = MISFIT * tolerance * size + NOISE * (h * abs(slope[m]) + size)
        if not off <= allowed:
            return False
    return True


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
