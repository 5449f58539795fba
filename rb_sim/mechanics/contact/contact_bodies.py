# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""N bodies with contacts that open, slip, stick and roll.

A contact owns rows of the same table as every other constraint: normal, two tangents and, where it
resists turning, two rolling rows and one of spin.  Its mode says which of them hold; the others
are zero and drop out of every solve.  A slipping contact pushes along n + T(s)/N, not along n: the
force directions are a table of their own.  Scenes without contact know nothing of all this.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rb_sim.catalogue.contact import ContactLaw
from rb_sim.mechanics.system import EVENT_DRIVEN
from rb_sim.mechanics.systems.many_bodies import ROW_TABLE_COLUMNS

# The table of contacts, `ContactBodies.contact_table`: a row for each point, its columns by name.
#
# Its four parts lie apart.  Parameters say what the contact is.  State is all that one step hands
# to the next: only events and the start of a step write it.  What is known of a step's start
# serves the look inside the step.  Scratch every evaluation of the equations writes anew, before
# it reads it, so that a sample between two steps disturbs neither.


class Column(NamedTuple):
    """One quantity of the table; vectors have world axes."""

    name: str
    width: int
    """numbers that it takes."""
    unit: str
    meaning: str


EVENT_FUNCTION_KINDS = 5
"""Event functions of one contact: of its gap or normal force, of slip, rolling, spinning, and of
jams; each may pass through zero and come back within a step."""
AT_SLIP, AT_ROLL, AT_SPIN, AT_JAM = 1, 2, 3, 4
"""Places among them; that of the gap or normal force is the first."""

LEAN_WIDTH = 7
"""Numbers of a rims.Lean."""

PARAMETERS = (
    Column("static", 1, "1", "bound of the traction at rest over N; 0: a law without a corner"),
    Column("rolling_arm", 1, "m", "bound of the rolling torque at rest over N"),
    Column("spinning_arm", 1, "m", "bound of the spinning torque at rest over N"),
    Column("bilateral", 1, "0 or 1", "whether N may pull"),
    Column("compliant", 1, "0 or 1", "whether the support gives way"),
    Column("rim", 1, "number", "first contact that is a point of the same rim; -1: of no rim"),
    Column("restitution", 1, "1", "e of impacts"),
    Column("kinetic", 1, "1", "traction over N as a slip begins after rest; inf: it never slips"),
    Column("drags", 1, "0 or 1", "whether the traction stays where N vanishes"),
    Column("stiffness", 1, "N/m", "of a compliant support"),
    Column("damping", 1, "N s/m", "of a compliant support"),
)

STATE = (
    Column("closed", 1, "0 or 1", "whether the contact pushes"),
    Column("slide", 1, "mode", "traction: NONE, SLIDING or STUCK"),
    Column("roll", 1, "mode", "rolling torque: NONE, SLIDING or STUCK"),
    Column("spin", 1, "mode", "spinning torque: NONE, SLIDING or STUCK"),
    Column("normal_sign", 1, "sign", "of N, where it may pull"),
    Column("slip_direction", 3, "1", "direction of slip at the start of the step"),
    Column("roll_direction", 3, "1", "direction of rolling at the start of the step"),
    Column("spin_sign", 1, "sign", "of spinning at the start of the step"),
    Column(
        "creeps", 1, "m/s", "slip below which a creeping contact may rest; 0: it does not creep"
    ),
    Column("lean_before", LEAN_WIDTH, "rims.Lean", "of a rim at the start of the step"),
)

START = (
    Column("gap_before", 1, "m", "gap at the start of the step"),
    Column("gap_rate_before", 1, "m/s", "its rate there"),
    Column("fastest_before", 1, "m/s", "speed that no point of body or support exceeds there"),
    Column("normal_before", 3, "1", "n there"),
    Column(
        "event_functions_before",
        EVENT_FUNCTION_KINDS,
        "1",
        "event functions at the start of the step",
    ),
    Column("event_rates_before", EVENT_FUNCTION_KINDS, "1/s", "their rates there"),
    Column(
        "stiff", 1, "1/s", "rate at which friction turns a slip that goes on; 0: none, or it ends"
    ),
    Column("slip_rate", 3, "m/s^2", "rate of the slip there"),
    Column("roll_rate", 3, "rad/s^2", "rate of the rolling, which is across n, there"),
    Column("swing", 1, "s", "time in which the low point of a held rim may go round it"),
    Column("nears", 1, "1", "cosine of the angle between where it leans and where it goes up to"),
)

SCRATCH = (
    Column("gap", 1, "m", "distance of the surfaces along n, negative where they overlap"),
    Column("gap_rate", 1, "m/s", "its rate"),
    Column("normal", 3, "1", "n, from the parent to the body"),
    Column("point", 3, "m", "P, where they touch or are nearest"),
    Column("slip", 3, "m/s", "velocity of the body's surface over the parent's, across n"),
    Column("relative_spin", 3, "rad/s", "angular velocity of the body over the parent's"),
    Column("direct", 3, "N", "force that does not wait for N: viscous, or of a compliance"),
    Column("direct_torque", 3, "N m", "torque that does not wait for N, about P"),
    Column("normal_force", 1, "N", "N itself"),
    Column("pivot", 1, "1", "effective over ideal pivot of N; 0 where friction jams"),
    Column("spring", 1, "N", "force of a compliant support without regard to its sign"),
    Column("fastest", 1, "m/s", "speed that no point of body or support exceeds here"),
    Column(
        "event_functions", EVENT_FUNCTION_KINDS, "1", "event functions in the mode of the contact"
    ),
    Column("low", 3, "1", "direction of the low point of a rim (rims.Lean)"),
    Column("axis", 3, "1", "that of the rim, upwards, across the normal (rims.Lean)"),
    Column("lean_sign", 1, "sign", "of the lean; ABSENT for a point that the rim has not here"),
    Column("around", 1, "rad", "0: low point of a rim; else its place round the rim"),
)


def first_columns(*parts: tuple[Column, ...]) -> tuple[dict[str, int], int]:
    """(the first column of each quantity, how many columns there are)."""
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
"""Columns from GAP on that a law gives in this order."""
FORCES_WIDTH = NORMAL_FORCE + 1 - DIRECT
"""Columns from DIRECT on that the law of a closed contact gives in this order."""

FIRST_OF_SCRATCH = GAP
"""Columns before it outlast an evaluation of the equations."""


def write_parameters(row: np.ndarray, law: ContactLaw) -> None:
    """Write what a contact is into the columns of PARAMETERS, of this and of other tables, but for
    the rim."""
    row[[STATIC, KINETIC, RESTITUTION]] = law.static, law.kinetic, law.restitution
    row[[ROLLING_ARM, SPINNING_ARM, BILATERAL]] = law.rolling_arm, law.spinning_arm, law.bilateral
    row[[COMPLIANT, DRAGS]] = law.compliant, law.drags
    row[[STIFFNESS, DAMPING]] = law.spring


TOUCH_DOWN, LIFT_OFF, SLIP_ENDS, SLIP_BEGINS = 0, 1, 2, 3
ROLL_ENDS, ROLL_BEGINS, SPIN_ENDS, SPIN_BEGINS, JAMS, LIES_FLAT = 4, 5, 6, 7, 8, 9
EVENT_KINDS = 16
"""An event's code is EVENT_KINDS contact + kind."""
FREE = 1e300
"""Event function of what has no bound."""
NUDGE = 1e-6
"""Time over which rates of event functions are found, in natural units."""
SHARP = 100.0
"""Speeds of slip and turning have less rounding, and are counted finer, than gaps and forces."""
SPEED_TOLERANCE = 1e-10
"""Speed of approach, slip or turning, relative to the speed of the scene, up to which it is
zero."""
JAMMED = 1e-6
"""Pivot of a slipping contact with friction, relative to the one without, below which its force
has no bound (Painleve's paradox)."""
NEAR_JAM = 1e-3
"""The same, below which a contact is the one that jams where no force or no step is found."""


class ContactBodies(NamedTuple):
    """As MultiBody, with contacts; y has WIDTH coordinates per body, then the contacts' work."""

    bodies: np.ndarray
    row_table: np.ndarray
    """body, parent, work space, ANGLE and DEPENDENT; integers, shape (n, ROW_TABLE_WIDTH)."""
    rows: np.ndarray
    delassus: np.ndarray
    """A = G M^-1 W and work space, of the rows that hold, shape (2, n, n)."""
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
    """force direction of each row: as the 12 columns of its Jacobian, shape (n, 12)."""
    mass: float
    """of all bodies [kg]."""
    velocity_tolerance: float
    """slip whose direction is lost in the method's errors, and taken to be that of before [m/s]."""
    creep: float
    """slip of a contact that gives way below which it creeps, and above which it is followed; 0:
    nothing creeps (see creep) [m/s]."""

    @property
    def joints(self) -> int:
        """Parts of the constraints that are no contacts."""
        return len(self.constraints)


EVENT_DRIVEN.add(ContactBodies)

SHARES = 2
"""Row of ContactBodies.vectors: reactions of a self-stress that the contacts keep."""
ACTIVE, DEPENDENT, RANK, MOST_RANK, STEP_RANK, REDUNDANT, ROW_TABLE_WIDTH = range(
    ROW_TABLE_COLUMNS, ROW_TABLE_COLUMNS + 7
)
"""Columns of ContactBodies.row_table for the rows that hold, and whether
a row of a joint depends on other joints': the sum of what it is among.  Of all rows, in the first
row: the rank found last, the most that counts, the most that counts in the step taken last, and 1
if one was less than the rows that hold."""
NOWHERE, AMONG_ROWS, AMONG_POSITIONS, CHANGING = 0, 1, 2, 4
"""What a row depends on: none, all rows of joints, the holonomic ones alone. Off the manifold,
where the stages of a step are, such a row contradicts the others.  CHANGING: that is chosen anew
where a step begins (see choice)."""


def keep(table, c, at, a):
    """Write a vector into the table of contacts: row c, from column `at` on."""
    for j in range(3):
        table[c, at + j] = a[j]


def may_creep(system, c):
    """True where slow slips of contact c are followed, and creep in the end."""
    return system.contact_table[c, COMPLIANT] == 1.0 and system.creep > 0.0


def least_slip(system, c):
    """Slip of contact c below which its direction is not followed [m/s]."""
    return system.creep if may_creep(system, c) else system.velocity_tolerance


def first_row_of(system, c):
    """First row of contact c."""
    return system.first_row[system.joints + c]
