"""The lines, rules and first impulses of the contacts and joints that take part in a step."""

from __future__ import annotations

import math

from rb_sim.catalogue.constraints.rows import RATE
from rb_sim.contact.kernels import inner
from rb_sim.contact.solvers.gauss_seidel import (
    BOUND,
    GIVE,
    LIGHT_A,
    LIGHT_B,
    LINES,
    PULLS,
    ROLLS,
    SPINS,
    TURN_A,
    TURN_B,
    VISCOUS_PER_PUSH,
    Graph,
    rate_of,
)
from rb_sim.contact.solvers.gauss_seidel import VISCOUS as VISCOUS_ALONE
from rb_sim.contact.stepping.geometry import (
    CLOSED,
    GAP,
    IMPULSE,
    MOVES,
    NORMAL,
    POINT,
    ROLL,
    SLIDE,
    SPIN,
    TURNS_AT,
    TWIST,
    put,
    triple,
)
from rb_sim.contact.stepping.room import (
    EXACT,
    FRESH,
    LEAVES,
    LENGTH,
    MOVES_AT,
    NEAR,
    NEAREST,
    STUCK,
)
from rb_sim.contact.stepping.tables import (
    BILATERAL,
    COEFFICIENT,
    COMPLIANT,
    COULOMB,
    DAMPING,
    KINETIC,
    LAW,
    REGULARISED,
    RESTITUTION,
    ROLLING,
    SLOW,
    SPINNING,
    STATIC,
    STIFFNESS,
    VISCOUS,
    VISCOUS_PER_NORMAL,
)
from rb_sim.engine.systems.many_bodies import (
    INVERSE,
    LOAD,
    MASS,
    state_of,
)
from rb_sim.engine.systems.many_bodies import WIDTH as STATE
from rb_sim.maths.vectors import (
    add,
    cross,
    dot,
    norm,
    perpendicular,
    rotate,
    scale,
    sub,
    symmetric_times,
    unrotate,
)


@inner
def six(a, i, k):
    return (a[i, k], a[i, k + 1], a[i, k + 2], a[i, k + 3], a[i, k + 4], a[i, k + 5])


@inner
def write_line(rows, k, tables, B, A, b, a, force, moment, r_B, r_A):
    """Line k: a force (world) at the arms r_B and r_A, and a moment (world), on B and back on A."""
    turn = unrotate(B.q_WB, add(moment, cross(r_B, force)))
    put(rows, k, 0, force)
    put(rows, k, 3, turn)
    put(rows, k, TURN_B, symmetric_times(six(tables.bodies, b, INVERSE), turn))
    rows[k, LIGHT_B], rows[k, LIGHT_A] = 1.0 / tables.bodies[b, MASS], 0.0
    for j in range(6):
        rows[k, 6 + j] = 0.0
    if a >= 0:
        back = unrotate(A.q_WB, scale(-1.0, add(moment, cross(r_A, force))))
        put(rows, k, 6, scale(-1.0, force))
        put(rows, k, 9, back)
        put(rows, k, TURN_A, symmetric_times(six(tables.bodies, a, INVERSE), back))
        rows[k, LIGHT_A] = 1.0 / tables.bodies[a, MASS]


@inner
def write_lines(tables, room, y, i, c):
    """The lines of contact i of those that take part, which is point c."""
    b, a, k = room.ends[i, 0], room.ends[i, 1], LINES * i
    spots, laws = room.spots, tables.laws
    B, A = state_of(y, b), state_of(y, a)
    n, p = triple(spots, c, NORMAL), triple(spots, c, POINT)
    t1, t2 = perpendicular(n)
    axes, none = (n, t1, t2), (0.0, 0.0, 0.0)
    r_B, r_A = sub(p, B.p_WC), sub(p, A.p_WC)
    moved, spun = triple(spots, c, MOVES), triple(spots, c, TURNS_AT)
    for j in range(3):
        write_line(room.rows, k + j, tables, B, A, b, a, axes[j], none, r_B, r_A)
        room.targets[k + j] = dot(axes[j], moved)
    if laws[c, ROLLING] > 0.0 or laws[c, SPINNING] > 0.0:
        around = (t1, t2, n)
        for j in range(3):
            write_line(room.rows, k + 3 + j, tables, B, A, b, a, none, around[j], none, none)
            room.targets[k + 3 + j] = dot(around[j], spun)


@inner
def speed_at(room, y, i, k):
    """Rate of line k of contact i at the velocities of y."""
    rows, s = room.rows, 0.0
    for j in range(6):
        s += rows[k, j] * y[STATE * room.ends[i, 0] + 7 + j]
    if room.ends[i, 1] >= 0:
        for j in range(6):
            s += rows[k, 6 + j] * y[STATE * room.ends[i, 1] + 7 + j]
    return s


@inner
def write_rules(tables, memory, room, y, i, c, h):
    """Friction, compliance and the target along the normal of contact i, which is point c."""
    laws, rules, k = tables.laws, room.rules, LINES * i
    b, a = room.ends[i, 0], room.ends[i, 1]
    gap = room.spots[c, GAP]
    before = speed_at(room, y, i, k) - room.targets[k]
    now = rate_of(room.rows, k, room.u, b, a) - room.targets[k]
    s1 = speed_at(room, y, i, k + 1) - room.targets[k + 1]
    s2 = speed_at(room, y, i, k + 2) - room.targets[k + 2]
    slip = math.sqrt(s1 * s1 + s2 * s2)
    if room.notes[FRESH] == 1.0:
        stuck = slip <= LEAVES * tables.scales[1]
    else:
        stuck = memory[c, SLIDE] == STUCK
    rules[i, PULLS], rules[i, GIVE] = laws[c, BILATERAL], 0.0
    rules[i, ROLLS], rules[i, SPINS] = laws[c, ROLLING], laws[c, SPINNING]
    rules[i, BOUND] = laws[c, STATIC] if stuck else laws[c, KINETIC]
    law = laws[c, LAW]
    if law != COULOMB:
        rules[i, BOUND] = -1.0
        rules[i, VISCOUS_PER_PUSH] = laws[c, COEFFICIENT] if law == VISCOUS_PER_NORMAL else 0.0
        rules[i, VISCOUS_ALONE] = h * laws[c, COEFFICIENT] if law == VISCOUS else 0.0
        if law == REGULARISED:
            rounded = math.sqrt(slip * slip + laws[c, SLOW] * laws[c, SLOW])
            rules[i, VISCOUS_PER_PUSH] = laws[c, COEFFICIENT] / rounded
    if laws[c, COMPLIANT] == 1.0:
        stiff = h * laws[c, STIFFNESS] + laws[c, DAMPING]
        rules[i, GIVE] = 1.0 / (h * stiff)
        room.targets[k] -= laws[c, STIFFNESS] * gap / stiff
    elif is_impact(laws[c, RESTITUTION], before, now):
        room.targets[k] -= laws[c, RESTITUTION] * before
    elif laws[c, BILATERAL] == 0.0:
        room.targets[k] -= max(0.0, gap - nearness(tables, y, b, a, h)) / h


@inner
def nearness(tables, y, b, a, h):
    """Gap [m] that is none between bodies that move, far less than the step's own error: closing
    the tiny gaps of many contacts exactly asks for velocities that contradict each other, and
    impulses would grow or change places without end."""
    length, bodies, B = tables.scales[0], tables.bodies, state_of(y, b)
    speed = norm(B.v_WC) + length * norm(B.w_WB_B)
    pull = norm(triple(bodies, b, LOAD)) / bodies[b, MASS]
    if a >= 0:
        A = state_of(y, a)
        speed += norm(A.v_WC) + length * norm(A.w_WB_B)
        pull = max(pull, norm(triple(bodies, a, LOAD)) / bodies[a, MASS])
    if speed <= MOVES_AT * h * pull:
        return EXACT * length
    return EXACT * length + min(NEAR * h * h * pull, NEAREST * length)


@inner
def is_impact(e, before, now):
    """What the loads alone would give in two steps is none: a body at rest does not bounce."""
    return e > 0.0 and before < 0.0 and before < 2.0 * (now - before)


@inner
def takes_part(tables, room, y, c, b, a, h):
    """Whether point c may be reached within the step."""
    gap, laws = room.spots[c, GAP], tables.laws
    if laws[c, BILATERAL] == 1.0 or gap <= 0.0:
        return True
    B, n, p = state_of(y, b), triple(room.spots, c, NORMAL), triple(room.spots, c, POINT)
    arm = unrotate(B.q_WB, sub(p, B.p_WC))
    u = room.u
    spin = rotate(B.q_WB, cross(triple(u, b, 3), arm))
    rate = dot(n, sub(add(triple(u, b, 0), spin), triple(room.spots, c, MOVES)))
    at_start = rotate(B.q_WB, cross(B.w_WB_B, arm))
    before = dot(n, sub(add(B.v_WC, at_start), triple(room.spots, c, MOVES)))
    if a >= 0:
        A = state_of(y, a)
        arm = unrotate(A.q_WB, sub(p, A.p_WC))
        rate -= dot(n, add(triple(u, a, 0), rotate(A.q_WB, cross(triple(u, a, 3), arm))))
        before -= dot(n, add(A.v_WC, rotate(A.q_WB, cross(A.w_WB_B, arm))))
    if laws[c, COMPLIANT] == 1.0 or is_impact(laws[c, RESTITUTION], before, rate):
        return gap + 0.5 * h * min(rate, 0.0) <= 0.0
    # a body nearby may push this one: all that could close takes part
    speed = norm(triple(u, b, 0)) + norm(triple(u, a, 0)) if a >= 0 else 0.0
    return gap + h * min(rate, before) <= h * (speed * 1e-3 + 1e-3 * tables.scales[1])


@inner
def gather(tables, memory, room, y, h):
    """Write lines, rules and first impulses of the points that take part; how many."""
    found, notes = 0, room.notes
    ratio = h / notes[LENGTH] if notes[LENGTH] > 0.0 else 0.0
    for c in range(tables.owners.shape[0]):
        b, a = tables.owners[c, 0], tables.owners[c, 1]
        if not (room.spots[c, GAP] < 1e299 and takes_part(tables, room, y, c, b, a, h)):
            memory[c, CLOSED] = memory[c, SLIDE] = memory[c, ROLL] = memory[c, SPIN] = 0.0
            put(memory, c, IMPULSE, (0.0, 0.0, 0.0))
            put(memory, c, TWIST, (0.0, 0.0, 0.0))
            continue
        i, k = found, LINES * found
        room.active[i], room.ends[i, 0], room.ends[i, 1] = c, b, a
        write_lines(tables, room, y, i, c)
        write_rules(tables, memory, room, y, i, c, h)
        n = triple(room.spots, c, NORMAL)
        t1, t2 = perpendicular(n)
        impulse, twist = triple(memory, c, IMPULSE), triple(memory, c, TWIST)
        room.x[k] = ratio * dot(n, impulse)
        if room.rules[i, BOUND] != 0.0:
            room.x[k + 1], room.x[k + 2] = ratio * dot(t1, impulse), ratio * dot(t2, impulse)
        room.x[k + 3], room.x[k + 4] = ratio * dot(t1, twist), ratio * dot(t2, twist)
        room.x[k + 5] = ratio * dot(n, twist)
        found += 1
    return found


@inner
def gather_joints(tables, room, h):
    """Lines of the joints, and their impulses of the step before."""
    ratio = h / room.notes[LENGTH] if room.notes[LENGTH] > 0.0 else 0.0
    for k in range(tables.joints.shape[0]):
        b, a = tables.joints[k, 0], tables.joints[k, 1]
        for j in range(12):
            room.joint_rows[k, j] = tables.joint_rows[k, j]
        turn = symmetric_times(six(tables.bodies, b, INVERSE), triple(tables.joint_rows, k, 3))
        put(room.joint_rows, k, TURN_B, turn)
        room.joint_rows[k, LIGHT_B] = 1.0 / tables.bodies[b, MASS]
        if a >= 0:
            turn = symmetric_times(six(tables.bodies, a, INVERSE), triple(tables.joint_rows, k, 9))
            put(room.joint_rows, k, TURN_A, turn)
            room.joint_rows[k, LIGHT_A] = 1.0 / tables.bodies[a, MASS]
        room.joint_targets[k] = tables.joint_rows[k, RATE]
        room.joint_x[k] *= ratio


@inner
def graph_of(tables, room, n):
    return Graph(
        room.ends[:n], room.rows[: LINES * n], room.targets[: LINES * n], room.rules[:n],
        room.blocks[:n], tables.joints, room.joint_rows, room.joint_targets,
    )  # fmt: skip
