# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Rows, loads, anchors and energies of bodies with contacts, written into their tables.

Loops call traced laws; interpreted, the same Python functions run as they are.
"""

from __future__ import annotations

from rb_sim.catalogue.constraints.rows import ROW_WIDTH
from rb_sim.catalogue.friction import BOUNDED, traction
from rb_sim.catalogue.geometry.corners_and_rims import Lean
from rb_sim.compiler.graph.symbols import leaves
from rb_sim.integrate.layout import INTEGER, REAL, Layout, PackedSystem
from rb_sim.mechanics.contact.contact_bodies import (
    AROUND,
    CLOSED,
    DIRECT,
    DIRECT_TORQUE,
    FASTEST,
    FORCES_WIDTH,
    GAP,
    GEOMETRY_WIDTH,
    KINETIC,
    LEAN_BEFORE,
    LEAN_WIDTH,
    LOW,
    NORMAL_FORCE,
    NORMAL_SIGN,
    RIM,
    ROLL,
    ROLL_DIRECTION,
    SLIDE,
    SLIP_DIRECTION,
    SPIN,
    SPIN_SIGN,
    SPRING,
    ContactBodies,
    first_row_of,
    keep,
    least_slip,
)
from rb_sim.mechanics.contact.contact_kinematics import Kept, forces, geometry
from rb_sim.mechanics.systems.many_bodies import (
    LOAD,
    WIDTH,
    anchor_all,
    apply_effects,
    energetics,
    fill_all,
    state_of,
    vec,
)
from rb_sim.mechanics.systems.multibody import write_rows
from rb_sim.numerics.kernels import call_law, dispatch, part, pointer
from rb_sim.numerics.vectors import norm

# Inputs and outputs of the traced law of a contact.
#
# It takes ARGUMENTS numbers, and computes the geometry and, if the contact is closed, its rows. The
# columns of the table that it fills have the same order.


KEPT = 26
"""Index of the arguments after the states of both bodies: Lean (7), modes and side (4), directions
(3, 3, 1), tolerances (2)."""
ARGUMENTS = KEPT + 20
GEOMETRY = GEOMETRY_WIDTH + 2 + LEAN_WIDTH + 1
"""Number of results for an open contact: gap, its rate, normal, point, slip, relative spin (14),
spring, fastest, Lean (7), angle round the rim."""
FORCES = GEOMETRY + FORCES_WIDTH
"""Number with the forces independent of N (3, 3) and N of a closed one; then follow 16 numbers of
each row, then 12 of each force direction."""
MOST_ROWS = 6
OUTPUTS = FORCES + 28 * MOST_ROWS
WORKSPACE = ARGUMENTS + OUTPUTS

OPEN_LAW, CLOSED_LAW, CONTACT_BODY, CONTACT_PARENT, FIRST_PARAMETER = range(5)
TRACTION_LAW, FIRST_OF_TRACTION, CONTACT_COLUMNS = range(5, 8)
"""Columns of `contacts`: addresses of the two laws, body and parent, index of the constants in
`parameters`; address of the law of traction (0: `kinetic` bounds it at every slip), and index of
its constants."""

LAYOUT = Layout(
    {
        "bodies": (REAL, 2),
        "row_table": (INTEGER, 2),
        "rows": (REAL, 2),
        "delassus": (REAL, 3),
        "vectors": (REAL, 2),
        "first_row": (INTEGER, 1),
        "members": (INTEGER, 2),
        "anchors": (REAL, 2),
        "length": REAL,
        "speed": REAL,
        "contact_table": (REAL, 2),
        "force_rows": (REAL, 2),
        "mass": REAL,
        "velocity_tolerance": REAL,
        "creep": REAL,
        "joints": INTEGER,
        "contacts": (INTEGER, 2),
        "parameters": (REAL, 1),
        "inputs": (REAL, 1),
        "workspace": (REAL, 1),
        "loads_law": INTEGER,
        "joint_rows_law": INTEGER,
        "anchors_law": INTEGER,
        "energy_law": INTEGER,
        "carry_law": INTEGER,
        "free_by_address": INTEGER,
        "accelerate_by_address": INTEGER,
        "project_by_address": INTEGER,
    }
)
"""Fields of ContactBodies; `inputs` of the laws of the scene, `workspace` for their results;
addresses of these laws, and of the functions compiled once (contact_laws)."""


def clear_contact(G, W, k, last, table, c):
    """Set rows and forces of an open contact to zero."""
    for i in range(k, last):
        for j in range(ROW_WIDTH):
            G[i, j] = 0.0
        for j in range(12):
            W[i, j] = 0.0
    keep(table, c, DIRECT, (0.0, 0.0, 0.0))
    keep(table, c, DIRECT_TORQUE, (0.0, 0.0, 0.0))
    table[c, NORMAL_FORCE] = 0.0


def put_geometry(table, c, out):
    """Write the geometry of a contact, open or closed, into the table of contacts."""
    for j in range(GEOMETRY_WIDTH):
        table[c, GAP + j] = out[j]
    table[c, SPRING], table[c, FASTEST] = out[GEOMETRY_WIDTH], out[GEOMETRY_WIDTH + 1]
    if table[c, RIM] >= 0.0:
        for j in range(LEAN_WIDTH):
            table[c, LOW + j] = out[GEOMETRY_WIDTH + 2 + j]
        table[c, AROUND] = out[GEOMETRY - 1]


def put_forces(system, c, out):
    """Write rows, force directions and forces of a closed contact into the tables."""
    first, last = first_row_of(system, c), first_row_of(system, c + 1)
    for j in range(FORCES_WIDTH):
        system.contact_table[c, DIRECT + j] = out[GEOMETRY + j]
    force_rows = FORCES + ROW_WIDTH * (last - first)
    for i in range(last - first):
        for j in range(ROW_WIDTH):
            system.rows[first + i, j] = out[FORCES + ROW_WIDTH * i + j]
        for j in range(12):
            system.force_rows[first + i, j] = out[force_rows + 12 * i + j]


def write_contact(placed, t, system, y, c):
    """Write geometry, rows and force directions of contact c at (t, y)."""
    table, at = system.contact_table, LEAN_BEFORE
    lean = Lean(vec(table, c, at), vec(table, c, at + 3), table[c, at + 6])
    B, A = state_of(y, placed.body), state_of(y, placed.parent)
    found, moving = geometry(placed.row, t, B, A, lean)
    put_geometry(table, c, list(leaves(found)))
    if table[c, CLOSED] == 0.0:
        clear_contact(
            system.rows,
            system.force_rows,
            first_row_of(system, c),
            first_row_of(system, c + 1),
            table,
            c,
        )
        return
    kept = Kept(
        lean,
        table[c, SLIDE],
        table[c, ROLL],
        table[c, SPIN],
        table[c, NORMAL_SIGN],
        vec(table, c, SLIP_DIRECTION),
        vec(table, c, ROLL_DIRECTION),
        table[c, SPIN_SIGN],
        least_slip(system, c),
        system.velocity_tolerance / system.length,
    )
    done = forces(placed.row, found, moving, kept)
    put_forces(system, c, list(leaves((found, done))))


def put_arguments(system, y, c, out):
    """Write the arguments of the law of contact c (see KEPT)."""
    table = system.contact_table
    b, a = system.contacts[c, CONTACT_BODY], system.contacts[c, CONTACT_PARENT]
    for j in range(WIDTH):
        out[j] = y[WIDTH * b + j]
        if a >= 0:
            out[WIDTH + j] = y[WIDTH * a + j]
    for j in range(LEAN_WIDTH):
        out[KEPT + j] = table[c, LEAN_BEFORE + j]
    for j in range(3):
        out[KEPT + 7 + j] = table[c, SLIDE + j]
    for j in range(8):
        out[KEPT + 10 + j] = table[c, NORMAL_SIGN + j]
    out[ARGUMENTS - 2], out[ARGUMENTS - 1] = (
        least_slip(system, c),
        system.velocity_tolerance / system.length,
    )


def write_contact_by_law(system, t, y, c):
    """As write_contact, in loops."""
    arguments = pointer(system.workspace)
    out = part(arguments, ARGUMENTS)
    put_arguments(system, y, c, arguments)
    constants = part(pointer(system.parameters), system.contacts[c, FIRST_PARAMETER])
    if system.contact_table[c, CLOSED] == 0.0:
        call_law(system.contacts[c, OPEN_LAW], t, arguments, constants, out)
        put_geometry(system.contact_table, c, out)
        first, last = first_row_of(system, c), first_row_of(system, c + 1)
        clear_contact(system.rows, system.force_rows, first, last, system.contact_table, c)
    else:
        call_law(system.contacts[c, CLOSED_LAW], t, arguments, constants, out)
        put_geometry(system.contact_table, c, out)
        put_forces(system, c, out)


def traction_at(law, slip, constants, work):
    """(|T| over N, |T| independent of N [N]) at a slip [m/s] by the law of traction; work: 9
    numbers of workspace."""
    found = part(work, 3)
    work[0], work[1], work[2] = slip, 0.0, 0.0
    call_law(law, 0.0, work, constants, found)
    return norm((found[0], found[1], found[2])), norm((found[3], found[4], found[5]))


@dispatch
def traction_over_normal_force(system, c, slip):
    """Largest tangential over normal force or impulse of contact c at a slip [m/s]."""


@traction_over_normal_force.register(ContactBodies)
def traction_over_normal_force_plainly(system, c, slip):
    """Interpreted: `kinetic` of a bounded law, else its traction at this slip."""
    rows = [placed.row for group in system.contacts for placed in group]
    if isinstance(rows[c].friction, BOUNDED):
        return system.contact_table[c, KINETIC]
    ahead = (1.0, 0.0, 0.0)
    return norm(traction(rows[c].friction, (slip, 0.0, 0.0), ahead, 0.0, False)[0])


@traction_over_normal_force.register(PackedSystem)
def traction_over_normal_force_by_law(system, c, slip):
    """Compiled: by the traced law of traction if there is one."""
    law = system.contacts[c, TRACTION_LAW]
    if law == 0:
        return system.contact_table[c, KINETIC]
    constants = part(pointer(system.parameters), system.contacts[c, FIRST_OF_TRACTION])
    return traction_at(law, slip, constants, pointer(system.workspace))[0]


def _write_all_rows(system, t, y, everywhere):
    """Write the rows of all constraints at (t, y), and the geometry of contacts.

    everywhere: of open contacts as well; False if their rows are zero already, for a rate.
    """


write_all_rows = dispatch(_write_all_rows)


@dispatch
def write_joints(system, t, y):
    """Write the rows of the joints at (t, y)."""


@write_joints.register(ContactBodies)
def write_joints_plainly(system, t, y):
    """Interpreted: each constraint's `fill` in turn."""
    fill_all(system.constraints, t, system, y)


@write_joints.register(PackedSystem)
def write_joints_by_law(system, t, y):
    """Compiled: the traced law of all joints."""
    if system.joint_rows_law:
        call_law(system.joint_rows_law, t, pointer(y), pointer(system.inputs), pointer(system.rows))


@write_all_rows.register(ContactBodies)
def write_all_rows_plainly(system, t, y, everywhere):
    """Interpreted: the rows of joints and contacts, then their force directions."""
    write_joints(system, t, y)
    placed_contacts = [placed for group in system.contacts for placed in group]
    for c, placed in enumerate(placed_contacts):
        if everywhere or system.contact_table[c, CLOSED] == 1.0:
            write_contact(placed, t, system, y, c)
    copy_joint_rows(system)


@write_all_rows.register(PackedSystem)
def write_all_rows_by_law(system, t, y, everywhere):
    """Compiled: the same by laws."""
    write_joints(system, t, y)
    for c in range(system.contact_table.shape[0]):
        if everywhere or system.contact_table[c, CLOSED] == 1.0:
            write_contact_by_law(system, t, y, c)
    copy_joint_rows(system)


@write_rows.register(ContactBodies, PackedSystem)
def write_contact_rows(system, t, y):
    """The rows of joints and of all contacts, open or closed."""
    write_all_rows(system, t, y, True)


def copy_joint_rows(system):
    """Copy the rows of joints, which are their force directions as well."""
    for k in range(first_row_of(system, 0)):
        for j in range(12):
            system.force_rows[k, j] = system.rows[k, j]


@dispatch
def load_effects(system, t, y):
    """Add the wrenches of all effects to the loads."""


@load_effects.register(ContactBodies)
def load_effects_plainly(system, t, y):
    """Interpreted: each effect's `wrench` in turn."""
    apply_effects(system.effects, t, system, y)


@load_effects.register(PackedSystem)
def load_effects_by_law(system, t, y):
    """Compiled: the traced law of all effects gives 6 numbers for each body."""
    loads = part(pointer(system.workspace), WORKSPACE)
    call_law(system.loads_law, t, pointer(y), pointer(system.inputs), loads)
    for i in range(system.bodies.shape[0]):
        for j in range(6):
            system.bodies[i, LOAD + j] += loads[6 * i + j]


@dispatch
def carry_inputs(system, t, y):
    """Update the inputs that laws carry from step to step, for a step that begins at (t, y)."""


@carry_inputs.register(ContactBodies)
def carry_nothing(system, t, y):
    """Interpreted: nothing is carried."""
    pass


@carry_inputs.register(PackedSystem)
def carry_inputs_by_law(system, t, y):
    """Compiled: the traced law computes all inputs except the last one, the length of a step."""
    if system.carry_law:
        found = part(pointer(system.workspace), WORKSPACE)
        call_law(system.carry_law, t, pointer(y), pointer(system.inputs), found)
        for i in range(system.inputs.shape[0] - 1):
            system.inputs[i] = found[i]


@dispatch
def write_anchors(system, y):
    """Write the anchors of the joints."""


@write_anchors.register(ContactBodies)
def write_anchors_plainly(system, y):
    """Interpreted: each constraint's `anchor` in turn."""
    anchor_all(system.constraints, system, y)


@write_anchors.register(PackedSystem)
def write_anchors_by_law(system, y):
    """Compiled: the traced law of all joints' anchors."""
    if system.anchors_law:
        anchors = pointer(system.anchors)
        call_law(system.anchors_law, 0.0, pointer(y), pointer(system.inputs), anchors)


@dispatch
def energies(system, t, y):
    """(potential energy [J], power of effects without a potential [W])."""


@energies.register(ContactBodies)
def energies_plainly(system, t, y):
    """Interpreted: each effect's potential energy and power in turn."""
    return energetics(system.effects, t, system, y)


@energies.register(PackedSystem)
def energies_by_law(system, t, y):
    """Compiled: by the traced law of all effects."""
    found = pointer(system.workspace)
    call_law(system.energy_law, t, pointer(y), pointer(system.inputs), found)
    return found[0], found[1]
