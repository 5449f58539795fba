"""What stands where in the arrays of the loops: laws, settings, the clock, the states.

Loops take everything as pointers: an array or a tuple goes from function to function number by
number, which would cost more than a step of a small law.
"""

from __future__ import annotations

FINE, NOT_FINITE, STEP_UNDERFLOW, LEFT_DOMAIN = 0, 1, 2, 3
UNFINISHED = 9
"""Status of a call that ends after PIECE_STEPS: called again it goes on as if it had not ended."""
PIECE_STEPS = 2048
ULPS = 1e-15
"""Instants closer than this, relative to the time itself, are one instant."""

RATE, SETTLE, GAP, POSITION, VELOCITY, INSIDE, SAMPLE, WHOLE, JACOBIAN, BACK = range(10)
ALONG, SHARE, CHOICE, EXPAND, ADD, SLOPE, BEGIN, COORDINATES, STEP, LAWS = range(10, 20)
"""Places in `laws`; 0 where there is nothing to call.  WHOLE is a step as one law, `stepped`; BACK
is the way to the manifold from nearby, which writes n coordinates and how far off it they were.
ALONG writes where the state is among the pieces of which a law is made, as WAYS pairs of a
parameter and its rate; SHARE makes of a step's length, the tolerance and the ways at its both ends
the share of the step after which a piece ends.  CHOICE writes the inputs of the next step that say
which of too many lines get a multiplier, and two numbers more.  For a method that steps along a
Taylor series, EXPAND and ADD write and sum it, and SLOPE is dy/dt of what has it; where that are
not the coordinates, BEGIN gives it at the start of a step, and COORDINATES the change of y from its
own."""

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
"""Places in what `record_into` is told: where laws, settings, sizes of a series, clock, counts,
states, inputs, work, the series, the rows of samples and CALL are; how many coordinates, inputs and
numbers of a sample there are (0: nothing is sampled). At REACHED it tells how many of the COUNT
times of this call it has reached; at CALL are, as real numbers, the time beyond which it does not
go, from FIRST_TIME on these times, and at WORST the worst residual, which is the last number of a
sample, of those taken since it was set to zero."""
FIRST_TIME, ROOM = 1, 256
"""ROOM: times of a call for which there is room."""
WORST = FIRST_TIME + ROOM
