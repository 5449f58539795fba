"""Steps of fixed length, cut where a piece of a law ends."""

from __future__ import annotations

from rb_sim.loops.attempt import MOST_CUTS, attempt, ended, finish, share_of
from rb_sim.loops.compiled import helper, part
from rb_sim.loops.places import (
    END,
    EXTRA,
    FINE,
    ORIGIN,
    PIECE_STEPS,
    SHARE,
    STEP_LENGTH,
    T0,
    T1,
    TAKEN,
    ULPS,
    UNFINISHED,
)


@helper
def upto_piece(laws, setting, n, t0, t1, h, old, p, last, work, new):
    """(end, 1 or 0 steps of the grid): a fixed step from t0 to t1, or to where a piece ends before
    it; what is left of it comes next."""
    whole = 1
    for cuts in range(MOST_CUTS + 1):
        attempt(laws, setting, n, t0, old, h, p, last, work, new)
        share = share_of(laws, setting, n, t0, t1, old, p, work, new)
        if cuts == MOST_CUTS or not share < 1.0 or not t0 + share * h > t0:
            break
        h, whole = share * h, 0
        t1 = t0 + h
    return t1, whole


@helper
def stride(laws, setting, n, clock, count, state, p, last, until, most, stop, work):
    """Fixed steps up to the time `until` or `most` steps, not beyond `stop`; returns a status.

    Also UNFINISHED after that many parts of steps: a motion that blows up passes pieces of a law
    without end, and nobody would be asked whether to go on.
    """
    row, end, step = 2 * n + EXTRA, count[END], setting[STEP_LENGTH]
    old, new = part(state, end * row), part(state, (1 - end) * row)
    taken, t0, t1 = count[TAKEN], clock[T0], clock[T1]
    cut, status, parts = stop - ULPS * abs(stop), FINE, 0
    while t1 < until and taken < most and status == FINE:
        h, t0, t1, whole = step, t1, clock[ORIGIN] + (taken + 1) * step, 1
        if t1 > cut or t1 == stop:
            t1 = stop
            h = t1 - t0
        if laws[SHARE]:
            if t0 != clock[ORIGIN] + taken * step:
                h = t1 - t0
            t1, whole = upto_piece(laws, setting, n, t0, t1, h, old, p, last, work, new)
        else:
            attempt(laws, setting, n, t0, old, h, p, last, work, new)
        finish(laws, setting, n, t1, old, p, work, new)
        old, new, end, taken = new, old, 1 - end, taken + whole
        status, parts = ended(laws, setting, n, t1, old, p, last, work, FINE), parts + 1 - whole
        if parts >= PIECE_STEPS and status == FINE:
            status = UNFINISHED
    clock[T0], clock[T1], count[TAKEN], count[END] = t0, t1, taken, end
    return status
