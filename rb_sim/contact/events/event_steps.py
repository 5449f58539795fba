# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""One call of the loop for bodies in contact: it stops at the instant of an event."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.catalogue.effects.wrench import BodyHarmonicRow, WorldHarmonicRow
from rb_sim.catalogue.geometry.pairs import Shaken, Turntable, carrier, touching
from rb_sim.catalogue.spec import WORLD
from rb_sim.compiler.builder import PackedSystem, Value
from rb_sim.compiler.calls import means
from rb_sim.contact.events.grid import (
    Grid,
    Stepping,
    advance_grid,
    before_stop,
    branch,
    copy,
    finite,
    is_implicit,
    state_at,
)
from rb_sim.contact.events.search import (
    GRADE,
    begin_step,
    cut_grid,
    nearly_stopped,
    next_event,
    note_rounded_leans,
)
from rb_sim.integrate.layout import (
    FINE,
    NOT_FINITE,
    PIECE_STEPS,
    STEP_UNDERFLOW,
    ULPS,
    UNFINISHED,
    held,
)
from rb_sim.integrate.methods.radau5 import radau5_of_slips
from rb_sim.mechanics.contact import motion_kernels as _registers_its_kernels  # noqa: F401
from rb_sim.mechanics.contact.accelerations import (
    contact_accelerations,
    moving,
    slides_with_friction,
)
from rb_sim.mechanics.contact.constraint_tables import carry_inputs, write_joints
from rb_sim.mechanics.contact.contact_bodies import (
    ACTIVE,
    AMONG_POSITIONS,
    AMONG_ROWS,
    AT_JAM,
    CHANGING,
    CLOSED,
    DEPENDENT,
    EVENT_FUNCTIONS_BEFORE,
    EVENT_KINDS,
    EVENT_RATES_BEFORE,
    FREE,
    JAMMED,
    JAMS,
    MOST_RANK,
    NEAR_JAM,
    NUDGE,
    REDUNDANT,
    SLIP,
    STEP_RANK,
    first_row_of,
    least_slip,
)
from rb_sim.mechanics.contact.contact_laws import rate_of_change
from rb_sim.mechanics.contact.event_functions import before_swing
from rb_sim.mechanics.contact.motion_kernels import contact_rate, fill_symmetric
from rb_sim.mechanics.system import project, sample
from rb_sim.mechanics.systems.elimination import largest_pivots
from rb_sim.mechanics.systems.many_bodies import WIDTH, state_of, vec
from rb_sim.mechanics.systems.multibody import put_rates
from rb_sim.motion.traced import settings_of
from rb_sim.numerics.kernels import by_address, entry, part, pointer
from rb_sim.numerics.vectors import norm
from rb_sim.scene.compiled import Compiled

# Methods as the loop of bodies in contact takes them: implicit steps, longest steps.


# df/dy of bodies in contact, by differences, for implicit steps where friction is stiff.
#
# A slow slip s is turned by friction at a rate that changes with s over |s| itself: differences are
# small parts of the slowest slip.


OF_SLIP = 1e-4
"""Difference of velocities, over the slowest slip: what is left out is as much of the entry."""
OF_PLACES = 1e-3
"""Difference of places, in lengths of the scene, over the slowest slip, in its speeds: a support
that turns makes a slip of it."""
MOST = 1e-8
"""Largest increment of finite differences, in lengths of the scene for positions, absolute for
quaternions: a larger one is affected by curvature, one below COMPUTED_ROUNDING by rounding."""
FASTEST = 1e-3
"""Slip, in speeds of the scene, beyond which differences do not grow with it."""


def slowest_slip(system):
    """The least speed of a slip whose friction has a corner, over the scene's."""
    table, least = system.contact_table, FASTEST * system.speed
    for c in range(table.shape[0]):
        if slides_with_friction(table, c):
            least = min(least, max(norm(vec(table, c, SLIP)), least_slip(system, c)))
    return least / system.speed


def difference(system, k, slip):
    """Of the k-th coordinate of a body; slip: the slowest."""
    if k >= 7:
        speed = OF_SLIP * slip * system.speed
        return speed if k < 10 else speed / system.length
    place = max(COMPUTED_ROUNDING, min(MOST, OF_PLACES * slip))
    return place * system.length if k < 3 else place


@by_address
def jacobian_by_differences(t, y, p, out):
    """df_i/dy_j into out[n i + j], n numbers of y; of the contacts' work, the last, nothing
    depends."""
    system = held(p)
    n = WIDTH * system.bodies.shape[0] + 1
    f, g, at = np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        at[i] = y[i]
        out[n * i + n - 1] = 0.0
    contact_rate(system, t, at, f)
    slip = slowest_slip(system)
    for j in range(n - 1):
        step = difference(system, j % WIDTH, slip)
        at[j] = y[j] + step
        contact_rate(system, t, at, f)
        width = at[j]
        at[j] = y[j] - step
        contact_rate(system, t, at, g)
        width -= at[j]
        at[j] = y[j]
        for i in range(n):
            out[n * i + j] = (f[i] - g[i]) / width


# How long an adaptive step may be where a support or a force comes and goes with time alone.
#
# The equations of bodies in flight know nothing of a support that they do not touch, and those of
# bodies at rest nothing of a force that friction holds: a step may be as long as the flight or the
# rest, while the support or the force comes and goes many times.


SHARE_OF_PERIOD = 0.125
"""Of a period, within which a gap, or the distance of a force to its bound, has one minimum at
most."""
PHASES = (0.13, 0.31, 0.57, 0.83)
"""Of a turn, at which a turning surface must lie where it was, to count as at rest."""


def paced(compiled: Compiled, method: Any) -> Any:
    """The method with steps no longer than a share of the shortest period of the scene; with fixed
    steps that is asked of supports alone, whose gaps are looked at within a step."""
    period = period_of_supports(compiled)
    largest = getattr(method, "largest_step", None)
    if largest is None:
        parts = math.ceil(method.step / (SHARE_OF_PERIOD * period))
        return method._replace(step=method.step / max(1, parts))
    period = min(period, period_of_forces(compiled))
    return method._replace(largest_step=min(largest, SHARE_OF_PERIOD * period))


def period_of_forces(compiled: Compiled) -> float:
    """The shortest of all harmonic forces; inf if there is none [s]."""
    shortest = math.inf
    for effect in compiled.system.effects:
        if isinstance(effect.row, WorldHarmonicRow | BodyHarmonicRow):
            rate = abs(effect.row.angular_frequency)
            shortest = min(shortest, 2.0 * math.pi / rate if rate > 0.0 else math.inf)
    return shortest


def period_of_supports(compiled: Compiled) -> float:
    """The shortest of all supports whose surface moves as prescribed; inf if there is none [s]."""
    shortest = math.inf
    for group in compiled.system.contacts:
        for contact in group:
            motion = contact.row.carrier
            if isinstance(motion, Shaken):
                shortest = min(shortest, 2.0 * math.pi / motion.frequency)
            elif isinstance(motion, Turntable) and wobbles(compiled, contact):
                shortest = min(shortest, 2.0 * math.pi / float(np.linalg.norm(motion.spin)))
    return shortest


def wobbles(compiled: Compiled, contact: Any) -> bool:
    """True if the turning support's surface does not turn into itself."""
    motion = contact.row.carrier
    rate = float(np.linalg.norm(motion.spin))
    if rate == 0.0:
        return False
    B = state_of(compiled.y, contact.body)
    gaps = [
        touching(contact.row.pair, B, carrier(motion, 2.0 * math.pi * turn / rate, WORLD)[0]).gap
        for turn in (0.0, *PHASES)
    ]
    return max(gaps) - min(gaps) > 1e-9 * compiled.system.length


# Methods as the loop of bodies in contact takes them, and the slips that they follow.


NOISE = 30.0
"""Slip in tolerances of an adaptive method whose direction is lost in its errors: explicit methods
turn it about where steps that keep the tolerance are too long for its stiffness."""
CREEP = 1e-9
"""Slip, relative to the speed of the scene, below which compliant contacts creep in steps of an
adaptive method; above it, implicit steps follow the slip."""


def slow_slips(system: Any, method: Any) -> dict[str, float]:
    """The slips [m/s] that are lost in errors, and that creep."""
    tolerance = getattr(method, "tolerance", 0.0)
    creep = CREEP * system.speed if tolerance > 0.0 else 0.0
    return {"velocity_tolerance": max(system.velocity_tolerance, NOISE * tolerance), "creep": creep}


def stepping_of(compiled: Compiled, method: Any, compliant_friction: bool) -> Stepping:
    """rubs: whether slips may be slow and stiff."""
    step, setting = settings_of(paced(compiled, method))
    implicit: tuple[Any, Any] = 0, 0
    if compliant_friction and getattr(method, "tolerance", 0.0) > 0.0:
        implicit = radau5_of_slips.reference, jacobian_by_differences.address
    setting = (*setting, float(step.implicit > 0))
    return Stepping(step.reference, rate_of_change.address, setting, *implicit)


# The call.


# Which rows of joints in loops get a multiplier in the next step, as
# `mechanics.systems.elimination` has it for scenes without contacts; and the rank of all rows in
# it.


def find_changing(system):
    """Number the rows that are chosen anew as those that hold; (how many, how many are chosen)."""
    count, rank = 0, 0
    for k in range(first_row_of(system, 0)):
        flags = system.row_table[k, DEPENDENT]
        if flags & CHANGING != 0:
            system.row_table[count, ACTIVE] = k
            count += 1
            if flags & AMONG_ROWS == 0:
                rank += 1
    return count, rank


def choose_rows(system, t, y):
    """Choose anew at (t, y), a state on the manifold, where a step begins."""
    count, rank = find_changing(system)
    if count == 0:
        return
    write_joints(system, t, y)
    fill_symmetric(system, count, False)
    workspace = np.empty(count * (count + rank + 2))
    matrix, chosen = pointer(workspace), part(pointer(workspace), count * count)
    for i in range(count):
        for j in range(count):
            matrix[i * count + j] = system.delassus[0, i, j]
    left, factors = part(chosen, count), part(chosen, 2 * count)
    least, _ = largest_pivots(count, rank, matrix, chosen, left, factors)
    if not least > 0.0:
        return
    for m in range(count):
        left_out = 0 if chosen[m] == 1.0 else AMONG_ROWS + AMONG_POSITIONS
        system.row_table[system.row_table[m, ACTIVE], DEPENDENT] = CHANGING + left_out


def free_rank(system):
    """Let each state have the rank that it is found to have."""
    system.row_table[0, MOST_RANK] = system.row_table.shape[0]


def choose_rank(system, t, y):
    """Choose the rank that all stages of the next step have at most: that at (t, y), a state on the
    manifold, where it lasts.

    More contacts than are needed to hold a body, as four wheels do, have rows that depend on each
    other on the manifold alone: at the stages they contradict each other, by little, and each would
    push with a force that is the larger the less that is.  A rank that is less at one instant only,
    as of a mechanism that passes a singular position, is none to keep: it is more a moment later.
    """
    free_rank(system)
    if system.row_table[0, REDUNDANT] == 0:
        return
    kept = system.contact_table.copy()
    rank, holding = moving(system, t, y, False)
    if rank < holding:
        nudge, later = NUDGE * system.length / system.speed, np.zeros_like(y)
        put_rates(system, y, later)
        for i in range(y.shape[0]):
            later[i] = y[i] + nudge * later[i]
        project(system, t + nudge, later)
        soon, _ = moving(system, t + nudge, later, False)
        if soon == rank:
            system.row_table[0, MOST_RANK] = int(rank)
    for c in range(kept.shape[0]):
        for j in range(kept.shape[1]):
            system.contact_table[c, j] = kept[c, j]


# As `integrate.loop`, for bodies in contact: it stops at the instant of an event.
#
# Between events the equations are smooth, so every method keeps its order.  After each step the
# event functions (gap, normal force, distance to the friction bound, slip along its direction) are
# read; if one has become negative, the first zero in the step is found by further steps of the
# method from the same grid point, as samples are, to the last digits of the time.


EVENT = 4
"""Status: a contact changes its mode at t1."""
JAM_PART, JAM_PASS = 0.5, 1.5
"""Parts of the time in which an effective pivot would vanish that one step may take, and that
the last one takes: beyond, the force would pass through infinity unseen."""

RETRIES = 20
"""Steps tried, each shorter by GRADE, where one has no solution."""


def before_jam(system, grid):
    """Where the step has to end, at the latest, not to jump over the instant at which a slipping
    contact jams."""
    table, last = system.contact_table, grid.t1
    for c in range(table.shape[0]):
        level, rate = (
            table[c, EVENT_FUNCTIONS_BEFORE + AT_JAM],
            table[c, EVENT_RATES_BEFORE + AT_JAM],
        )
        if table[c, CLOSED] == 1.0 and 0.0 < level < FREE and rate < 0.0:
            part = JAM_PART if level > JAMMED else JAM_PASS
            last = min(last, grid.t0 - part * level / rate)
    return last


def jam_that_is_due(system):
    """Code of the event that a slipping contact jams, where its pivot vanishes faster than the
    clock can tell; or -1.

    Its force turns the slip, so that the pivot vanishes as the root of the time left: no step that
    changes t may bring it down to JAMMED.
    """
    table = system.contact_table
    for c in range(table.shape[0]):
        if table[c, CLOSED] == 1.0 and table[c, EVENT_FUNCTIONS_BEFORE + AT_JAM] < NEAR_JAM:
            return EVENT_KINDS * c + JAMS
    return -1


def bears(system):
    """Whether a contact is closed: else a step without a solution is too long for the loads."""
    for c in range(system.contact_table.shape[0]):
        if system.contact_table[c, CLOSED] == 1.0:
            return True
    return False


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
def record_contacts(method, packed, grid, times, stop, sampling, out, work, code, kept, arms):
    """Integrate to each of `times` and sample there if `sampling`, up to the next event.

    packed: the system as its layout has it. code: the event at t1 that is due, or -1.
    kept, arms: as `next_event` takes them.
    Returns (grid, status, number of times reached, code of the event that is due or -1).
    """
    system = system_of(packed)
    status = FINE
    reached = 0
    if grid.t0 < grid.t1:  # samples of the step taken last are steps of the same law
        system.row_table[0, MOST_RANK] = system.row_table[0, STEP_RANK]
    # a step costs as much as there are contacts, and a signal waits for the end of the piece
    last_step = grid.steps + max(1, PIECE_STEPS // system.contact_table.shape[0])
    for i in range(times.shape[0]):
        t = times[i]
        while grid.t1 < t - ULPS * abs(t) or (code >= 0 and grid.t1 <= t + ULPS * abs(t)):
            if code >= 0:  # before a sample at the same instant, which shows what comes after
                status = EVENT
                break
            if grid.steps >= last_step:
                status = UNFINISHED
                break
            carry_inputs(system, grid.t1, grid.y1)
            choose_rows(system, grid.t1, grid.y1)
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
            if status == NOT_FINITE and bears(system):
                status, code, grid = shorter_step(method, system, grid, work)
            if status != FINE:
                break
            if code < 0:
                note_rounded_leans(system.contact_table, kept, grid.t0)
                code, grid = next_event(method, system, grid, work, kept, arms)
                if not finite(grid.y1):
                    status = NOT_FINITE
                    break
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
    system.row_table[0, STEP_RANK] = system.row_table[0, MOST_RANK]
    free_rank(system)
    return grid, status, reached, code


def kind_of(code: int) -> tuple[int, int]:
    """(contact, kind of event) of a code."""
    return code // EVENT_KINDS, code % EVENT_KINDS
