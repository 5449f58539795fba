"""As `loops.record`, for bodies in contact: it stops at the instant of an event.

Between events the equations are smooth, so every method keeps its order.  After each step the event
functions (gap, normal force, distance to the friction bound, slip along its direction) are read; if
one has become negative, the first zero in the step is found by further steps of the method from the
same grid point, as samples are, to the last digits of the time.
"""

from __future__ import annotations

import numpy as np

from rb_sim.compiler.builder import Value
from rb_sim.compiler.calls import means
from rb_sim.compiler.kinds import PackedSystem
from rb_sim.contact.events.bracket import LOCATED, begin_bracket, first_crossing, note_levels
from rb_sim.contact.events.grid import Grid, advance_grid, branch, copy, finite, state_at
from rb_sim.contact.events.search import SLACK, first_dip, level_at, level_of
from rb_sim.contact.events.stops import FAINT, before_stop, stop_that_is_due
from rb_sim.contact.geometry.rims import FLAT
from rb_sim.contact.system import rates as _registers_its_kernels  # noqa: F401
from rb_sim.contact.system.accelerations import contact_accelerations
from rb_sim.contact.system.bodies import (
    EVENT_KINDS,
    FREE,
    JAMMED,
    JAMS,
    NEAR_JAM,
    ROLL_ENDS,
    SLIP_ENDS,
    STOPPED,
)
from rb_sim.contact.system.levels import level_rates, look_ahead
from rb_sim.contact.system.terms import SLIDING
from rb_sim.contact.system.touch import (
    AT_JAM,
    AT_SLIP,
    AXIS,
    CLOSED,
    LEAN_BEFORE,
    LEVELS,
    LEVELS_BEFORE,
    NORMAL,
    RIM,
    SENSE,
    SLIDE,
    SLIP,
    SLOPES_BEFORE,
    STATIC,
    TURN,
)
from rb_sim.engine.system import sample
from rb_sim.engine.systems.many_bodies import vec
from rb_sim.loops.places import FINE, NOT_FINITE, PIECE_STEPS, STEP_UNDERFLOW, ULPS, UNFINISHED
from rb_sim.maths.jit import entry, inline, plain
from rb_sim.maths.vectors import dot, norm, scale, sub

EVENT = 4
"""Status: a contact changes its mode at t1."""
GRADE, ROUGH, APPROACH = 4.0, 0.1, 1e-10
"""The direction of a slip that vanishes is lost in rounding at the very end, and may turn ever
faster before: steps towards that instant, located to the part ROUGH of what is left, shrink by
GRADE each, down to APPROACH (natural units)."""

JAM_PART, JAM_PASS = 0.5, 1.5
"""Parts of the time in which an effective pivot would vanish that one step may take, and that
the last one takes: beyond, the force would pass through infinity unseen."""

TURNED, STRAIGHT, HALVINGS = 0.5, 0.75, 40
"""Cosine of the angle by which the lean of a rim that is held may turn in a step; part of its way
that it has come when it has gone straight through flat; and the most halvings of a longer step."""

FOLLOWED = 0.5
"""Part of the fall that its rate tells of a slip, which it follows where it is no rounding."""
RETRIES = 20
"""Steps tried, each shorter by GRADE, where one has no solution."""


@plain
def begin_step(system, t, y, c):
    """Bring the tables up to date at (t, y), from where the next step starts; c: the low digits of
    y."""
    level_of(system, t, y, c)
    look_ahead(system, level_rates(system, t, y))


@plain
def cut_grid(grid, t, y, c, h):
    """The grid with its last step ended at t in the state y with the low digits c; h: the step to
    try next."""
    y1, c1 = copy(grid.y1, y), copy(grid.c1, c)
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
        level, rate = touch[c, LEVELS_BEFORE + AT_JAM], touch[c, SLOPES_BEFORE + AT_JAM]
        if touch[c, CLOSED] == 1.0 and 0.0 < level < FREE and rate < 0.0:
            part = JAM_PART if level > JAMMED else JAM_PASS
            last = min(last, grid.t0 - part * level / rate)
    return last


@plain
def jam_that_is_due(system):
    """Code of the event that a slipping contact jams, where its pivot vanishes faster than the
    clock can tell; or -1.

    Its force turns the slip, so that the pivot vanishes as the root of the time left: no step that
    changes t may bring it down to JAMMED.
    """
    touch = system.touch
    for c in range(touch.shape[0]):
        if touch[c, CLOSED] == 1.0 and touch[c, LEVELS_BEFORE + AT_JAM] < NEAR_JAM:
            return EVENT_KINDS * c + JAMS
    return -1


@plain
def rim_turned_too_far(system, width):
    """True if the lean of a rim that is held has turned so far in the step, of this width, that its
    low point may have been taken for the high one: it may lean the other way for having gone
    straight through flat, or for having turned round."""
    touch = system.touch
    for c in range(touch.shape[0]):
        if touch[c, RIM] < 0.0 or touch[c, CLOSED] == 0.0:
            continue
        axis, before = vec(touch, c, AXIS), vec(touch, c, LEAN_BEFORE + 3)
        if norm(axis) == 0.0 and norm(before) == 0.0:
            continue  # on what is round a rim is told by its half, not by its lean
        if touch[c, SENSE] != touch[c, LEAN_BEFORE + 6]:
            turn, n = vec(touch, c, TURN), vec(touch, c, NORMAL)
            way = norm(sub(turn, scale(dot(turn, n), n))) * width
            if norm(sub(axis, before)) < STRAIGHT * way:
                return True
        elif dot(axis, before) < TURNED * norm(axis) * norm(before):
            return norm(axis) > FLAT and norm(before) > FLAT
    return False


@plain
def not_too_far(method, system, grid, work, y, c):
    """(lowest event function, its code, the grid with its last step no longer than the leans of the
    rims allow); the tables are those of its end."""
    lowest, code = level_of(system, grid.t1, grid.y1, grid.c1)
    for _ in range(HALVINGS):
        if not rim_turned_too_far(system, grid.t1 - grid.t0):
            break
        t = 0.5 * (grid.t0 + grid.t1)
        lowest, code = level_at(method, system, grid, t, work, y, c)
        grid = cut_grid(grid, t, y, c, grid.h)
    return lowest, code, grid


@inline
def slip_vanishes(code):
    kind = code % EVENT_KINDS
    return kind == SLIP_ENDS or kind == ROLL_ENDS


@inline
def is_none(width, t):
    """True if a span of time that ends at t is but its rounding."""
    return width <= 1e-15 * max(abs(t), width)


@plain
def next_event(method, system, grid, work):
    """(code of the first event within the last step or -1, the grid, cut there)."""
    y, c = np.empty_like(grid.y1), np.empty_like(grid.c1)
    lowest, code, grid = not_too_far(method, system, grid, work, y, c)
    rates = level_rates(system, grid.t1, grid.y1)
    late = first_dip(method, system, grid, rates, work, y, c)
    if late == grid.t1 and not lowest < -SLACK:
        lost = slip_that_is_lost(system, grid.t1 - grid.t0)
        look_ahead(system, rates)
        return lost if lost >= 0 else stop_that_is_due(method, system), grid
    best, low = grid.y1.copy(), grid.c1.copy()
    if late < grid.t1:
        lowest, code = level_at(method, system, grid, late, work, y, c)
        copy(best, y)
        copy(low, c)
    bracket = begin_bracket(system, grid, rates, late)
    early, deepest, found = grid.t0, lowest, code
    approach_time = APPROACH * system.length / system.speed
    for i in range(200):
        width = late - early
        left = late - grid.t0
        graded = slip_vanishes(found) and left > approach_time
        if graded and width <= ROUGH * left:
            break
        if (deepest > -LOCATED and not graded) or is_none(width, late):
            break
        t = 0.5 * (early + late)
        if i % 3 != 2:  # every third step bisects
            t = first_crossing(system, bracket, early, late)
        level, code = level_at(method, system, grid, t, work, y, c)
        note_levels(system, bracket, level < 0.0)
        if level < 0.0:
            late, deepest, found = t, level, code
            copy(best, y)
            copy(low, c)
        else:
            early = t
    left = late - grid.t0
    if slip_vanishes(found) and left > approach_time and early > grid.t0:
        found, late = -1, early - (early - grid.t0) / GRADE
        branch(method, system, grid, late, work, best, low)
    at_once = early == grid.t0 and is_none(left, late)
    h = grid.h if at_once else min(grid.h, 2.0 * left / GRADE)
    cut = cut_grid(grid, late, best, low, h)
    if found < 0:
        begin_step(system, late, cut.y1, cut.c1)
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
def slip_that_is_lost(system, width):
    """Code of the event that a slip ends which was to fall in the step, of this width, is lost in
    the method's errors, and did not; or -1.

    Its direction is then kept from before, and where friction along that one drives it off
    sideways, it is turned back as soon as it is seen: so on, without end.
    """
    touch = system.touch
    for c in range(touch.shape[0]):
        if touch[c, CLOSED] == 0.0 or touch[c, SLIDE] != SLIDING or touch[c, STATIC] == 0.0:
            continue
        before, level = touch[c, LEVELS_BEFORE + AT_SLIP], touch[c, LEVELS + AT_SLIP]
        rate = touch[c, SLOPES_BEFORE + AT_SLIP]
        fall = rate * width if rate < -FAINT else 0.0
        lost = norm(vec(touch, c, SLIP)) <= system.still
        if lost and fall < 0.0 and level > before + FOLLOWED * fall:
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
    copy(c, grid.c0)
    if code >= 0:
        status = FINE
    for k in range(1, RETRIES):
        if status == FINE:
            break
        t = grid.t0 + (grid.t1 - grid.t0) / GRADE**k
        branch(method, system, grid, t, work, y, c)
        if finite(y):
            status = FINE
    return status, code, cut_grid(grid, t, y, c, grid.h)


def system_of(packed):
    """The system that is packed; interpreted, it comes as it is."""
    return packed


@means(system_of)
def _system_of(f, packed):
    return Value(PackedSystem(), (packed.leaves[0],))


@entry
def record_contacts(method, packed, grid, times, stop, sampling, out, work, code):
    """Integrate to each of `times` and sample there if `sampling`, up to the next event.

    packed: the system as its layout has it. code: the event at t1 that is due, or -1.
    Returns (grid, status, number of times reached, code of the event that is due or -1).
    """
    system = system_of(packed)
    status = FINE
    reached = 0
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
            if status == STEP_UNDERFLOW:
                code = jam_that_is_due(system)
                if code >= 0:
                    begin_step(system, grid.t0, grid.y0, grid.c0)
                    grid, status = cut_grid(grid, grid.t0, grid.y0, grid.c0, grid.h), EVENT
                break
            last = before_jam(system, grid)
            if status == FINE:
                last = min(last, before_stop(method, system, grid))
            if last < grid.t1:
                y, c = np.empty_like(grid.y1), np.empty_like(grid.c1)
                branch(method, system, grid, last, work, y, c)
                status = FINE if finite(y) else NOT_FINITE
                grid = cut_grid(grid, last, y, c, grid.h)
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
        if not finite(y):
            status = NOT_FINITE
            break
        if sampling:
            sample(system, t, y, out[i])
        reached += 1
    return grid, status, reached, code


def kind_of(code: int) -> tuple[int, int]:
    """(contact, kind of event) of a code."""
    return code // EVENT_KINDS, code % EVENT_KINDS
