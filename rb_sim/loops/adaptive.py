"""Steps of adaptive length, as long as the tolerance lets them be.

The method estimates its error, or the step goes along a Taylor series.
"""

from __future__ import annotations

import math

from rb_sim.loops.attempt import MOST_CUTS, attempt, ended, finish, root, share_of
from rb_sim.loops.compiled import call_law, helper, part
from rb_sim.loops.places import (
    ADD,
    BEGIN,
    COORDINATES,
    CUT,
    END,
    EXPAND,
    EXTRA,
    FINE,
    LARGEST,
    NEXT,
    ORDER,
    REJECTED,
    SLOPE,
    STEP_UNDERFLOW,
    T0,
    T1,
    TAKEN,
    TOLERANCE,
    ULPS,
)
from rb_sim.loops.rows import DY
from rb_sim.loops.series import (
    LOOKS,
    agrees,
    before_events,
    evaluate,
    longest,
    of_coordinates,
    variables,
)


@helper
def first_length(laws, setting, n, t, y, p, last, work, new):
    """A trial step of the largest length, cut by its own error estimate until that is within."""
    h = setting[LARGEST]
    for _ in range(60):
        error = attempt(laws, setting, n, t, y, h, p, last, work, new)
        if math.isfinite(error) and error <= 1.0:
            return h
        if math.isfinite(error):
            h *= min(0.5, max(0.01, 0.9 / root(setting[ORDER], error)))
        else:
            h *= 0.01
    return h


@helper
def next_length(setting, h, error):
    """The step to try after one of length h with this error."""
    if not math.isfinite(error):
        return 0.2 * h
    factor = 6.0 if error == 0.0 else min(6.0, max(0.2, 0.9 / root(setting[ORDER], error)))
    return min(factor * h, setting[LARGEST])


@helper
def advance_adaptive(laws, setting, n, clock, count, p, last, stop, work, old, new):
    """(end of the step, status): one step of the grid from the row `old`, with as many attempts
    as the tolerance takes."""
    t0, h, tries, cuts, uncut = clock[T1], clock[NEXT], 0, 0, 0.0
    if h == 0.0:
        h = first_length(laws, setting, n, t0, old, p, last, work, new)
    while True:
        t = t0 + h
        if t > stop - ULPS * abs(stop):
            t = stop
        tried = t - t0
        error = attempt(laws, setting, n, t0, old, tried, p, last, work, new)
        h_next = next_length(setting, tried, error)
        if error <= 1.0 and cuts < MOST_CUTS:
            share = share_of(laws, setting, n, t0, t, old, p, work, new)
            if share < 1.0:
                h, cuts, uncut = share * tried, cuts + 1, max(uncut, tried)
                continue
        if error <= 1.0 or not tried > 4.0 * ULPS * max(abs(t0), 1e-3):
            break
        h, tries = h_next, tries + 1
    if t == stop and h_next < h:
        h_next = h
    if tries > 0:
        h_next = min(h_next, tried)
    clock[NEXT] = max(h_next, uncut)
    count[REJECTED] += tries + cuts
    count[CUT] += cuts
    return t, FINE if error <= 1.0 else STEP_UNDERFLOW


@helper
def advance_series(laws, setting, sizes, n, clock, count, p, stop, work, old, new, series):
    """As advance_adaptive, along the Taylor series at the end of the last step."""
    t0, tries, cuts, kept = clock[T1], 0, 0, False
    start = variables(laws[BEGIN], sizes, n, t0, old, p, series)
    call_law(laws[EXPAND], t0, start, p, series)
    own = laws[BEGIN] != 0
    h = longest(own, sizes, setting[TOLERANCE], setting[LARGEST], n, start, series, work)
    t, least = t0, 4.0 * ULPS * max(abs(t0), 1e-3)
    while h > 0.0:
        t = t0 + h
        if t > stop - ULPS * abs(stop):
            t = stop
        tried = t - t0
        free = before_events(sizes, tried, series)
        if free < tried and tried > least:
            h = max(free, tried / LOOKS)
        else:
            evaluate(laws[ADD], sizes, tried, series, part(work, DY * n))
            kept = agrees(own, laws[SLOPE], setting[TOLERANCE], sizes, n, t, tried, start, p, work)
            share = 1.0
            if tries < MOST_CUTS:
                share = share_of(laws, setting, n, t0, t, old, p, work, new)
            if (kept and not share < 1.0) or not tried > least:
                break
            cuts += 1 if share < 1.0 else 0
            h = share * tried if share < 1.0 else 0.5 * tried
        tries += 1
    of_coordinates(laws[COORDINATES], sizes, n, t0, p, series, work)
    clock[NEXT] = h
    count[REJECTED] += tries
    count[CUT] += cuts
    return t, FINE if kept else STEP_UNDERFLOW


@helper
def advance(laws, setting, sizes, n, clock, count, state, p, last, stop, work, series):
    """One more step of adaptive length, not beyond `stop`; returns a status."""
    row = 2 * n + EXTRA
    old, new = part(state, count[END] * row), part(state, (1 - count[END]) * row)
    if laws[EXPAND]:
        t, status = advance_series(
            laws, setting, sizes, n, clock, count, p, stop, work, old, new, series
        )
    else:
        t, status = advance_adaptive(laws, setting, n, clock, count, p, last, stop, work, old, new)
    if status != FINE and laws[EXPAND]:
        return status
    finish(laws, setting, n, t, old, p, work, new)
    clock[T0], clock[T1] = clock[T1], t
    count[TAKEN] += 1
    count[END] = 1 - count[END]
    return ended(laws, setting, n, t, new, p, last, work, status)
