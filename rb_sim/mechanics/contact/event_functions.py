# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Event functions of bodies in contact: positive while the present modes are valid; dimensionless.

A contact has EVENT_FUNCTION_KINDS of them: the gap if it is open, the normal force if it is closed;
for slip, rolling and spinning each the distance of the friction from its bound at rest, or the
speed along the previous direction in motion; and the pivot of a slipping contact. One that a
contact does not have is FREE.
"""

from __future__ import annotations

import numpy as np

from rb_sim.base.rounding import TWO_ULPS
from rb_sim.catalogue.geometry.corners_and_rims import ABSENT, FLAT, IN_FLIGHT, SLAMS
from rb_sim.mechanics.contact.accelerations import contact_accelerations
from rb_sim.mechanics.contact.contact_bodies import (
    AT_JAM,
    AT_ROLL,
    AT_SLIP,
    AT_SPIN,
    AXIS,
    BILATERAL,
    CLOSED,
    COMPLIANT,
    CREEPS,
    DAMPING,
    EVENT_FUNCTION_KINDS,
    EVENT_FUNCTIONS,
    EVENT_KINDS,
    FREE,
    GAP,
    GAP_RATE,
    JAMMED,
    JAMS,
    LEAN_BEFORE,
    LEAN_SIGN,
    LEAN_WIDTH,
    LIES_FLAT,
    LIFT_OFF,
    LOW,
    MOST_RANK,
    NEARS,
    NORMAL,
    NORMAL_FORCE,
    NORMAL_SIGN,
    NUDGE,
    PIVOT,
    RANK,
    RELATIVE_SPIN,
    RIM,
    ROLL,
    ROLL_BEGINS,
    ROLL_DIRECTION,
    ROLL_ENDS,
    ROLL_RATE,
    ROLLING_ARM,
    SHARP,
    SLIDE,
    SLIP,
    SLIP_BEGINS,
    SLIP_DIRECTION,
    SLIP_ENDS,
    SLIP_RATE,
    SPIN,
    SPIN_BEGINS,
    SPIN_ENDS,
    SPIN_SIGN,
    SPINNING_ARM,
    SPRING,
    STATIC,
    SWING,
    TOUCH_DOWN,
    first_row_of,
    keep,
)
from rb_sim.mechanics.contact.contact_kinematics import SLIDING, STUCK
from rb_sim.mechanics.systems.many_bodies import MULTIPLIERS, vec
from rb_sim.mechanics.systems.multibody import put_rates
from rb_sim.numerics.vectors import add, cross, dot, norm, scale, sub

# Rims in contact at one point that nearly fall flat: how long a step may be.
#
# The tilt of a rim, as a vector across the plane's normal, passes the flat position as a particle
# passes the tip of a cone: the lowest point runs round the rim within the time tilt / rate, and the
# contact force is the larger the closer the flat position is passed (Srinivasan and Ruina, "Rocking
# and rolling: A can that appears to rock might actually roll", Phys. Rev. E 78, 2008). A long step
# may have no stage within that time and would pass straight through the flat position. So steps are
# shortened until they resolve it. A rim that falls straight to flat slams: its next point touches.


NEARLY_FLAT = 1e-7
"""Tilt [rad] below which a rim that falls straight to flat slams."""
MISSED = 0.5 * FLAT
"""Largest tilt [rad] at closest approach of a rim that slams."""
TURNED, LEANS = 0.5, 0.9
"""TURNED: cosine of the largest angle by which the tilt vector may turn in a step. LEANS: sine of
the tilt above which it may turn by any angle."""
SHALLOW, PART = 1e-5, 0.02
"""SHALLOW: tilt [rad] below which rounding turns the tilt vector by more than a tolerance. PART:
step of order 8, relative to tilt / rate, whose error is rounding."""
ROUND, ROUND_PART, NEARER = 0.3, 0.03, 0.5
"""ROUND: largest fixed step relative to tilt / rate. ROUND_PART, NEARER: step that is taken instead
of a longer one, if the lowest point runs round, or if the rim still falls straight to flat."""
STRAIGHT = 0.99995
"""Cosine of the angle between tilt and its rate above which a rim falls straight."""


def is_held(table, c):
    """Whether any point of the rim of contact c is in contact."""
    for other in range(table.shape[0]):
        if table[other, RIM] == table[c, RIM] and table[other, CLOSED] == 1.0:
            return True
    return False


def note_lean(table, c):
    """Set the tilt of a rim at the start of a step, and the time and direction of its fall."""
    for i in range(LEAN_WIDTH):
        table[c, LEAN_BEFORE + i] = table[c, LOW + i]
    table[c, SWING], table[c, NEARS] = FREE, 0.0
    if table[c, RIM] < 0.0:
        return
    if not is_held(table, c):
        table[c, LEAN_BEFORE + 6] = IN_FLIGHT
        return
    side, size = 1.0 if table[c, LEAN_SIGN] > 0.0 else -1.0, abs(table[c, LEAN_SIGN])
    if size == IN_FLIGHT or size == SLAMS:
        table[c, LEAN_BEFORE + 6] = side
    lean, rate = vec(table, c, AXIS), lean_rate(table, c)
    tilt, speed = norm(lean), norm(rate)
    if not FLAT < tilt < speed * FREE:
        return
    table[c, SWING], table[c, NEARS] = tilt / speed, -dot(lean, rate) / (tilt * speed)
    missed = norm(cross(lean, rate)) / speed
    if table[c, NEARS] > 0.0 and missed < MISSED and tilt < NEARLY_FLAT:
        table[c, LEAN_BEFORE + 6] = side * SLAMS


def lean_rate(table, c):
    """Rate [rad/s] of the tilt vector of a rim relative to its support."""
    lean, n = vec(table, c, AXIS), vec(table, c, NORMAL)
    upright = max(0.0, 1.0 - dot(lean, lean)) ** 0.5
    rate = cross(vec(table, c, RELATIVE_SPIN), add(lean, scale(upright, n)))
    return sub(rate, scale(dot(rate, n), n))


def lean_has_turned(table, c):
    """Whether the lowest point of a rim has moved too far round it in the step."""
    lean, before = vec(table, c, AXIS), vec(table, c, LEAN_BEFORE + 3)
    least, most = min(norm(lean), norm(before)), max(norm(lean), norm(before))
    if least <= FLAT or least > LEANS or abs(table[c, LEAN_BEFORE + 6]) == SLAMS:
        return False
    return dot(lean, before) < TURNED * least * most


def end_for_rims(system, t0, t1):
    """Latest end of the step from t0 to t1 for rims in contact [s]; the tables are those of t1."""
    table, end = system.contact_table, t1
    for c in range(table.shape[0]):
        if table[c, RIM] >= 0.0 and table[c, CLOSED] == 1.0 and lean_has_turned(table, c):
            end = 0.5 * (t0 + t1)
    return end


def before_swing(method, system, t0, t1):
    """Latest end of a fixed step from t0 to t1 for rims whose lowest point would run far round."""
    table, end = system.contact_table, t1
    if method.setting[1] != 0.0:
        return end
    for c in range(table.shape[0]):
        round_it = abs(table[c, NEARS]) < STRAIGHT
        goes = table[c, CLOSED] == 1.0 and (round_it or table[c, NEARS] > 0.0)
        if goes and t1 - t0 > ROUND * table[c, SWING]:
            end = min(end, t0 + (ROUND_PART if round_it else NEARER) * table[c, SWING])
    return end


def step_of_swings(system):
    """Smallest useful step for rims that pass very close to flat [s]; 0 without such rims. Shorter
    steps would only resolve how rounding turns the tilt."""
    table, least = system.contact_table, FREE
    for c in range(table.shape[0]):
        if table[c, CLOSED] == 1.0 and norm(vec(table, c, LEAN_BEFORE + 3)) < SHALLOW:
            least = min(least, table[c, SWING])
    return PART * least if least < FREE else 0.0


def turned_by_rounding(table, c):
    """Angle [rad] by which rounding turns the tilt vector of contact c's rim at the start of the
    step; 0 unless its lowest point runs round."""
    goes = table[c, CLOSED] == 1.0 and table[c, SWING] < FREE and abs(table[c, NEARS]) < STRAIGHT
    return TWO_ULPS / norm(vec(table, c, LEAN_BEFORE + 3)) if goes else 0.0


def natural_force(system):
    """Unit of force of the scene, m v^2 / l, from its mass, speed and length [N]."""
    return system.mass * system.speed * system.speed / system.length


def natural_turning(system):
    """Unit of angular velocity for rolling and spinning: v / l over SHARP [rad/s]."""
    return system.speed / system.length / SHARP


def approach(system, c):
    """Event function of an open contact: its gap in units of the scene's length.

    A body that leaves a damped support is open although it still overlaps, until the support would
    push again; then the function is the negative force, and it is continuous at the end of the
    overlap.
    """
    table, level = system.contact_table, system.contact_table[c, GAP] / system.length
    if table[c, LEAN_SIGN] == ABSENT:
        return FREE
    if table[c, COMPLIANT] == 1.0:
        pull = -table[c, SPRING] if level < 0.0 else table[c, DAMPING] * table[c, GAP_RATE]
        level = max(level, pull / natural_force(system))
    return level


def slip_level(system, c, slip):
    """Event function of a slipping contact: its slip along the previous direction."""
    return SHARP * dot(slip, vec(system.contact_table, c, SLIP_DIRECTION)) / system.speed


def rolling(table, c):
    """Relative angular velocity across the normal [rad/s], without spinning."""
    turn, n = vec(table, c, RELATIVE_SPIN), vec(table, c, NORMAL)
    return sub(turn, scale(dot(turn, n), n))


def roll_level(system, c, roll):
    """Event function of a rolling contact that moves: its rate along the previous direction."""
    return dot(roll, vec(system.contact_table, c, ROLL_DIRECTION)) / natural_turning(system)


def tail(system, k):
    """Norm of the multipliers of rows k and k + 1."""
    x, z = system.vectors[MULTIPLIERS, k], system.vectors[MULTIPLIERS, k + 1]
    return (x * x + z * z) ** 0.5


def normal_force_events(system, c):
    """Event functions of the normal force and of the friction of a closed contact."""
    table, k, force = system.contact_table, first_row_of(system, c), natural_force(system)
    normal = table[c, NORMAL_FORCE]
    if table[c, BILATERAL] == 0.0:
        table[c, EVENT_FUNCTIONS] = normal / force
    else:
        if table[c, SLIDE] == SLIDING and table[c, STATIC] > 0.0:
            table[c, EVENT_FUNCTIONS] = table[c, NORMAL_SIGN] * normal / force
        normal = abs(normal)
    if table[c, SLIDE] == STUCK and table[c, STATIC] < 1e300:
        table[c, EVENT_FUNCTIONS + AT_SLIP] = (
            table[c, STATIC] * normal - tail(system, k + 1)
        ) / force
    elif table[c, SLIDE] == SLIDING and table[c, STATIC] > 0.0:
        if table[c, CREEPS] == 0.0:
            table[c, EVENT_FUNCTIONS + AT_SLIP] = slip_level(system, c, vec(table, c, SLIP))
        if table[c, COMPLIANT] == 0.0:
            table[c, EVENT_FUNCTIONS + AT_JAM] = table[c, PIVOT] - JAMMED
    turn, torque = vec(table, c, RELATIVE_SPIN), force * system.length
    if table[c, ROLL] == STUCK:
        level = table[c, ROLLING_ARM] * normal - tail(system, k + 3)
        table[c, EVENT_FUNCTIONS + AT_ROLL] = level / torque
    elif table[c, ROLL] == SLIDING:
        table[c, EVENT_FUNCTIONS + AT_ROLL] = roll_level(system, c, rolling(table, c))
    if table[c, SPIN] == STUCK:
        level = table[c, SPINNING_ARM] * normal - abs(system.vectors[MULTIPLIERS, k + 5])
        table[c, EVENT_FUNCTIONS + AT_SPIN] = level / torque
    elif table[c, SPIN] == SLIDING:
        about = table[c, SPIN_SIGN] * dot(turn, vec(table, c, NORMAL))
        table[c, EVENT_FUNCTIONS + AT_SPIN] = about / natural_turning(system)


def event_of(table, c, i):
    """The kind of event at which event function i of contact c vanishes."""
    if i == 0:
        return LIFT_OFF if table[c, CLOSED] == 1.0 else TOUCH_DOWN
    if i == AT_SLIP:
        return SLIP_ENDS if table[c, SLIDE] == SLIDING else SLIP_BEGINS
    if i == AT_ROLL:
        return ROLL_ENDS if table[c, ROLL] == SLIDING else ROLL_BEGINS
    if i == AT_SPIN:
        return SPIN_ENDS if table[c, SPIN] == SLIDING else SPIN_BEGINS
    return JAMS


def lowest_level(system):
    """(least value, code of its event) of all event functions, which are written into the table of
    contacts. Call after `contact_accelerations`."""
    table, lowest, code = system.contact_table, FREE, -1
    for c in range(table.shape[0]):
        for i in range(EVENT_FUNCTION_KINDS):
            table[c, EVENT_FUNCTIONS + i] = FREE
        if table[c, CLOSED] == 1.0:
            normal_force_events(system, c)
            if abs(table[c, LEAN_SIGN]) - 0.5 < lowest:
                lowest, code = abs(table[c, LEAN_SIGN]) - 0.5, EVENT_KINDS * c + LIES_FLAT
        else:
            table[c, EVENT_FUNCTIONS] = approach(system, c)
        for i in range(EVENT_FUNCTION_KINDS):
            if table[c, EVENT_FUNCTIONS + i] < lowest:
                lowest, code = (
                    table[c, EVENT_FUNCTIONS + i],
                    EVENT_KINDS * c + event_of(table, c, i),
                )
    return lowest, code


def in_rigid_flight(table, c):
    """Whether contact c is open and rigid, so that it closes by an impact."""
    return table[c, CLOSED] == 0.0 and table[c, COMPLIANT] == 0.0


def level_rates(system, t, y):
    """Rates of the event functions at (t, y), shape (contacts, EVENT_FUNCTION_KINDS).

    Call after `contact_accelerations` and `lowest_level`. It changes all tables except that of the
    contacts, into which it writes the rates of slip and rolling.
    """
    table = system.contact_table
    rates, least = np.zeros((table.shape[0], EVENT_FUNCTION_KINDS)), FREE
    for c in range(table.shape[0]):
        if in_rigid_flight(table, c):
            rates[c, 0] = table[c, GAP_RATE] / system.length
        else:
            for i in range(EVENT_FUNCTION_KINDS):
                least = min(least, table[c, EVENT_FUNCTIONS + i])
    if least == FREE:
        return rates
    kept, nudge = table.copy(), NUDGE * system.length / system.speed
    later = np.zeros_like(y)
    put_rates(system, y, later)
    for i in range(y.shape[0]):
        later[i] = y[i] + nudge * later[i]
    row_table = system.row_table
    most = row_table[0, MOST_RANK]
    row_table[0, MOST_RANK] = row_table[0, RANK]  # off the manifold rows contradict each other
    contact_accelerations(system, t + nudge, later)
    row_table[0, MOST_RANK] = most
    lowest_level(system)
    for c in range(table.shape[0]):
        for i in range(EVENT_FUNCTION_KINDS):
            if not (i == 0 and in_rigid_flight(kept, c)):
                rates[c, i] = (table[c, EVENT_FUNCTIONS + i] - kept[c, EVENT_FUNCTIONS + i]) / nudge
        slip = scale(1.0 / nudge, sub(vec(table, c, SLIP), vec(kept, c, SLIP)))
        roll = scale(1.0 / nudge, sub(rolling(table, c), rolling(kept, c)))
        for j in range(table.shape[1]):
            table[c, j] = kept[c, j]
        keep(table, c, SLIP_RATE, slip)
        keep(table, c, ROLL_RATE, roll)
    return rates
