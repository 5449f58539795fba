# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Impacts: u+ = u- + M^-1 J^T x, for all contacts together or one at a time.

The laws are Newton's restitution v_n+ = -e v_n- for contacts with an impulse, and Coulomb's law
between impulse and slip after the impact. If that would increase the energy, Poisson's two phases
are used, and if these do as well, no rebound (Glocker, Set-Valued Force Laws, 2001). One at a time,
the fastest contact first, suits hard elastic bodies that touch at points (Newton's cradle).
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any, NamedTuple

import numpy as np

from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.contact.assembly import (
    NOT_FINITE,
    SOLVED,
    UNSOLVED,
    VELOCITY,
    Velocities,
    along_rows,
    assemble,
    lay_out_in,
    push,
    read_velocities,
    solve_in,
    write_all_rows,
)
from rb_sim.contact.event_workspace import (
    AMBIGUOUS,
    IMPACT,
    JAMS,
    OF_ROUND,
    RESTS,
    TOUCHING,
    Workspace,
    find_touching,
    note,
    note_impulses,
    slip_speed,
    touches,
    velocity_tolerance_of,
    workspace_left,
)
from rb_sim.contact.few_contacts import take_least
from rb_sim.contact.problem import (
    APART,
    BOUND,
    FREE,
    HOLDS,
    LEAST,
    PART,
    PULLS,
    ROLLS,
    SPINS,
    problem_of,
)
from rb_sim.mechanics.contact.accelerations import contact_accelerations
from rb_sim.mechanics.contact.constraint_tables import traction_over_normal_force
from rb_sim.mechanics.contact.contact_bodies import (
    BILATERAL,
    CLOSED,
    DRAGS,
    GAP,
    GAP_RATE,
    KINETIC,
    NEAR_JAM,
    RESTITUTION,
    ROLLING_ARM,
    SPINNING_ARM,
    STATIC,
    first_row_of,
)
from rb_sim.mechanics.systems.many_bodies import BODY, PARENT, RESPONSE, WIDTH
from rb_sim.numerics.complementarity import fill_steps
from rb_sim.numerics.kernels import pointer

# Endless series of contact changes: they are skipped (see `instant.leap`).


AT_ONCE = 50
"""Number of rounds of impacts at one instant from which a series counts as endless."""
CHANGES_IN_LEAP = 10
"""Number of changes within DENSE from which a series counts as endless."""
DENSE, LONGEST_LEAP = 1e-6, 1e-3
"""Intervals, in natural units: changes of contacts within DENSE count as simultaneous, and
LONGEST_LEAP is the longest time that is skipped after an endless series of them."""


class Chatter:
    """Detects endless series of contact changes. unit: the scene's natural time [s]."""

    def __init__(self, unit: float) -> None:
        self._short = DENSE * unit
        self._longest = LONGEST_LEAP * unit
        self._changes: deque[float] = deque(maxlen=CHANGES_IN_LEAP)
        self._leapt = (-math.inf, 0.0)

    def is_endless(self, t: float) -> bool:
        """Count a change at t [s]; returns whether it belongs to an endless series."""
        self._changes.append(t)
        full = len(self._changes) == CHANGES_IN_LEAP
        return full and t - self._changes[0] < self._short

    def length_of_leap(self, t: float) -> float:
        """Time to be skipped at t [s]: negligible, and longer if one has just been skipped."""
        end, length = self._leapt
        return min(4.0 * length, self._longest) if t - end < 10.0 * length else self._short

    def leapt(self, end: float, length: float) -> None:
        """Record that a time of this length, up to `end`, has been skipped [s]."""
        self._leapt = (end, length)
        self._changes.clear()


# Endless bounces: with e < 1 the time between bounces shrinks by the factor e each time, so that
# the end of the series is known from one bounce. There the contact closes.


ZENO_HEIGHT = 1e-11
"""Height of the next bounce, relative to the length of the scene, below which a contact closes:
the neglected motion is of that size, and the time of rest is known from the series."""
ZENO_BOUNCES = 3
"""Number of successive bounces from which they count as an endless series."""
LAST, BEST, CHANGE = range(3)
"""Columns of `rests`: end of the series [s] estimated from the last bounce; the best estimate, for
which two successive bounces agree best; and their difference. Low bounces are more accurate if the
acceleration changes, but their relative rounding error is larger."""


def forget_bounces(workspace: Workspace) -> None:
    """Reset the counts of bounces."""
    workspace.bounces[:] = 0
    workspace.rests[:] = math.inf


def acceleration_along(system, workspace, k):
    """Acceleration along row k, J du/dt plus velocity terms [m/s^2], from the accelerations in the
    tables."""
    s = workspace.row_bias[k]
    b, a = system.row_table[k, BODY], system.row_table[k, PARENT]
    for j in range(6):
        s += workspace.all_rows[k, j] * system.bodies[b, RESPONSE + j]
    if a >= 0:
        for j in range(6):
            s += workspace.all_rows[k, 6 + j] * system.bodies[a, RESPONSE + j]
    return s


def free_normal_acceleration(system, workspace, t, y, c):
    """Acceleration of the gap of contact c if it is open and the others are unchanged [m/s^2]."""
    mode = system.contact_table[c, CLOSED]
    system.contact_table[c, CLOSED] = 0.0
    contact_accelerations(system, t, y)
    system.contact_table[c, CLOSED] = mode
    return acceleration_along(system, workspace, first_row_of(system, c))


def is_low(system, workspace, t, y, c):
    """Whether contact c falls from, or rises to, a height below ZENO_HEIGHT."""
    fall = -free_normal_acceleration(system, workspace, t, y, c)
    height = 0.5 * system.contact_table[c, GAP_RATE] ** 2
    return fall > 0.0 and height < ZENO_HEIGHT * system.length * fall


def close_endless(system, workspace, t, y):
    """Make exactly those contacts plastic whose further bounces would be below ZENO_HEIGHT."""
    table = system.contact_table
    for c in range(table.shape[0]):
        workspace.plastic[c] = 0
        e, speed = table[c, RESTITUTION], -table[c, GAP_RATE]
        bounces = touches(system, c) and 0.0 < e < 1.0 and speed > velocity_tolerance_of(system)
        if not bounces or workspace.bounces[c] < ZENO_BOUNCES:
            continue
        fall = -free_normal_acceleration(system, workspace, t, y, c)
        if fall <= 0.0:
            continue
        ends, rests = t + 2.0 * e * speed / (fall * (1.0 - e)), workspace.rests
        change = abs(ends - rests[c, LAST])
        if change <= rests[c, CHANGE]:
            rests[c, BEST], rests[c, CHANGE] = ends, change
        rests[c, LAST] = ends
        if 0.5 * (e * speed) ** 2 / fall < ZENO_HEIGHT * system.length:
            workspace.plastic[c] = 1
            note(workspace, rests[c, BEST], c, RESTS, (0.0, 0.0, 0.0))


def close_rocking(system, workspace, t, y):
    """Mark contacts that have impacts in alternation, below ZENO_HEIGHT, to close together; returns
    whether there are any."""
    table, velocity_tolerance, count = system.contact_table, velocity_tolerance_of(system), 0
    low, struck = True, False
    for c in range(table.shape[0]):
        workspace.together[c] = 0
        count += 1 if touches(system, c) else 0
    for c in range(table.shape[0]):
        if count >= 2 and touches(system, c) and table[c, GAP_RATE] < -velocity_tolerance:
            struck = True
            low = low and is_low(system, workspace, t, y, c)
    if not struck:
        return False
    last = table.shape[0]
    workspace.bounces[last] = workspace.bounces[last] + 1 if low else 0
    if workspace.bounces[last] <= ZENO_BOUNCES:
        return False
    for c in range(table.shape[0]):
        if touches(system, c) and table[c, GAP_RATE] < -velocity_tolerance:
            note(workspace, t, c, RESTS, (0.0, 0.0, 0.0))
    any_together = False
    for c in range(table.shape[0]):
        if touches(system, c) and is_low(system, workspace, t, y, c):
            workspace.together[c] = 1
            any_together = True
    return any_together


def count_bounces(workspace):
    """Count a bounce of the contacts that separate after an impact; reset the others."""
    for c in range(workspace.rests.shape[0]):
        if workspace.rebounding[c] == 1:
            workspace.bounces[c] += 1
        else:
            workspace.bounces[c] = 0
            for j in range(3):
                workspace.rests[c, j] = math.inf


# The length of flights that begin at an instant.


HELD_DOWN = 1e-6
"""Acceleration towards the support, in natural units, above which a contact that has just opened
would close again at once."""
LANDED = 2.4
"""Time, relative to that up to the top of a flight, after which the flight has ended even if the
acceleration changes a little."""


def time_of_flights(system, workspace, t, y, fixed):
    """(time within which the flights that begin here end [s], inf without any; 0, or 1 + a contact
    whose drag lifts a body that falls back at once).

    A flight so low that rounding of gaps may hide it, and any flight with fixed steps, must have a
    step end at its top.
    """
    table, length, dragged = system.contact_table, math.inf, 0
    near, natural = TOUCHING * system.length, system.speed**2 / system.length
    contact_accelerations(system, t, y)
    for c in range(table.shape[0]):
        if table[c, CLOSED] != 0.0 or abs(table[c, GAP]) > near:
            continue
        fall = -acceleration_along(system, workspace, first_row_of(system, c))
        rise = table[c, GAP_RATE]
        if fall > 0.0 and rise > velocity_tolerance_of(system):
            hidden = fixed or 0.5 * rise * rise < TOUCHING * fall * system.length
            length = min(length, (1.0 if hidden else LANDED) * rise / fall)
        elif table[c, DRAGS] == 1.0 and fall > HELD_DOWN * natural and dragged == 0:
            dragged = 1 + c
    return length, dragged


# The impulses of an impact by one rule.


class Rule(NamedTuple):
    """The laws of an impact."""

    rebound: Any
    """e of each contact, (C,)."""
    least: Any
    """least impulse of each contact, (C,)."""
    together: bool
    """whether contacts that are marked to close together are bilateral."""
    stop: bool
    """whether perfectly rough contacts stop slipping, even if that requires no normal impulse."""
    held: int = -1
    """contact that is at rest afterwards, by impulses of any size; -1: none."""


def grips(system, c, v):
    """Whether contact c is perfectly rough and does not separate."""
    rough = system.contact_table[c, KINETIC] == math.inf
    return rough and v[first_row_of(system, c)] <= velocity_tolerance_of(system)


def lay_out_impact(system, workspace, v, rule, loose):
    """Write rows and laws of an impact of the participating contacts; returns (rows, bounds).

    loose: perfectly rough contacts that do not separate have zero slip without a normal impulse.
    """
    table, rules = system.contact_table, workspace.contact_rules
    for c in range(table.shape[0]):
        k = first_row_of(system, c)
        slip = math.sqrt(v[k + 1] ** 2 + v[k + 2] ** 2)
        both = table[c, BILATERAL] == 1.0 or (rule.together and workspace.together[c] == 1)
        both, holds = both or c == rule.held, (loose and grips(system, c, v)) or c == rule.held
        rules[c, PART] = FREE if workspace.taking_part[c] == 1 else APART
        rules[c, PULLS], rules[c, LEAST] = 1.0 if both else 0.0, rule.least[c]
        rules[c, BOUND] = HOLDS if holds else traction_over_normal_force(system, c, slip)
        rules[c, ROLLS] = table[c, ROLLING_ARM]
        rules[c, SPINS] = table[c, SPINNING_ARM]
    return lay_out_in(system, workspace)


def take_least_shares(system, workspace, m, A, b, terms, x):
    """Replace impulses x that are not unique by the least ones, as in time stepping (few_contacts);
    workspace.undetermined[0]: largest difference of the motion after other solutions.

    The laws do not determine how the corners of a face share an impulse, and rounding would choose.
    If they slip in different directions, friction and motion depend on it.
    """
    n = x.shape[0]
    least, step = x.copy(), np.empty(n)
    p = problem_of(workspace, n, m, A, b, step)
    p = p._replace(blur=fill_steps(n, p.A, pointer(terms), p.step))
    free, figure, _ = take_least(p, velocity_tolerance_of(system), pointer(least), True)
    if free > 0:
        workspace.undetermined[0] = max(workspace.undetermined[0], figure)
        for i in range(n):
            x[i] = least[i]


def try_impulses(system, workspace, before, rule, loose, x):
    """As `impulses_with`, for one set of laws."""
    n, m = lay_out_impact(system, workspace, before.v, rule, loose)
    A, b, terms, found = np.empty((n, n)), np.empty(n), np.empty(n), np.empty(n)
    assemble(system, workspace, VELOCITY, n, before.u, 1.0, A, b, terms)
    for c in range(system.contact_table.shape[0]):
        if workspace.taking_part[c] == 1:
            b[workspace.place_of[first_row_of(system, c)]] *= 1.0 + rule.rebound[c]
    status = solve_in(workspace, n, m, A, b, terms, found)
    if status == SOLVED:
        take_least_shares(system, workspace, m, A, b, terms, found)
    for k in range(x.shape[0]):
        x[k] = 0.0
    for i in range(n):
        x[workspace.used[i]] = workspace.units[i] * found[i]
    return status


def impulses_with(system, workspace, before, rule, x):
    """Write the impulses of all rows, with w = A x + v + e v-, to x; returns SOLVED, UNSOLVED or
    NOT_FINITE."""
    holding = False
    for c in range(system.contact_table.shape[0]):
        holding = holding or (workspace.taking_part[c] == 1 and grips(system, c, before.v))
    status = UNSOLVED
    if not (rule.stop and holding):
        status = try_impulses(system, workspace, before, rule, False, x)
    if status == UNSOLVED and holding:
        # perfectly rough contacts stop slipping even if that alone opens them
        status = try_impulses(system, workspace, before, rule, True, x)
    return status


def gains_energy(system, workspace, u, x):
    """Whether the impulses would increase the kinetic energy, other than by driven supports."""
    work, size = push(system, workspace, x, u, np.empty_like(u))
    for k in range(x.shape[0]):
        work -= x[k] * workspace.row_rate[k]
    return work > COMPUTED_ROUNDING * size


def can_hold(system, x, c):
    """Whether the impulse of contact c is within its friction cone, to NEAR_JAM of it."""
    k = first_row_of(system, c)
    across = math.sqrt(x[k + 1] ** 2 + x[k + 2] ** 2)
    return (1.0 - NEAR_JAM) * across <= system.contact_table[c, KINETIC] * x[k]


def poisson_impulses(system, workspace, before, rebound, held, x):
    """Write the impulses by Poisson's law to x: compression to rest, then at least e times its
    normal impulse once more. held: as in `Rule`; UNSOLVED if friction cannot hold it."""
    none, least = np.zeros_like(rebound), np.zeros_like(rebound)
    first, compressed = np.empty_like(x), Velocities(np.empty_like(before.u), np.empty_like(x))
    status = impulses_with(system, workspace, before, Rule(none, none, False, False, held), first)
    if status != SOLVED:
        return status
    if held >= 0 and not can_hold(system, first, held):
        return UNSOLVED
    for c in range(least.shape[0]):
        least[c] = rebound[c] * first[first_row_of(system, c)]
    push(system, workspace, first, before.u, compressed.u)
    along_rows(system, workspace, compressed.u, compressed.v)
    status = impulses_with(system, workspace, compressed, Rule(none, least, False, False), x)
    for k in range(x.shape[0]):
        x[k] += first[k]
    return status


NOTHING, STRUCK, NO_IMPULSES, OVERFLOWN, GOES_ON, ENDLESS = range(6)
"""Result of rounds of impacts: no contact approaches; there was an impact; the laws have no
solution; numbers are not finite; to be continued; all rounds made."""
TIED = 1e-9
"""Relative difference of approach speeds up to which two contacts are equally fast, so that
rounding does not choose which corner of an edge has the first impact."""


def must_stop_slipping(system, c):
    """Whether contact c is perfectly rough, closed, not separating, and slips."""
    table, velocity_tolerance = system.contact_table, velocity_tolerance_of(system)
    stays = table[c, CLOSED] == 1.0 and table[c, GAP_RATE] <= velocity_tolerance
    return table[c, STATIC] == math.inf and stays and slip_speed(system, c) > velocity_tolerance


def apply_impulses(system, workspace, t, y, x):
    """Add the impulses to the velocities, and their work to that of the contacts, in y."""
    u = np.empty_like(workspace.free_accelerations)
    after = np.empty_like(u)
    read_velocities(system, y, u)
    work, _ = push(system, workspace, x, u, after)
    for i in range(system.bodies.shape[0]):
        for j in range(6):
            y[WIDTH * i + 7 + j] = after[i, j]
    y[WIDTH * system.bodies.shape[0]] += work
    write_all_rows(system, t, y, workspace)


def impulses_of_strike(system, workspace, before, fastest, x):
    """Write the impulses of the participating contacts to x, by the first rule that has a solution
    without a gain of energy."""
    table, contacts = system.contact_table, system.contact_table.shape[0]
    rebound, none, any_together = np.zeros(contacts), np.zeros(contacts), False
    workspace.undetermined[0] = 0.0
    for c in range(contacts):
        any_together = any_together or workspace.together[c] == 1
        if workspace.taking_part[c] == 1 and workspace.plastic[c] == 0:
            if before.v[first_row_of(system, c)] < 0.0:
                rebound[c] = table[c, RESTITUTION]
    status = UNSOLVED
    if any_together:
        status = impulses_with(system, workspace, before, Rule(none, none, True, False), x)
    if status == UNSOLVED and not table[fastest, GAP_RATE] < -velocity_tolerance_of(system):
        status = impulses_with(system, workspace, before, Rule(none, none, False, True), x)
    if status == UNSOLVED:
        status = impulses_with(system, workspace, before, Rule(rebound, none, False, False), x)
    if status == UNSOLVED or (status == SOLVED and gains_energy(system, workspace, before.u, x)):
        status = poisson_impulses(system, workspace, before, rebound, -1, x)
        if status == UNSOLVED or (
            status == SOLVED and gains_energy(system, workspace, before.u, x)
        ):
            status = impulses_with(system, workspace, before, Rule(none, none, False, False), x)
    return status


def strike(system, workspace, t, y, alone):
    """One impact of the approaching contacts; returns NOTHING, STRUCK, NO_IMPULSES or OVERFLOWN.

    `workspace.plastic`: contacts without rebound; `workspace.together`: touching ones that do not
    separate either; alone: only the fastest contact, and equally fast ones. Impulses are in the
    workspace, and `workspace.rebounding` is 1 for contacts that separate afterwards.
    """
    table, velocity_tolerance = system.contact_table, velocity_tolerance_of(system)
    fastest, strikes = find_touching(system, workspace), False
    for c in range(table.shape[0]):
        if workspace.taking_part[c] == 1:
            approaches = table[c, GAP_RATE] < -velocity_tolerance
            strikes = strikes or approaches or must_stop_slipping(system, c)
    if not strikes:
        return NOTHING
    if alone and table[fastest, GAP_RATE] < -velocity_tolerance:
        for c in range(table.shape[0]):
            as_fast = table[c, GAP_RATE] <= (1.0 - TIED) * table[fastest, GAP_RATE]
            workspace.taking_part[c] = 1 if workspace.taking_part[c] == 1 and as_fast else 0
    u, v = np.empty_like(workspace.free_accelerations), np.empty_like(workspace.row_rate)
    read_velocities(system, y, u)
    along_rows(system, workspace, u, v)
    x = workspace.impulses
    status = impulses_of_strike(system, workspace, Velocities(u, v), fastest, x)
    if status == NOT_FINITE:
        return OVERFLOWN
    if status == UNSOLVED:
        return NO_IMPULSES
    if workspace.undetermined[0] > 0.0:
        note(workspace, t, fastest, AMBIGUOUS, (0.0, 0.0, 0.0))
        if workspace.undetermined[0] > workspace.undetermined[1]:
            workspace.undetermined[1] = workspace.undetermined[0]
            workspace.undetermined[2], workspace.undetermined[3] = t, fastest
    apply_impulses(system, workspace, t, y, x)
    read_velocities(system, y, u)
    along_rows(system, workspace, u, v)
    for c in range(table.shape[0]):
        parts = workspace.taking_part[c] == 1 and v[first_row_of(system, c)] > velocity_tolerance
        workspace.rebounding[c] = 1 if parts else 0
    return STRUCK


def stop_jam(system, workspace, t, y, c):
    """Stop the slip of contact c, which jams (Painleve's paradox), by an impact without collision;
    returns STRUCK, NO_IMPULSES or OVERFLOWN.

    Normal impulse and friction drive the contact into the support until the slip stops; then it
    sticks and returns to zero normal velocity (Genot and Brogliato 1999). However it slips
    meanwhile, the total impulse is the one after which it is at rest, within the friction bound as
    all its parts are. Poisson's second phase follows.
    """
    contacts = system.contact_table.shape[0]
    u, v = np.empty_like(workspace.free_accelerations), np.empty_like(workspace.row_rate)
    rebound = np.zeros(contacts)
    for i in range(contacts):
        workspace.taking_part[i] = 1 if i == c else 0
    rebound[c] = system.contact_table[c, RESTITUTION]
    read_velocities(system, y, u)
    along_rows(system, workspace, u, v)
    x = workspace.impulses
    status = poisson_impulses(system, workspace, Velocities(u, v), rebound, c, x)
    if status != SOLVED:
        return OVERFLOWN if status == NOT_FINITE else NO_IMPULSES
    apply_impulses(system, workspace, t, y, x)
    note_impulses(system, workspace, t, JAMS)
    return STRUCK


def strike_in_rounds(system, workspace, t, y, first, last, single):
    """Rounds of impacts first to last - 1, until no contact approaches; endless bounces are closed.

    single: number of rounds with one contact at a time. Returns (result, next round); GOES_ON if
    the workspace has no room for more notes.
    """
    contacts = system.contact_table.shape[0]
    for n in range(first, last):
        if workspace_left(workspace) < OF_ROUND * contacts + 1:
            return GOES_ON, n
        close_endless(system, workspace, t, y)
        rocks = close_rocking(system, workspace, t, y)
        for c in range(contacts):
            if 0 < single <= n or workspace.together[c] == 1:  # endless: the rest all together
                workspace.plastic[c] = 1
        status = strike(system, workspace, t, y, n < single and not rocks)
        if status != STRUCK:
            return status, n
        note_impulses(system, workspace, t, IMPACT)
        count_bounces(workspace)
    return ENDLESS, last
