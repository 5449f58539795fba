# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Memory layout of the loops: where laws, settings, clock, states and tables lie."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rb_sim.compiler import arrays
from rb_sim.compiler import builder as k
from rb_sim.compiler.builder import PackedSystem, Value
from rb_sim.compiler.calls import means
from rb_sim.numerics.kernels import helper

# Rows of the work array, n numbers each, that every step finds.


IS_VELOCITY = 0
"""1 where the coordinate is a velocity, 0 where it is configuration."""
FLOOR = 1
"""size of a coordinate below which its error is no longer relative to it but to this."""
START = 2
"""what a coordinate is counted from."""
SHARE_OF_WAY = 3
"""share of its way from there to which its error is relative."""
AT = 4
"""the argument of a stage; free between two calls."""
DY = 5
"""the increment."""
SLOPES = 6
"""first of SLOPE_ROWS rows for the slopes of the stages."""
SLOPE_ROWS = 16
WORK_ROWS = SLOPES + SLOPE_ROWS


@helper
def size_of(n, y, work, m):
    """The size to which the error of coordinate m is relative."""
    way = work[SHARE_OF_WAY * n + m] * abs(y[m] - work[START * n + m])
    return max(work[FLOOR * n + m], way)


# What stands where in the arrays of the loops: laws, settings, the clock, the states.
#
# Loops take everything as pointers: an array or a tuple goes from function to function number by
# number, which would cost more than a step of a small law.


FINE, NOT_FINITE, STEP_UNDERFLOW, LEFT_DOMAIN = 0, 1, 2, 3
UNFINISHED = 9
"""Status of a call that ends after PIECE_STEPS: called again it goes on as if it had not ended."""
PIECE_STEPS = 2048
ULPS = 1e-15
"""Instants closer than this, relative to the time itself, are one instant."""

RATE, SETTLE, GAP, POSITION, VELOCITY, INSIDE, SAMPLE, WHOLE, JACOBIAN, BACK = range(10)
ALONG, SHARE, CHOICE, EXPAND, ADD, SLOPE, BEGIN, COORDINATES, STEP, LAWS = range(10, 20)
"""Places in `laws`; 0 where there is nothing to call. WHOLE is a step as one law, `stepped`; BACK
is the way to the manifold from nearby, which writes n coordinates and how far off it they were.
ALONG writes where the state is among the pieces of which a law is made, as WAYS pairs of a
parameter and its rate; SHARE makes of a step's length, the tolerance and the ways at its both ends
the share of the step after which a piece ends.  CHOICE writes the inputs of a step that are kept
from the one before or chosen for each: turns of torsion springs, and which of too many rows get a
multiplier; two numbers more may follow.  For a method that steps along a Taylor series, EXPAND and
ADD write and sum it, and SLOPE is dy/dt of what has it; where that are not the coordinates, BEGIN
gives it at the start of a step, and COORDINATES the change of y from its own."""

ORIGIN, T0, T1, NEXT, CLOCKS = range(5)
"""Places in `clock`: start of the grid, last step, step to try next (0 before the first) [s]."""
TAKEN, REJECTED, END, CUT, COUNTS = range(5)
"""Places in `count`; END tells which row of `states`, 0 or 1, is the end of the last step.  CUT
counts those of the rejected attempts that only went beyond the end of a piece."""

NOW, STATES = 2, 3
"""Rows of `states`: two for the ends of the last step, one for the time last asked for; each is
y (n), what compensated summation has still to add to it (n), and EXTRA numbers of the step."""
EXTRA = 2
"""After y and carry: the sum of y, which tells whether all are finite, and the error estimate."""

STEP_LENGTH, TOLERANCE, LARGEST, ORDER, LENGTH, WAYS, CHOSEN, SETTINGS = range(8)
"""Places in `setting`: fixed step [s]; or tolerance (0 for a fixed step), largest step [s] and
order of the error estimate; the length of the scene, for the way back to the manifold [m]; pairs
that ALONG writes; how many of the inputs, the last but that of the step's length, CHOICE writes."""

LAWS_AT, SETTING_AT, SIZES_AT, CLOCK_AT, COUNT_AT, STATE_AT = range(6)
INPUTS_AT, WORK_AT, SERIES_AT, ROWS_AT, CALL_AT = range(6, 11)
COORDINATE_COUNT, INPUT_COUNT, WIDTH, REACHED, COUNT, CALL = range(11, 17)
"""Places in the arguments of `record_into`: where laws, settings, sizes of a series, clock, counts,
states, inputs, work, the series, the rows of samples and CALL are; how many coordinates, inputs and
numbers of a sample there are (0: nothing is sampled). At REACHED it tells how many of the COUNT
times of this call it has reached; at CALL are, as real numbers, the time beyond which it does not
go, from FIRST_TIME on these times, and at WORST the worst residual, which is the last number of a
sample, of those taken since it was set to zero."""
FIRST_TIME, CAPACITY = 1, 256
"""CAPACITY: the most times of one call."""
WORST = FIRST_TIME + CAPACITY


# Systems as loops pass them on: one address, behind which numbers and tables are packed.
#
# A system of many tables goes from function to function as the address of its `Layout`; its tables
# are read from there where they are used.  Whoever calls a loop holds the arrays.


REAL, INTEGER = "real", "integer"
"""Kinds of fields that are one number; tables are ("real", dimensions) or ("integer", ...)."""
_NUMBERS = {REAL: k.REAL, INTEGER: k.INTEGER}
_ARRAYS: dict[str, Any] = {REAL: np.float64, INTEGER: np.int64}


def held(vector):
    """The system whose packed layout begins here; interpreted, the system itself."""
    return vector


@means(held)
def _held(f: Any, vector: Value) -> Value:
    return Value(PackedSystem(), (vector.leaves[0],))


def held_at(places, i):
    """As `held`, of the layout whose address is among the places, at i."""
    return places[i]


@means(held_at)
def _held_at(f: Any, places: Value, i: Value) -> Value:
    return Value(PackedSystem(), arrays.as_kind(f, arrays.entry(f, places, [i]), k.VECTOR).leaves)


def address(system):
    """Where the packed layout of the system begins; interpreted, the system itself."""
    return system


@means(address)
def _address(f: Any, system: Value) -> Value:
    return Value(k.VECTOR, system.leaves)


def _slots(kind: Any) -> int:
    return 1 if isinstance(kind, str) else 1 + kind[1]


class Layout:
    """Names and kinds of the fields of a system; loops read them as attributes."""

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
        """The system as numbers; arrays by address, which the caller keeps alive."""
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
