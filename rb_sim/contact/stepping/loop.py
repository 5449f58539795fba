"""The kernels that Python calls: many steps at once, the parts of one step, the row of a sample.

A scene whose contacts, joints and effects all are in the tables takes its steps in `run`; one with
others goes through the other tasks of it step by step, and Python adds what the tables do not have
between them.
"""

from __future__ import annotations

from rb_sim.contact.stepping.apart import pay_for_lift, push_apart, shift_deepest
from rb_sim.contact.stepping.bends import note_ends
from rb_sim.contact.stepping.geometry import (
    AIM,
    ANCHOR,
    CLOSED,
    GAP,
    IMPULSE,
    NORMAL,
    POINT,
    SLIDE,
    TWIST,
    find_spots,
    pushed,
    put,
    triple,
)
from rb_sim.contact.stepping.lines import six
from rb_sim.contact.stepping.parts import add_up, leave_out, look_again, next_part
from rb_sim.contact.stepping.room import (
    ASTRAY,
    ASTRAY_AT,
    ASTRAY_OF,
    MADE,
    PART,
    PUSH_ROUNDS,
    SHIFT_ROUNDS,
    STUCK,
    WORK,
)
from rb_sim.contact.stepping.step import STATE, drift, fastest_of, load_gravity, solve_step
from rb_sim.contact.stepping.tables import COMPLIANT
from rb_sim.engine.systems.many_bodies import INERTIA, MASS, state_of
from rb_sim.maths.jit import entry, inline
from rb_sim.maths.vectors import add, cross, dot, norm, rotate, scale, sub, symmetric_times

REACH = 1e-6
"""Of the scene's length, by which boxes that are not yet near may be apart and be looked at."""


@inline
def reach_of(tables, y, h):
    """Distance [m] that two surfaces can lose in a step, generously."""
    length = tables.scales[0]
    return min(2.0 * h * fastest_of(tables, y), length) + REACH * length


@inline
def note_anchors(memory, room):
    """Places of the points at the end of the step, where they are still there."""
    for c in range(memory.shape[0]):
        if room.spots[c, GAP] < 1e299:
            put(memory, c, ANCHOR, triple(room.spots, c, POINT))


@inline
def note_aims(memory, room, t):
    """How far the normals along which points have pushed in the step, up to t, have turned since
    its middle: what passes a round surface fast is sent off in a direction that is none.

    The velocity that the impulse gave, times the turn, is what is wrong of it.
    """
    for c in range(memory.shape[0]):
        given = triple(memory, c, AIM)
        if pushed(memory, c) and room.spots[c, GAP] < 1e299:
            size = norm(given)
            wrong = norm(sub(scale(size, triple(room.spots, c, NORMAL)), given))
            if wrong > room.notes[ASTRAY]:
                room.notes[ASTRAY], room.notes[ASTRAY_AT], room.notes[ASTRAY_OF] = wrong, t, c
        put(memory, c, AIM, (0.0, 0.0, 0.0))


@inline
def to_middle(tables, memory, room, t, y, h):
    """Half a drift, and the spots there."""
    drift(tables, y, 0.5 * h)
    reach = reach_of(tables, y, h)
    find_spots(tables, memory, room.spots, room.polygons, t + 0.5 * h, y, reach, False)
    leave_out(room)


@inline
def to_end(tables, memory, room, y, h):
    """Impulses, the other half of the drift, and the work of the contacts in the last of y."""
    solve_step(tables, memory, room, y, h)
    look_again(room)
    drift(tables, y, 0.5 * h)
    y[y.shape[0] - 1] += room.notes[WORK]
    for i in range(y.shape[0]):
        room.before[i] = y[i]


@inline
def find_at_end(tables, memory, room, t, y, h):
    reach = reach_of(tables, y, h)
    find_spots(tables, memory, room.spots, room.polygons, t, y, reach, True)


@inline
def has_strayed(tables, y, h):
    """Whether bodies that are no neighbours may meet in the next step of length h: one has moved
    too far since neighbours were looked for, with what it can do in that step."""
    near, fastest, pull = tables.near, 0.0, 0.0
    for i in range(near.shape[0]):
        B = state_of(y, i)
        fastest = max(fastest, norm(B.v_WC) + near[i, 3] * norm(B.w_WB_B))
        pull = max(pull, norm(triple(tables.gravity, i, 0)))
    way = 2.0 * h * (fastest + h * pull)
    for i in range(near.shape[0]):
        moved = norm(sub(state_of(y, i).p_WC, triple(near, i, 0)))
        if not 2.0 * (moved + way) <= tables.margin[0]:
            return True
    return False


@inline
def is_finite(y):
    s = 0.0
    for i in range(y.shape[0]):
        s += 0.0 * y[i]
    return s == 0.0


@inline
def one_step(tables, memory, room, t, y, h):
    """A step of length h from t of a scene that is all in the tables, in its parts; y in place."""
    left, at, number = h, t, 0
    while left > 0.0:
        part = next_part(tables, room, y, left, number)
        one_part(tables, memory, room, at, y, part)
        if number > 0 or part < left:
            add_up(memory, room, number, part == left, h)
        left, at, number = left - part, at + part, number + 1


@inline
def one_part(tables, memory, room, t, y, h):
    """A part of length h of a step, as it is a step; y in place."""
    load_gravity(tables)
    to_middle(tables, memory, room, t, y, h)
    to_end(tables, memory, room, y, h)
    apart = False
    for _ in range(PUSH_ROUNDS):
        find_at_end(tables, memory, room, t + h, y, h)
        apart = push_apart(tables, room, y)
        if apart:
            break
    for _ in range(SHIFT_ROUNDS):
        if apart:
            break
        find_at_end(tables, memory, room, t + h, y, h)
        apart = shift_deepest(tables, room, y)
    if not apart:
        find_at_end(tables, memory, room, t + h, y, h)
    note_aims(memory, room, t + h)
    note_anchors(memory, room)
    room.notes[MADE] += pay_for_lift(tables, memory, room, y, room.before)
    note_ends(tables, memory, room, y)


@inline
def steps(tables, memory, room, origin, first, count, h, y, y_before, memory_before):
    """Steps number first to first + count - 1 of the grid origin + k h; y and memory in place.

    y_before and memory_before: as they were before the last of them.  Returns how many were taken;
    fewer where the state is no longer finite, or neighbours have to be looked for before the next.
    """
    for k in range(first, first + count):
        if k > first and has_strayed(tables, y, h):
            return k - first
        for i in range(y.shape[0]):
            y_before[i] = y[i]
        for c in range(memory.shape[0]):
            for j in range(memory.shape[1]):
                memory_before[c, j] = memory[c, j]
        one_step(tables, memory, room, origin + k * h, y, h)
        if not is_finite(y):
            return k - first
    return count


STEPS, BEGIN, FINISH, FIND, PUSH, SHIFT, PAY, NEXT_PART, ADD_UP, STRAYED = range(10)
"""Tasks of `run`: whole steps; to the middle of a step, with loads of gravity and spots there, to
which the rest is added from Python; from there to its end, where bodies may still overlap; spots
there; a round of moving bodies apart (1 once nothing overlaps), and of the deepest pair alone;
places and velocities of the points, and the energy of what was lifted; length of the next part of a
step; impulses of its parts so far, of the whole step after the last; 1 if neighbours have to be
looked for before the step."""


@entry
def run(task, tables, memory, room, t, h, y, first, count, y_before, memory_before):
    """Do a task at (t, y), with a step of length h; y and memory in place.  Of NEXT_PART h is what
    is left of the step, and first the number of the part; of ADD_UP count is 1 after the last.

    One kernel for all of them, so that what they share is compiled once.  first, count, y_before,
    memory_before: of `steps`, where t is the origin; else of no use.
    """
    if task == STEPS:
        return steps(tables, memory, room, t, first, count, h, y, y_before, memory_before)
    if task == BEGIN:
        load_gravity(tables)
        to_middle(tables, memory, room, t, y, h)
    elif task == FINISH:
        to_end(tables, memory, room, y, h)
    elif task == FIND:
        find_at_end(tables, memory, room, t, y, h)
    elif task == PUSH:
        return 1 if push_apart(tables, room, y) else 0
    elif task == STRAYED:
        return 1 if has_strayed(tables, y, h) else 0
    elif task == SHIFT:
        return 1 if shift_deepest(tables, room, y) else 0
    elif task == PAY:
        note_aims(memory, room, t)
        note_anchors(memory, room)
        room.notes[MADE] += pay_for_lift(tables, memory, room, y, room.before)
        note_ends(tables, memory, room, y)
    elif task == NEXT_PART:
        room.notes[PART] = next_part(tables, room, y, h, first)
    else:
        add_up(memory, room, first, count == 1, h)
    return 0


@inline
def put_balance(tables, y, out, at):
    """Kinetic energy, energy in gravity, momenta and angular momenta of all bodies."""
    kinetic, potential = 0.0, 0.0
    momentum, angular = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(tables.bodies.shape[0]):
        B, m = state_of(y, i), tables.bodies[i, MASS]
        p = scale(m, B.v_WC)
        spin = symmetric_times(six(tables.bodies, i, INERTIA), B.w_WB_B)
        kinetic += 0.5 * (dot(p, B.v_WC) + dot(spin, B.w_WB_B))
        potential -= m * dot(triple(tables.gravity, i, 0), B.p_WC)
        momentum = add(momentum, p)
        angular = add(angular, add(cross(B.p_WC, p), rotate(B.q_WB, spin)))
    out[at], out[at + 1], out[at + 2] = kinetic, potential, 0.0
    for j in range(3):
        out[at + 3 + j], out[at + 6 + j] = momentum[j], angular[j]


@inline
def power_at(tables, y, c, force, torque, point):
    """Power of the reaction at point c on its bodies [W]."""
    b, a = tables.owners[c, 0], tables.owners[c, 1]
    B = state_of(y, b)
    spin = rotate(B.q_WB, B.w_WB_B)
    power = dot(force, add(B.v_WC, cross(spin, sub(point, B.p_WC)))) + dot(torque, spin)
    if a >= 0:
        A = state_of(y, a)
        spin = rotate(A.q_WB, A.w_WB_B)
        power -= dot(force, add(A.v_WC, cross(spin, sub(point, A.p_WC)))) + dot(torque, spin)
    return power


@inline
def put_reaction(tables, memory, members, o, joints, y, h, out, at):
    """Force, torque about the anchor and anchor of reaction o, from the impulses of a step h."""
    main = members[o, 0]
    force, torque = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if main >= 0:
        anchor = triple(memory, main - joints, ANCHOR)
    else:
        anchor = state_of(y, -1 - main).p_WC
    for c in range(members.shape[1] - 1 - joints):
        if members[o, 1 + joints + c] == 0:
            continue
        f = scale(1.0 / h, triple(memory, c, IMPULSE))
        arm = sub(triple(memory, c, ANCHOR), anchor)
        force = add(force, f)
        torque = add(torque, add(scale(1.0 / h, triple(memory, c, TWIST)), cross(arm, f)))
    for j in range(3):
        out[at + j], out[at + 3 + j], out[at + 6 + j] = force[j], torque[j], anchor[j]


@inline
def put_shares(tables, memory, y, c, h, out, at):
    """Add point c of a pair of neighbours to the reactions on both its bodies, about their C."""
    f, p = scale(1.0 / h, triple(memory, c, IMPULSE)), triple(memory, c, ANCHOR)
    free, sign = scale(1.0 / h, triple(memory, c, TWIST)), 1.0
    for side in range(2):
        k = at + 9 * tables.shares[c, side]
        turn = add(free, cross(sub(p, state_of(y, tables.owners[c, side]).p_WC), f))
        for j in range(3):
            out[k + j] += sign * f[j]
            out[k + 3 + j] += sign * turn[j]
        sign = -1.0


@entry
def report(tables, memory, room, members, joints, y, h, out):
    """Write the row of a sample at y after a step of length h; joints: parts that are no contacts.

    Reactions are impulses over the step, those of contacts that are open after it among them.
    """
    bodies = tables.bodies.shape[0]
    for i in range(STATE * bodies):
        out[i] = y[i]
    at = STATE * bodies
    for o in range(members.shape[0]):
        contact = members[o, 0] < 0 or members[o, 0] >= joints
        if contact:
            put_reaction(tables, memory, members, o, joints, y, h, out, at)
        at += 9
    fixed = members.shape[1] - 1 - joints
    for c in range(fixed, memory.shape[0]):
        put_shares(tables, memory, y, c, h, out, STATE * bodies)
    put_balance(tables, y, out, at)
    overlap = 0.0
    for k in range(at + 11 + fixed, out.shape[0]):
        out[k] = 0.0
    for c in range(memory.shape[0]):
        force = scale(1.0 / h, triple(memory, c, IMPULSE))
        torque = scale(1.0 / h, triple(memory, c, TWIST))
        out[at + 2] += power_at(tables, y, c, force, torque, triple(memory, c, ANCHOR))
        if tables.laws[c, COMPLIANT] == 0.0 and room.spots[c, GAP] < 1e299:
            overlap = max(overlap, -room.spots[c, GAP])
        state = 0.0 if memory[c, CLOSED] == 0.0 else 1.0
        state = 2.0 if state == 1.0 and memory[c, SLIDE] == STUCK else state
        if c < fixed:
            out[at + 11 + c] = state
            continue
        for side in range(2):
            k = at + 11 + tables.shares[c, 2 + side]
            out[k] = state if out[k] == 0.0 or 0.0 < state < out[k] else out[k]
    out[at + 9], out[at + 10] = overlap / tables.scales[0], y[STATE * bodies]
