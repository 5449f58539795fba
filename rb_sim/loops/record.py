"""The loop that Python calls: carry a state over a grid of steps and sample on the way.

The grid of steps does not depend on when samples are taken.  A sample between two grid points is
one more step of the method from the grid point before it, so it has the method's full order and
costs nothing where no sample is asked for; a run split in two equals the run in one, bit for bit.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from rb_sim.graph.machine import interpreted
from rb_sim.loops.adaptive import advance
from rb_sim.loops.attempt import attempt, finish
from rb_sim.loops.compiled import call_law, for_python, helper, integers_to, part, pointer_to, where
from rb_sim.loops.fixed import stride
from rb_sim.loops.places import (
    ADD,
    CALL,
    CALL_AT,
    CLOCK_AT,
    COORDINATE_COUNT,
    COORDINATES,
    COUNT,
    COUNT_AT,
    END,
    EXPAND,
    EXTRA,
    FINE,
    FIRST_TIME,
    INPUT_COUNT,
    INPUTS_AT,
    LAWS_AT,
    NOW,
    PIECE_STEPS,
    REACHED,
    ROOM,
    ROWS_AT,
    SAMPLE,
    SERIES_AT,
    SETTING_AT,
    SIZES_AT,
    STATE_AT,
    T0,
    T1,
    TAKEN,
    TOLERANCE,
    ULPS,
    UNFINISHED,
    WIDTH,
    WORK_AT,
    WORST,
)
from rb_sim.loops.rows import DY
from rb_sim.loops.series import evaluate, of_coordinates
from rb_sim.loops.settle import copy


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
            residual = out[(i + 1) * width - 1]
            if not residual <= call[WORST] and call[WORST] == call[WORST]:
                call[WORST] = residual
        reached += 1
    places[REACHED] = reached
    return FINE


ONE_TIME = struct.Struct("=qdd")
"""What stands at COUNT and CALL in a call for one time."""


class Places:
    """The arguments of `record_into`: addresses of the arrays that stay, and numbers.

    The arrays, in the order of LAWS_AT ... SERIES_AT, must live as long. width: of a sample's row,
    0 where nothing is sampled.
    """

    def __init__(self, arrays: Sequence[Any], coordinates: int, inputs: int, width: int) -> None:
        self.rows = np.zeros((ROOM, width))
        room = np.zeros(CALL + WORST + 1)
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

    def take_worst(self) -> float:
        """The worst residual of the samples since this was last asked for; nan if one is."""
        worst, self.call[WORST] = float(self.call[WORST]), 0.0
        return worst

    def tell(self, times: Any, stop: float) -> None:
        """Say for which times the next call is."""
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
