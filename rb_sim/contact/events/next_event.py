"""The first event within a step: where one of the event functions passes through zero.

After each step they are read (gap, normal force, distance to the friction bound, slip along its
direction); if one has become negative, the first zero in the step is found by further steps of the
method from the same grid point, as samples are, to the last digits of the time.
"""

from __future__ import annotations

import numpy as np

from rb_sim.contact.events.grid import Grid, branch, copy, note_stiffness
from rb_sim.contact.events.search import (
    LOCATED,
    SLACK,
    begin_bracket,
    first_crossing,
    first_dip,
    level_at,
    level_of,
    note_event_functions,
)
from rb_sim.contact.events.stick_transition import stop_that_is_due
from rb_sim.mechanics.contact import motion_kernels as _registers_its_kernels  # noqa: F401
from rb_sim.mechanics.contact.contact_bodies import (
    EVENT_KINDS,
    ROLL_ENDS,
    SLIP_ENDS,
    STOPPED,
    keep,
    least_slip,
)
from rb_sim.mechanics.contact.contact_kinematics import SLIDING
from rb_sim.mechanics.contact.contact_table import (
    AT_ROLL,
    AT_SLIP,
    AT_SPIN,
    CLOSED,
    EVENT_FUNCTION_KINDS,
    EVENT_FUNCTIONS,
    EVENT_FUNCTIONS_BEFORE,
    EVENT_RATES_BEFORE,
    FASTEST,
    FASTEST_BEFORE,
    GAP,
    GAP_BEFORE,
    GAP_RATE,
    GAP_RATE_BEFORE,
    NORMAL,
    NORMAL_BEFORE,
    RELATIVE_SPIN,
    ROLL,
    ROLL_DIRECTION,
    ROLL_RATE,
    SLIDE,
    SLIP,
    SLIP_DIRECTION,
    SLIP_RATE,
    SPIN,
    SPIN_SIGN,
    STATIC,
)
from rb_sim.mechanics.contact.creep import SOON, fastest_creep, note_creep, rubs
from rb_sim.mechanics.contact.event_functions import level_rates, roll_level, rolling, slip_level
from rb_sim.mechanics.contact.near_flat_rims import end_for_rims, note_lean, turned_by_rounding
from rb_sim.mechanics.systems.many_bodies import vec
from rb_sim.numerics.kernels import inline
from rb_sim.numerics.vectors import dot, norm, scale

# What a step of bodies in contact starts from: directions, gaps, event functions, leans.


@inline
def look_ahead(system, rates):
    """Note what the next step starts from: directions of slip and turning, gaps, levels, leans.

    After `lowest_level` and, with the rates that it has found, `level_rates`.
    """
    touch = system.touch
    for c in range(touch.shape[0]):
        for i in range(EVENT_FUNCTION_KINDS):
            touch[c, EVENT_FUNCTIONS_BEFORE + i] = touch[c, EVENT_FUNCTIONS + i]
            touch[c, EVENT_RATES_BEFORE + i] = rates[c, i]
        touch[c, GAP_RATE_BEFORE], touch[c, GAP_BEFORE] = touch[c, GAP_RATE], touch[c, GAP]
        touch[c, FASTEST_BEFORE] = touch[c, FASTEST]
        keep(touch, c, NORMAL_BEFORE, vec(touch, c, NORMAL))
        note_directions(system, c)
        note_creep(system, c)
        note_lean(touch, c)


@inline
def note_directions(system, c):
    """Directions of slip and turning, and the event functions along them."""
    touch, before, slopes = system.touch, EVENT_FUNCTIONS_BEFORE, EVENT_RATES_BEFORE
    slip, roll = vec(touch, c, SLIP), rolling(touch, c)
    note_direction(touch, c, SLIP_DIRECTION, slip, least_slip(system, c))
    about = dot(vec(touch, c, RELATIVE_SPIN), vec(touch, c, NORMAL))
    still = system.still / system.length
    note_direction(touch, c, ROLL_DIRECTION, roll, still)
    if rubs(touch, c):
        touch[c, before + AT_SLIP] = slip_level(system, c, slip)
        touch[c, slopes + AT_SLIP] = slip_level(system, c, vec(touch, c, SLIP_RATE))
    if touch[c, CLOSED] == 1.0 and touch[c, ROLL] == SLIDING:
        touch[c, before + AT_ROLL] = roll_level(system, c, roll)
        touch[c, slopes + AT_ROLL] = roll_level(system, c, vec(touch, c, ROLL_RATE))
    if abs(about) > still:
        ahead = 1.0 if about > 0.0 else -1.0
        if touch[c, CLOSED] == 1.0 and touch[c, SPIN] == SLIDING and ahead != touch[c, SPIN_SIGN]:
            touch[c, before + AT_SPIN] = -touch[c, before + AT_SPIN]
            touch[c, slopes + AT_SPIN] = -touch[c, slopes + AT_SPIN]
        touch[c, SPIN_SIGN] = ahead


@inline
def note_direction(touch, c, at, a, still):
    size = norm(a)
    if size > still:
        keep(touch, c, at, scale(1.0 / size, a))


ROUNDED, ROUNDED_TIME, KEPT = range(3)
"""Columns by contact of what is kept of rims: the largest angle [rad] by which rounding has turned
the lean of one (see `near_flat_rims`), its time [s]. KEPT: how many."""


@inline
def note_rounded_leans(touch, kept, t):
    """Note how far rounding turns the leans of rims that hardly miss flat, in the step from t."""
    for c in range(touch.shape[0]):
        turned = turned_by_rounding(touch, c)
        if turned > kept[c, ROUNDED]:
            kept[c, ROUNDED], kept[c, ROUNDED_TIME] = turned, t


GRADE, ROUGH, APPROACH = 4.0, 0.1, 1e-10
"""The direction of a slip that vanishes is lost in rounding at the very end, and may turn ever
faster before: steps towards that instant, located to the part ROUGH of what is left, shrink by
GRADE each, down to APPROACH (natural units)."""

CUTS = 40
"""The most cuts of a step for the leans of rims."""

TRIES = 32
"""Steps after which contacts that creep are tried for rest again."""


@inline
def begin_step(system, t, y, c):
    """Bring the tables up to date at (t, y), from where the next step starts; c: the low digits of
    y."""
    level_of(system, t, y, c)
    look_ahead(system, level_rates(system, t, y))
    note_stiffness(system, y)


@inline
def cut_grid(grid, t, y, c, h):
    """The grid with its last step ended at t in the state y with the low digits c; h: the step to
    try next."""
    y1, c1 = copy(grid.y1, y), copy(grid.c1, c)
    return Grid(
        grid.origin + (t - grid.t1), grid.steps, grid.rejected, grid.t0, grid.y0, grid.c0,
        t, y1, c1, h, grid.y, grid.c,
    )  # fmt: skip


@inline
def not_too_far(method, system, grid, work, y, c):
    """(lowest event function, its code, the grid with its last step no longer than the leans of the
    rims allow); the tables are those of its end."""
    lowest, code = level_of(system, grid.t1, grid.y1, grid.c1)
    for _ in range(CUTS):
        t = end_for_rims(system, grid.t0, grid.t1)
        if t == grid.t1:
            break
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


@inline
def next_event(method, system, grid, work):
    """(code of the first event within the last step or -1, the grid, cut there)."""
    y, c = np.empty_like(grid.y1), np.empty_like(grid.c1)
    lowest, code, grid = not_too_far(method, system, grid, work, y, c)
    rates = level_rates(system, grid.t1, grid.y1)
    late = first_dip(method, system, grid, rates, work, y, c)
    if late == grid.t1 and not lowest < -SLACK:
        look_ahead(system, rates)
        note_stiffness(system, grid.y1)
        rests = creep_that_may_rest(system, grid)
        return rests if rests >= 0 else stop_that_is_due(method, system, grid.t1), grid
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
        note_event_functions(system, bracket, level < 0.0)
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


@inline
def nearly_stopped(system):
    """Code of the event that the slip of a contact ends, where it is as good as ended; or -1."""
    for c in range(system.touch.shape[0]):
        if system.touch[c, CLOSED] == 1.0 and system.touch[c, SLIDE] == SLIDING:
            slip = norm(vec(system.touch, c, SLIP))
            if system.touch[c, STATIC] > 0.0 and slip < STOPPED * system.speed:
                return EVENT_KINDS * c + SLIP_ENDS
    return -1


@inline
def creep_that_may_rest(system, grid):
    """Code of the event that contacts creep so slowly that they may have come to rest, all at once;
    or -1.  Where they have not, they are tried again now and then."""
    most, bound, first = fastest_creep(system)
    again = grid.steps % TRIES == 0 and most < SOON * system.creep
    return EVENT_KINDS * first + SLIP_ENDS if first >= 0 and (most < bound or again) else -1
