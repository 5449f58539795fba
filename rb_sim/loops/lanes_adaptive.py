"""The loop of `record` in steps of adaptive length for several runs at once, on laws in lanes.

Every lane has its own clock, error control and place among its samples; one call of the law is an
attempt of each lane, whatever it is at, and a lane that has ended its run takes the next.  The
steps are those that `record` takes.
"""

from __future__ import annotations

import math

from rb_sim.graph.lanes import LANES
from rb_sim.loops.attempt import root
from rb_sim.loops.compiled import call_law, helper, loop, part, pointer
from rb_sim.loops.lanes import FORCED, LARGEST, OPEN, SAMPLING, STEP, TIME
from rb_sim.loops.places import FINE, LEFT_DOMAIN, NOT_FINITE, STEP_UNDERFLOW, ULPS

ERROR, ACCEPTED, FOLLOWING, WITHIN, ALL, ADAPTIVE_EXTRA = range(6)
"""After old, new and tried coordinates of an attempt: its error in units of the tolerance; 1 where
it is accepted; length of the next attempt [s]; 0 outside the domain; the sum of y."""
IDLE, ADVANCE, SAMPLE, FIRST = range(4)
"""What a lane is at."""
MODE, RUN, REACHED, TRIES, TAKEN, T0, T1, NEXT, TRIED, UNTIL, PLACES = range(11)
"""Rows of `lane`: what it is at, its run, samples reached, attempts, steps; then times [s]: ends of
the last step, step to try next, the one tried and its end."""
NEXT_RUN, BEGUN, RUNS, TIMES, GIVEN, QUEUE = range(6)
"""Places in `queue`: the next run, 1 once lanes have begun; numbers of runs, times and inputs."""
MOST_FIRST = 60
"""Attempts to find a first step."""


@helper
def begin(k, n, lane, state, inputs, starts, given, queue):
    """Lane k takes the next run, if there is one."""
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


@helper
def keep(k, n, lane, state, first, queue, out):
    """The coordinates of lane k from row `first` on become its next sample."""
    row = int(lane[RUN * LANES + k]) * int(queue[TIMES]) + int(lane[REACHED * LANES + k])
    for i in range(n):
        out[row * n + i] = state[(first + i) * LANES + k]
    lane[REACHED * LANES + k] += 1.0


@helper
def end(k, lane, ended, status):
    """The run of lane k has ended; `ended` gets its status and steps."""
    run = int(lane[RUN * LANES + k])
    ended[2 * run] = status
    ended[2 * run + 1] = lane[TAKEN * LANES + k]


@helper
def go_on(k, lane, inputs, m):
    """Lane k attempts a step."""
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


@helper
def attempt(k, inputs, m, start, h, sampling):
    inputs[(m + STEP) * LANES + k] = h
    inputs[(m + TIME) * LANES + k] = start
    inputs[(m + SAMPLING) * LANES + k] = sampling


@helper
def prepare(k, n, lane, state, inputs, starts, given, queue, times, out, ended):
    """Choose what lane k attempts; samples that need no attempt are kept, runs end and begin."""
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


@helper
def cut(k, lane, error):
    """A shorter first step."""
    lane[TRIES * LANES + k] += 1.0
    if math.isfinite(error):
        lane[NEXT * LANES + k] *= min(0.5, max(0.01, 0.9 / root(8.0, error)))
    else:
        lane[NEXT * LANES + k] *= 0.01
    if lane[TRIES * LANES + k] == MOST_FIRST:
        lane[MODE * LANES + k] = ADVANCE
        lane[TRIES * LANES + k] = 0.0


@helper
def take(k, lane, state, last):
    """Lane k has taken its step; returns a status, OPEN where it goes on."""
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


@helper
def judge(k, n, lane, state, queue, out):
    """Accept the attempt of lane k or not; returns a status, OPEN where its run goes on."""
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


@loop
def adaptive(law, n, lanes, buffer, inputs, runs, queue_of, times_of, most, paths, results):
    """Carry all runs to each of `times_of` with a step size of their own; True once all have ended.

    runs: (coordinates (runs, n), inputs of the law (runs, m)); paths: (runs, times, n); results:
    (runs, 2), status and steps.  lanes, buffer (two rows), inputs and queue_of are the lanes' own:
    a call that ends after `most` attempts goes on when it is called again.
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
