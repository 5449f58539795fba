# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""N bodies with contacts that open, slip, stick and roll.

A contact has rows in the same table as every other constraint: one normal, two tangential and, if
it resists rotation, two rolling rows and one spinning row. Its mode determines which rows are
active; the others are zero and are left out of every solve. The force of a slipping contact is
along n + T(s)/N, not along n, so the force directions have a table of their own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rb_sim.catalogue.contact import ContactLaw
from rb_sim.mechanics.system import EVENT_DRIVEN
from rb_sim.mechanics.systems.many_bodies import ROW_TABLE_COLUMNS

# The table of contacts, `ContactBodies.contact_table`: a row for each point, columns by name.
#
# It has four parts. PARAMETERS are constants of the contact. STATE is carried from step to step;
# only events and the start of a step write it. START holds values at the start of the step, for the
# location of events within it. SCRATCH is written by every evaluation of the equations before it is
# read, so that a sample between two steps changes neither.


class Column(NamedTuple):
    """One quantity of the table; vectors have world axes."""

    name: str
    width: int
    """number of columns."""
    unit: str
    meaning: str


EVENT_FUNCTION_KINDS = 5
"""Number of event functions of a contact: gap or normal force, slip, rolling, spinning, jam. Each
may pass through zero and return within a step."""
AT_SLIP, AT_ROLL, AT_SPIN, AT_JAM = 1, 2, 3, 4
"""Indices of these; gap or normal force has index 0."""

LEAN_WIDTH = 7
"""Number of values in a Lean (catalogue/geometry/corners_and_rims)."""

PARAMETERS = (
    Column("static", 1, "1", "largest traction at rest over N; 0: a law without static friction"),
    Column("rolling_arm", 1, "m", "largest rolling torque at rest over N"),
    Column("spinning_arm", 1, "m", "largest spinning torque at rest over N"),
    Column("bilateral", 1, "0 or 1", "whether N may be negative"),
    Column("compliant", 1, "0 or 1", "whether the support is compliant"),
    Column("rim", 1, "number", "first contact that is a point of the same rim; -1: no rim"),
    Column("restitution", 1, "1", "coefficient of restitution e"),
    Column("kinetic", 1, "1", "traction over N as a slip begins; inf: perfectly rough"),
    Column("drags", 1, "0 or 1", "whether there is traction without N"),
    Column("stiffness", 1, "N/m", "of a compliant support"),
    Column("damping", 1, "N s/m", "of a compliant support"),
)

STATE = (
    Column("closed", 1, "0 or 1", "whether the contact is closed"),
    Column("slide", 1, "mode", "traction: NONE, SLIDING or STUCK"),
    Column("roll", 1, "mode", "rolling torque: NONE, SLIDING or STUCK"),
    Column("spin", 1, "mode", "spinning torque: NONE, SLIDING or STUCK"),
    Column("normal_sign", 1, "sign", "of N, if it may be negative"),
    Column("slip_direction", 3, "1", "direction of slip at the start of the step"),
    Column("roll_direction", 3, "1", "direction of rolling at the start of the step"),
    Column("spin_sign", 1, "sign", "of spinning at the start of the step"),
    Column(
        "creeps", 1, "m/s", "slip below which a creeping contact may stick; 0: it does not creep"
    ),
    Column("lean_before", LEAN_WIDTH, "Lean", "of a rim at the start of the step"),
)

START = (
    Column("gap_before", 1, "m", "gap at the start of the step"),
    Column("gap_rate_before", 1, "m/s", "rate of the gap there"),
    Column("fastest_before", 1, "m/s", "upper bound of the speed of all points there"),
    Column("normal_before", 3, "1", "n there"),
    Column(
        "event_functions_before",
        EVENT_FUNCTION_KINDS,
        "1",
        "event functions at the start of the step",
    ),
    Column("event_rates_before", EVENT_FUNCTION_KINDS, "1/s", "their rates there"),
    Column("stiff", 1, "1/s", "rate at which friction turns a lasting slip; 0: none, or it ends"),
    Column("slip_rate", 3, "m/s^2", "rate of the slip there"),
    Column("roll_rate", 3, "rad/s^2", "rate of the rolling velocity there"),
    Column("swing", 1, "s", "tilt over its rate: time in which a rim's lowest point may run round"),
    Column("nears", 1, "1", "cosine of the angle between tilt and its rate, as vectors, negated"),
)

SCRATCH = (
    Column("gap", 1, "m", "distance of the surfaces along n, negative if they overlap"),
    Column("gap_rate", 1, "m/s", "rate of the gap"),
    Column("normal", 3, "1", "n, from the parent to the body"),
    Column("point", 3, "m", "P, contact point or nearest point"),
    Column("slip", 3, "m/s", "velocity of the body relative to the parent at P, across n"),
    Column("relative_spin", 3, "rad/s", "angular velocity of the body relative to the parent"),
    Column("direct", 3, "N", "force independent of N: viscous, or of a compliant support"),
    Column("direct_torque", 3, "N m", "torque independent of N, about P"),
    Column("normal_force", 1, "N", "N"),
    Column("pivot", 1, "1", "pivot of N with friction over that without; 0 if friction jams"),
    Column("spring", 1, "N", "force of a compliant support, also if it would pull"),
    Column("fastest", 1, "m/s", "upper bound of the speed of all points"),
    Column(
        "event_functions", EVENT_FUNCTION_KINDS, "1", "event functions in the mode of the contact"
    ),
    Column("low", 3, "1", "direction of the lowest point of a rim (Lean)"),
    Column("axis", 3, "1", "upward axis of the rim, projected across n (Lean)"),
    Column("lean_sign", 1, "sign", "of the tilt; ABSENT: the rim has no such point here"),
    Column("around", 1, "rad", "angle from the lowest point of the rim"),
)


def first_columns(*parts: tuple[Column, ...]) -> tuple[dict[str, int], int]:
    """(first column of each quantity, number of columns)."""
    places: dict[str, int] = {}
    at = 0
    for column in (column for part in parts for column in part):
        places[column.name], at = at, at + column.width
    return places, at


_AT, CONTACT_TABLE_WIDTH = first_columns(PARAMETERS, STATE, START, SCRATCH)

STATIC, ROLLING_ARM, SPINNING_ARM = _AT["static"], _AT["rolling_arm"], _AT["spinning_arm"]
BILATERAL, COMPLIANT, RIM = _AT["bilateral"], _AT["compliant"], _AT["rim"]
RESTITUTION, KINETIC, DRAGS = _AT["restitution"], _AT["kinetic"], _AT["drags"]
STIFFNESS, DAMPING, PARAMETERS_WIDTH = _AT["stiffness"], _AT["damping"], _AT["closed"]
CLOSED, SLIDE, ROLL, SPIN, NORMAL_SIGN = (
    _AT[n] for n in ("closed", "slide", "roll", "spin", "normal_sign")
)
SLIP_DIRECTION, ROLL_DIRECTION, SPIN_SIGN = (
    _AT["slip_direction"],
    _AT["roll_direction"],
    _AT["spin_sign"],
)
LEAN_BEFORE, CREEPS = _AT["lean_before"], _AT["creeps"]
STIFF = _AT["stiff"]
GAP_BEFORE, GAP_RATE_BEFORE = _AT["gap_before"], _AT["gap_rate_before"]
FASTEST_BEFORE, NORMAL_BEFORE = _AT["fastest_before"], _AT["normal_before"]
EVENT_FUNCTIONS_BEFORE, EVENT_RATES_BEFORE = (
    _AT["event_functions_before"],
    _AT["event_rates_before"],
)
SLIP_RATE, ROLL_RATE = _AT["slip_rate"], _AT["roll_rate"]
SWING, NEARS = _AT["swing"], _AT["nears"]
GAP, GAP_RATE, NORMAL, POINT = (_AT[n] for n in ("gap", "gap_rate", "normal", "point"))
SLIP, RELATIVE_SPIN = _AT["slip"], _AT["relative_spin"]
DIRECT, DIRECT_TORQUE, NORMAL_FORCE = _AT["direct"], _AT["direct_torque"], _AT["normal_force"]
PIVOT, SPRING, FASTEST, EVENT_FUNCTIONS = (
    _AT[n] for n in ("pivot", "spring", "fastest", "event_functions")
)
LOW, AXIS, LEAN_SIGN, AROUND = (_AT[n] for n in ("low", "axis", "lean_sign", "around"))

GEOMETRY_WIDTH = RELATIVE_SPIN + 3 - GAP
"""Number of columns from GAP on that the law of every contact computes, in this order."""
FORCES_WIDTH = NORMAL_FORCE + 1 - DIRECT
"""Number of columns from DIRECT on that the law of a closed contact computes, in this order."""

FIRST_OF_SCRATCH = GAP
"""First column that an evaluation of the equations overwrites."""


def write_parameters(row: np.ndarray, law: ContactLaw) -> None:
    """Write the columns of PARAMETERS, except the rim, into a row of this or another table."""
    row[[STATIC, KINETIC, RESTITUTION]] = law.static, law.kinetic, law.restitution
    row[[ROLLING_ARM, SPINNING_ARM, BILATERAL]] = law.rolling_arm, law.spinning_arm, law.bilateral
    row[[COMPLIANT, DRAGS]] = law.compliant, law.drags
    row[[STIFFNESS, DAMPING]] = law.spring


TOUCH_DOWN, LIFT_OFF, SLIP_ENDS, SLIP_BEGINS = 0, 1, 2, 3
ROLL_ENDS, ROLL_BEGINS, SPIN_ENDS, SPIN_BEGINS, JAMS, LIES_FLAT = 4, 5, 6, 7, 8, 9
EVENT_KINDS = 16
"""An event's code is EVENT_KINDS contact + kind."""
FREE = 1e300
"""Value of an event function that a contact does not have."""
NUDGE = 1e-6
"""Time difference for the rates of event functions, in natural units."""
SHARP = 100.0
"""Factor of the event functions of slip and rotation, which have less rounding than gaps and
forces."""
SPEED_TOLERANCE = 1e-10
"""Speed of approach, slip or rotation, relative to the speed of the scene, that counts as zero."""
JAMMED = 1e-6
"""Pivot of a slipping contact with friction, relative to the one without, below which its force
is unbounded (Painleve's paradox)."""
NEAR_JAM = 1e-3
"""The same limit for the contact that jams if no force or no step is found."""


class ContactBodies(NamedTuple):
    """As MultiBody, with contacts; y has WIDTH coordinates per body, then the contacts' work."""

    bodies: np.ndarray
    row_table: np.ndarray
    """body, parent, workspace, ANGLE and DEPENDENT; integers, shape (n, ROW_TABLE_WIDTH)."""
    rows: np.ndarray
    delassus: np.ndarray
    """A = G M^-1 W^T of the active rows, and workspace, shape (2, n, n)."""
    vectors: np.ndarray
    first_row: np.ndarray
    members: np.ndarray
    anchors: np.ndarray
    length: float
    speed: float
    effects: tuple
    constraints: tuple
    contacts: tuple
    """placed ContactRows in groups of one kind; their parts come after those of the constraints."""
    contact_table: np.ndarray
    """the table of contacts, see above, shape (contacts, CONTACT_TABLE_WIDTH)."""
    force_rows: np.ndarray
    """force direction of each row, as the 12 columns of a Jacobian, shape (n, 12)."""
    mass: float
    """of all bodies [kg]."""
    velocity_tolerance: float
    """slip below which the method's errors hide its direction, which is then kept [m/s]."""
    creep: float
    """slip below which a compliant contact creeps; 0: no contact creeps [m/s]."""

    @property
    def joints(self) -> int:
        """Number of parts of the constraints that are not contacts."""
        return len(self.constraints)


EVENT_DRIVEN.add(ContactBodies)

SHARES = 2
"""Row of ContactBodies.vectors: reactions to which the undetermined ones are nearest."""
ACTIVE, DEPENDENT, RANK, MOST_RANK, STEP_RANK, REDUNDANT, ROW_TABLE_WIDTH = range(
    ROW_TABLE_COLUMNS, ROW_TABLE_COLUMNS + 7
)
"""Columns of ContactBodies.row_table: active rows, and whether a row of a joint depends on other
rows of joints (sum of the values below). The first row also has, for all rows: the rank found last,
the largest rank allowed, that of the last step, and 1 if one was below the number of active rows.
"""
NOWHERE, AMONG_ROWS, AMONG_POSITIONS, CHANGING = 0, 1, 2, 4
"""A row depends on none, on all rows of joints, or on the holonomic ones; off the manifold, at the
stages of a step, it contradicts them. CHANGING: chosen anew at the start of each step."""


def keep(table, c, at, a):
    """Write a vector into row c of the table of contacts, from column `at` on."""
    for j in range(3):
        table[c, at + j] = a[j]


def may_creep(system, c):
    """Whether contact c creeps at slow slips."""
    return system.contact_table[c, COMPLIANT] == 1.0 and system.creep > 0.0


def least_slip(system, c):
    """Slip of contact c below which its direction is not followed [m/s]."""
    return system.creep if may_creep(system, c) else system.velocity_tolerance


def first_row_of(system, c):
    """First row of contact c."""
    return system.first_row[system.joints + c]
