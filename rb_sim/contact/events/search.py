# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The first event within a step: the first zero of an event function.

After each step the event functions are evaluated (gap, normal force, distance from the friction
bound, slip along its direction). If one is negative, its zero is located to the last digits of the
time by further steps of the method from the same grid point, as samples are computed.
"""

from __future__ import annotations

import numpy as np

from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.catalogue.geometry.corners_and_rims import IN_FLIGHT
from rb_sim.contact.events.grid import Grid, branch, note_stiffness, reach, stop_that_is_due
from rb_sim.contact.problem import copy
from rb_sim.integrate.quadrature import cubic_at, cubic_minimum, cubic_range, tangents_meet
from rb_sim.mechanics.contact import motion_kernels as _registers_its_kernels  # noqa: F401
from rb_sim.mechanics.contact.accelerations import (
    SOON,
    contact_accelerations,
    fastest_creep,
    note_creep,
    slides_with_friction,
)
from rb_sim.mechanics.contact.contact_bodies import (
    AROUND,
    AT_ROLL,
    AT_SLIP,
    AT_SPIN,
    CLOSED,
    EVENT_FUNCTION_KINDS,
    EVENT_FUNCTIONS,
    EVENT_FUNCTIONS_BEFORE,
    EVENT_KINDS,
    EVENT_RATES_BEFORE,
    FASTEST,
    FASTEST_BEFORE,
    FREE,
    GAP,
    GAP_BEFORE,
    GAP_RATE,
    GAP_RATE_BEFORE,
    KINETIC,
    LEAN_SIGN,
    NORMAL,
    NORMAL_BEFORE,
    NORMAL_FORCE,
    RELATIVE_SPIN,
    ROLL,
    ROLL_DIRECTION,
    ROLL_ENDS,
    ROLL_RATE,
    SLIDE,
    SLIP,
    SLIP_DIRECTION,
    SLIP_ENDS,
    SLIP_RATE,
    SPEED_TOLERANCE,
    SPIN,
    SPIN_SIGN,
    STATIC,
    first_row_of,
    keep,
    least_slip,
    may_creep,
)
from rb_sim.mechanics.contact.contact_kinematics import SLIDING
from rb_sim.mechanics.contact.event_functions import (
    end_for_rims,
    in_rigid_flight,
    level_rates,
    lowest_level,
    note_lean,
    roll_level,
    rolling,
    slip_level,
    step_of_swings,
    turned_by_rounding,
)
from rb_sim.mechanics.systems.many_bodies import BODY, MASS, PARENT, WIDTH, vec
from rb_sim.numerics.vectors import dot, norm, scale, sub, unrotate

# Prediction of the first zero of the event functions between two instants.
#
# For the gap of a contact in rigid flight values and rates are known at both instants, and the zero
# is that of a cubic. Any other event function is the cubic over the whole step, by values and rates
# at its ends, plus the difference observed at the nearer instant. A few evaluations thus locate the
# event to the last digits, whatever the number of contacts.


LOCATED = 1e-15
"""Value of an event function below zero, in natural units, at which the event counts as located."""
FLOOR = 3e-16
"""Smallest width of a bracket of an event, relative to the time: little more than rounding."""
REFINED = 6
"""Number of Newton steps for the zero of a cubic."""
EARLY, LATE, BEGIN, END = 0, 2, 4, 6
"""Columns of a bracket: value and rate (if known) of an event function at the earlier and the later
instant, and at the start and the end of the step (times in its last row)."""


def begin_bracket(system, grid, rates, late):
    """The bracket from the start of the step to `late`, (contacts, EVENT_FUNCTION_KINDS + 1, 8).

    Call after `level_at` at `late`; rates: at the end of the step.
    """
    table = system.contact_table
    bracket = np.full((table.shape[0], EVENT_FUNCTION_KINDS + 1, 8), FREE)
    for c in range(table.shape[0]):
        bracket[c, EVENT_FUNCTION_KINDS, BEGIN], bracket[c, EVENT_FUNCTION_KINDS, END] = (
            grid.t0,
            grid.t1,
        )
        for k in range(EVENT_FUNCTION_KINDS):
            bracket[c, k, EARLY] = table[c, EVENT_FUNCTIONS_BEFORE + k]
            bracket[c, k, BEGIN] = table[c, EVENT_FUNCTIONS_BEFORE + k]
            bracket[c, k, BEGIN + 1] = table[c, EVENT_RATES_BEFORE + k]
            if late == grid.t1:
                bracket[c, k, END] = table[c, EVENT_FUNCTIONS + k]
                bracket[c, k, END + 1] = rates[c, k]
        bracket[c, 0, EARLY + 1] = table[c, GAP_RATE_BEFORE] / system.length
    note_event_functions(system, bracket, True)
    return bracket


def note_event_functions(system, bracket, late):
    """Copy the event functions from the table of contacts into one side of the bracket."""
    table, side = system.contact_table, LATE if late else EARLY
    for c in range(table.shape[0]):
        for k in range(EVENT_FUNCTION_KINDS):
            bracket[c, k, side] = table[c, EVENT_FUNCTIONS + k]
        bracket[c, 0, side + 1] = table[c, GAP_RATE] / system.length


def zero_of(a, ra, b, rb, width, target, s):
    """Place at which the cubic has the value `target`, by Newton's method from s."""
    for _ in range(REFINED):
        value, slope = cubic_at(a, ra, b, rb, width, s)
        if slope == 0.0:
            break
        s -= (value - target) / slope
    return s


def crossing(one, step, flies, early, late):
    """(predicted zero of an event function, its rate there); one: its row of the bracket, step: the
    row of times, flies: whether its rates are known."""
    a, b, width = one[EARLY], one[LATE], late - early
    if a < 0.0 and a + one[BEGIN + 1] * width <= 0.0:
        return early, 0.0  # negative by rounding at the start of the step, and not rising
    part = a / (a - b) if 0.0 < a < FREE else 0.5
    rate = (b - a) / width if a < FREE else -abs(b) / width
    if flies and a < FREE:
        s = zero_of(a, one[EARLY + 1], b, one[LATE + 1], width, 0.0, part)
        slope = cubic_at(a, one[EARLY + 1], b, one[LATE + 1], width, s)[1] / width
        if 0.0 <= s <= 1.0:
            return early + s * width, slope
    elif one[BEGIN] < FREE and one[END] < FREE:
        whole = step[END] - step[BEGIN]
        near, seen = (early, a) if abs(a) < abs(b) else (late, b)
        begin, at_begin, end, at_end = one[BEGIN], one[BEGIN + 1], one[END], one[END + 1]
        expected, _ = cubic_at(begin, at_begin, end, at_end, whole, (near - step[BEGIN]) / whole)
        guess = (early + part * width - step[BEGIN]) / whole
        s = zero_of(begin, at_begin, end, at_end, whole, expected - seen, guess)
        slope = cubic_at(begin, at_begin, end, at_end, whole, s)[1] / whole
        t = step[BEGIN] + s * whole
        if early <= t <= late:
            return t, slope
    return early + part * width, rate


def first_crossing(system, bracket, early, late):
    """Instant between `early` and `late` just after the first predicted zero."""
    first, slope = late, 0.0
    for c in range(bracket.shape[0]):
        flies = in_rigid_flight(system.contact_table, c)
        for k in range(EVENT_FUNCTION_KINDS):
            if bracket[c, k, LATE] < 0.0:
                t, rate = crossing(
                    bracket[c, k], bracket[c, EVENT_FUNCTION_KINDS], flies and k == 0, early, late
                )
                if t <= first:
                    first, slope = t, rate
    least = FLOOR * abs(late)
    beyond = 0.5 * LOCATED / abs(slope) if slope != 0.0 else 0.0
    t = first + max(beyond, least)
    if not t < late:
        t = late - 2.0 * max(beyond, least)
    if not early < t < late:
        t = 0.5 * (early + late)
    return t


# Dips: event functions that become negative and positive again within a step.
#
# Over a span of time, values and rates at its ends give a cubic. Its error is measured at a point
# inside, and falls with the fourth power of the span. A span is done if the cubic is farther from
# zero than this error; otherwise it is divided. The distance from a solid with faces has a kink
# where the nearest face changes, which no cubic describes; along a straight path, however, it is
# convex and so above its tangents. A gap that falls first and rises last is therefore evaluated
# where its tangents meet.
#
# A body that is on one side of a solid at the start of a span and on another side at its end may
# have passed through it, whatever the rates are (a body released from rest does not fall at first).
# Such a span is divided until the sides agree or the surfaces move too little to meet.
#
# A step in which an event function changes by less than its distance from zero needs no search.
# Event functions are in natural units; a depth below COMPUTED_ROUNDING is rounding.


ROUNDS, DEPTH = 60, 40
"""Maximum number of points evaluated for one event function of one step, and of stored spans."""
SHORT = 1.0
"""Motion of the surfaces in a span, by the sum of their speeds at its ends and in units of the
scene's length, up to which a cubic describes a gap."""
TURN = 1.0
"""Rotation of the bodies in a span [rad] up to which a cubic describes a gap."""
END_SIZE = 7
"""Number of values of one end of a span."""
UNKNOWN = 1e300
"""Error of a cubic that has not been measured."""
DETOUR = 2.0
"""Longest path of a body in a step, relative to the distance between its start and its end."""
BENT = 1.0
"""Curvature of a gap by rotation and forces, relative to the fall of its tangents within a span."""
INSIDE = 0.05
"""Smallest distance from the ends of a span, relative to it, at which it is divided."""
ONE_SIDE = 0.5
"""Cosine of the angle between the normals at both ends of a span, in axes of the parent, above
which the body is on the same side: faces of a box are 90 degrees apart."""


def add_low_digits(system, c):
    """Add the contribution of the low digits c of the positions to every gap: they matter for a gap
    that is a small difference of large coordinates."""
    table = system.contact_table
    for i in range(table.shape[0]):
        n, k = vec(table, i, NORMAL), first_row_of(system, i)
        b, a = WIDTH * system.row_table[k, BODY], system.row_table[k, PARENT]
        low = (c[b], c[b + 1], c[b + 2])
        if a >= 0:
            low = sub(low, (c[WIDTH * a], c[WIDTH * a + 1], c[WIDTH * a + 2]))
        table[i, GAP] += dot(n, low)


def level_of(system, t, y, c):
    """(lowest event function, its code) of the state y at t; c: low digits of y by compensated
    summation."""
    contact_accelerations(system, t, y)
    add_low_digits(system, c)
    return lowest_level(system)


def level_at(method, system, grid, t, work, y, c):
    """(lowest event function, its code) at t; writes the state there and its low digits to y, c."""
    reach(method, system, grid, t, work, y, c)
    return level_of(system, t, y, c)


def corner_of(a, ra, b, rb, width):
    """Place in the span, 0 to 1, at which a gap with a kink may be negative; -1: none."""
    if not ra < 0.0 < rb:
        return -1.0
    s, least = tangents_meet(a, ra, b, rb, width)
    return s if least < BENT * (a + b - 2.0 * least) - COMPUTED_ROUNDING else -1.0


def normal_on_parent(system, y, i, n):
    """The normal n of contact i in axes of its parent, in the state y."""
    a = system.row_table[first_row_of(system, i), PARENT]
    if a < 0:
        return n
    q = WIDTH * a + 3
    return unrotate((y[q], y[q + 1], y[q + 2], y[q + 3]), n)


def normals_of_step(system, grid, ends, i):
    """The normals of contact i at the start and the end of the step, in axes of its parent."""
    before = normal_on_parent(system, grid.y0, i, vec(ends, i, NORMAL_BEFORE))
    return before, normal_on_parent(system, grid.y1, i, vec(ends, i, NORMAL))


def way_apart(y, other, b, length):
    """Displacement of body b between two states, plus its rotation times the length [m]."""
    way, turn = 0.0, 0.0
    for i in range(3):
        way += (y[WIDTH * b + i] - other[WIDTH * b + i]) ** 2
    for i in range(3, 7):
        turn += (y[WIDTH * b + i] - other[WIDTH * b + i]) ** 2
    return way**0.5 + 2.0 * length * turn**0.5


def way_of_surfaces(system, grid, ends, i):
    """Upper estimate of the relative motion of the two surfaces of contact i in the step [m].

    By the speeds at the ends of the step and by the displacement in it: a pendulum that swings from
    rest to rest is fast in between.
    """
    width, k = grid.t1 - grid.t0, first_row_of(system, i)
    apart = way_apart(grid.y1, grid.y0, system.row_table[k, BODY], system.length)
    if system.row_table[k, PARENT] >= 0:
        apart += way_apart(grid.y1, grid.y0, system.row_table[k, PARENT], system.length)
    return (ends[i, FASTEST_BEFORE] + ends[i, FASTEST]) * width + DETOUR * apart


def spin_of(system, y, i):
    """Sum of the angular speeds of the bodies of contact i in the state y [rad/s]."""
    k = first_row_of(system, i)
    b, a = WIDTH * system.row_table[k, BODY] + 10, system.row_table[k, PARENT]
    spin = norm((y[b], y[b + 1], y[b + 2]))
    if a >= 0:
        a = WIDTH * a + 10
        spin += norm((y[a], y[a + 1], y[a + 2]))
    return spin


def fastest_spin(system, grid, i):
    """The larger of `spin_of` at the ends of the step [rad/s]."""
    return max(spin_of(system, grid.y0, i), spin_of(system, grid.y1, i))


def may_dip(system, grid, ends, rates, i, k):
    """Whether event function k of contact i may become negative within the step and positive again;
    ends: the table of contacts at the end of the step."""
    low, high, width = (
        ends[i, EVENT_FUNCTIONS_BEFORE + k],
        ends[i, EVENT_FUNCTIONS + k],
        grid.t1 - grid.t0,
    )
    if low == FREE or high == FREE or high < -COMPUTED_ROUNDING:
        return False
    if k == 0 and ends[i, CLOSED] == 0.0:
        if ends[i, AROUND] > 0.0 and ends[i, LEAN_SIGN] == IN_FLIGHT:
            return False  # the lowest point of a rim in flight has its own contact
        reach = way_of_surfaces(system, grid, ends, i)
        if ends[i, GAP_BEFORE] + ends[i, GAP] >= reach:
            return False
        if reach > SHORT * system.length or fastest_spin(system, grid, i) * width > TURN:
            return True
        before, after = normals_of_step(system, grid, ends, i)
        if dot(before, after) < ONE_SIDE:
            return True
        if corner_of(low, ends[i, EVENT_RATES_BEFORE], high, rates[i, 0], width) >= 0.0:
            return True
    lowest, highest = cubic_range(low, ends[i, EVENT_RATES_BEFORE + k], high, rates[i, k], width)
    return highest > COMPUTED_ROUNDING and not lowest > highest - lowest


def is_clear(a, ra, b, rb, width, error):
    """Whether a function within `error` of this cubic has no zero inside the span."""
    if not max(a, b) > COMPUTED_ROUNDING:
        return True  # only round-off
    s = cubic_minimum(a, ra, b, rb, width)
    if s > 0.0:
        least, _ = cubic_at(a, ra, b, rb, width, s)
        if not least > error:
            return error <= 0.1 * COMPUTED_ROUNDING and least > -COMPUTED_ROUNDING
    rises_from_a = a > error or ra * width > 8.0 * error
    falls_to_b = b > error or -rb * width > 8.0 * error
    return error <= 0.1 * COMPUTED_ROUNDING or (rises_from_a and falls_to_b)


def put_span(spans, top, a, b, error):
    """Put a span on the stack: (t, value, rate, speed, normal in axes of the parent) at both ends,
    and the error of its cubic; returns the new height."""
    for j in range(END_SIZE):
        spans[top, j], spans[top, END_SIZE + j] = a[j], b[j]
    spans[top, 2 * END_SIZE] = error
    return top + 1


def end_of(spans, top, j):
    """One end of the span at `top` of the stack: the first for j = 0, the second for END_SIZE."""
    return (
        spans[top, j], spans[top, j + 1], spans[top, j + 2], spans[top, j + 3],
        spans[top, j + 4], spans[top, j + 5], spans[top, j + 6],
    )  # fmt: skip


def on_one_side(a, b):
    """Whether the body is on the same side of the parent at the ends a and b of a span."""
    return a[4] * b[4] + a[5] * b[5] + a[6] * b[6] >= ONE_SIDE


def measured(a, ra, b, rb, width, s, value, rate):
    """Largest error of the cubic in the span, estimated from value and rate at s."""
    guess, slope = cubic_at(a, ra, b, rb, width, s)
    place = 4.0 * s * (1.0 - s)
    return max(abs(value - guess) / (place * place), 0.25 * abs(rate * width - slope))


def next_place(a, b, error, width, way, turn, flies):
    """Place in the span from a to b, 0 to 1, to evaluate next; -1 if there is no zero in it.

    way: motion of the surfaces in units of the scene's length; turn: rotation of the bodies [rad];
    flies: whether the function is the gap of an open contact.
    """
    if way > SHORT or turn > TURN:
        return -1.0 if a[1] + b[1] >= way else 0.5
    if flies and not on_one_side(a, b):
        # a body may be at rest at both ends of a whole step and fast in between
        if error < UNKNOWN and a[1] + b[1] >= way:
            return -1.0
        place = corner_of(a[1], a[2], b[1], b[2], width)
        return min(max(place, INSIDE), 1.0 - INSIDE) if place > 0.0 else 0.5
    place = corner_of(a[1], a[2], b[1], b[2], width) if flies else -1.0
    if place < 0.0:
        if is_clear(a[1], a[2], b[1], b[2], width, error):
            return -1.0
        place = cubic_minimum(a[1], a[2], b[1], b[2], width)
    return min(max(place, INSIDE), 1.0 - INSIDE) if place > 0.0 else 0.5


def rate_of(system, t, y, i, k):
    """Rate of event function k of contact i, whose value has been computed at (t, y)."""
    if in_rigid_flight(system.contact_table, i):
        return system.contact_table[i, GAP_RATE] / system.length
    return level_rates(system, t, y)[i, k]


def dip_of(method, system, grid, spans, i, k, work, y, c):
    """(earliest time found in spans[0] at which event function k of contact i is negative, or t1;
    time up to which the span has been searched).

    The second is less than t1 if a gap exceeds ROUNDS or DEPTH. A slip may exceed them where it
    begins, since its event function jumps there; a shorter step would not help.
    """
    table, top = system.contact_table, 1
    flies = k == 0 and table[i, CLOSED] == 0.0
    spin = fastest_spin(system, grid, i) if flies else 0.0
    for _ in range(ROUNDS):
        if top == 0:
            break
        top -= 1
        a, b = end_of(spans, top, 0), end_of(spans, top, END_SIZE)
        width = b[0] - a[0]
        way = (a[3] + b[3]) * width / system.length if flies else 0.0
        s = next_place(a, b, spans[top, 2 * END_SIZE], width, way, spin * width, flies)
        if s < 0.0:
            continue
        t = a[0] + s * width
        if not a[0] < t < b[0]:
            continue
        if top + 2 > DEPTH:
            top += 1
            break
        level_at(method, system, grid, t, work, y, c)
        level = table[i, EVENT_FUNCTIONS + k]
        if level < -COMPUTED_ROUNDING:
            return t, t
        rate = rate_of(system, t, y, i, k)
        error = measured(a[1], a[2], b[1], b[2], width, s, level, rate)
        n = normal_on_parent(system, y, i, vec(table, i, NORMAL))
        middle = (t, level, rate, table[i, FASTEST], n[0], n[1], n[2])
        top = put_span(spans, top, middle, b, 2.0 * error * (1.0 - s) ** 4)
        top = put_span(spans, top, a, middle, 2.0 * error * s**4)
    return grid.t1, spans[top - 1, 0] if flies and top > 0 else grid.t1


def first_that_may_dip(system, grid, rates):
    """Index of the first event function, in the order of the contacts, that may dip; -1: none."""
    for i in range(system.contact_table.shape[0]):
        for k in range(EVENT_FUNCTION_KINDS):
            if may_dip(system, grid, system.contact_table, rates, i, k):
                return i * EVENT_FUNCTION_KINDS + k
    return -1


def first_dip(method, system, grid, rates, work, y, c):
    """(earliest time found within the step at which an event function is negative that is positive
    at its end, or t1; time up to which the step has been searched, see `dip_of`).

    Call after `lowest_level` at t1 and `level_rates`, which returns `rates`. If nothing is found,
    the tables are those of t1 again.
    """
    table, earliest, searched = system.contact_table, grid.t1, grid.t1
    first = first_that_may_dip(system, grid, rates)
    if first < 0:
        return earliest, searched
    ends, spans = table.copy(), np.empty((DEPTH, 2 * END_SIZE + 1))
    for at in range(first, table.shape[0] * EVENT_FUNCTION_KINDS):
        i, k = at // EVENT_FUNCTION_KINDS, at % EVENT_FUNCTION_KINDS
        if at > first and not may_dip(system, grid, ends, rates, i, k):
            continue
        early, late = ends[i, FASTEST_BEFORE], ends[i, FASTEST]
        m, n = normals_of_step(system, grid, ends, i)
        before = (
            grid.t0, ends[i, EVENT_FUNCTIONS_BEFORE + k], ends[i, EVENT_RATES_BEFORE + k], early,
            m[0], m[1], m[2],
        )  # fmt: skip
        after = (grid.t1, ends[i, EVENT_FUNCTIONS + k], rates[i, k], late, n[0], n[1], n[2])
        put_span(spans, 0, before, after, UNKNOWN)
        dip, upto = dip_of(method, system, grid, spans, i, k, work, y, c)
        earliest, searched = min(earliest, dip), min(searched, upto)
    if earliest == grid.t1:
        level_of(system, grid.t1, grid.y1, grid.c1)
        for i in range(table.shape[0]):
            for j in range(table.shape[1]):
                table[i, j] = ends[i, j]
    return earliest, searched


# Values at the start of a step: directions, gaps, event functions, tilts of rims.


def look_ahead(system, rates):
    """Store the values at the start of the next step in the table of contacts.

    Call after `lowest_level` and `level_rates`, which returns `rates`.
    """
    table = system.contact_table
    for c in range(table.shape[0]):
        for i in range(EVENT_FUNCTION_KINDS):
            table[c, EVENT_FUNCTIONS_BEFORE + i] = table[c, EVENT_FUNCTIONS + i]
            table[c, EVENT_RATES_BEFORE + i] = rates[c, i]
        table[c, GAP_RATE_BEFORE], table[c, GAP_BEFORE] = table[c, GAP_RATE], table[c, GAP]
        table[c, FASTEST_BEFORE] = table[c, FASTEST]
        keep(table, c, NORMAL_BEFORE, vec(table, c, NORMAL))
        note_directions(system, c)
        note_creep(system, c)
        note_lean(table, c)


def note_directions(system, c):
    """Store the directions of slip, rolling and spinning, and the event functions along them."""
    table, before, slopes = system.contact_table, EVENT_FUNCTIONS_BEFORE, EVENT_RATES_BEFORE
    slip, roll = vec(table, c, SLIP), rolling(table, c)
    note_direction(table, c, SLIP_DIRECTION, slip, least_slip(system, c))
    about = dot(vec(table, c, RELATIVE_SPIN), vec(table, c, NORMAL))
    velocity_tolerance = system.velocity_tolerance / system.length
    note_direction(table, c, ROLL_DIRECTION, roll, velocity_tolerance)
    if slides_with_friction(table, c):
        table[c, before + AT_SLIP] = slip_level(system, c, slip)
        table[c, slopes + AT_SLIP] = slip_level(system, c, vec(table, c, SLIP_RATE))
    if table[c, CLOSED] == 1.0 and table[c, ROLL] == SLIDING:
        table[c, before + AT_ROLL] = roll_level(system, c, roll)
        table[c, slopes + AT_ROLL] = roll_level(system, c, vec(table, c, ROLL_RATE))
    if abs(about) > velocity_tolerance:
        ahead = 1.0 if about > 0.0 else -1.0
        if table[c, CLOSED] == 1.0 and table[c, SPIN] == SLIDING and ahead != table[c, SPIN_SIGN]:
            table[c, before + AT_SPIN] = -table[c, before + AT_SPIN]
            table[c, slopes + AT_SPIN] = -table[c, slopes + AT_SPIN]
        table[c, SPIN_SIGN] = ahead


def note_direction(table, c, at, a, velocity_tolerance):
    """Store the unit vector of `a` in the table from column `at` on, if |a| is above
    `velocity_tolerance`; otherwise the previous one stays."""
    size = norm(a)
    if size > velocity_tolerance:
        keep(table, c, at, scale(1.0 / size, a))


# Slips on rigid supports that are so slow that errors hide their direction.
#
# At the stages of a step the direction of such a slip is only the error of the method. Friction
# then keeps its previous direction, and most such slips end before that matters. If one lasts, e.g.
# on a pad close to a hinge, and turns by an angle p, friction dissipates mu N s (1 - cos p) too
# little power, with s the slip; the error estimate of the step does not contain it.


LASTING = 10.0
"""A slip lasts if friction has acted for this multiple of the impulse that would stop it."""
LAGS, ERRORS = 0.1, 3.0
"""Speed of the energy that friction should have dissipated, relative to the body's speed as the
slip became slow, and to `velocity_tolerance`; reported above both. 0.1 is 0.01 of the energy."""


PUSHED, BEGAN, NOT_TAKEN, LAG, LAG_TIME, ROUNDED, ROUNDED_TIME, KEPT = range(8)
"""Columns by contact for slow slips: impulse of friction [N s], speed of the body at their start
[m/s], energy not dissipated [J], the largest LAG and its time [s]; for rims: largest angle by which
rounding has turned the tilt (mechanics/contact/event_functions) [rad], and its time [s]. KEPT:
number of columns."""


def speed_of(y, b, arms):
    """|(v_C, A w)| of body b; arms: rows of A of each body (mechanics/error_scales) [m]."""
    total = 0.0
    for i in range(3):
        turned = 0.0
        for j in range(3):
            turned += arms[b, 3 * i + j] * y[WIDTH * b + 10 + j]
        total += y[WIDTH * b + 7 + i] ** 2 + turned * turned
    return total**0.5


def note_rounded_leans(table, kept, t):
    """Store the largest angle by which rounding turns the tilt of a rim in the step from t."""
    for c in range(table.shape[0]):
        turned = turned_by_rounding(table, c)
        if turned > kept[c, ROUNDED]:
            kept[c, ROUNDED], kept[c, ROUNDED_TIME] = turned, t


def note_slow_slips(system, kept, arms, grid):
    """Add up the energy that friction on slow slips has not dissipated in the last step.

    Call after the event functions at its end, before `look_ahead`.
    """
    table = system.contact_table
    for c in range(table.shape[0]):
        slip = vec(table, c, SLIP)
        size = norm(slip)
        followed = size > system.velocity_tolerance or may_creep(system, c)
        if not slides_with_friction(table, c) or followed or size <= SPEED_TOLERANCE * system.speed:
            kept[c, PUSHED] = kept[c, NOT_TAKEN] = 0.0
            continue
        b = lighter(system, c)
        mass, friction = system.bodies[b, MASS], table[c, KINETIC] * table[c, NORMAL_FORCE]
        if kept[c, PUSHED] == 0.0:
            kept[c, BEGAN] = speed_of(grid.y0, b, arms)
        turn = norm(sub(scale(1.0 / size, slip), vec(table, c, SLIP_DIRECTION)))
        kept[c, PUSHED] += friction * (grid.t1 - grid.t0)
        kept[c, NOT_TAKEN] += friction * (grid.t1 - grid.t0) * size * 0.5 * turn * turn
        if kept[c, PUSHED] > LASTING * mass * system.velocity_tolerance:
            speed = (2.0 * kept[c, NOT_TAKEN] / mass) ** 0.5
            share = speed / kept[c, BEGAN] if kept[c, BEGAN] > speed else 1.0
            if speed > ERRORS * system.velocity_tolerance and share > max(kept[c, LAG], LAGS):
                kept[c, LAG], kept[c, LAG_TIME] = share, grid.t0


def lighter(system, c):
    """The lighter one of the two bodies of contact c."""
    k = first_row_of(system, c)
    b, parent = system.row_table[k, BODY], system.row_table[k, PARENT]
    if parent >= 0 and system.bodies[parent, MASS] < system.bodies[b, MASS]:
        return parent
    return b


GRADE, ROUGH, APPROACH = 4.0, 0.1, 1e-10
"""Steps towards the end of a slip, whose direction may turn faster and faster and is rounding at
the very end. The end is located to the fraction ROUGH of the remaining time, steps shrink by the
factor GRADE, until the remaining time is APPROACH (natural units)."""

CUTS = 40
"""Maximum number of reductions of a step for the tilt of rims."""

TRIES = 32
"""Number of steps between attempts to let creeping contacts stick."""


def begin_step(system, t, y, c):
    """Update the tables for a step that starts at (t, y); c: low digits of y."""
    level_of(system, t, y, c)
    look_ahead(system, level_rates(system, t, y))
    note_stiffness(system, y)


def cut_grid(grid, t, y, c, h):
    """The grid whose last step ends at t in the state y with low digits c; h: next step to try."""
    y1, c1 = copy(grid.y1, y), copy(grid.c1, c)
    return Grid(
        grid.origin + (t - grid.t1), grid.steps, grid.rejected, grid.t0, grid.y0, grid.c0,
        t, y1, c1, h, grid.y, grid.c,
    )  # fmt: skip


def not_too_far(method, system, grid, work, y, c):
    """(lowest event function, its code, the grid with its last step cut as the tilt of rims
    requires); the tables are those of its end.

    A long step may pass straight through the flat position without a stage near it, where the
    shorter one does not: the error of the shorter step decides whether it is short enough.
    """
    lowest, code = level_of(system, grid.t1, grid.y1, grid.c1)
    error, least = 0.0, 2.0 * step_of_swings(system)
    for _ in range(CUTS):
        t = end_for_rims(system, grid.t0, grid.t1)
        if error > 1.0 and grid.t1 - grid.t0 > least:
            t = 0.5 * (grid.t0 + grid.t1)
        if t == grid.t1:
            break
        error = reach(method, system, grid, t, work, y, c)
        lowest, code = level_of(system, t, y, c)
        grid = cut_grid(grid, t, y, c, grid.h)
    return lowest, code, grid


def slip_vanishes(code):
    """Whether this event is the end of a slip or of rolling."""
    kind = code % EVENT_KINDS
    return kind == SLIP_ENDS or kind == ROLL_ENDS


def is_none(width, t):
    """Whether a span of time that ends at t is only rounding."""
    return width <= 1e-15 * max(abs(t), width)


def locate(method, system, grid, rates, late, lowest, work, at, best):
    """(instant before, instant after, code) of the first event up to `late`.

    lowest: lowest event function, which is negative, and its code at `late`. best: state and low
    digits at `late`; then those at the instant after the event. at: workspace.
    """
    (deepest, found), (y, c) = lowest, at
    bracket, early = begin_bracket(system, grid, rates, late), grid.t0
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
            copy(best[0], y)
            copy(best[1], c)
        else:
            early = t
    return early, late, found


def half_of(method, system, grid, work, y, c):
    """(lowest event function, its code, the grid with the first half of its last step), for a step
    that is too long to be searched."""
    t = 0.5 * (grid.t0 + grid.t1)
    lowest, code = level_at(method, system, grid, t, work, y, c)
    return lowest, code, cut_grid(grid, t, y, c, t - grid.t0)


def next_event(method, system, grid, work, kept, arms):
    """(code of the first event within the last step or -1, the grid cut there).

    kept: table of slow slips, see PUSHED; arms: as for `speed_of`."""
    y, c = np.empty_like(grid.y1), np.empty_like(grid.c1)
    lowest, code, grid = not_too_far(method, system, grid, work, y, c)
    best, low = np.empty_like(y), np.empty_like(c)
    early, found = grid.t0, -1
    approach_time = APPROACH * system.length / system.speed
    while True:
        rates = level_rates(system, grid.t1, grid.y1)
        late, searched = first_dip(method, system, grid, rates, work, y, c)
        if searched < late and not is_none(grid.t1 - grid.t0, grid.t1):
            lowest, code, grid = half_of(method, system, grid, work, y, c)
            found = -1
            continue
        if late == grid.t1 and found >= 0:
            break
        if late == grid.t1 and not lowest < -COMPUTED_ROUNDING:
            note_slow_slips(system, kept, arms, grid)
            look_ahead(system, rates)
            note_stiffness(system, grid.y1)
            rests = creep_that_may_rest(system, grid)
            return rests if rests >= 0 else stop_that_is_due(method, system, grid.t1), grid
        copy(best, grid.y1)
        copy(low, grid.c1)
        if late < grid.t1:
            lowest, code = level_at(method, system, grid, late, work, y, c)
            copy(best, y)
            copy(low, c)
        early, late, found = locate(
            method, system, grid, rates, late, (lowest, code), work, (y, c), (best, low)
        )
        # a function negative at the end of the step, or another one, may have a dip before
        grid = cut_grid(grid, late, best, low, grid.h)
        lowest, code = level_of(system, late, grid.y1, grid.c1)
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


def nearly_stopped(system):
    """Code of the end of a slip that is slower than SPEED_TOLERANCE; or -1."""
    for c in range(system.contact_table.shape[0]):
        if system.contact_table[c, CLOSED] == 1.0 and system.contact_table[c, SLIDE] == SLIDING:
            slip = norm(vec(system.contact_table, c, SLIP))
            if system.contact_table[c, STATIC] > 0.0 and slip < SPEED_TOLERANCE * system.speed:
                return EVENT_KINDS * c + SLIP_ENDS
    return -1


def creep_that_may_rest(system, grid):
    """Code of the event that all creeping contacts are slow enough to stick; or -1. If they do not
    stick, they are tried again after TRIES steps."""
    most, bound, first = fastest_creep(system)
    again = grid.steps % TRIES == 0 and most < SOON * system.creep
    return EVENT_KINDS * first + SLIP_ENDS if first >= 0 and (most < bound or again) else -1
