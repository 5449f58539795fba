"""The loop that Python calls: carry a state over a grid of steps and sample on the way.

The grid of steps does not depend on when samples are taken.  A sample between two grid points is
one more step of the method from the grid point before it, so it has the method's full order and
costs nothing where no sample is asked for; a run split in two equals the run in one, bit for bit.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from rb_sim.graph.machine import interpreted
from rb_sim.loops.compiled import (
    call_law,
    call_step,
    for_python,
    helper,
    integers_to,
    part,
    pointer_to,
    where,
)
from rb_sim.loops.rows import AT, DY, SLOPES
from rb_sim.loops.series import (
    LOOKS,
    agrees,
    before_events,
    evaluate,
    longest,
    of_coordinates,
    variables,
)

FINE, NOT_FINITE, STEP_UNDERFLOW, LEFT_DOMAIN = 0, 1, 2, 3
UNFINISHED = 9
"""Status of a call that ends after PIECE_STEPS: called again it goes on as if it had not ended."""
PIECE_STEPS = 2048
ULPS = 1e-15
"""Instants closer than this, relative to the time itself, are one instant."""

RATE, SETTLE, GAP, POSITION, VELOCITY, INSIDE, SAMPLE, WHOLE, JACOBIAN, BACK = range(10)
ALONG, SHARE, EXPAND, ADD, SLOPE, BEGIN, COORDINATES, STEP, LAWS = range(10, 19)
"""Places in `laws`; 0 where there is nothing to call.  WHOLE is a step as one law, `stepped`; BACK
is the way to the manifold from nearby, which writes n coordinates and how far off it they were.
ALONG writes where the state is among the pieces of which a law is made, as WAYS pairs of a
parameter and its rate; SHARE makes of a step's length, the tolerance and the ways at its both ends
the share of the step after which a piece ends.  For a method that steps along a Taylor series,
EXPAND and ADD write and sum it, and SLOPE is dy/dt of what has it; where that are not the
coordinates, BEGIN gives it at the start of a step, and COORDINATES the change of y from its own."""

ORIGIN, T0, T1, NEXT, CLOCKS = range(5)
"""Places in `clock`: start of the grid, last step, step to try next (0 before the first) [s]."""
TAKEN, REJECTED, END, COUNTS = range(4)
"""Places in `count`; END tells which row of `states`, 0 or 1, is the end of the last step."""
NOW, STATES = 2, 3
"""Rows of `states`: two for the ends of the last step, one for the time last asked for; each is
y (n), what compensated summation has still to add to it (n), and EXTRA numbers of the step."""
EXTRA = 2
"""After y and carry: the sum of y, which tells whether all are finite, and the error estimate."""
STEP_LENGTH, TOLERANCE, LARGEST, ORDER, LENGTH, WAYS, SETTINGS = range(7)
"""Places in `setting`: fixed step [s]; or tolerance (0 for a fixed step), largest step [s] and
order of the error estimate; the length of the scene, for the way back to the manifold [m]; pairs
that ALONG writes."""
LAWS_AT, SETTING_AT, SIZES_AT, CLOCK_AT, COUNT_AT, STATE_AT = range(6)
INPUTS_AT, WORK_AT, SERIES_AT, ROWS_AT, CALL_AT = range(6, 11)
COORDINATE_COUNT, INPUT_COUNT, WIDTH, REACHED, COUNT, CALL = range(11, 17)
"""Places in what `record_into` is told: where laws, settings, sizes of a series, clock, counts,
states, inputs, work, the series, the rows of samples and CALL are; how many coordinates, inputs and
numbers of a sample there are (0: nothing is sampled). At REACHED it tells how many of the COUNT
times of this call it has reached; at CALL are, as real numbers, the time beyond which it does not
go, and from FIRST_TIME on these times."""
FIRST_TIME = 1
MOST_CUTS = 8
"""Attempts to let a step end where a piece does."""
CROSSING = 1e-14
"""The tolerance for crossing the end of a piece where there is no other, or a smaller one."""

POSITION_SWEEPS = 8
ON_MANIFOLD = 2e-15
"""Position error, relative to the scene's length, at which Newton's iteration ends."""
NEAR = 1e-9
"""Position error from which one step of Newton's iteration, whose error is its square, ends at
round-off."""
LOST = 1e-6
"""Position error before the last sweep above which the iteration has not converged."""


@helper
def accumulate(n, y, dy, carry):
    """y + dy by Kahan's compensated summation, in place: rounding does not grow with the steps."""
    for i in range(n):
        d = dy[i] + carry[i]
        s = y[i] + d
        carry[i] = d - (s - y[i])
        y[i] = s


@helper
def copy(n, to, of):
    for i in range(n):
        to[i] = of[i]


@helper
def project(laws, setting, n, t, y, p, work):
    """y with unit quaternions on the manifold of the constraints, in place; NaN if out of reach.

    Newton's iteration on the positions ends at round-off or when it gains no more; then the
    velocity goes to the nearest admissible one.
    """
    at = part(work, AT * n)
    last, worst = math.inf, 0.0
    for _ in range(POSITION_SWEEPS):
        call_law(laws[GAP], t, y, p, at)
        worst = at[0]
        if worst <= ON_MANIFOLD * setting[LENGTH] or worst >= last:
            break
        last = worst
        call_law(laws[POSITION], t, y, p, at)
        copy(n, y, at)
        if worst <= NEAR * setting[LENGTH]:
            break
    if not worst <= LOST * setting[LENGTH]:
        y[0] = math.nan
    call_law(laws[VELOCITY], t, y, p, at)
    copy(n, y, at)


@helper
def settle(laws, setting, n, t, y, p, work):
    """y brought back to where it belongs, in place."""
    if laws[BACK]:
        at = part(work, AT * n)  # and into the row after it, DY: the increment is used up
        call_law(laws[BACK], t, y, p, at)
        if at[n] <= NEAR * setting[LENGTH]:
            copy(n, y, at)
            return
    if laws[SETTLE]:
        call_law(laws[SETTLE], t, y, p, part(work, AT * n))
        copy(n, y, part(work, AT * n))
    if laws[POSITION]:
        project(laws, setting, n, t, y, p, work)


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
    return t, FINE if error <= 1.0 else STEP_UNDERFLOW


@helper
def advance_series(laws, setting, sizes, n, clock, count, p, stop, work, old, new, series):
    """As advance_adaptive, along the Taylor series at the end of the last step."""
    t0, tries, kept = clock[T1], 0, False
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
            h = share * tried if share < 1.0 else 0.5 * tried
        tries += 1
    of_coordinates(laws[COORDINATES], sizes, n, t0, p, series, work)
    clock[NEXT] = h
    count[REJECTED] += tries
    return t, FINE if kept else STEP_UNDERFLOW


@helper
def ended(laws, n, t, y, p, work, status):
    """The status of a step that has come to the row y at t; `status` if there is nothing else."""
    if not math.isfinite(y[2 * n]):
        return NOT_FINITE
    if laws[INSIDE]:
        at = part(work, AT * n)
        call_law(laws[INSIDE], t, y, p, at)
        if at[0] == 0.0:
            return LEFT_DOMAIN
    return status


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
    return ended(laws, n, t, new, p, work, status)


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
        status, parts = ended(laws, n, t1, old, p, work, FINE), parts + 1 - whole
        if parts >= PIECE_STEPS and status == FINE:
            status = UNFINISHED
    clock[T0], clock[T1], count[TAKEN], count[END] = t0, t1, taken, end
    return status


@helper
def go_on(laws, setting, sizes, n, clock, count, state, p, last, until, most, stop, work, series):
    """One more step of the grid, or several; returns a status."""
    if setting[TOLERANCE] == 0.0:
        return stride(laws, setting, n, clock, count, state, p, last, until, most, stop, work)
    return advance(laws, setting, sizes, n, clock, count, state, p, last, stop, work, series)


@helper
def move_to(laws, setting, sizes, n, clock, count, state, t, p, last, work, series):
    """The row NOW becomes the state at t, with t0 <= t <= t1; returns it."""
    row, slack = 2 * n + EXTRA, ULPS * abs(t)
    old, new = part(state, (1 - count[END]) * row), part(state, count[END] * row)
    now = part(state, NOW * row)
    if t >= clock[T1] - slack:
        copy(n, now, new)
    elif t <= clock[T0] + slack:
        copy(n, now, old)
    else:
        if laws[EXPAND]:
            evaluate(laws[ADD], sizes, t - clock[T0], series, part(work, DY * n))
            of_coordinates(laws[COORDINATES], sizes, n, clock[T0], p, series, work)
        else:
            attempt(laws, setting, n, clock[T0], old, t - clock[T0], p, last, work, now)
        finish(laws, setting, n, t, old, p, work, now)
    return now


@for_python
def record_into(places):
    """See `record`; returns the status.

    All comes by one address, since each argument costs where Python calls. And everything goes on
    as a pointer: an array or a tuple goes from function to function number by number, which would
    cost more than a step of a small law.
    """
    n, last = places[COORDINATE_COUNT], places[INPUT_COUNT] - 1
    laws, setting = integers_to(places, LAWS_AT), pointer_to(places, SETTING_AT)
    sizes, clock = integers_to(places, SIZES_AT), pointer_to(places, CLOCK_AT)
    taken, state = integers_to(places, COUNT_AT), pointer_to(places, STATE_AT)
    p, work = pointer_to(places, INPUTS_AT), pointer_to(places, WORK_AT)
    series, out = pointer_to(places, SERIES_AT), pointer_to(places, ROWS_AT)
    call, width = pointer_to(places, CALL_AT), places[WIDTH]
    stop, reached, most = call[0], 0, taken[TAKEN] + PIECE_STEPS
    for i in range(places[COUNT]):
        t = call[FIRST_TIME + i]
        until = t - ULPS * abs(t)
        while clock[T1] < until:
            if taken[TAKEN] >= most:
                places[REACHED] = reached
                return UNFINISHED
            status = go_on(
                laws, setting, sizes, n, clock, taken, state, p, last, until, most, stop, work,
                series,
            )  # fmt: skip
            if status != FINE:
                places[REACHED] = reached
                return status
        now = move_to(laws, setting, sizes, n, clock, taken, state, t, p, last, work, series)
        if width > 0:
            call_law(laws[SAMPLE], t, now, p, part(out, i * width))
        reached += 1
    places[REACHED] = reached
    return FINE


ROOM = 256
"""Times of a call for which there is room."""


ONE_TIME = struct.Struct("=qdd")
"""What stands at COUNT and CALL in a call for one time."""


class Places:
    """What `record_into` is told again and again: addresses of the arrays that stay, and numbers.

    The arrays, in the order of LAWS_AT ... SERIES_AT, must live as long. width: of a sample's row,
    0 where nothing is sampled.
    """

    def __init__(self, arrays: Sequence[Any], coordinates: int, inputs: int, width: int) -> None:
        self.rows = np.zeros((ROOM, width))
        room = np.zeros(CALL + FIRST_TIME + ROOM)
        self.call = room[CALL:]
        plain = interpreted()
        found = [a if plain else where(a) for a in (*arrays, self.rows, self.call)]
        numbers = [*found, coordinates, inputs, width, 0, 0]
        self.numbers: Any = numbers if plain else room.view(np.int64)
        self.numbers[:CALL] = numbers
        self.at = numbers if plain else where(room)
        told = memoryview(room.data).cast("B")[COUNT * room.itemsize :]
        self._one = None if plain else partial(ONE_TIME.pack_into, told, 0)
        """For one time, which is asked for often: half the time of a call."""

    def tell(self, times: Any, stop: float) -> None:
        """What the next call is about."""
        count = len(times)
        if self._one is not None and count == 1:
            self._one(1, stop, times[0])
            return
        self.numbers[COUNT] = count
        self.call[0] = stop
        self.call[FIRST_TIME : FIRST_TIME + count] = times


def record(places: Places, times: Any, stop: float, out: Any) -> tuple[int, int]:
    """Integrate to each of `times` (increasing, not before T0) and sample into the rows of `out`.

    Nothing is sampled where `out` is None; the places were made with a width of 0 then.  The last
    of the inputs is the length of a step that is one law.  At SIZES_AT and SERIES_AT: sizes of a
    Taylor series, see `loops.series`, and its room, which is kept from call to call.  Returns
    (status, number of times reached).
    """
    first, count, status = 0, len(times), FINE
    while first < count and status == FINE:
        some = times if count <= ROOM else times[first : first + ROOM]
        places.tell(some, stop)
        status = record_into(places.at)
        done = len(some) if status == FINE else int(places.numbers[REACHED])
        if out is not None:
            out[first : first + done] = places.rows[:done]
        first += done
    return status, first
