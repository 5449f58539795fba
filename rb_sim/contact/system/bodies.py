"""N bodies with contacts that open, slip, stick and roll: the table of contacts and its lines.

A contact owns lines of the same table as every other constraint: normal, two tangents and, where it
resists turning, two rolling lines and one of spin.  Its mode says which of them hold; the others
are zero and drop out of every solve.  A slipping contact pushes along n + T(s)/N, not along n: the
directions of push are a table of their own.  Scenes without contact know nothing of all this.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rb_sim.catalogue.constraints.rows import BIAS, ROW_WIDTH
from rb_sim.contact.geometry.rims import Lean
from rb_sim.contact.system.layout import (
    ARGUMENTS,
    CLOSED_LAW,
    CONTACT_BODY,
    CONTACT_PARENT,
    FIRST_PARAMETER,
    FORCES,
    GEOMETRY,
    KEPT,
    OPEN_LAW,
    ROOM,
)
from rb_sim.contact.system.terms import NONE as NONE
from rb_sim.contact.system.terms import SLIDING, Kept, forces, geometry
from rb_sim.contact.system.terms import STUCK as STUCK
from rb_sim.contact.system.touch import (
    AHEAD,
    AROUND,
    CLOSED,
    COMPLIANT,
    DIRECT,
    DIRECT_TORQUE,
    FASTEST,
    FORCE,
    FORCES_WIDTH,
    GAP,
    GEOMETRY_WIDTH,
    LEAN_BEFORE,
    LEAN_WIDTH,
    LOW,
    PIVOT,
    POINT,
    RIM,
    ROLL,
    ROLL_AHEAD,
    SIDE,
    SLIDE,
    SPIN,
    SPIN_AHEAD,
    SPRING,
    STATIC,
)
from rb_sim.engine.system import EVENT_DRIVEN
from rb_sim.engine.systems.many_bodies import (
    BODY,
    LOAD,
    MULTIPLIERS,
    ORDER,
    PARENT,
    PUSH,
    RIGHT,
    WIDTH,
    add_load,
    anchor_all,
    apply_effects,
    energetics,
    fill_all,
    state_of,
    vec,
)
from rb_sim.engine.systems.multipliers import (
    add_push,
    clear_loads,
    coupling,
    free_accelerations,
    row_times_push,
    write_rows,
)
from rb_sim.engine.systems.multipliers import inverse_mass_times as inverse_mass_row
from rb_sim.graph.functions import leaves
from rb_sim.loops.compiled import call_law, part, pointer
from rb_sim.loops.tables import Held, address, whole
from rb_sim.maths.jit import dispatch, inline, plain
from rb_sim.maths.unsymmetric import least_norm, solve_unsymmetric
from rb_sim.maths.vectors import add, cross, dot, norm, rotate, scale, sub, unrotate

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


HELD = 1e-9
"""Part of a contact's pivot left by the joints below which they hold it in place by themselves."""


class ContactBodies(NamedTuple):
    """As MultiBody, with contacts; y has WIDTH coordinates per body, then the contacts' work."""

    bodies: np.ndarray
    lines: np.ndarray
    """body, parent and work space; integers, shape (n, 5)."""
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
    """the table of contacts (see touch), shape (contacts, TOUCH_WIDTH)."""
    pushes: np.ndarray
    """direction of push of each line: as the 12 columns of its Jacobian, shape (n, 12)."""
    mass: float
    """of all bodies [kg]."""
    still: float
    """slip whose direction is lost in the method's errors, and taken to be that of before [m/s]."""

    @property
    def joints(self) -> int:
        """Parts of the constraints that are no contacts."""
        return len(self.constraints)


EVENT_DRIVEN.add(ContactBodies)

SHARES = 2
"""Row of ContactBodies.vectors: reactions of a self-stress that the contacts keep."""
SECOND_ORDER, HOLDS = 3, 4
"""Columns of ContactBodies.lines for the solver's column order, and the lines that hold."""


@inline
def keep(touch, c, at, a):
    for j in range(3):
        touch[c, at + j] = a[j]


@plain
def clear_contact(G, W, k, last, touch, c):
    """No lines and no forces of a contact that is open."""
    for i in range(k, last):
        for j in range(ROW_WIDTH):
            G[i, j] = 0.0
        for j in range(12):
            W[i, j] = 0.0
    keep(touch, c, DIRECT, (0.0, 0.0, 0.0))
    keep(touch, c, DIRECT_TORQUE, (0.0, 0.0, 0.0))
    touch[c, FORCE] = 0.0


@inline
def put_geometry(touch, c, out):
    """Into the table of contacts what is known of an open contact as well."""
    for j in range(GEOMETRY_WIDTH):
        touch[c, GAP + j] = out[j]
    touch[c, SPRING], touch[c, FASTEST] = out[GEOMETRY_WIDTH], out[GEOMETRY_WIDTH + 1]
    if touch[c, RIM] >= 0.0:
        for j in range(LEAN_WIDTH):
            touch[c, LOW + j] = out[GEOMETRY_WIDTH + 2 + j]
        touch[c, AROUND] = out[GEOMETRY - 1]


@inline
def put_forces(system, c, out):
    """Lines, pushes and forces of a closed contact into the tables."""
    first, last = line_of(system, c), line_of(system, c + 1)
    for j in range(FORCES_WIDTH):
        system.touch[c, DIRECT + j] = out[GEOMETRY + j]
    pushes = FORCES + ROW_WIDTH * (last - first)
    for i in range(last - first):
        for j in range(ROW_WIDTH):
            system.rows[first + i, j] = out[FORCES + ROW_WIDTH * i + j]
        for j in range(12):
            system.pushes[first + i, j] = out[pushes + 12 * i + j]


def write_contact(placed, t, system, y, c):
    """Geometry, lines and pushes of contact c at (t, y)."""
    touch, at = system.touch, LEAN_BEFORE
    lean = Lean(vec(touch, c, at), vec(touch, c, at + 3), touch[c, at + 6])
    B, A = state_of(y, placed.body), state_of(y, placed.parent)
    found, moving = geometry(placed.row, t, B, A, lean)
    put_geometry(touch, c, list(leaves(found)))
    if touch[c, CLOSED] == 0.0:
        clear_contact(
            system.rows, system.pushes, line_of(system, c), line_of(system, c + 1), touch, c
        )
        return
    kept = Kept(
        lean,
        touch[c, SLIDE],
        touch[c, ROLL],
        touch[c, SPIN],
        touch[c, SIDE],
        vec(touch, c, AHEAD),
        vec(touch, c, ROLL_AHEAD),
        touch[c, SPIN_AHEAD],
        system.still,
        system.still / system.length,
    )
    done = forces(placed.row, found, moving, kept)
    put_forces(system, c, list(leaves((found, done))))


@inline
def put_arguments(system, y, c, out):
    """What the law of contact c gets, see layout."""
    touch = system.touch
    b, a = system.contacts[c, CONTACT_BODY], system.contacts[c, CONTACT_PARENT]
    for j in range(WIDTH):
        out[j] = y[WIDTH * b + j]
        if a >= 0:
            out[WIDTH + j] = y[WIDTH * a + j]
    for j in range(LEAN_WIDTH):
        out[KEPT + j] = touch[c, LEAN_BEFORE + j]
    for j in range(3):
        out[KEPT + 7 + j] = touch[c, SLIDE + j]
    for j in range(8):
        out[KEPT + 10 + j] = touch[c, SIDE + j]
    out[ARGUMENTS - 2], out[ARGUMENTS - 1] = system.still, system.still / system.length


@plain
def write_contact_by_law(system, t, y, c):
    """As write_contact, in loops."""
    arguments = pointer(system.room)
    out = part(arguments, ARGUMENTS)
    put_arguments(system, y, c, arguments)
    constants = part(pointer(system.parameters), system.contacts[c, FIRST_PARAMETER])
    if system.touch[c, CLOSED] == 0.0:
        call_law(system.contacts[c, OPEN_LAW], t, arguments, constants, out)
        put_geometry(system.touch, c, out)
        first, last = line_of(system, c), line_of(system, c + 1)
        clear_contact(system.rows, system.pushes, first, last, system.touch, c)
    else:
        call_law(system.contacts[c, CLOSED_LAW], t, arguments, constants, out)
        put_geometry(system.touch, c, out)
        put_forces(system, c, out)


def write_contacts(groups, t, system, y, c):
    """Write the contacts of all groups, the first of which is number c."""
    for group in groups:
        for placed in group:
            write_contact(placed, t, system, y, c)
            c += 1


@write_rows.register(ContactBodies)
def write_contact_rows(system, t, y):
    fill_all(system.constraints, t, system, y, 0)
    write_contacts(system.contacts, t, system, y, 0)
    push_joints_along(system)


@write_rows.register(Held)
def write_rows_by_law(system, t, y):
    if system.lines_law:
        rows = pointer(system.rows)
        call_law(system.lines_law, t, pointer(y), pointer(system.inputs), rows)
    for c in range(system.touch.shape[0]):
        write_contact_by_law(system, t, y, c)
    push_joints_along(system)


@inline
def push_joints_along(system):
    """A joint pushes along the line that it enforces."""
    for k in range(line_of(system, 0)):
        for j in range(12):
            system.pushes[k, j] = system.rows[k, j]


@dispatch
def load_effects(system, t, y):
    """Add the wrenches of all effects to the loads."""


@load_effects.register(ContactBodies)
def load_effects_plainly(system, t, y):
    apply_effects(system.effects, t, system, y)


@load_effects.register(Held)
def load_effects_by_law(system, t, y):
    loads = part(pointer(system.room), ROOM)
    call_law(system.loads_law, t, pointer(y), pointer(system.inputs), loads)
    for i in range(system.bodies.shape[0]):
        for j in range(6):
            system.bodies[i, LOAD + j] += loads[6 * i + j]


@dispatch
def write_anchors(system, y):
    """Write the anchors of the joints."""


@write_anchors.register(ContactBodies)
def write_anchors_plainly(system, y):
    anchor_all(system.constraints, system, y, 0)


@write_anchors.register(Held)
def write_anchors_by_law(system, y):
    if system.anchors_law:
        anchors = pointer(system.anchors)
        call_law(system.anchors_law, 0.0, pointer(y), pointer(system.inputs), anchors)


@dispatch
def energies(system, t, y):
    """(potential energy, power of the effects that have none)."""


@energies.register(ContactBodies)
def energies_plainly(system, t, y):
    return energetics(system.effects, t, system, y)


@energies.register(Held)
def energies_by_law(system, t, y):
    found = pointer(system.room)
    call_law(system.energy_law, t, pointer(y), pointer(system.inputs), found)
    return found[0], found[1]


@inline
def line_of(system, c):
    """First line of contact c."""
    return system.first_row[system.joints + c]


@plain
def add_direct(system, y):
    """Add the forces of the contacts that do not wait for N to the loads."""
    touch = system.touch
    for c in range(touch.shape[0]):
        k = line_of(system, c)
        f, m, p = vec(touch, c, DIRECT), vec(touch, c, DIRECT_TORQUE), vec(touch, c, POINT)
        b, a = system.lines[k, BODY], system.lines[k, PARENT]
        B = state_of(y, b)
        add_load(system.bodies, b, f, unrotate(B.q_WB, add(m, cross(sub(p, B.p_WC), f))))
        if a >= 0:
            A = state_of(y, a)
            back = unrotate(A.q_WB, add(m, cross(sub(p, A.p_WC), f)))
            add_load(system.bodies, a, scale(-1.0, f), scale(-1.0, back))


@inline
def push_of(system, i, j, column):
    """M_i^-1 of the push of line j on body i, whose columns start at `column`."""
    force = scale(1.0 / system.bodies[i, 0], vec(system.pushes, j, column))
    s = system.bodies
    k = vec(system.pushes, j, column + 3)
    turn = (
        s[i, 7] * k[0] + s[i, 10] * k[1] + s[i, 11] * k[2],
        s[i, 10] * k[0] + s[i, 8] * k[1] + s[i, 12] * k[2],
        s[i, 11] * k[0] + s[i, 12] * k[1] + s[i, 9] * k[2],
    )
    return force, turn


@plain
def find_holding(system):
    """Number the lines that hold, those that are not zero; returns how many there are."""
    holding = 0
    for k in range(system.lines.shape[0]):
        size = 0.0
        for j in range(12):
            size += abs(system.rows[k, j])
        if size > 0.0:
            system.lines[holding, HOLDS] = k
            holding += 1
    return holding


@plain
def fill_pushed_matrix(system, holding):
    """A = G M^-1 W^T of the lines that hold."""
    rows, lines = system.rows, system.lines
    for n in range(holding):
        j = lines[n, HOLDS]
        b, a = lines[j, BODY], lines[j, PARENT]
        fb, kb = push_of(system, b, j, 0)
        fa, ka = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        if a >= 0:
            fa, ka = push_of(system, a, j, 6)
        for m in range(holding):
            i = lines[m, HOLDS]
            s = 0.0
            if lines[i, BODY] == b:
                s += coupling(rows, i, 0, fb, kb)
            if lines[i, PARENT] == b:
                s += coupling(rows, i, 6, fb, kb)
            if a >= 0:
                if lines[i, BODY] == a:
                    s += coupling(rows, i, 0, fa, ka)
                if lines[i, PARENT] == a:
                    s += coupling(rows, i, 6, fa, ka)
            system.square[0, m, n] = s


@plain
def spread_multipliers(system, holding):
    """From the lines that hold, in order, to all lines; the others are zero."""
    x = system.vectors[MULTIPLIERS]
    for k in range(holding, x.shape[0]):
        x[k] = 0.0
    for m in range(holding - 1, -1, -1):
        value = x[m]
        x[m] = 0.0
        x[system.lines[m, HOLDS]] = value


@plain
def joints_share(system, joints, at, column):
    """What the joints take of the rise at contact line `at` (counted among those that hold) per
    unit of push: A_cJ A_JJ^-1 x, x a column of A or, where column < 0, the push along the line
    itself."""
    A, spare = system.square[0], system.square[1]
    b, x = spare[joints], spare[joints + 1]
    for j in range(joints):
        b[j] = A[j, column] if column >= 0 else A[at, j]
    lines = whole(system.lines)
    solve_unsymmetric(A, b, x, spare, lines[:, ORDER], lines[:, SECOND_ORDER], joints)
    share = 0.0
    for j in range(joints):
        share += A[at, j] * x[j]
    return share


@plain
def pivots(system, holding):
    """N of every contact, and the effective over the ideal pivot of those that slip, joints
    holding, into the table of contacts.

    A contact's pivot is the rise of its two points away from each other per unit of push.
    """
    touch, joints = system.touch, 0
    while joints < holding and system.lines[joints, HOLDS] < line_of(system, 0):
        joints += 1
    at = joints
    for c in range(touch.shape[0]):
        k = line_of(system, c)
        touch[c, PIVOT] = 1.0
        if touch[c, CLOSED] == 0.0 or touch[c, COMPLIANT] == 1.0:
            continue
        touch[c, FORCE] = system.vectors[MULTIPLIERS, k]
        if touch[c, SLIDE] != SLIDING or touch[c, STATIC] == 0.0:
            continue
        while at < holding and system.lines[at, HOLDS] < k:
            at += 1
        b, a = system.lines[k, BODY], system.lines[k, PARENT]
        force, turn = inverse_mass_row(system, b, k, 0)
        alone = coupling(system.rows, k, 0, force, turn)
        if a >= 0:
            force, turn = inverse_mass_row(system, a, k, 6)
            alone += coupling(system.rows, k, 6, force, turn)
        ideal, effective = alone, system.square[0, at, at]
        if joints > 0:
            ideal -= joints_share(system, joints, at, -1)
            effective -= joints_share(system, joints, at, at)
        if ideal > HELD * alone:
            touch[c, PIVOT] = effective / ideal


@plain
def note_sizes(system):
    """Sizes of the accelerations from the loads alone, in place of the loads."""
    for i in range(system.bodies.shape[0]):
        for j in range(6):
            system.bodies[i, LOAD + j] = abs(system.bodies[i, PUSH + j])


@inline
def add_term(bodies, i, force, turn, x):
    """push += x (force, turn), and the sizes of these terms to the others."""
    add_push(bodies, i, force, turn, x)
    for j in range(3):
        bodies[i, LOAD + j] += abs(x * force[j])
        bodies[i, LOAD + 3 + j] += abs(x * turn[j])


@plain
def drop_rounding(system):
    """An acceleration that is but the rounding of its terms is none: what rests does not creep."""
    bodies = system.bodies
    for i in range(bodies.shape[0]):
        for first in (0, 3):
            terms = norm(vec(bodies, i, LOAD + first))
            for j in range(first, first + 3):
                if abs(bodies[i, PUSH + j]) <= ROUNDING * terms:
                    bodies[i, PUSH + j] = 0.0


@dispatch
def unconstrained(system, t, y):
    """Write the lines, and push = accelerations from loads and given contact forces alone."""


@unconstrained.register(ContactBodies)
def unconstrained_here(system, t, y):
    clear_loads(system)
    load_effects(system, t, y)
    write_rows(system, t, y)
    add_direct(system, y)
    free_accelerations(system, y)


@plain
def least_reactions(system, rank, holding):
    """x = x_s + the least x with A (x_s + x) = b: x_s are the shares that the contacts keep."""
    A, right, shares = system.square[0], system.vectors[RIGHT], system.vectors[SHARES]
    x, lines = system.vectors[MULTIPLIERS], system.lines
    for m in range(holding):
        for n in range(holding):
            right[m] -= A[m, n] * shares[lines[n, HOLDS]]
    least_norm(A, right, x, rank, holding)
    for m in range(holding):
        x[m] += shares[lines[m, HOLDS]]


@unconstrained.register(Held)
def unconstrained_by_address(system, t, y):
    call_law(system.free_by_address, t, pointer(y), address(system), pointer(system.room))


@dispatch
def contact_accelerations(system, t, y):
    """Fill multipliers, contact forces and push = accelerations; returns (rank, lines that hold).

    Where reactions are not determined, those nearest to the SHARES.
    """


@contact_accelerations.register(Held)
def accelerations_by_address(system, t, y):
    found = pointer(system.room)
    call_law(system.accelerate_by_address, t, pointer(y), address(system), found)
    return found[0], found[1]


@contact_accelerations.register(ContactBodies)
def accelerations_here(system, t, y):
    unconstrained(system, t, y)
    n, holding = system.lines.shape[0], find_holding(system)
    fill_pushed_matrix(system, holding)
    right, x = system.vectors[RIGHT], system.vectors[MULTIPLIERS]
    for m in range(holding):
        k = system.lines[m, HOLDS]
        right[m] = -(system.rows[k, BIAS] + row_times_push(system, k))
    lines = whole(system.lines)
    rank = solve_unsymmetric(
        system.square[0],
        right,
        x,
        system.square[1],
        lines[:, ORDER],
        lines[:, SECOND_ORDER],
        holding,
    )
    if rank < holding:
        least_reactions(system, rank, holding)
    spread_multipliers(system, holding)
    note_sizes(system)
    for k in range(n):
        x, b, a = system.vectors[MULTIPLIERS, k], system.lines[k, BODY], system.lines[k, PARENT]
        if x != 0.0:
            force, turn = push_of(system, b, k, 0)
            add_term(system.bodies, b, force, turn, x)
            if a >= 0:
                force, turn = push_of(system, a, k, 6)
                add_term(system.bodies, a, force, turn, x)
    drop_rounding(system)
    pivots(system, holding)
    return rank, holding


@plain
def contact_power(system, y):
    """Power of all contacts on the bodies [W]: friction, dampers, driven supports."""
    power = 0.0
    for c in range(system.touch.shape[0]):
        k = line_of(system, c)
        last = line_of(system, c + 1)
        b, a = system.lines[k, BODY], system.lines[k, PARENT]
        B, A = state_of(y, b), state_of(y, a)
        for i in range(k, last):
            x = system.vectors[MULTIPLIERS, i]
            s = coupling(system.pushes, i, 0, B.v_WC, B.w_WB_B)
            if a >= 0:
                s += coupling(system.pushes, i, 6, A.v_WC, A.w_WB_B)
            power += x * s
        f, m, p = (
            vec(system.touch, c, DIRECT),
            vec(system.touch, c, DIRECT_TORQUE),
            vec(system.touch, c, POINT),
        )
        speed = add(B.v_WC, cross(rotate(B.q_WB, B.w_WB_B), sub(p, B.p_WC)))
        turn = rotate(B.q_WB, B.w_WB_B)
        if a >= 0:
            spin_A = rotate(A.q_WB, A.w_WB_B)
            speed = sub(speed, add(A.v_WC, cross(spin_A, sub(p, A.p_WC))))
            turn = sub(turn, spin_A)
        power += dot(f, speed) + dot(m, turn)
    return power
