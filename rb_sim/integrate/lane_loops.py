# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Stepping loops for several runs at once, on laws in SIMD lanes.

A law in lanes (rb_sim.compiler.graph.vector_code) evaluates one run per lane of a vector register.
With fixed steps all lanes have one clock. The steps are those of `record`.
"""

from __future__ import annotations

import math

from rb_sim.compiler.graph.vector_code import LANES
from rb_sim.integrate.attempt import root
from rb_sim.integrate.layout import FINE, LEFT_DOMAIN, NOT_FINITE, STEP_UNDERFLOW, ULPS
from rb_sim.numerics.kernels import call_law, entry, part, pointer

OPEN = -1
"""Status of an unfinished run."""
STEP, TIME, SAMPLING, FORCED, TOLERANCE, LARGEST, EXTRA_INPUTS = range(7)
"""Indices of further inputs after those of a law, a vector each: length [s] and start [s] of the
attempt; 1 for a step to a sample; 1 if it is accepted with any error; tolerance; largest step
[s]."""
TOTAL, INSIDE, FIXED_EXTRA = range(3)
"""Indices after coordinates and carry of a fixed step: sum of y; 0 outside the system's domain;
their number."""


def fill(vector, row, value):
    """Write one value into all lanes of a row of a vector table."""
    for lane in range(LANES):
        vector[row * LANES + lane] = value


def note_fixed(n, new, statuses):
    """Set the statuses of lanes that have just failed; returns the number of open lanes."""
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


@entry
def fixed(law, h, n, clock, count, buffer, inputs, times, most, out, statuses):
    """Advance LANES runs in fixed steps of h to each of `times`; out: (LANES, times, n)
    coordinates.

    buffer: three rows (coordinates, carry and FIXED_EXTRA of each lane). clock: start and end of
    the last step; count: steps taken, index of the row of its end, times reached. A call ends after
    `most` steps; the next call continues. statuses stay OPEN until a run has ended.
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


@entry
def samples(law, n, first, path, inputs_of, times, inputs, buffer, rows, samples_of):
    """Write samples_of (LANES, times, width) from the coordinates `path` (runs, times, n).

    For the LANES runs from `first` on; missing runs are replaced by the last one.
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


# Adaptive steps for several runs at once, on laws in lanes.
#
# Every lane has its own clock, error control and index of its next sample; one call of the law is
# an attempt of every lane, and a lane whose run has ended starts the next run. The steps are those
# of `record`.


ERROR, ACCEPTED, FOLLOWING, WITHIN, ALL, ADAPTIVE_EXTRA = range(6)
"""Indices after the old, new and tried coordinates of an attempt: its error relative to the
tolerance; 1 if it is accepted; length of the next attempt [s]; 0 outside the domain; sum of y;
their number."""
IDLE, ADVANCE, SAMPLE, FIRST = range(4)
"""Modes of a lane: no run, regular step, step to a sample, first step."""
MODE, RUN, REACHED, TRIES, TAKEN, T0, T1, NEXT, TRIED, UNTIL, PLACES = range(11)
"""Rows of `lane`: mode, run, samples reached, attempts, steps; then times [s]: start and end of the
last step, next step to try, length and end of the one tried."""
NEXT_RUN, BEGUN, RUNS, TIMES, GIVEN, QUEUE = range(6)
"""Indices of `queue`: next run, 1 once the lanes have started; numbers of runs, times and
inputs."""
MOST_FIRST = 60
"""Most attempts to find a first step."""


def begin(k, n, lane, state, inputs, starts, given, queue):
    """Start the next run in lane k, if there is one."""
    run, m = int(queue[NEXT_RUN]), int(queue[GIVEN])
    for i in range(PLACES):
        lane[i * LANES + k] = 0.0
    if run >= int(queue[RUNS]):
        lane[MODE * LANES + k] = IDLE
        return
    queue[NEXT_RUN] = run + 1
    lane[MODE * LANES + k] = FIRST
    lane[RUN * LANES + k] = run
    for i in range(n):
        y = starts[run * n + i]
        state[i * LANES + k] = y
        state[(2 * n + i) * LANES + k] = y
        state[(n + i) * LANES + k] = 0.0
        state[(3 * n + i) * LANES + k] = 0.0
    for i in range(m):
        inputs[i * LANES + k] = given[run * m + i]


def keep(k, n, lane, state, first, queue, out):
    """Store the coordinates of lane k, from row `first` on, as its next sample."""
    row = int(lane[RUN * LANES + k]) * int(queue[TIMES]) + int(lane[REACHED * LANES + k])
    for i in range(n):
        out[row * n + i] = state[(first + i) * LANES + k]
    lane[REACHED * LANES + k] += 1.0


def end(k, lane, ended, status):
    """End the run of lane k: write its status and number of steps into `ended`."""
    run = int(lane[RUN * LANES + k])
    ended[2 * run] = status
    ended[2 * run + 1] = lane[TAKEN * LANES + k]


def go_on(k, lane, inputs, m):
    """Prepare a step of lane k."""
    start, mode = lane[T1 * LANES + k], int(lane[MODE * LANES + k])
    if mode == SAMPLE:
        mode = ADVANCE
    if lane[NEXT * LANES + k] == 0.0:
        mode = FIRST
        lane[NEXT * LANES + k] = inputs[(m + LARGEST) * LANES + k]
    lane[MODE * LANES + k] = mode
    until = start + lane[NEXT * LANES + k]
    tried = until - start
    lane[UNTIL * LANES + k] = until
    lane[TRIED * LANES + k] = tried
    small = not tried > 4.0 * ULPS * max(abs(start), 1e-3)
    attempt(k, inputs, m, start, tried, 0.0)
    inputs[(m + FORCED) * LANES + k] = 1.0 if small and mode == ADVANCE else 0.0


def attempt(k, inputs, m, start, h, sampling):
    """Set start and length [s] of the next attempt of lane k, and whether it leads to a sample."""
    inputs[(m + STEP) * LANES + k] = h
    inputs[(m + TIME) * LANES + k] = start
    inputs[(m + SAMPLING) * LANES + k] = sampling


def prepare(k, n, lane, state, inputs, starts, given, queue, times, out, ended):
    """Prepare the next attempt of lane k; store samples at grid points, end and start runs."""
    m = int(queue[GIVEN])
    while lane[MODE * LANES + k] != IDLE:
        reached = int(lane[REACHED * LANES + k])
        if reached == int(queue[TIMES]):
            end(k, lane, ended, FINE)
            begin(k, n, lane, state, inputs, starts, given, queue)
            continue
        t, t0, t1 = times[reached], lane[T0 * LANES + k], lane[T1 * LANES + k]
        slack = ULPS * abs(t)
        if t1 < t - slack:
            go_on(k, lane, inputs, m)
            return
        if t >= t1 - slack:
            keep(k, n, lane, state, 2 * n, queue, out)
        elif t <= t0 + slack:
            keep(k, n, lane, state, 0, queue, out)
        else:
            lane[MODE * LANES + k] = SAMPLE
            attempt(k, inputs, m, t0, t - t0, 1.0)
            return
    attempt(k, inputs, m, 0.0, 0.0, 1.0)


def cut(k, lane, error):
    """Shorten the first step of lane k after a rejected attempt."""
    lane[TRIES * LANES + k] += 1.0
    if math.isfinite(error):
        lane[NEXT * LANES + k] *= min(0.5, max(0.01, 0.9 / root(8.0, error)))
    else:
        lane[NEXT * LANES + k] *= 0.01
    if lane[TRIES * LANES + k] == MOST_FIRST:
        lane[MODE * LANES + k] = ADVANCE
        lane[TRIES * LANES + k] = 0.0


def take(k, lane, state, last):
    """Accept the step of lane k; returns a status, OPEN if its run continues."""
    following = state[(last + FOLLOWING) * LANES + k]
    if lane[MODE * LANES + k] == ADVANCE and lane[TRIES * LANES + k] > 0.0:
        following = min(following, lane[TRIED * LANES + k])
    lane[NEXT * LANES + k] = following
    lane[T0 * LANES + k] = lane[T1 * LANES + k]
    lane[T1 * LANES + k] = lane[UNTIL * LANES + k]
    lane[TAKEN * LANES + k] += 1.0
    lane[TRIES * LANES + k] = 0.0
    lane[MODE * LANES + k] = ADVANCE
    if not math.isfinite(state[(last + ALL) * LANES + k]):
        return NOT_FINITE
    if state[(last + WITHIN) * LANES + k] == 0.0:
        return LEFT_DOMAIN
    return OPEN if state[(last + ERROR) * LANES + k] <= 1.0 else STEP_UNDERFLOW


def judge(k, n, lane, state, queue, out):
    """Evaluate the attempt of lane k; returns a status, OPEN if its run continues."""
    last, mode = 6 * n, int(lane[MODE * LANES + k])
    if mode == SAMPLE:
        keep(k, n, lane, state, 4 * n, queue, out)
    elif state[(last + ACCEPTED) * LANES + k] != 0.0:
        return take(k, lane, state, last)
    elif mode == FIRST:
        cut(k, lane, state[(last + ERROR) * LANES + k])
    else:
        lane[NEXT * LANES + k] = state[(last + FOLLOWING) * LANES + k]
        lane[TRIES * LANES + k] += 1.0
    return OPEN


@entry
def adaptive(law, n, lanes, buffer, inputs, runs, queue_of, times_of, most, paths, results):
    """Advance all runs to each of `times_of` with adaptive steps; True once all have ended.

    runs: (coordinates (runs, n), inputs of the law (runs, m)); paths: (runs, times, n); results:
    (runs, 2), status and steps. lanes, buffer (two rows), inputs and queue_of hold the state of the
    lanes: a call ends after `most` attempts, and the next call continues.
    """
    size = (6 * n + ADAPTIVE_EXTRA) * LANES
    rows, p, lane, queue = pointer(buffer), pointer(inputs), pointer(lanes), pointer(queue_of)
    starts, given, times = pointer(runs[0]), pointer(runs[1]), pointer(times_of)
    out, ended = pointer(paths), pointer(results)
    a, b = rows, part(rows, size)
    if queue[BEGUN] == 0.0:
        queue[BEGUN] = 1.0
        for k in range(LANES):
            begin(k, n, lane, a, p, starts, given, queue)
            prepare(k, n, lane, a, p, starts, given, queue, times, out, ended)
    for _ in range(most):
        call_law(law, 0.0, a, p, b)
        a, b = b, a
        active = 0
        for k in range(LANES):
            if lane[MODE * LANES + k] == IDLE:
                continue
            active += 1
            status = judge(k, n, lane, a, queue, out)
            if status != OPEN:
                end(k, lane, ended, status)
                begin(k, n, lane, a, p, starts, given, queue)
            prepare(k, n, lane, a, p, starts, given, queue, times, out, ended)
        if active == 0:
            return True
    for i in range(4 * n * LANES):
        rows[i] = a[i]
    return False
