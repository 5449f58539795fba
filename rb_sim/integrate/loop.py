# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The stepping loop: fixed or adaptive steps on a grid, with samples between grid points."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from rb_sim.compiler.graph.machine import interpreted
from rb_sim.integrate.attempt import MOST_CUTS, attempt, begin, copy, ended, finish, root, share_of
from rb_sim.integrate.layout import (
    ADD,
    BEGIN,
    CALL,
    CALL_AT,
    CAPACITY,
    CLOCK_AT,
    COORDINATE_COUNT,
    COORDINATES,
    COUNT,
    COUNT_AT,
    CUT,
    DY,
    END,
    EXPAND,
    EXTRA,
    FINE,
    FIRST_TIME,
    INPUT_COUNT,
    INPUTS_AT,
    LARGEST,
    LAWS_AT,
    NEXT,
    NOT_FINITE,
    NOW,
    ORDER,
    ORIGIN,
    PIECE_STEPS,
    REACHED,
    REJECTED,
    ROWS_AT,
    SAMPLE,
    SERIES_AT,
    SETTING_AT,
    SHARE,
    SIZES_AT,
    SLOPE,
    STATE_AT,
    STEP_LENGTH,
    STEP_UNDERFLOW,
    T0,
    T1,
    TAKEN,
    TOLERANCE,
    ULPS,
    UNFINISHED,
    WHOLE,
    WIDTH,
    WORK_AT,
    WORST,
)
from rb_sim.integrate.methods.taylor import (
    LOOKS,
    agrees,
    before_events,
    evaluate,
    longest,
    of_coordinates,
    variables,
)
from rb_sim.numerics.kernels import (
    call_law,
    for_python,
    integers_to,
    part,
    pointer_to,
    where,
)

# Fixed steps, cut at the ends of pieces of a law.


def upto_piece(laws, setting, n, t0, t1, h, old, p, last, work, new):
    """(end [s], 1 for a whole step or 0): a fixed step from t0 to t1, or to the end of a piece
    before."""
    whole = 1
    for cuts in range(MOST_CUTS + 1):
        attempt(laws, setting, n, t0, old, h, p, last, work, new)
        share = share_of(laws, setting, n, t0, t1, old, p, work, new)
        if cuts == MOST_CUTS or not share < 1.0 or not t0 + share * h > t0:
            break
        h, whole = share * h, 0
        t1 = t0 + h
    return t1, whole


def stride(laws, setting, n, clock, count, state, p, last, until, most, stop, work):
    """Fixed steps up to the time `until` or `most` steps, not beyond `stop`; returns a status.

    Also UNFINISHED after PIECE_STEPS parts of steps: a diverging motion crosses pieces of a law
    without end, and the caller must be able to stop it.
    """
    row, end, step = 2 * n + EXTRA, count[END], setting[STEP_LENGTH]
    old, new = part(state, end * row), part(state, (1 - end) * row)
    taken, t0, t1 = count[TAKEN], clock[T0], clock[T1]
    cut, status, parts = stop - ULPS * abs(stop), FINE, 0
    while t1 < until and taken < most and status == FINE:
        begin(laws, setting, n, t1, old, p, last, work)
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


# Adaptive steps, as long as the tolerance allows: the method estimates its error, or the step is
# along a Taylor series.


def first_length(laws, setting, n, t, y, p, last, work, new):
    """Length of the first step: the largest one, shortened by its error estimate until that is
    accepted."""
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


def next_length(setting, h, error):
    """Length of the next step after one of length h with this error."""
    if not math.isfinite(error):
        return 0.2 * h
    factor = 6.0 if error == 0.0 else min(6.0, max(0.2, 0.9 / root(setting[ORDER], error)))
    return min(factor * h, setting[LARGEST])


def advance_adaptive(laws, setting, n, clock, count, p, last, stop, work, old, new):
    """(end of the step, status): one step from the row `old`, repeated until the tolerance is
    met."""
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


def advance(laws, setting, sizes, n, clock, count, state, p, last, stop, work, series):
    """One adaptive step, not beyond `stop`; returns a status."""
    row = 2 * n + EXTRA
    old, new = part(state, count[END] * row), part(state, (1 - count[END]) * row)
    begin(laws, setting, n, clock[T1], old, p, last, work)
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


# The loop that Python calls: advance a state over a grid of steps, with samples.
#
# The grid does not depend on the sample times. A sample between two grid points is one more step of
# the method from the grid point before it: it has the method's full order, costs nothing without
# samples, and a run split in two equals the run in one, bit for bit.


def go_on(laws, setting, sizes, n, clock, count, state, p, last, until, most, stop, work, series):
    """One or more steps of the grid; returns a status."""
    if setting[TOLERANCE] == 0.0:
        return stride(laws, setting, n, clock, count, state, p, last, until, most, stop, work)
    return advance(laws, setting, sizes, n, clock, count, state, p, last, stop, work, series)


MOST_PARTS = 8
"""Most equal steps to a sample: the iteration of an implicit method may fail in part of a step that
has succeeded, if a stage is at a loss of rank of a loop."""


def in_parts(laws, setting, n, t0, t, parts, old, p, last, work, now):
    """Write the state at t into the row `now`, by `parts` equal steps from the row `old`."""
    copy(2 * n + EXTRA, now, old)
    for i in range(parts):
        begun, end = t0 + (t - t0) * i / parts, t0 + (t - t0) * (i + 1) / parts
        attempt(laws, setting, n, begun, now, end - begun, p, last, work, now)
        finish(laws, setting, n, end, now, p, work, now)


def move_to(laws, setting, sizes, n, clock, count, state, t, p, last, work, series):
    """Write the state at t, t0 <= t <= t1, into the row NOW; returns that row."""
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
        parts = 2
        while parts <= MOST_PARTS and not (laws[WHOLE] or math.isfinite(now[2 * n])):
            in_parts(laws, setting, n, clock[T0], t, parts, old, p, last, work, now)
            parts *= 2
    return now


@for_python
def record_into(places):
    """Loop of `record` on packed arguments; returns the status.

    All arguments are behind one address, since each one costs when Python calls; arrays are passed
    on as pointers, since passing them number by number would cost more than a step of a small law.
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
        if not math.isfinite(now[2 * n]):
            places[REACHED] = reached
            return NOT_FINITE
        if width > 0:
            call_law(laws[SAMPLE], t, now, p, part(out, i * width))
            residual = out[(i + 1) * width - 1]
            if not residual <= call[WORST] and call[WORST] == call[WORST]:
                call[WORST] = residual
        reached += 1
    places[REACHED] = reached
    return FINE


ONE_TIME = struct.Struct("=qdd")
"""Format of COUNT and the first numbers of CALL for a call with one time."""


class Places:
    """The arguments of `record_into`: addresses of permanent arrays, and numbers.

    The arrays, in the order of LAWS_AT ... SERIES_AT, must live as long as this object. width: of a
    sample's row, 0 without samples.
    """

    def __init__(self, arrays: Sequence[Any], coordinates: int, inputs: int, width: int) -> None:
        self.rows = np.zeros((CAPACITY, width))
        workspace = np.zeros(CALL + WORST + 1)
        self.call = workspace[CALL:]
        plain = interpreted()
        found = [a if plain else where(a) for a in (*arrays, self.rows, self.call)]
        numbers = [*found, coordinates, inputs, width, 0, 0]
        self.numbers: Any = numbers if plain else workspace.view(np.int64)
        self.numbers[:CALL] = numbers
        self.at = numbers if plain else where(workspace)
        first_time = memoryview(workspace.data).cast("B")[COUNT * workspace.itemsize :]
        self._one = None if plain else partial(ONE_TIME.pack_into, first_time, 0)
        """packs a single time, a frequent case: halves the cost of a call."""

    def take_worst(self) -> float:
        """The largest residual of the samples since the last call of this; NaN if one is NaN."""
        worst, self.call[WORST] = float(self.call[WORST]), 0.0
        return worst

    def tell(self, times: Any, stop: float) -> None:
        """Set the times of the next call."""
        count = len(times)
        if self._one is not None and count == 1:
            self._one(1, stop, times[0])
            return
        self.numbers[COUNT] = count
        self.call[0] = stop
        self.call[FIRST_TIME : FIRST_TIME + count] = times


def record(places: Places, times: Any, stop: float, out: Any) -> tuple[int, int]:
    """Integrate to each of `times` (increasing, not before T0) and sample into the rows of `out`.

    `out` is None for places with width 0: no samples. The last input is the length of a step that
    is one law. SIZES_AT and SERIES_AT: sizes of a Taylor series, see `integrate.methods.taylor`,
    and its workspace, kept from call to call. Returns (status, number of times reached).
    """
    first, count, status = 0, len(times), FINE
    while first < count and status == FINE:
        some = times if count <= CAPACITY else times[first : first + CAPACITY]
        places.tell(some, stop)
        status = record_into(places.at)
        done = len(some) if status == FINE else int(places.numbers[REACHED])
        if out is not None:
            out[first : first + done] = places.rows[:done]
        first += done
    return status, first
