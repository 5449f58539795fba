"""Where the event functions between two instants are expected to vanish first.

Of every event function the values at both instants are known, and of the gaps of what is in rigid
flight the rates: a cubic through them tells its zero.  The others are taken to differ by a constant
from the cubic over the whole step, values and rates at its ends, and this constant is what was seen
at the nearer instant.  So a handful of states tells the instant to its last digits, however many
contacts there are.
"""

from __future__ import annotations

import numpy as np

from rb_sim.contact.system.bodies import FREE
from rb_sim.contact.system.levels import in_rigid_flight
from rb_sim.contact.system.touch import (
    GAP_RATE,
    GAP_RATE_BEFORE,
    LEVEL_KINDS,
    LEVELS,
    LEVELS_BEFORE,
    SLOPES_BEFORE,
)
from rb_sim.maths.cubic import cubic_at
from rb_sim.maths.jit import inline

LOCATED = 1e-15
"""Depth below zero, in natural units, at which an event counts as located."""
FLOOR = 3e-16
"""Part of the time that is hardly more than its rounding."""
REFINED = 6
"""Steps of Newton's method for the zero of a cubic."""
EARLY, LATE, BEGIN, END = 0, 2, 4, 6
"""Columns of a bracket, of the values and the rates (where they are known) of an event function at
the earlier and the later instant, and at the begin and the end of the step (t in its last row)."""


@inline
def begin_bracket(system, grid, rates, late):
    """The bracket from the begin of the step to `late`, shape (contacts, LEVEL_KINDS + 1, 8).

    After `level_at` at `late`; rates: those at the end of the step.
    """
    touch = system.touch
    bracket = np.full((touch.shape[0], LEVEL_KINDS + 1, 8), FREE)
    for c in range(touch.shape[0]):
        bracket[c, LEVEL_KINDS, BEGIN], bracket[c, LEVEL_KINDS, END] = grid.t0, grid.t1
        for k in range(LEVEL_KINDS):
            bracket[c, k, EARLY] = touch[c, LEVELS_BEFORE + k]
            bracket[c, k, BEGIN] = touch[c, LEVELS_BEFORE + k]
            bracket[c, k, BEGIN + 1] = touch[c, SLOPES_BEFORE + k]
            if late == grid.t1:
                bracket[c, k, END] = touch[c, LEVELS + k]
                bracket[c, k, END + 1] = rates[c, k]
        bracket[c, 0, EARLY + 1] = touch[c, GAP_RATE_BEFORE] / system.length
    note_levels(system, bracket, True)
    return bracket


@inline
def note_levels(system, bracket, late):
    """The event functions as they are in the table of contacts, into one side of the bracket."""
    touch, side = system.touch, LATE if late else EARLY
    for c in range(touch.shape[0]):
        for k in range(LEVEL_KINDS):
            bracket[c, k, side] = touch[c, LEVELS + k]
        bracket[c, 0, side + 1] = touch[c, GAP_RATE] / system.length


@inline
def zero_of(a, ra, b, rb, width, target, s):
    """Where the cubic has the value `target`, by Newton's method from s."""
    for _ in range(REFINED):
        value, slope = cubic_at(a, ra, b, rb, width, s)
        if slope == 0.0:
            break
        s -= (value - target) / slope
    return s


@inline
def crossing(one, step, flies, early, late):
    """(instant at which an event function is expected to vanish, its rate there); one: its row of
    the bracket, step: that of the times, flies: its rates are known."""
    a, b, width = one[EARLY], one[LATE], late - early
    if a < 0.0 and a + one[BEGIN + 1] * width <= 0.0:
        return early, 0.0  # below zero by rounding where the step begins, and does not rise
    part = a / (a - b) if 0.0 < a < FREE else 0.5
    rate = (b - a) / width if a < FREE else -abs(b) / width
    if flies and a < FREE:
        s = zero_of(a, one[EARLY + 1], b, one[LATE + 1], width, 0.0, part)
        slope = cubic_at(a, one[EARLY + 1], b, one[LATE + 1], width, s)[1] / width
        if 0.0 <= s <= 1.0:
            return early + s * width, slope
    elif one[BEGIN] < FREE and one[END] < FREE:
        whole = step[END] - step[BEGIN]
        near, seen = (early, a) if abs(a) < abs(b) else (late, b)
        begin, at_begin, end, at_end = one[BEGIN], one[BEGIN + 1], one[END], one[END + 1]
        expected, _ = cubic_at(begin, at_begin, end, at_end, whole, (near - step[BEGIN]) / whole)
        guess = (early + part * width - step[BEGIN]) / whole
        s = zero_of(begin, at_begin, end, at_end, whole, expected - seen, guess)
        slope = cubic_at(begin, at_begin, end, at_end, whole, s)[1] / whole
        t = step[BEGIN] + s * whole
        if early <= t <= late:
            return t, slope
    return early + part * width, rate


@inline
def first_crossing(system, bracket, early, late):
    """An instant between both at which the first of the event functions is expected to have just
    vanished."""
    first, slope = late, 0.0
    for c in range(bracket.shape[0]):
        flies = in_rigid_flight(system.touch, c)
        for k in range(LEVEL_KINDS):
            if bracket[c, k, LATE] < 0.0:
                t, rate = crossing(
                    bracket[c, k], bracket[c, LEVEL_KINDS], flies and k == 0, early, late
                )
                if t <= first:
                    first, slope = t, rate
    least = FLOOR * abs(late)
    beyond = 0.5 * LOCATED / abs(slope) if slope != 0.0 else 0.0
    t = first + max(beyond, least)
    if not t < late:
        t = late - 2.0 * max(beyond, least)
    if not early < t < late:
        t = 0.5 * (early + late)
    return t
