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
from rb_sim.contact.events.grazes import Doubts, note_rounded_leans
from rb_sim.contact.events.grid import (
    Grid,
    advance_grid,
    branch,
    copy,
    finite,
    is_implicit,
    state_at,
)
from rb_sim.contact.events.missed import note_missed, weight
from rb_sim.contact.events.next_event import (
    GRADE,
    begin_step,
    cut_grid,
    nearly_stopped,
    next_event,
)
from rb_sim.contact.events.stops import before_stop
from rb_sim.contact.system import rates as _registers_its_kernels  # noqa: F401
from rb_sim.contact.system.accelerations import contact_accelerations
from rb_sim.contact.system.bodies import (
    EVENT_KINDS,
    FREE,
    JAMMED,
    JAMS,
    NEAR_JAM,
)
from rb_sim.contact.system.choice import choose_lines, choose_rank, free_rank
from rb_sim.contact.system.swings import before_swing
from rb_sim.contact.system.touch import (
    AT_JAM,
    CLOSED,
    LEVELS_BEFORE,
    SLOPES_BEFORE,
)
from rb_sim.engine.system import sample
from rb_sim.loops.places import FINE, NOT_FINITE, PIECE_STEPS, STEP_UNDERFLOW, ULPS, UNFINISHED
from rb_sim.maths.jit import entry, inline

EVENT = 4
"""Status: a contact changes its mode at t1."""
JAM_PART, JAM_PASS = 0.5, 1.5
"""Parts of the time in which an effective pivot would vanish that one step may take, and that
the last one takes: beyond, the force would pass through infinity unseen."""

RETRIES = 20
"""Steps tried, each shorter by GRADE, where one has no solution."""


@inline
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


@inline
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


@inline
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
def record_contacts(
    method, packed, grid, times, stop, sampling, out, work, code, missed, grazes, counted, begun
):
    """Integrate to each of `times` and sample there if `sampling`, up to the next event.

    packed: the system as its layout has it. code: the event at t1 that is due, or -1. missed: what
    steps of fixed length miss; grazes: impacts that may be missed; counted: steps before those of
    the grid; begun: when the run began [s].
    Returns (grid, status, number of times reached, code of the event that is due or -1).
    """
    system = system_of(packed)
    status = FINE
    reached = 0
    # a step costs as much as there are contacts, and a signal waits for the end of the piece
    last_step = grid.steps + max(1, PIECE_STEPS // system.touch.shape[0])
    for i in range(times.shape[0]):
        t = times[i]
        while grid.t1 < t - ULPS * abs(t) or (code >= 0 and grid.t1 <= t + ULPS * abs(t)):
            if code >= 0:  # before a sample at the same instant, which shows what comes after
                status = EVENT
                break
            if grid.steps >= last_step:
                status = UNFINISHED
                break
            stands_for = weight(counted + grid.steps, grid.steps)
            looked = method.setting[1] == 0.0 and stands_for > 0
            before = system.touch.copy() if looked else system.touch
            choose_lines(system, grid.t1, grid.y1)
            choose_rank(system, grid.t1, grid.y1)
            grid, status = advance_grid(method, system, grid, stop, work)
            if status == STEP_UNDERFLOW:
                code = jam_that_is_due(system)
                if code >= 0:
                    begin_step(system, grid.t0, grid.y0, grid.c0)
                    grid, status = cut_grid(grid, grid.t0, grid.y0, grid.c0, grid.h), EVENT
                break
            last = min(before_jam(system, grid), before_swing(method, system, grid.t0, grid.t1))
            if status == FINE:
                last = min(last, before_stop(method, system, grid, is_implicit(work)))
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
                allowed = method.setting[1] * (counted + grid.steps)
                doubts = Doubts(grazes, missed, grid.t1 - begun, allowed)
                note_rounded_leans(system, doubts, grid.t0)
                code, grid = next_event(method, system, grid, work, doubts)
                if not finite(grid.y1):
                    status = NOT_FINITE
                    break
                if looked:
                    note_missed(method, system, grid, before, work, missed, stands_for)
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
    free_rank(system)
    return grid, status, reached, code


def kind_of(code: int) -> tuple[int, int]:
    """(contact, kind of event) of a code."""
    return code // EVENT_KINDS, code % EVENT_KINDS
