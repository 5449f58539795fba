# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Memory layout of the loops: laws, settings, clock, states and tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rb_sim.compiler import arrays
from rb_sim.compiler import builder as k
from rb_sim.compiler.builder import PackedSystem, Value
from rb_sim.compiler.calls import means

# Rows of the work array, of n numbers each, that every step uses.


IS_VELOCITY = 0
"""1 for a coordinate that is a velocity, 0 for configuration."""
FLOOR = 1
"""least scale to which the error of a coordinate is relative."""
START = 2
"""reference value of a coordinate for its error scale."""
SHARE_OF_WAY = 3
"""weight of the distance from START in the error scale."""
AT = 4
"""argument of a stage; free between two calls."""
DY = 5
"""increment of the step."""
SLOPES = 6
"""first of SLOPE_ROWS rows of the slopes of the stages."""
SLOPE_ROWS = 16
WORK_ROWS = SLOPES + SLOPE_ROWS


def size_of(n, y, work, m):
    """Scale to which the error of coordinate m is relative."""
    way = work[SHARE_OF_WAY * n + m] * abs(y[m] - work[START * n + m])
    return max(work[FLOOR * n + m], way)


# Indices of the arrays of the loops: laws, settings, clock, states.
#
# Loops take everything as pointers: arrays and tuples are passed number by number, which would cost
# more than a step of a small law.


FINE, NOT_FINITE, STEP_UNDERFLOW, LEFT_DOMAIN = 0, 1, 2, 3
UNFINISHED = 9
"""Status of a call that ended after PIECE_STEPS steps: the next call continues the run."""
PIECE_STEPS = 2048
ULPS = 1e-15
"""Relative difference up to which two instants are equal."""

RATE, SETTLE, GAP, POSITION, VELOCITY, INSIDE, SAMPLE, WHOLE, JACOBIAN, BACK = range(10)
ALONG, SHARE, CHOICE, EXPAND, ADD, SLOPE, BEGIN, COORDINATES, STEP, LAWS = range(10, 20)
"""Indices of `laws`; 0 for a law that does not exist.

WHOLE is a step as one law (ReducedLaws.whole). BACK projects onto the manifold from nearby: it
writes n coordinates and the error before. ALONG writes the position of the state among the pieces
of laws, as WAYS pairs of a parameter and its rate; SHARE takes a step's length, the tolerance and
these pairs at both ends, and gives the fraction of the step after which a piece ends. CHOICE writes
the inputs that are carried over from step to step or chosen for each: turns of torsion springs, and
which redundant rows get a multiplier; two further numbers may follow. For a method that uses a
Taylor series, EXPAND and ADD write and sum it, and SLOPE is dy/dt of its variables; if these are
not the coordinates, BEGIN gives them at the start of a step, and COORDINATES the change of y from
theirs.
"""

ORIGIN, T0, T1, NEXT, CLOCKS = range(5)
"""Indices of `clock`: start of the grid, start and end of the last step, next step to try (0 before
the first) [s]."""
TAKEN, REJECTED, END, CUT, COUNTS = range(5)
"""Indices of `count`; END is the row of `states`, 0 or 1, that is the end of the last step. CUT
counts the rejected attempts that only crossed the end of a piece."""

NOW, STATES = 2, 3
"""Rows of `states`: two for the ends of the last step, row NOW for the time requested last; each
holds y (n), the carry of compensated summation (n), and EXTRA numbers of the step."""
EXTRA = 2
"""Numbers after y and carry: the sum of y, not finite if any entry is not, and the error
estimate."""

STEP_LENGTH, TOLERANCE, LARGEST, ORDER, LENGTH, WAYS, CHOSEN, SETTINGS = range(8)
"""Indices of `setting`: fixed step [s]; tolerance (0 for a fixed step), largest step [s] and order
of the error estimate; length of the scene, for the projection onto the manifold [m]; number of
pairs that ALONG writes; number of inputs, before the length of the step, that CHOICE writes."""

LAWS_AT, SETTING_AT, SIZES_AT, CLOCK_AT, COUNT_AT, STATE_AT = range(6)
INPUTS_AT, WORK_AT, SERIES_AT, ROWS_AT, CALL_AT = range(6, 11)
COORDINATE_COUNT, INPUT_COUNT, WIDTH, REACHED, COUNT, CALL = range(11, 17)
"""Indices of the arguments of `record_into`.

Addresses: laws, settings, sizes of a series, clock, counts, states, inputs, work, the series, rows
of samples, CALL. Numbers: of coordinates, of inputs, of a sample (0: no samples). REACHED: output,
how many of the COUNT times of this call were reached. CALL (real numbers): the time not to be
exceeded, the times from FIRST_TIME on, and at WORST the largest residual (last number of a sample)
since it was set to zero.
"""
FIRST_TIME, CAPACITY = 1, 256
"""CAPACITY is the largest number of times of one call."""
WORST = FIRST_TIME + CAPACITY


# Systems as loops pass them: one address of packed numbers and tables.
#
# A system of many tables is passed as the address of its `Layout`; its tables are read where they
# are used. The caller of a loop keeps the arrays alive.


REAL, INTEGER = "real", "integer"
"""Kinds of fields that are single numbers; tables are ("real", dimensions) or ("integer", ...)."""
_NUMBERS = {REAL: k.REAL, INTEGER: k.INTEGER}
_ARRAYS: dict[str, Any] = {REAL: np.float64, INTEGER: np.int64}


def held(vector):
    """The system whose packed layout starts at this address; if interpreted, the system itself."""
    return vector


@means(held)
def _held(f: Any, vector: Value) -> Value:
    return Value(PackedSystem(), (vector.leaves[0],))


def held_at(places, i):
    """As `held`, for the layout whose address is places[i]."""
    return places[i]


@means(held_at)
def _held_at(f: Any, places: Value, i: Value) -> Value:
    return Value(PackedSystem(), arrays.as_kind(f, arrays.entry(f, places, [i]), k.VECTOR).leaves)


def address(system):
    """Address of the packed layout of a system; if interpreted, the system itself."""
    return system


@means(address)
def _address(f: Any, system: Value) -> Value:
    return Value(k.VECTOR, system.leaves)


def _slots(kind: Any) -> int:
    return 1 if isinstance(kind, str) else 1 + kind[1]


class Layout:
    """Names and kinds of the fields of a system, which loops read as attributes."""

    def __init__(self, fields: Mapping[str, Any]) -> None:
        self.fields = dict(fields)
        at = 0
        for name, kind in self.fields.items():
            number = isinstance(kind, str)
            found = _NUMBERS[kind] if number else k.Array(kind[0], kind[1])
            if arrays.FIELDS.setdefault(name, (found, at)) != (found, at):
                raise ValueError(f"{name}: a field of another layout, which lies elsewhere")
            at += _slots(kind)
        self.size = at

    def pack(self, values: Mapping[str, Any]) -> np.ndarray:
        """The system as packed numbers; arrays by address, which the caller keeps alive."""
        packed = np.zeros(self.size, np.int64)
        at = 0
        for name, kind in self.fields.items():
            value = values[name]
            if kind == REAL:
                packed[at : at + 1].view(np.float64)[0] = value
            elif kind == INTEGER:
                packed[at] = value
            else:
                if value.dtype != _ARRAYS[kind[0]] or not value.flags.c_contiguous:
                    raise TypeError(f"{name}: must be a contiguous table of {kind[0]} numbers")
                packed[at] = value.ctypes.data
                packed[at + 1 : at + 1 + kind[1]] = value.shape
            at += _slots(kind)
        return packed.view(np.float64)
