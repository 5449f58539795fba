"""The kernel of `integrate.record` for bodies in contact: it stops at the instant of an event.

Between events the equations are smooth, so every method keeps its order.  After each step the event
functions (gap, normal force, distance to the friction bound, slip along its direction) are read; if
one has become negative, the first zero in the step is found by further steps of the method from the
same grid point, as samples are, to the last digits of the time.
"""

from __future__ import annotations

import numpy as np

from rb_sim.engine.integrate import (
    FINE,
    NOT_FINITE,
    PIECE_STEPS,
    ULPS,
    UNFINISHED,
    Grid,
    advance_grid,
    state_at,
)
from rb_sim.engine.methods.method import increment
from rb_sim.engine.methods.tuples import accumulate, copy, finite
from rb_sim.engine.system import sample, settle
from rb_sim.engine.systems import contact_motion  # noqa: F401  (registers its kernels)
from rb_sim.engine.systems.contact_bodies import (
    BOUNDS,
    CLOSED,
    EVENT_KINDS,
    FREE,
    GAP,
    GAP_BEFORE,
    GAP_RATE,
    GAP_RATE_BEFORE,
    JAMMED,
    JAMS,
    LEVELS,
    LEVELS_BEFORE,
    ROLL_ENDS,
    SLIDE,
    SLIDING,
    SLIP,
    SLIP_ENDS,
    SLOPES_BEFORE,
    SPEED_BEFORE,
    STATIC,
    STOPPED,
    approach,
    bound_rates,
    contact_accelerations,
    look_ahead,
    lowest_level,
    relative_speed,
    unconstrained,
)
from rb_sim.engine.systems.many_bodies import vec
from rb_sim.engine.systems.multipliers import write_rows
from rb_sim.maths.held import hold
from rb_sim.maths.jit import entry, inline, plain
from rb_sim.maths.vectors import norm

EVENT = 4
"""Status: a contact changes its mode at t1."""
RECORD, WRITE, UNCONSTRAINED, ACCELERATE, SETTLE, BEGIN = 0, 1, 2, 3, 4, 5
"""Tasks of the kernel: run; or write the lines, the accelerations without and with reactions, bring
y back to the manifold, or begin a step."""
SLACK = 1e-12
"""Depth of an event function below zero, in natural units, that is round-off."""
LOCATED = 1e-15
"""The same, at which an event counts as located."""
DIP_ROUNDS, DIP_DEPTH, DIP_SHORT = 120, 40, 0.1
"""Halvings of a step in search of the least gap in it; parts kept at a time; way of the surfaces
in a part, in lengths of the scene, below which a gap that does not fall at first does not dip."""
SAG_ROUNDS, SAG_TRUST, SAG_FOUND = 12, 0.5, 0.1
"""Rounds in search of a force's least distance to its bound; part of the change of that distance
over the bracket above which its cubic is trusted to stay clear of zero; part of the least distance
to which it is found."""

GRADE, ROUGH, APPROACH = 4.0, 0.1, 1e-10
"""The direction of a slip that vanishes is lost in rounding at the very end, and may turn ever
faster before: steps towards that instant, located to the part ROUGH of what is left, shrink by
GRADE each, down to APPROACH (natural units)."""

JAM_PART, JAM_PASS = 0.5, 1.5
"""Parts of the time in which an effective pivot would vanish that one step may take, and that
the last one takes: beyond, the force would pass through infinity unseen."""
JAM_BOUND = BOUNDS.index(JAMS)

RETRIES = 20
"""Steps tried, each shorter by GRADE, where one has no solution."""


@plain
def branch(method, system, grid, t, work, y, c):
    """y = the state at t, by one step from t0; c is work space."""
    copy(y, grid.y0)
    copy(c, grid.c0)
    dy = increment(method, system, grid.t0, grid.y0, t - grid.t0, work)
    accumulate(y, dy, c)
    settle(system, t, y)


@plain
def level_of(system, t, y):
    """(lowest event function, its code) of the state y at t."""
    contact_accelerations(system, t, y)
    return lowest_level(system)


@plain
def begin_step(system, t, y):
    """Bring the tables up to date at (t, y), from where the next step starts."""
    level_of(system, t, y)
    look_ahead(system, bound_rates(system, t, y))


@plain
def level_at(method, system, grid, t, work, y, c):
    """(lowest event function, its code) at t; y = the state there."""
    branch(method, system, grid, t, work, y, c)
    return level_of(system, t, y)


@inline
def may_have_touched(touch, c, width):
    """Open at both ends of the step, leaving at the last, and not too far away."""
    if touch[c, CLOSED] == 1.0 or not touch[c, GAP_RATE] > 0.0:
        return False
    fastest = max(touch[c, SPEED_BEFORE], relative_speed(touch, c))
    return touch[c, GAP_BEFORE] + touch[c, GAP] < fastest * width


@inline
def push_span(spans, top, early, late):
    """Put (t, gap, its rate, relative speed) at both ends on the stack; returns its new height."""
    for j in range(4):
        spans[top, j], spans[top, 4 + j] = early[j], late[j]
    return top + 1


@plain
def dip(method, system, grid, work, y, c):
    """The earliest time within the step at which a contact that is open at both ends overlaps; t1
    if there is none.  After `level_of` at t1; its tables are spoiled only where such a time is
    found.

    Where the gap falls at first, its least is bracketed by the sign of its rate; where it does not
    (thrown up over a sphere), the step is halved, early parts first, down to parts in which little
    moves.  No gap changes faster than the surfaces move, which rules out most parts at once: what
    passes far away costs nothing.
    """
    touch, earliest, some = system.touch, grid.t1, False
    for i in range(touch.shape[0]):
        some = some or may_have_touched(touch, i, grid.t1 - grid.t0)
    if not some:
        return earliest
    ends, spans = touch.copy(), np.empty((DIP_DEPTH, 8))
    for i in range(touch.shape[0]):
        if not may_have_touched(ends, i, grid.t1 - grid.t0):
            continue
        first = (grid.t0, ends[i, GAP_BEFORE], ends[i, GAP_RATE_BEFORE], ends[i, SPEED_BEFORE])
        last = (grid.t1, ends[i, GAP], ends[i, GAP_RATE], relative_speed(ends, i))
        top = push_span(spans, 0, first, last)
        for _ in range(DIP_ROUNDS):
            if top == 0:
                break
            top -= 1
            a = (spans[top, 0], spans[top, 1], spans[top, 2], spans[top, 3])
            b = (spans[top, 4], spans[top, 5], spans[top, 6], spans[top, 7])
            reach = max(a[3], b[3]) * (b[0] - a[0])
            bracket = a[2] < -SLACK * system.speed
            if not b[2] > 0.0 or a[1] + b[1] > reach:
                continue
            if not bracket and (reach < DIP_SHORT * system.length or top + 2 > DIP_DEPTH):
                continue
            t = 0.5 * (a[0] + b[0])
            level_at(method, system, grid, t, work, y, c)
            if approach(system, i) < -SLACK:
                earliest = min(earliest, t)
                break
            m = (t, touch[i, GAP], touch[i, GAP_RATE], relative_speed(touch, i))
            if m[2] < 0.0 or not bracket:
                top = push_span(spans, top, m, b)
            if not (m[2] < 0.0 and bracket):
                top = push_span(spans, top, a, m)
    if earliest == grid.t1:
        level_of(system, grid.t1, grid.y1)
    return earliest


@inline
def least_of_cubic(a, rate_a, b, rate_b, width):
    """(place in 0..1, value) of the least of the cubic through a and b with these rates, of which
    the first is negative and the second positive."""
    m0, m1 = rate_a * width, rate_b * width
    q, r = 3.0 * (b - a) - 2.0 * m0 - m1, m0 + m1 - 2.0 * (b - a)
    turn = q + (q * q - 3.0 * r * m0) ** 0.5
    s = -m0 / turn if turn > 0.0 else 0.5
    return s, a + s * (m0 + s * (q + s * r))


@plain
def sag(method, system, grid, rates, work, y, c):
    """The earliest time within the step at which a force that is within its bound at both ends is
    beyond it; t1 if there is none.

    Where the distance to the bound falls at first and rises at last, its least is sought by cubics
    through values and rates, those at t1 given.  As `dip`, spoils the tables only where such a time
    is found.
    """
    touch, earliest, searched = system.touch, grid.t1, False
    ends = touch.copy()
    for i in range(touch.shape[0]):
        for k in range(len(BOUNDS)):
            early, low, fall = grid.t0, ends[i, LEVELS_BEFORE + k], ends[i, SLOPES_BEFORE + k]
            late, high, rise = grid.t1, ends[i, LEVELS + k], rates[i, k]
            if low == FREE or high == FREE:
                continue
            for _ in range(SAG_ROUNDS):
                if not (fall < 0.0 and rise > 0.0):
                    break
                place, least = least_of_cubic(low, fall, high, rise, late - early)
                if least > SAG_TRUST * (max(low, high) - least):
                    break
                t, searched = early + place * (late - early), True
                level_at(method, system, grid, t, work, y, c)
                level = touch[i, LEVELS + k]
                if level < -SLACK:
                    earliest = min(earliest, t)
                    break
                if abs(level - least) <= SAG_FOUND * level:
                    break
                rate = bound_rates(system, t, y)[i, k]
                if rate < 0.0:
                    early, low, fall = t, level, rate
                else:
                    late, high, rise = t, level, rate
    if searched and earliest == grid.t1:
        level_of(system, grid.t1, grid.y1)
    return earliest


@plain
def cut_grid(grid, t, y, h):
    """The grid with its last step ended at t in the state y; h: the step to try next."""
    y1, c1 = copy(grid.y1, y), grid.c1
    for i in range(c1.shape[0]):
        c1[i] = 0.0
    return Grid(
        grid.origin + (t - grid.t1), grid.steps, grid.rejected, grid.t0, grid.y0, grid.c0,
        t, y1, c1, h, grid.y, grid.c,
    )  # fmt: skip


@plain
def before_jam(system, grid):
    """Where the step has to end, at the latest, not to jump over the instant at which a slipping
    contact jams."""
    touch, last = system.touch, grid.t1
    for c in range(touch.shape[0]):
        level, rate = touch[c, LEVELS_BEFORE + JAM_BOUND], touch[c, SLOPES_BEFORE + JAM_BOUND]
        if touch[c, CLOSED] == 1.0 and 0.0 < level < FREE and rate < 0.0:
            part = JAM_PART if level > JAMMED else JAM_PASS
            last = min(last, grid.t0 - part * level / rate)
    return last


@inline
def slip_vanishes(code):
    kind = code % EVENT_KINDS
    return kind == SLIP_ENDS or kind == ROLL_ENDS


@plain
def next_event(method, system, grid, work):
    """(code of the first event within the last step or -1, the grid, cut there)."""
    lowest, code = level_of(system, grid.t1, grid.y1)
    y, c = np.empty_like(grid.y1), np.empty_like(grid.c1)
    late = dip(method, system, grid, work, y, c)
    if late == grid.t1 and not lowest < -SLACK:
        rates = bound_rates(system, grid.t1, grid.y1)
        late = sag(method, system, grid, rates, work, y, c)
        if late == grid.t1:
            look_ahead(system, rates)
            return -1, grid
    best = np.empty_like(grid.y1)
    if late < grid.t1:
        lowest, code = level_at(method, system, grid, late, work, y, c)
        copy(best, y)
    else:
        copy(best, grid.y1)
    early, high = grid.t0, level_at(method, system, grid, grid.t0, work, y, c)[0]
    low, deepest, found, last = lowest, lowest, code, 0
    approach_time = APPROACH * system.length / system.speed
    for i in range(200):
        width = late - early
        left = late - grid.t0
        graded = slip_vanishes(found) and left > approach_time
        if graded and width <= ROUGH * left:
            break
        if (deepest > -LOCATED and not graded) or width <= 1e-15 * max(abs(late), width):
            break
        t = 0.5 * (early + late)
        if high > SLACK and i % 3 != 2:  # Illinois; every third step bisects
            t = late - width * low / (low - high)
            if not early < t < late:
                t = 0.5 * (early + late)
        level, code = level_at(method, system, grid, t, work, y, c)
        if level < 0.0:
            late, low, deepest, found = t, level, level, code
            copy(best, y)
            high = 0.5 * high if last < 0 else high
            last = -1
        else:
            early, high = t, level
            low = 0.5 * low if last > 0 else low
            last = 1
    left = late - grid.t0
    if slip_vanishes(found) and left > approach_time and early > grid.t0:
        found, late = -1, early - (early - grid.t0) / GRADE
        branch(method, system, grid, late, work, best, c)
    cut = cut_grid(grid, late, best, min(grid.h, 2.0 * left / GRADE))
    if found < 0:
        begin_step(system, late, cut.y1)
    return found, cut


@plain
def nearly_stopped(system):
    """Code of the event that the slip of a contact ends, where it is as good as ended; or -1."""
    for c in range(system.touch.shape[0]):
        if system.touch[c, CLOSED] == 1.0 and system.touch[c, SLIDE] == SLIDING:
            slip = norm(vec(system.touch, c, SLIP))
            if system.touch[c, STATIC] > 0.0 and slip < STOPPED * system.speed:
                return EVENT_KINDS * c + SLIP_ENDS
    return -1


@plain
def shorter_step(method, system, grid, work):
    """(status, event code, grid): the step that failed from t0, as long as it can be.

    An implicit method has no solution across the end of a slip; it comes as near as it likes, and
    what is left is the event.
    """
    y, c = np.empty_like(grid.y1), np.empty_like(grid.c1)
    contact_accelerations(system, grid.t0, grid.y0)
    code, t, status = nearly_stopped(system), grid.t0, NOT_FINITE
    copy(y, grid.y0)
    if code >= 0:
        status = FINE
    for k in range(1, RETRIES):
        if status == FINE:
            break
        t = grid.t0 + (grid.t1 - grid.t0) / GRADE**k
        branch(method, system, grid, t, work, y, c)
        if finite(y):
            status = FINE
    return status, code, cut_grid(grid, t, y, grid.h)


@entry
def record_contacts(method, system, grid, times, stop, sampling, out, work, code, task):
    """As `integrate.record`, up to the next event; code: the event at t1 that is due, or -1.

    Other tasks than RECORD only bring the system's tables up to date at (times[0], grid.y): events
    are handled in Python, with the compiled functions that are here anyhow.
    Returns (grid, status, number of times reached, code of the event that is due or -1).
    """
    system = hold(system, grid.y)
    status = FINE
    reached = 0
    if task == WRITE:
        write_rows(system, times[0], grid.y)
    elif task == UNCONSTRAINED:
        unconstrained(system, times[0], grid.y)
    elif task == ACCELERATE:
        contact_accelerations(system, times[0], grid.y)
    elif task == SETTLE:
        settle(system, times[0], grid.y)
    elif task == BEGIN:
        begin_step(system, times[0], grid.y)
    if task != RECORD:
        return grid, status, reached, code
    last_step = grid.steps + PIECE_STEPS
    for i in range(times.shape[0]):
        t = times[i]
        while grid.t1 < t - ULPS * abs(t) or (code >= 0 and grid.t1 <= t + ULPS * abs(t)):
            if code >= 0:  # before a sample at the same instant, which shows what comes after
                status = EVENT
                break
            if grid.steps >= last_step:
                status = UNFINISHED
                break
            grid, status = advance_grid(method, system, grid, stop, work)
            last = before_jam(system, grid)
            if last < grid.t1:
                y, c = np.empty_like(grid.y1), np.empty_like(grid.c1)
                branch(method, system, grid, last, work, y, c)
                grid, status = cut_grid(grid, last, y, grid.h), FINE if finite(y) else NOT_FINITE
            if status == NOT_FINITE:
                status, code, grid = shorter_step(method, system, grid, work)
            if status != FINE:
                break
            if code < 0:
                code, grid = next_event(method, system, grid, work)
        if status != FINE:
            break
        y = state_at(method, system, grid, t, work)
        grid = Grid(
            grid.origin, grid.steps, grid.rejected, grid.t0, grid.y0, grid.c0,
            grid.t1, grid.y1, grid.c1, grid.h, y, grid.c,
        )  # fmt: skip
        if sampling:
            sample(system, t, y, out[i])
        reached += 1
    return grid, status, reached, code


def kind_of(code: int) -> tuple[int, int]:
    """(contact, kind of event) of a code."""
    return code // EVENT_KINDS, code % EVENT_KINDS
