# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The workspace of an event: touching contacts, rows, and notes of the changes of contacts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np

from rb_sim.base.rounding import SOLVED
from rb_sim.catalogue.contact import ContactLaw
from rb_sim.catalogue.geometry.corners_and_rims import ABSENT
from rb_sim.contact.problem import RULES, tables_of, zeros_of
from rb_sim.contact.problem import WIDTH as ROW_WIDTH
from rb_sim.integrate.layout import INTEGER, REAL, Layout
from rb_sim.mechanics.contact.contact_bodies import (
    BILATERAL,
    CLOSED,
    COMPLIANT,
    GAP,
    GAP_RATE,
    LEAN_SIGN,
    NORMAL,
    RELATIVE_SPIN,
    ROLL,
    ROLLING_ARM,
    SLIDE,
    SLIP,
    SLIP_DIRECTION,
    SPEED_TOLERANCE,
    SPIN,
    SPINNING_ARM,
    STATIC,
    ContactBodies,
    first_row_of,
)
from rb_sim.mechanics.contact.contact_kinematics import SLIDING, STUCK
from rb_sim.mechanics.samples import ContactEvent
from rb_sim.mechanics.systems.many_bodies import vec
from rb_sim.numerics.complementarity import BOUND_WIDTH
from rb_sim.numerics.vectors import add, dot, norm, scale, sub

TOUCHING = 1e-10
"""Gap, relative to the length of the scene, up to which surfaces touch."""
OPEN = 1e-8
"""Relative difference of two admissible velocities, accelerations or reactions above which they are
different solutions; below, it is rounding."""


def velocity_tolerance_of(system):
    """Speed that counts as zero [m/s]."""
    return SPEED_TOLERANCE * system.speed


def spin_tolerance_of(system):
    """Angular speed that counts as zero [rad/s]."""
    return SPEED_TOLERANCE * system.speed / system.length


def touches(system, c):
    """Whether contact c is rigid and its surfaces touch."""
    table = system.contact_table
    if table[c, COMPLIANT] == 1.0 or table[c, LEAN_SIGN] == ABSENT:
        return False
    return table[c, GAP] <= TOUCHING * system.length or table[c, BILATERAL] == 1.0


def find_touching(system, workspace):
    """Let the touching contacts participate; returns the one that approaches fastest, or -1."""
    table, fastest = system.contact_table, -1
    for c in range(table.shape[0]):
        here = touches(system, c)
        workspace.taking_part[c] = 1 if here else 0
        if here and (fastest < 0 or table[c, GAP_RATE] < table[fastest, GAP_RATE]):
            fastest = c
    return fastest


def slip_speed(system, c):
    """Slip speed of contact c [m/s]."""
    return norm(vec(system.contact_table, c, SLIP))


def turning(system, c):
    """Relative angular velocity of contact c: (across the normal, along it) [rad/s]."""
    turn, n = vec(system.contact_table, c, RELATIVE_SPIN), vec(system.contact_table, c, NORMAL)
    about = dot(turn, n)
    return sub(turn, scale(about, n)), about


MODES_WIDTH = SLIP_DIRECTION + 3
"""Number of first columns of the table of contacts up to the modes and directions of slip."""
NOTE_WIDTH = 6
"""Columns of a note: time [s], contact, kind (index in KINDS), impulse (3) [N s]."""
WAYS = 3
"""Number of kinds of motion of a contact: slip, roll, spin."""


class Workspace(NamedTuple):
    """Tables of the rows, bodies and contacts of a scene; integers of a contact are 0 or 1."""

    all_rows: Annotated[np.ndarray, REAL, "rows", ROW_WIDTH]
    """rows of joints and contacts, all closed and stuck, see `problem`."""
    all_pushes: Annotated[np.ndarray, REAL, "rows", ROW_WIDTH]
    """force directions: as the rows, except for the normals of slipping contacts."""
    row_bias: Annotated[np.ndarray, REAL, "rows"]
    row_rate: Annotated[np.ndarray, REAL, "rows"]
    """prescribed velocity along each row, J u = rate."""
    free_accelerations: Annotated[np.ndarray, REAL, "bodies", 6]
    """accelerations by the loads alone."""
    impulses: Annotated[np.ndarray, REAL, "rows"]
    """of every row."""
    used: Annotated[np.ndarray, INTEGER, "rows"]
    """this and the following fields: see `problem.Laws`."""
    place_of: Annotated[np.ndarray, INTEGER, "rows"]
    units: Annotated[np.ndarray, REAL, "rows"]
    rules: Annotated[np.ndarray, INTEGER, "rows"]
    least: Annotated[np.ndarray, REAL, "rows"]
    bounds: Annotated[np.ndarray, INTEGER, "bounds", BOUND_WIDTH]
    limits: Annotated[np.ndarray, REAL, "bounds"]
    moves: Annotated[np.ndarray, INTEGER, "bounds", 2]
    contact_rules: Annotated[np.ndarray, REAL, "contacts", RULES]
    """of each contact, see `problem`."""
    taking_part: Annotated[np.ndarray, INTEGER, "contacts"]
    """participation: rigid contacts that touch (1), compliant ones with a force (2)."""
    plastic: Annotated[np.ndarray, INTEGER, "contacts"]
    """contacts without rebound."""
    together: Annotated[np.ndarray, INTEGER, "contacts"]
    """contacts that do not separate in an impact."""
    rebounding: Annotated[np.ndarray, INTEGER, "contacts"]
    """contacts that separate after an impact."""
    opened: Annotated[np.ndarray, INTEGER, "contacts"]
    """contacts that must not close."""
    parted: Annotated[np.ndarray, INTEGER, "contacts"]
    """contacts that opened while they slipped."""
    moved: Annotated[np.ndarray, INTEGER, "contacts", WAYS]
    """contacts that have begun to slip, roll or spin."""
    bounces: Annotated[np.ndarray, INTEGER, "counts"]
    """number of successive bounces of each contact, then of all very low ones, (C + 1,)."""
    rests: Annotated[np.ndarray, REAL, "contacts", 3]
    """end of the series of bounces of each contact, see `impacts`."""
    before: Annotated[np.ndarray, REAL, "contacts", MODES_WIDTH]
    """modes before an event."""
    undetermined: Annotated[np.ndarray, REAL, 7]
    """largest difference of the motions that the laws allow after an impact, relative to the
    largest velocity before it; the largest of the run, its time and contact; the same three for
    shares of a load, (7,)."""
    notes: Annotated[np.ndarray, REAL, "notes", NOTE_WIDTH]
    """changes of contacts, (capacity, NOTE_WIDTH)."""
    written: Annotated[np.ndarray, INTEGER, 1]
    """number of notes, (1,)."""


WORKSPACE_LAYOUT = Layout(
    {name: (number, len(shape)) for name, (number, *shape) in tables_of(Workspace).items()}
)


def workspace_for(system: ContactBodies) -> Workspace:
    """The workspace for a system."""
    rows, contacts = len(system.row_table), len(system.contact_table)
    return zeros_of(
        Workspace, rows=rows, contacts=contacts, bodies=len(system.bodies), bounds=WAYS * contacts,
        counts=contacts + 1, notes=64 + 8 * contacts,
    )  # fmt: skip


# Notes: changes of contacts, which `Journal` reads.


KINDS = (
    "impact", "rests", "closes", "opens", "slips", "sticks", "rolls", "stops rolling", "spins",
    "stops spinning", "reverses", "jams", "leaps", "ambiguous",
)  # fmt: skip
"""Names of events by the number in a note; laws may have other names for closing and opening."""
(
    IMPACT, RESTS, CLOSES, OPENS, SLIPS, STICKS, ROLLS, STOPS_ROLLING, SPINS, STOPS_SPINNING,
    REVERSES, JAMS, LEAPS, AMBIGUOUS,
) = range(14)  # fmt: skip
OF_ROUND, CHANGES = 3, 5
"""Maximum number of notes of one contact in a round of impacts, and of changes at one instant."""


def workspace_left(workspace):
    """Number of notes that still fit in."""
    return workspace.notes.shape[0] - workspace.written[0]


def note(workspace, t, c, kind, impulse):
    """Add a note of contact c; impulse: by it on its body, world axes [N s]."""
    k = workspace.written[0]
    workspace.notes[k, 0], workspace.notes[k, 1], workspace.notes[k, 2] = t, c, kind
    for j in range(3):
        workspace.notes[k, 3 + j] = impulse[j]
    workspace.written[0] = k + 1


def note_impulses(system, workspace, t, kind):
    """Add a note for each contact with an impulse in the workspace."""
    x, rows, most = workspace.impulses, workspace.all_rows, 0.0
    for k in range(x.shape[0]):
        most = max(most, abs(x[k]))
    for c in range(system.contact_table.shape[0]):
        k = first_row_of(system, c)
        if max(abs(x[k]), abs(x[k + 1]), abs(x[k + 2])) > SOLVED * most:
            impulse = scale(x[k], vec(rows, k, 0))
            for j in range(1, 3):
                impulse = add(impulse, scale(x[k + j], vec(rows, k + j, 0)))
            note(workspace, t, c, kind, impulse)


def take_before(system, workspace):
    """Store the modes of the contacts before an event."""
    for c in range(workspace.before.shape[0]):
        for j in range(workspace.before.shape[1]):
            workspace.before[c, j] = system.contact_table[c, j]


def note_way(system, workspace, t, c, way, kinds):
    """Add a note if one kind of friction has changed; way: columns of its mode and bound, kinds: of
    its start and its end."""
    mode, bound = way
    was, now = workspace.before[c, mode], system.contact_table[c, mode]
    if system.contact_table[c, bound] > 0.0 and was != now:
        note(workspace, t, c, kinds[1] if now == STUCK else kinds[0], (0.0, 0.0, 0.0))


def note_changes(system, workspace, t):
    """Add notes of all contacts that opened, closed, began to slip or stuck."""
    table, before = system.contact_table, workspace.before
    for c in range(table.shape[0]):
        if before[c, CLOSED] != table[c, CLOSED]:
            note(workspace, t, c, CLOSES if table[c, CLOSED] != 0.0 else OPENS, (0.0, 0.0, 0.0))
        if table[c, CLOSED] == 0.0:
            continue
        note_way(system, workspace, t, c, (SLIDE, STATIC), (SLIPS, STICKS))
        note_way(system, workspace, t, c, (ROLL, ROLLING_ARM), (ROLLS, STOPS_ROLLING))
        note_way(system, workspace, t, c, (SPIN, SPINNING_ARM), (SPINS, STOPS_SPINNING))
        along = 0.0
        for j in range(3):
            along += before[c, SLIP_DIRECTION + j] * table[c, SLIP_DIRECTION + j]
        slides = before[c, SLIDE] == SLIDING and table[c, SLIDE] == SLIDING
        if table[c, STATIC] > 0.0 and slides and along < 0.0:
            note(workspace, t, c, REVERSES, (0.0, 0.0, 0.0))


MOST_EVENTS = 100_000
"""Minimum number of events that are kept."""


class Journal:
    """The contact events of a run; of very many the earliest are dropped."""

    def __init__(self, names: Sequence[str], laws: Sequence[ContactLaw]) -> None:
        self.names = names
        self.events: list[ContactEvent] = []
        self.forgotten = 0
        self._kinds = [
            tuple(
                law.closes if k == CLOSES else law.opens if k == OPENS else kind
                for k, kind in enumerate(KINDS)
            )
            for law in laws
        ]

    def note(self, t: float, c: int, kind: int) -> None:
        """Add an event of contact c without an impulse; kind: index in KINDS."""
        kind_name = self._kinds[c][kind]
        self._add(ContactEvent(float(t), self.names[c], kind_name, (0.0, 0.0, 0.0)))

    def take(self, workspace: Workspace) -> None:
        """Move the notes of the workspace into the journal."""
        for t, contact, kind, *impulse in workspace.notes[: int(workspace.written[0])].tolist():
            c = int(contact)
            name = self._kinds[c][int(kind)]
            self._add(ContactEvent(t, self.names[c], name, tuple(impulse)))
        workspace.written[0] = 0

    def _add(self, event: ContactEvent) -> None:
        self.events.append(event)
        if len(self.events) >= 2 * MOST_EVENTS:  # a node may run without end
            del self.events[:MOST_EVENTS]
            self.forgotten += MOST_EVENTS
