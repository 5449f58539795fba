"""The loop of `record` in steps of fixed length for several runs at once, on laws in lanes.

A law in lanes (rb_sim.graph.lanes) works on as many runs as a register has numbers.  All lanes have
one clock, and take the steps that `record` takes.
"""

from __future__ import annotations

import math

from rb_sim.graph.lanes import LANES
from rb_sim.loops.compiled import call_law, helper, loop, part, pointer
from rb_sim.loops.places import FINE, LEFT_DOMAIN, NOT_FINITE, ULPS

OPEN = -1
"""Status of a run that has not ended."""
STEP, TIME, SAMPLING, FORCED, TOLERANCE, LARGEST, EXTRA_INPUTS = range(7)
"""Places after the inputs of a law, a vector each: length [s] and start [s] of the attempt; 1 where
it goes to a sample; 1 where it is accepted whatever its error; tolerance; largest step [s]."""
TOTAL, INSIDE, FIXED_EXTRA = range(3)
"""After coordinates and carry, of a fixed step: the sum of y; 0 outside the system's domain."""


@helper
def fill(vector, row, value):
    for lane in range(LANES):
        vector[row * LANES + lane] = value


@helper
def note_fixed(n, new, statuses):
    """Statuses of the lanes that have just ended; returns how many are open."""
    left = 0
    for lane in range(LANES):
        if statuses[lane] != OPEN:
            continue
        if not math.isfinite(new[(2 * n + TOTAL) * LANES + lane]):
            statuses[lane] = NOT_FINITE
        elif new[(2 * n + INSIDE) * LANES + lane] == 0.0:
            statuses[lane] = LEFT_DOMAIN
        else:
            left += 1
    return left


@loop
def fixed(law, h, n, clock, count, buffer, inputs, times, most, out, statuses):
    """Carry LANES runs in steps of h to each of `times`; out: (LANES, times, n) coordinates.

    buffer: three rows (coordinates, carry and FIXED_EXTRA of each lane). clock: both ends of the
    last step; count: steps taken, the row of the later end, times reached; a call that ends after
    `most` steps goes on when it is called again. statuses stay OPEN until the run has ended.
    """
    size = (2 * n + FIXED_EXTRA) * LANES
    rows, p, given = pointer(buffer), pointer(inputs), inputs.shape[0] - EXTRA_INPUTS
    upto = count[0] + most
    while count[2] < times.shape[0]:
        t = times[count[2]]
        while clock[1] < t - ULPS * abs(t):
            if count[0] >= upto:
                return
            fill(p, given + STEP, h)
            fill(p, given + TIME, clock[1])
            old, new = part(rows, count[1] * size), part(rows, (1 - count[1]) * size)
            call_law(law, 0.0, old, p, new)
            count[0] += 1
            count[1] = 1 - count[1]
            clock[0], clock[1] = clock[1], count[0] * h
            if note_fixed(n, new, statuses) == 0:
                return
        old, new = part(rows, (1 - count[1]) * size), part(rows, count[1] * size)
        now = new
        if t < clock[1] - ULPS * abs(t):
            now = old
            if t > clock[0] + ULPS * abs(t):
                now = part(rows, 2 * size)
                fill(p, given + STEP, t - clock[0])
                fill(p, given + TIME, clock[0])
                call_law(law, 0.0, old, p, now)
        for i in range(n):
            for lane in range(LANES):
                out[lane, count[2], i] = now[i * LANES + lane]
        count[2] += 1
    for lane in range(LANES):
        if statuses[lane] == OPEN:
            statuses[lane] = FINE


@loop
def samples(law, n, first, path, inputs_of, times, inputs, buffer, rows, samples_of):
    """Write the samples: samples_of (LANES, times, width) from the coordinates (runs, times, n).

    Of the LANES runs from `first` on; where there are fewer, the last stands for the others.
    """
    p, y, width = pointer(inputs), pointer(buffer), samples_of.shape[2]
    at, m, last, count = pointer(rows), inputs_of.shape[1], path.shape[0] - 1, times.shape[0]
    starts, given, out = pointer(path), pointer(inputs_of), pointer(samples_of)
    for k in range(LANES):
        for i in range(m):
            p[i * LANES + k] = given[min(first + k, last) * m + i]
    for j in range(count):
        fill(p, m + TIME, times[j])
        for k in range(LANES):
            row = (min(first + k, last) * count + j) * n
            for i in range(n):
                y[i * LANES + k] = starts[row + i]
        call_law(law, 0.0, y, p, at)
        for k in range(LANES):
            for i in range(width):
                out[(k * count + j) * width + i] = at[i * LANES + k]
