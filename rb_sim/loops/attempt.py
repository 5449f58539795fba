"""One attempt of a step, whatever its length.

It gives the increment and its error, then the row of the end, and says after which share of the
step a piece of a law ends.
"""

from __future__ import annotations

import math

from rb_sim.loops.compiled import call_law, call_step, helper, part
from rb_sim.loops.places import (
    ALONG,
    CHOICE,
    CHOSEN,
    INSIDE,
    JACOBIAN,
    LEFT_DOMAIN,
    NOT_FINITE,
    RATE,
    SHARE,
    STEP,
    TOLERANCE,
    WAYS,
    WHOLE,
)
from rb_sim.loops.rows import AT, DY, SLOPES
from rb_sim.loops.settle import accumulate, copy, settle

MOST_CUTS = 8
"""Attempts to let a step end where a piece does."""
CROSSING = 1e-14
"""The tolerance for crossing the end of a piece where there is no other, or a smaller one."""


@helper
def root(order, x):
    """x^(1/order)."""
    if order == 8.0:
        return math.sqrt(math.sqrt(math.sqrt(x)))
    return x ** (1.0 / order)


@helper
def relative(setting, error):
    """The error in units of the tolerance; 0 for a fixed step."""
    return error / setting[TOLERANCE] if setting[TOLERANCE] > 0.0 else 0.0


@helper
def attempt(laws, setting, n, t, old, h, p, last, work, new):
    """One step of length h from the row `old`; returns its error in units of the tolerance.

    A step that is one law has written the row `new`, otherwise `finish` does; `last` is the place
    of h among the inputs.
    """
    if laws[WHOLE]:
        p[last] = h
        call_law(laws[WHOLE], t, old, p, new)
        return relative(setting, new[2 * n + 1])
    dy = part(work, DY * n)
    error = call_step(laws[STEP], laws[RATE], laws[JACOBIAN], n, t, old, h, p, dy, work)
    return relative(setting, error)


@helper
def finish(laws, setting, n, t, old, p, work, new):
    """Write the row `new` for the end t of a step that has been accepted."""
    if laws[WHOLE]:
        return
    copy(2 * n, new, old)
    accumulate(n, new, part(work, DY * n), part(new, n))
    settle(laws, setting, n, t, new, p, work)
    total = 0.0
    for i in range(n):
        total += new[i]
    new[2 * n] = total


@helper
def share_of(laws, setting, n, t0, t, old, p, work, new):
    """The share of a step from the row `old` after which a piece of a law ends; 1 where none does.

    The slopes of its stages, which nothing needs any more, give the room.
    """
    if not laws[SHARE]:
        return 1.0
    ways, room = int(setting[WAYS]), part(work, SLOPES * n)
    if laws[WHOLE]:
        at = new
    else:
        at = part(work, AT * n)
        for i in range(n):
            at[i] = old[i] + work[DY * n + i]
    call_law(laws[ALONG], t0, old, p, part(room, 2))
    call_law(laws[ALONG], t, at, p, part(room, 2 + 2 * ways))
    room[0], room[1] = t - t0, max(setting[TOLERANCE], CROSSING)
    found = part(room, 2 + 4 * ways)
    call_law(laws[SHARE], t, room, p, found)
    return found[0]


@helper
def ended(laws, setting, n, t, y, p, last, work, status):
    """The status of a step that has come to the row y at t; `status` if there is nothing else.

    Lines are chosen for the next step; `last` is the place of its length among the inputs.
    """
    if not math.isfinite(y[2 * n]):
        return NOT_FINITE
    if laws[CHOICE]:
        at, count = part(work, AT * n), int(setting[CHOSEN])
        call_law(laws[CHOICE], t, y, p, at)
        copy(count, part(p, last - count), at)
    if laws[INSIDE]:
        at = part(work, AT * n)
        call_law(laws[INSIDE], t, y, p, at)
        if at[0] == 0.0:
            return LEFT_DOMAIN
    return status
