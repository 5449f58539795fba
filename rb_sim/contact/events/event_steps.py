# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The stepping loop of bodies in contact, which stops at each event."""

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
from rb_sim.contact.events.grid import Grid, Stepping, advance_grid, before_stop, branch, state_at
from rb_sim.contact.events.search import (
    GRADE,
    begin_step,
    cut_grid,
    nearly_stopped,
    next_event,
    note_rounded_leans,
)
from rb_sim.contact.problem import copy, finite
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
from rb_sim.mechanics.compiled import Compiled
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

# The Jacobian df/dy of bodies in contact, by finite differences, for implicit steps of slow slips.
#
# The rate at which friction turns a slow slip varies on the scale of |s|, so increments are small
# fractions of the slowest slip.


OF_SLIP = 1e-4
"""Increment of velocities relative to the slowest slip, which is also the relative error."""
OF_PLACES = 1e-3
"""Increment of positions, in lengths of the scene, relative to the slowest slip in its speeds: on a
rotating support a displacement causes a slip."""
MOST = 1e-8
"""Largest increment of finite differences, in lengths of the scene for positions, absolute for
quaternions: a larger one is affected by curvature, one below COMPUTED_ROUNDING by rounding."""
FASTEST = 1e-3
"""Largest slip, in speeds of the scene, that increments are relative to."""


def slowest_slip(system):
    """Slowest slip with Coulomb friction, relative to the scene's speed."""
    table, least = system.contact_table, FASTEST * system.speed
    for c in range(table.shape[0]):
        if slides_with_friction(table, c):
            least = min(least, max(norm(vec(table, c, SLIP)), least_slip(system, c)))
    return least / system.speed


def difference(system, k, slip):
    """Increment of coordinate k of a body; slip: the slowest one."""
    if k >= 7:
        speed = OF_SLIP * slip * system.speed
        return speed if k < 10 else speed / system.length
    place = max(COMPUTED_ROUNDING, min(MOST, OF_PLACES * slip))
    return place * system.length if k < 3 else place


@by_address
def jacobian_by_differences(t, y, p, out):
    """Write df_i/dy_j to out[n i + j], n = len(y); nothing depends on the last coordinate, the work
    of the contacts."""
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


# The longest step with periodic supports or forces.
#
# The motion of bodies in flight does not depend on a support that they do not touch, nor the rest
# of bodies on a force that friction balances. A step could be as long as the flight or the rest,
# while the support or the force oscillates many times.


SHARE_OF_PERIOD = 0.125
"""Longest step relative to a period: within it a gap, or the distance of a force from its bound,
has at most one minimum."""
PHASES = (0.13, 0.31, 0.57, 0.83)
"""Fractions of a turn at which a rotating surface is compared with its initial place."""


def paced(compiled: Compiled, method: Any) -> Any:
    """The method with steps no longer than SHARE_OF_PERIOD of the shortest period; fixed steps
    depend on periodic supports only."""
    period = period_of_supports(compiled)
    largest = getattr(method, "largest_step", None)
    if largest is None:
        parts = math.ceil(method.step / (SHARE_OF_PERIOD * period))
        return method._replace(step=method.step / max(1, parts))
    period = min(period, period_of_forces(compiled))
    return method._replace(largest_step=min(largest, SHARE_OF_PERIOD * period))


def period_of_forces(compiled: Compiled) -> float:
    """Shortest period of all harmonic forces; inf if there is none [s]."""
    shortest = math.inf
    for effect in compiled.system.effects:
        if isinstance(effect.row, WorldHarmonicRow | BodyHarmonicRow):
            rate = abs(effect.row.angular_frequency)
            shortest = min(shortest, 2.0 * math.pi / rate if rate > 0.0 else math.inf)
    return shortest


def period_of_supports(compiled: Compiled) -> float:
    """Shortest period of all driven supports; inf if there is none [s]."""
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
    """Whether the surface of a rotating support is not symmetric about its axis of rotation."""
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


NOISE = 30.0
"""Slip, in tolerances of an adaptive method, below which errors hide its direction: explicit steps
that keep the tolerance are then too long for its stiffness."""
CREEP = 1e-9
"""Slip, relative to the speed of the scene, below which compliant contacts creep in steps of an
adaptive method; above it, implicit steps follow the slip."""


def slow_slips(system: Any, method: Any) -> dict[str, float]:
    """Fields of ContactBodies: slips below which errors hide the direction, and below which
    compliant contacts creep [m/s]."""
    tolerance = getattr(method, "tolerance", 0.0)
    creep = CREEP * system.speed if tolerance > 0.0 else 0.0
    return {"velocity_tolerance": max(system.velocity_tolerance, NOISE * tolerance), "creep": creep}


def stepping_of(compiled: Compiled, method: Any, compliant_friction: bool) -> Stepping:
    """The method for the loop. compliant_friction: whether slow slips may be stiff."""
    step, setting = settings_of(paced(compiled, method))
    implicit: tuple[Any, Any] = 0, 0
    if compliant_friction and getattr(method, "tolerance", 0.0) > 0.0:
        implicit = radau5_of_slips.reference, jacobian_by_differences.address
    setting = (*setting, float(step.implicit > 0))
    return Stepping(step.reference, rate_of_change.address, setting, *implicit)


# Rows of joints in closed chains that get a multiplier in the next step (as in
# mechanics/systems/elimination for scenes without contacts), and the rank of all rows in it.


def find_changing(system):
    """Write the rows to be chosen into ACTIVE; returns (their number, the number to be chosen)."""
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
    """Choose the rows of closed chains at (t, y), on the manifold, at the start of a step."""
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
    """Remove the limit of the rank."""
    system.row_table[0, MOST_RANK] = system.row_table.shape[0]


def choose_rank(system, t, y):
    """Limit the rank at the stages of the next step to that at (t, y), a state on the manifold.

    If a body has more contacts than needed, such as four wheels, their rows are dependent on the
    manifold only. At the stages they contradict each other slightly, and solving them all would
    give very large forces. A rank that is lower at one instant only, as in a singular
    configuration, is not used as a limit.
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


# The loop: as `integrate.loop`, but it stops at each event (see events/search). Between events the
# equations are smooth, so every method keeps its order.


EVENT = 4
"""Status: a contact changes its mode at t1."""
JAM_PART, JAM_PASS = 0.5, 1.5
"""Step relative to the time in which a pivot would vanish at its present rate: the longest one, and
the last one. A longer step would not notice that the force becomes infinite."""

RETRIES = 20
"""Maximum number of shorter steps, each by the factor 1 / GRADE, if a step has no solution."""


def before_jam(system, grid):
    """Latest end of the step before the instant at which a slipping contact jams."""
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
    """Code of the jam of a slipping contact whose pivot is below NEAR_JAM; or -1.

    The force turns the slip, so that the pivot vanishes as the square root of the remaining time:
    there may be no double t at which it is JAMMED.
    """
    table = system.contact_table
    for c in range(table.shape[0]):
        if table[c, CLOSED] == 1.0 and table[c, EVENT_FUNCTIONS_BEFORE + AT_JAM] < NEAR_JAM:
            return EVENT_KINDS * c + JAMS
    return -1


def any_closed(system):
    """Whether any contact is closed."""
    for c in range(system.contact_table.shape[0]):
        if system.contact_table[c, CLOSED] == 1.0:
            return True
    return False


def shorter_step(method, system, grid, work):
    """(status, event code, grid) with the longest step from t0 that succeeds, after one has failed.

    An implicit method has no solution across the end of a slip. Shorter steps approach it, and the
    end is an event.
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
    """The packed system; interpreted, its argument."""
    return packed


@means(system_of)
def _system_of(f, packed):
    return Value(PackedSystem(), (packed.leaves[0],))


@entry
def record_contacts(method, packed, grid, times, stop, sampling, out, work, code, kept, arms):
    """Integrate to each of `times`, and sample there if `sampling`, up to the next event.

    packed: the system in its layout. code: event that is due at t1, or -1. kept, arms: as for
    `next_event`. Returns (grid, status, number of times reached, code of the event due or -1).
    """
    system = system_of(packed)
    status = FINE
    reached = 0
    if grid.t0 < grid.t1:  # samples in the last step use its rank
        system.row_table[0, MOST_RANK] = system.row_table[0, STEP_RANK]
    # with many contacts a step takes long, and signals are handled at the end of the piece
    last_step = grid.steps + max(1, PIECE_STEPS // system.contact_table.shape[0])
    for i in range(times.shape[0]):
        t = times[i]
        while grid.t1 < t - ULPS * abs(t) or (code >= 0 and grid.t1 <= t + ULPS * abs(t)):
            if code >= 0:  # a sample at the same instant is after the event
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
                last = min(last, before_stop(method, system, grid))
            if last < grid.t1:
                y, c = np.empty_like(grid.y1), np.empty_like(grid.c1)
                branch(method, system, grid, last, work, y, c)
                status = FINE if finite(y) else NOT_FINITE
                grid = cut_grid(grid, last, y, c, grid.h)
            if status == NOT_FINITE and any_closed(system):
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
