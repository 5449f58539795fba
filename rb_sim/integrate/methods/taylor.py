# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Taylor's method: the series of the motion, to an order that follows from the tolerance.

Jorba & Zou, A software package for the numerical integration of ODEs by means of high-order Taylor
methods, Experimental Mathematics 14 (2005): the order grows with -ln(tolerance), so that the work
per time is least, and the step is such that the last two terms of the series are within the
tolerance. The step is known before it is taken, so few are rejected. Near rounding the order is
about 20 and a step spans a large part of the radius of convergence: far fewer steps than a
Runge-Kutta method needs.

The series is that of the traced law (`graph.taylor_series`), for a few systems in other variables
than their coordinates (`Variables` of `mechanics.laws`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from rb_sim.base.rounding import SUM_ROUNDING
from rb_sim.integrate.layout import DY, size_of
from rb_sim.numerics.kernels import SeriesStep, call_law, part

# Steps along the Taylor series of the motion: their length, and the state at their end.
#
# Jorba & Zou, Experimental Mathematics 14 (2005): the last two terms of the series are within the
# tolerance, so the step is known in advance. Two checks follow: the slope of the series at the end
# must equal dy/dt there, and no event function may change sign within the step. A step that fails
# is shortened; its series is kept. The root of a square is such an event: if a body reverses on a
# line its speed is |v|, while the series continues v, which becomes negative. A drag |v| v that is
# crossed twice has the right slope again. A step may end slightly beyond such a zero, where the
# slope shows whether it matters: nearer to the zero the series has only rounding left. The series
# may be that of other variables z than the coordinates y: one law gives z at the start of a step,
# another the change of y from that of z.


SERIES_SIZES = 8
ORDERS, COORDINATES_AT, WIDTH, EVENTS, EVENTS_AT, COUNT, VARIABLES_AT, ROOTS = range(SERIES_SIZES)
"""Indices of `sizes`: highest order; first row in the workspace of the series, numbers of a row,
number of events, place of their values at order 0; number of variables with a series, and their
place if they are not the coordinates: y, then z, then the change of z; number of events, the first
ones, that are roots."""

LOOKS = 16
"""Number of parts of a step, to one of which the sign change of an event is located."""

LEAST_LOOK = 2.0**-24
"""Part of a step below which an event close to zero is not resolved: the error of missing it is its
square, 4e-15 of the change of the event in the step."""


MISFIT = 300.0
"""Factor of the tolerance that the error of slope times step may reach: the first omitted term
counts with its order, and the series may converge slowly."""

MOST_EXPONENT = 700.0
"""Logarithm of the step from which on the largest step is taken."""

NOISE = 1e-13
"""Error of the slope, relative to the slope itself, that is only rounding."""


def variables(begin, sizes, n, t, y, p, workspace):
    """The variables with a series, at the start of a step."""
    if not begin:
        return y
    at = part(workspace, sizes[VARIABLES_AT])
    for m in range(n):
        at[m] = y[m]
    call_law(begin, t, y, p, part(at, n))
    return part(at, n)


def of_coordinates(end, sizes, n, t, p, workspace, work):
    """Replace the change of the variables, in DY, by that of the coordinates."""
    if not end:
        return
    at, dy, first = part(workspace, sizes[VARIABLES_AT]), part(work, DY * n), n + sizes[COUNT]
    for m in range(sizes[COUNT]):
        at[first + m] = dy[m]
    call_law(end, t, at, p, dy)


def of_variable(own, n, y, work, m):
    """Scale to which the error of variable m is relative.

    own: variables other than the coordinates, of which there may be more than n.
    """
    return max(1.0, abs(y[m])) if own else size_of(n, y, work, m)


def longest(own, sizes, setting_tolerance, largest, n, y, workspace, work):
    """Step for which the last two terms are within the tolerance [s]; NaN if they are not
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


def evaluate(add, sizes, h, workspace, dy):
    """Write y(h) - y(0) of the variables into dy, followed by dy/dt(h)."""
    call_law(add, h, part(workspace, sizes[COORDINATES_AT]), workspace, dy)


def event(sizes, h, i, workspace):
    """Value of the event function i after h; its coefficients follow those of the variables."""
    value = 0.0
    at = sizes[COORDINATES_AT] + sizes[COUNT] + i
    for k in range(sizes[ORDERS] - 1, 0, -1):
        value = h * (workspace[at + (k - 1) * sizes[WIDTH]] + value)
    return workspace[sizes[EVENTS_AT] + i] + value


def bend(sizes, h, i, workspace):
    """Upper bound of h^2 |e''| of the event function i within the step h: sum of absolute terms."""
    value = 0.0
    at = sizes[COORDINATES_AT] + sizes[COUNT] + i
    for k in range(sizes[ORDERS] - 1, 1, -1):
        value = h * (abs(workspace[at + (k - 1) * sizes[WIDTH]]) * k * (k - 1) + value)
    return h * value


def leaving(sizes, h, i, workspace):
    """Part of h after which the event function i, zero at the start, exceeds rounding."""
    while abs(event(sizes, 0.5 * h, i, workspace)) > SUM_ROUNDING:
        h *= 0.5
    return h


def before_events(sizes, h, workspace):
    """Part of h [s] without a sign change of an event; a root may change sign in its last part.

    Over a fraction d/h of the step an event function differs from its chord by at most (d/h)^2 bend
    / 8: if both its ends have the same sign and are further from zero, there is no zero between
    them.
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


def agrees(own, rate, tolerance, sizes, n, t, h, y, p, work):
    """Whether the slope of the series at the end t of a step equals dy/dt there; y: the variables.

    DY and the following rows hold the output of `evaluate`.
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


# Order and settings of Taylor's method.


LEAST_ORDER, LARGEST_ORDER = 4, 40


def order(tolerance: float) -> int:
    """The order for a local tolerance.

    The terms fall like (h / radius)^n. The products alone have least work per time at h = radius /
    e^2, that is at the order 1 - ln(tolerance)/2 (Jorba & Zou 2005); eight or nine more terms
    compensate the other costs of a step, on the shipped scenes.
    """
    return min(max(math.ceil(9.5 - 0.5 * math.log(tolerance)), LEAST_ORDER), LARGEST_ORDER)


taylor = SeriesStep(order)


class AdaptiveTaylor(NamedTuple):
    """Taylor's method: order and step such that the last two terms of the series are within the
    tolerance."""

    tolerance: float
    """local error relative to max(1, |y_i|) of each coordinate."""
    largest_step: float
    """largest step [s]."""
