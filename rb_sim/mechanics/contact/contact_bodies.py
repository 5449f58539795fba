"""N bodies with contacts that open, slip, stick and roll.

A contact owns lines of the same table as every other constraint: normal, two tangents and, where it
resists turning, two rolling lines and one of spin.  Its mode says which of them hold; the others
are zero and drop out of every solve.  A slipping contact pushes along n + T(s)/N, not along n: the
directions of push are a table of their own.  Scenes without contact know nothing of all this.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rb_sim.mechanics.contact.contact_table import COMPLIANT
from rb_sim.mechanics.system import EVENT_DRIVEN
from rb_sim.mechanics.systems.many_bodies import LINE_COLUMNS
from rb_sim.numerics.kernels import inline

TOUCH_DOWN, LIFT_OFF, SLIP_ENDS, SLIP_BEGINS = 0, 1, 2, 3
ROLL_ENDS, ROLL_BEGINS, SPIN_ENDS, SPIN_BEGINS, JAMS, LIES_FLAT = 4, 5, 6, 7, 8, 9
EVENT_KINDS = 16
"""An event's code is EVENT_KINDS contact + kind."""
FREE = 1e300
"""Event function of what has no bound."""
NUDGE = 1e-6
"""Time over which rates of event functions are found, in natural units."""
ROUNDING = 1e-14
"""Of an acceleration, relative to the terms that it is the sum of."""
SHARP = 100.0
"""Speeds of slip and turning have less rounding, and are counted finer, than gaps and forces."""
STOPPED = 1e-10
"""Slip, relative to the scene's speed, that is none."""
JAMMED = 1e-6
"""Effective over ideal pivot at which a slipping contact's force has no bound (Painleve)."""
NEAR_JAM = 1e-3
"""The same, below which a contact is the one that jams where no force or no step is found."""


HELD = 1e-9
"""Part of a contact's pivot left by the joints below which they hold it in place by themselves."""


class ContactBodies(NamedTuple):
    """As MultiBody, with contacts; y has WIDTH coordinates per body, then the contacts' work."""

    bodies: np.ndarray
    lines: np.ndarray
    """body, parent, work space, ANGLE and DEPENDENT; integers, shape (n, LINE_WIDTH)."""
    rows: np.ndarray
    square: np.ndarray
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
    touch: np.ndarray
    """the table of contacts (see contact_table), shape (contacts, TOUCH_WIDTH)."""
    pushes: np.ndarray
    """direction of push of each line: as the 12 columns of its Jacobian, shape (n, 12)."""
    mass: float
    """of all bodies [kg]."""
    still: float
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
SECOND_ORDER, HOLDS, DEPENDENT, RANK, MOST_RANK, STEP_RANK, REDUNDANT, LINE_WIDTH = range(
    LINE_COLUMNS, LINE_COLUMNS + 8
)
"""Columns of ContactBodies.lines for the solver's column order, the lines that hold, and whether a
line of a joint depends on other joints': the sum of what it is among.  Of all lines, in the first
row: the rank found last, the most that counts, the most that counts in the step taken last, and 1
if one was less than the lines that hold."""
NOWHERE, AMONG_LINES, AMONG_POSITIONS, CHANGING = 0, 1, 2, 4
"""What a line depends on: none, all lines of joints, the holonomic ones alone. Off the manifold,
where the stages of a step are, such a line contradicts the others.  CHANGING: that is chosen anew
where a step begins (see choice)."""


@inline
def keep(touch, c, at, a):
    for j in range(3):
        touch[c, at + j] = a[j]


@inline
def may_creep(system, c):
    """True where slow slips of contact c are followed, and creep in the end."""
    return system.touch[c, COMPLIANT] == 1.0 and system.creep > 0.0


@inline
def least_slip(system, c):
    """Slip of contact c below which its direction is not followed [m/s]."""
    return system.creep if may_creep(system, c) else system.still


@inline
def line_of(system, c):
    """First line of contact c."""
    return system.first_row[system.joints + c]
