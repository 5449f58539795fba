"""Steps along the Taylor series of the motion: how long they may be, and the state at their end.

Jorba & Zou, Experimental Mathematics 14 (2005): the step is that for which the last two terms of
the series are within the tolerance; it is known before it is taken.  What the last terms cannot
tell is looked at afterwards: the slope of the series at the end must be dy/dt there, and no event
may have changed its sign on the way.  A step that fails is shortened; its series stays.
"""

from __future__ import annotations

import math

from rb_sim.loops.compiled import call_law, helper, part
from rb_sim.loops.rows import AT, DY, SLOPES, size_of

SERIES_SIZES = 5
ORDERS, COORDINATES_AT, WIDTH, EVENTS, EVENTS_AT = range(SERIES_SIZES)
"""Places in `sizes`: highest order; in the room of the series the first row, numbers of a row,
events, where their values at order 0 are."""

LOOKS = 16
"""Instants of a step at which the events are looked at."""

MISFIT = 300.0
"""Times the tolerance by which slope times step may miss: the first term left out counts as often
as its order, and the series may fall slowly."""

NOISE = 1e-13
"""The same relative to the slope itself: rounding."""


@helper
def longest(sizes, setting_tolerance, largest, n, y, room, work):
    """The step for which the last two terms are within the tolerance [s]; NaN if they are not
    finite."""
    order = sizes[ORDERS]
    rows = part(room, sizes[COORDINATES_AT])
    last = part(rows, (order - 1) * sizes[WIDTH])
    before = part(rows, (order - 2) * sizes[WIDTH])
    most, more = 0.0, 0.0
    total = 0.0
    for m in range(n):
        size = 1.0 / size_of(n, y, work, m)
        most = max(most, abs(last[m]) * size)
        more = max(more, abs(before[m]) * size)
        total += last[m] + before[m]
    if not math.isfinite(total):
        return math.nan
    h = largest
    if most > 0.0:
        h = min(h, (setting_tolerance / most) ** (1.0 / order))
    if more > 0.0:
        h = min(h, (setting_tolerance / more) ** (1.0 / (order - 1)))
    return h


@helper
def evaluate(add, sizes, h, room, dy):
    """dy becomes y(h) - y(0), and the n numbers after it dy/dt(h)."""
    call_law(add, h, part(room, sizes[COORDINATES_AT]), room, dy)


@helper
def event(sizes, n, h, i, room):
    """The event function i after h; its coefficients lie after the n of the coordinates."""
    value = 0.0
    at = sizes[COORDINATES_AT] + n + i
    for k in range(sizes[ORDERS] - 1, 0, -1):
        value = h * (room[at + (k - 1) * sizes[WIDTH]] + value)
    return room[sizes[EVENTS_AT] + i] + value


@helper
def before_events(sizes, n, h, room):
    """The part of h before which no event changes its sign."""
    free = h
    for i in range(sizes[EVENTS]):
        begins = room[sizes[EVENTS_AT] + i]
        for look in range(1, LOOKS + 1):
            at = h * look / LOOKS
            if at > free:
                break
            value = event(sizes, n, at, i, room) if begins != 0.0 else 0.0
            if (value < 0.0 < begins) or (begins < 0.0 < value):
                free = h * (look - 1) / LOOKS
                break
    return free


@helper
def agrees(rate, tolerance, n, t, h, y, p, work):
    """Whether the slope of the series at the end t of a step is dy/dt there.

    In DY and SLOPES what `evaluate` wrote.
    """
    at, dy, slope = part(work, AT * n), part(work, DY * n), part(work, SLOPES * n)
    true = part(work, (SLOPES + 1) * n)
    for m in range(n):
        at[m] = y[m] + dy[m]
    call_law(rate, t, at, p, true)
    for m in range(n):
        off = h * abs(true[m] - slope[m])
        size = size_of(n, y, work, m)
        allowed = MISFIT * tolerance * size + NOISE * (h * abs(slope[m]) + size)
        if not off <= allowed:
            return False
    return True
