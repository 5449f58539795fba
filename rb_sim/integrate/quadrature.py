# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Cubics through values and rates, and integrals of sampled functions by them."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np

from rb_sim.base.rounding import WRITTEN_ROUNDING
from rb_sim.graph.machine import interpreted
from rb_sim.numerics.kernels import for_python, helper, inline, part, pointer_to

# The cubic through values a, b and rates ra, rb at the ends of a span, on s in 0..1 (Hermite).


@inline
def cubic_at(a, ra, b, rb, width, s):
    """(value, derivative by s) of the cubic."""
    m0, m1 = ra * width, rb * width
    q, r = 3.0 * (b - a) - 2.0 * m0 - m1, m0 + m1 - 2.0 * (b - a)
    return a + s * (m0 + s * (q + s * r)), m0 + s * (2.0 * q + 3.0 * s * r)


@inline
def tangents_meet(a, ra, b, rb, width):
    """(place in 0 to 1, value) where the tangents at the ends of a span meet, for ra < 0 < rb.

    A convex function, however it bends, is nowhere below that value.
    """
    s = (b - a - rb * width) / ((ra - rb) * width)
    s = min(max(s, 0.0), 1.0)
    return s, max(a + ra * width * s, b - rb * width * (1.0 - s))


@inline
def cubic_range(a, ra, b, rb, width):
    """Bounds of the cubic: the least and the largest of its Bernstein coefficients."""
    x, z = a + ra * width / 3.0, b - rb * width / 3.0
    return min(min(a, b), min(x, z)), max(max(a, b), max(x, z))


@inline
def cubic_minimum(a, ra, b, rb, width):
    """Place s of the minimum of the cubic inside the span; -1 if it has none there."""
    m0, m1 = ra * width, rb * width
    q, r = 3.0 * (b - a) - 2.0 * m0 - m1, m0 + m1 - 2.0 * (b - a)
    inner = q * q - 3.0 * r * m0
    if not inner >= 0.0:
        return -1.0
    turn = inner**0.5
    if q >= 0.0:
        s = -m0 / (q + turn) if q + turn > 0.0 else -1.0
    else:
        s = (turn - q) / (3.0 * r) if r != 0.0 else -1.0
    return s if 0.0 < s < 1.0 else -1.0


# Integrals of sampled functions by the cubics through four neighbours, sample after sample.
#
# Where the functions break, the cubics of either side go up to there. Between two breaks, with
# samples t_1 ... t_m, the integral from a sample to the next is that of the cubic through the two
# and their neighbours, at the ends through the four nearest; of fewer samples all make one
# polynomial.


NODES = 4
"""Samples per interpolating cubic: the rule is of order 4 for smooth functions."""

GAUSS = 3.0**-0.5
"""Two points, this far from the middle of an interval of half length 1, integrate a cubic."""


M, BREAK, BROKEN, CROWD, CROWDED, TIMES = 0, 1, 2, 3, 4, 5
WORKSPACE, LAST, SEEN, LONGEST, COLUMNS = 9, 13, 14, 15, 16
"""Places in the state of an integral: samples of the present piece; the break at which it begins,
and whether there is one; the last of more breaks before its first sample, and whether there is one;
the times of its last samples; workspace for weights; the time of the last sample of all, and
whether there is one; the longest interval that is no gap; where the columns begin."""
SUM, BEFORE, UNRESOLVED, PART, VALUES, VALUE, SIZE, SIGNED, GAP = 0, 1, 2, 3, 4, 8, 9, 10, 11
COLUMN = 12
"""Places in each column: the integral; the size of the last sample before the piece; what samples
leave open beside breaks; the last part of the integral; the values of the last samples, and of the
last of all; by trapezoids the integrals of the size, of the value, and of the size over gaps."""

END = 1e300
"""A time that no sample reaches."""

STATE_AT, WIDTH, USED, TIMES_AT, VALUES_AT, BREAKS_AT = range(6)
COUNT, FIRST, STRIDE, BREAKS, ENDS = range(6, 11)
"""Places in the arguments of `integrate_into`."""


@helper
def weigh(state, n, start, end):
    """Weights of the last n samples in the integral from start to end of their one polynomial."""
    middle, half = 0.5 * (start + end), 0.5 * (end - start)
    for j in range(n):
        low, high, between = half, half, 1.0
        for i in range(n):
            if i != j:
                low *= middle - half * GAUSS - state[TIMES + i]
                high *= middle + half * GAUSS - state[TIMES + i]
                between *= state[TIMES + j] - state[TIMES + i]
        state[WORKSPACE + j] = (low + high) / between


@helper
def put_parts(state, width, n):
    """PART of every column by the weights."""
    for c in range(width):
        column = part(state, COLUMNS + COLUMN * c)
        found = 0.0
        for j in range(n):
            found += state[WORKSPACE + j] * column[VALUES + j]
        column[PART] = found


@helper
def add_span(state, width, n, start, end):
    """Add the integral from start to end of the one polynomial through the last n samples."""
    weigh(state, n, start, end)
    put_parts(state, width, n)
    for c in range(width):
        column = part(state, COLUMNS + COLUMN * c)
        column[SUM] += column[PART]


@helper
def add_interval(state, width, left):
    """Add the integral from the sample `left` of the last four to the next."""
    a, b, c, d = state[TIMES], state[TIMES + 1], state[TIMES + 2], state[TIMES + 3]
    h = (d - a) / 3.0
    if max(abs(b - a - h), abs(c - b - h), abs(d - c - h)) <= WRITTEN_ROUNDING * h:
        inner, near, far = 13.0 * h / 24.0, 19.0 * h / 24.0, -5.0 * h / 24.0
        if left == 1:
            state[WORKSPACE], state[WORKSPACE + 1], state[WORKSPACE + 2] = -h / 24.0, inner, inner
            state[WORKSPACE + 3] = -h / 24.0
        elif left == 0:
            state[WORKSPACE], state[WORKSPACE + 1], state[WORKSPACE + 2] = 9.0 * h / 24.0, near, far
            state[WORKSPACE + 3] = h / 24.0
        else:
            state[WORKSPACE], state[WORKSPACE + 1], state[WORKSPACE + 2] = h / 24.0, far, near
            state[WORKSPACE + 3] = 9.0 * h / 24.0
    else:
        weigh(state, NODES, state[TIMES + left], state[TIMES + left + 1])
    put_parts(state, width, NODES)
    for k in range(width):
        column = part(state, COLUMNS + COLUMN * k)
        column[SUM] += column[PART]


@helper
def doubt_part(state, width, n, value, length):
    """What may be wrong of the PART, an integral beyond the n samples of a piece, whose nearest is
    the one at `value`: all that it may be where there is one sample; of two or three, all but the
    value times the length, for a slope that they happen to keep may change; of more, nothing."""
    for c in range(width):
        column = part(state, COLUMNS + COLUMN * c)
        if n == 1:
            column[UNRESOLVED] += max(abs(column[VALUES]), column[BEFORE]) * length
        elif n < NODES:
            column[UNRESOLVED] += abs(column[PART] - column[VALUES + value] * length)


@helper
def add_head(state, width, n):
    """Add what lies between the break at which a piece begins and its first sample."""
    if state[BROKEN] == 0.0:
        return
    add_span(state, width, n, state[BREAK], state[TIMES])
    doubt_part(state, width, n, 0, state[TIMES] - state[BREAK])
    if state[CROWDED] != 0.0:
        weigh(state, n, state[BREAK], state[CROWD])
        put_parts(state, width, n)
        for c in range(width):
            column = part(state, COLUMNS + COLUMN * c)
            column[UNRESOLVED] += abs(column[PART])


@helper
def end_samples(state, width):
    """Add what is still missing up to the last sample of the piece."""
    n = int(state[M])
    if n >= NODES:
        add_interval(state, width, 2)
    elif n > 0:
        add_head(state, width, n)
        for i in range(n - 1):
            add_span(state, width, n, state[TIMES + i], state[TIMES + i + 1])


@helper
def end_piece(state, width, instant):
    """Begin anew at a break; one without a sample since the last is left out."""
    if state[M] == 0.0:
        state[CROWD], state[CROWDED] = instant, state[BROKEN]
        return
    n = min(int(state[M]), NODES)
    end_samples(state, width)
    last = state[TIMES + n - 1]
    add_span(state, width, n, last, instant)
    doubt_part(state, width, n, n - 1, instant - last)
    for c in range(width):
        column = part(state, COLUMNS + COLUMN * c)
        column[BEFORE] = abs(column[VALUES + n - 1])
    state[M], state[BREAK], state[BROKEN], state[CROWDED] = 0.0, instant, 1.0, 0.0


@helper
def add_trapezoid(state, width, t, values):
    """Add the integrals by trapezoids from the last sample of all to this one."""
    half = 0.5 * (t - state[LAST]) * state[SEEN]
    for c in range(width):
        column = part(state, COLUMNS + COLUMN * c)
        size = half * (abs(values[c]) + abs(column[VALUE]))
        column[SIZE] += size
        column[SIGNED] += half * (values[c] + column[VALUE])
        if 2.0 * half > state[LONGEST]:
            column[GAP] += size
        column[VALUE] = values[c]
    state[LAST], state[SEEN] = t, 1.0


@helper
def take(state, width, t, values):
    """The next sample."""
    add_trapezoid(state, width, t, values)
    n = int(state[M])
    at = min(n, NODES - 1)
    if n >= NODES:
        for j in range(NODES - 1):
            state[TIMES + j] = state[TIMES + j + 1]
    state[TIMES + at] = t
    for c in range(width):
        column = part(state, COLUMNS + COLUMN * c + VALUES)
        if n >= NODES:
            for j in range(NODES - 1):
                column[j] = column[j + 1]
        column[at] = values[c]
    state[M] = min(n + 1.0, NODES + 1.0)
    if n == NODES - 1:
        add_head(state, width, NODES)
        add_interval(state, width, 0)
        add_interval(state, width, 1)
    elif n >= NODES:
        add_interval(state, width, 1)


@helper
def equal_ahead(state, times, count, i, stride, until):
    """How many samples from i on go on in the spacing of the last four, before the time `until`."""
    h = (state[TIMES + 3] - state[TIMES]) / 3.0
    inner = max(abs(state[TIMES + 1] - state[TIMES] - h), abs(state[TIMES + 3] - state[LAST]))
    slack = WRITTEN_ROUNDING * h
    if state[M] < NODES or inner > slack or h > state[LONGEST]:
        return 0
    if abs(state[TIMES + 2] - state[TIMES + 1] - h) > slack:
        return 0
    before, found = state[TIMES + 3], 0
    while i < count and times[i] < until and abs(times[i] - before - h) <= slack:
        before = times[i]
        i += stride
        found += 1
    return found


@helper
def take_equal(state, width, times, values, i, stride, found):
    """So many samples from i on, in the spacing of the last four."""
    h = (state[TIMES + 3] - state[TIMES]) / 3.0
    for k in range(width):
        column = part(state, COLUMNS + COLUMN * k)
        a, b, c = column[VALUES + 1], column[VALUES + 2], column[VALUES + 3]
        z, at = column[VALUES], i * width + k
        total, size, signed = 0.0, 0.0, 0.0
        for _ in range(found):
            d = values[at]
            total += 13.0 * (b + c) - (a + d)
            size += abs(c) + abs(d)
            signed += c + d
            z, a, b, c = a, b, c, d
            at += stride * width
        column[SUM] += h * total / 24.0
        column[SIZE] += 0.5 * h * size
        column[SIGNED] += 0.5 * h * signed
        column[VALUES], column[VALUES + 1], column[VALUES + 2] = z, a, b
        column[VALUES + 3] = column[VALUE] = c
    for j in range(NODES):
        back = found - NODES + j
        if back >= 0:
            state[WORKSPACE + j] = times[i + stride * back]
        else:
            state[WORKSPACE + j] = state[TIMES + NODES + back]
    for j in range(NODES):
        state[TIMES + j] = state[WORKSPACE + j]
    state[M], state[LAST] = NODES + 1.0, state[TIMES + 3]


@for_python
def integrate_into(places):
    """Take every STRIDE-th of the samples from FIRST on, with the breaks before them, of which USED
    tells how many there were; then, if ENDS, add what is missing up to the last."""
    state, times = pointer_to(places, STATE_AT), pointer_to(places, TIMES_AT)
    values, breaks = pointer_to(places, VALUES_AT), pointer_to(places, BREAKS_AT)
    width, i, used = places[WIDTH], places[FIRST], 0
    while i < places[COUNT]:
        while used < places[BREAKS] and breaks[used] <= times[i]:
            end_piece(state, width, breaks[used])
            used += 1
        found = 0
        if used < places[BREAKS]:
            found = equal_ahead(state, times, places[COUNT], i, places[STRIDE], breaks[used])
        else:
            found = equal_ahead(state, times, places[COUNT], i, places[STRIDE], END)
        if found > 0:
            take_equal(state, width, times, values, i, places[STRIDE], found)
            i += places[STRIDE] * found
        else:
            take(state, width, times[i], part(values, i * width))
            i += places[STRIDE]
    places[USED] = used
    if places[ENDS]:
        end_samples(state, width)
    return 0


# Integrals over samples that come in pieces: arguments and results of `integrate.quadrature`.


NONE = np.zeros(1)
NUMBERS = struct.Struct("=8q")
"""What stands from TIMES_AT on."""


FEW = 32
"""Samples up to which Python takes them: to load the loop takes more than that of all of them."""


class Samples:
    """Samples of functions. t: (n,); values: (n, width)."""

    def __init__(self, t: Any, values: Any) -> None:
        self.arrays = np.ascontiguousarray(t, float), np.ascontiguousarray(values, float)
        self.count = len(t)

    @cached_property
    def places(self) -> tuple[Any, Any]:
        """Where the arrays are."""
        t, values = self.arrays
        return t.ctypes.data, values.ctypes.data

    @property
    def last(self) -> Samples:
        """The last of them."""
        t, values = self.arrays
        return Samples(t[-1:], values[-1:])


class Integral:
    """Integrals of so many functions over samples that come in pieces."""

    def __init__(self, width: int) -> None:
        self._state = np.zeros(COLUMNS + COLUMN * width)
        self._state[LONGEST] = np.inf
        self._width = width
        self._few = np.inf if interpreted() else FEW
        """samples that Python still takes."""
        self._numbers: Any = None
        """places of the loop, and what writes them, once it is needed."""

    def take(
        self, samples: Samples, breaks: Sequence[float] = (), first: int = 0, stride: int = 1
    ) -> int:
        """Take every stride-th of the samples from `first` on; how many breaks are used up.

        breaks: increasing; those beyond the last sample stay.
        """
        self._few -= samples.count
        return self._call(samples, breaks, (samples.count, first, stride, len(breaks), 0))

    def _call(self, samples: Samples, breaks: Sequence[float], numbers: tuple[int, ...]) -> int:
        beside = np.array(breaks, dtype=float) if breaks else NONE
        if self._few >= 0:
            arrays = (array.reshape(-1) for array in (*samples.arrays, beside))
            places: Any = [self._state, self._width, 0, *arrays, *numbers]
            integrate_into.function(places)
            return places[USED]
        if self._numbers is None:
            places = np.zeros(ENDS + 1, np.int64)
            places[STATE_AT], places[WIDTH] = self._state.ctypes.data, self._width
            pack = partial(NUMBERS.pack_into, places, 8 * TIMES_AT)
            self._numbers = places, places.ctypes.data, pack
        places, at, pack = self._numbers
        pack(*samples.places, beside.ctypes.data if breaks else 0, *numbers)
        integrate_into(at)
        return int(places[USED])

    def copy(self) -> Integral:
        """Another one of the same samples."""
        other = Integral(self._width)
        other._state[:], other._few = self._state, self._few
        return other

    def ended(self) -> Any:
        """The columns, (width, COLUMN), with what is missing up to the last sample."""
        other = self.copy()
        other._call(NO_SAMPLES, (), (0, 0, 1, 0, 1))
        return other.columns

    @property
    def columns(self) -> Any:
        """(width, COLUMN)."""
        return self._state[COLUMNS:].reshape(-1, COLUMN)

    def gaps_from(self, longest: float) -> None:
        """Intervals beyond this are gaps from now on."""
        self._state[LONGEST] = longest


NO_SAMPLES = Samples(NONE[:0], NONE[:0, None])
