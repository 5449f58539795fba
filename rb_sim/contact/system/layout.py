"""Bodies in contact as loops see them: tables by address, and what the traced laws read and write.

A contact's law gets ARGUMENTS numbers and gives those of its geometry and, where it is closed, of
its lines; the columns of `touch` that it fills lie as the law gives them.
"""

from __future__ import annotations

from rb_sim.contact.system.touch import FORCES_WIDTH, GEOMETRY_WIDTH, LEAN_WIDTH
from rb_sim.loops.tables import INTEGER, REAL, Layout

KEPT = 26
"""Place among the arguments after the states of both bodies: Lean (7), modes and side (4),
directions (3, 3, 1), what is but rounding (2)."""
ARGUMENTS = KEPT + 20
GEOMETRY = GEOMETRY_WIDTH + 2 + LEAN_WIDTH + 1
"""Numbers of an open contact: gap, its rate, normal, point, slip, turning (14), spring, fastest,
Lean (7), place round the rim."""
FORCES = GEOMETRY + FORCES_WIDTH
"""Of a closed one besides: forces that do not wait for N (3, 3), force; from here on 16 numbers of
each line, then 12 of each push."""
MOST_LINES = 6
OUTPUTS = FORCES + 28 * MOST_LINES
ROOM = ARGUMENTS + OUTPUTS

OPEN_LAW, CLOSED_LAW, CONTACT_BODY, CONTACT_PARENT, FIRST_PARAMETER, CONTACT_COLUMNS = range(6)
"""Columns of `contacts`: addresses of the laws of the contact, its bodies, where its constants
begin in `parameters`."""

LAYOUT = Layout(
    {
        "bodies": (REAL, 2),
        "lines": (INTEGER, 2),
        "rows": (REAL, 2),
        "square": (REAL, 3),
        "vectors": (REAL, 2),
        "first_row": (INTEGER, 1),
        "members": (INTEGER, 2),
        "anchors": (REAL, 2),
        "length": REAL,
        "speed": REAL,
        "touch": (REAL, 2),
        "pushes": (REAL, 2),
        "mass": REAL,
        "still": REAL,
        "creep": REAL,
        "joints": INTEGER,
        "contacts": (INTEGER, 2),
        "parameters": (REAL, 1),
        "inputs": (REAL, 1),
        "room": (REAL, 1),
        "loads_law": INTEGER,
        "lines_law": INTEGER,
        "anchors_law": INTEGER,
        "energy_law": INTEGER,
        "free_by_address": INTEGER,
        "accelerate_by_address": INTEGER,
        "settle_by_address": INTEGER,
    }
)
"""Fields as those of ContactBodies; `inputs` of the laws of the scene, `room` for what laws give;
laws of the scene; functions compiled once (see compiled)."""
