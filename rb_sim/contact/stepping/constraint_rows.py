# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Rows, laws and initial impulses of the active contacts and joints of a time step."""

from __future__ import annotations

import math

from rb_sim.base.rounding import COMPUTED_ROUNDING, SOLVED
from rb_sim.catalogue.constraints.rows import RATE
from rb_sim.contact.problem import (
    BOUND,
    COMPLIANCE,
    CONTACT_ROWS,
    FORCE_A,
    FORCE_B,
    LEAST,
    PULLS,
    ROLLS,
    SPINS,
    TORQUE_A,
    TORQUE_B,
    VISCOUS,
    VISCOUS_PER_NORMAL,
    Graph,
    rate_of,
    respond,
)
from rb_sim.contact.stepping.geometry import CROWDED, find_bend, straighten_crowds
from rb_sim.contact.stepping.scene_tables import FIRST_CONSTANT, TRACTION
from rb_sim.contact.stepping.step_workspace import (
    CLOSED,
    FRESH,
    GAP,
    IMPULSE,
    LENGTH,
    MOVES,
    MOVES_AT,
    NEAR,
    NEAREST,
    NORMAL,
    POINT,
    ROLL,
    SLIDE,
    SPIN,
    TURNS_AT,
    TWIST,
)
from rb_sim.mechanics.contact.constraint_tables import traction_at
from rb_sim.mechanics.contact.contact_bodies import (
    BILATERAL,
    COMPLIANT,
    DAMPING,
    KINETIC,
    RESTITUTION,
    ROLLING_ARM,
    SPINNING_ARM,
    STATIC,
    STIFFNESS,
    keep,
)
from rb_sim.mechanics.contact.contact_kinematics import STUCK, torque_of
from rb_sim.mechanics.systems.many_bodies import LOAD, MASS, state_of, vec
from rb_sim.mechanics.systems.many_bodies import WIDTH as STATE
from rb_sim.numerics.kernels import part, pointer
from rb_sim.numerics.vectors import (
    add,
    cross,
    dot,
    neg,
    norm,
    perpendicular,
    rotate,
    sub,
    unrotate,
)

FARTHER = 1.01
"""Gap relative to the largest approach in a step above which a pair is not examined."""


def write_row(rows, k, bodies, B, A, b, a, force, moment, r_B, r_A):
    """Write row k: a force (world) at the arms r_B and r_A, and a moment (world), on B, and the
    opposite on A."""
    keep(rows, k, FORCE_B, force)
    keep(rows, k, TORQUE_B, torque_of(B, r_B, force, moment))
    for j in range(6):
        rows[k, FORCE_A + j] = 0.0
    if a >= 0:
        keep(rows, k, FORCE_A, neg(force))
        keep(rows, k, TORQUE_A, neg(torque_of(A, r_A, force, moment)))
    respond(rows, k, bodies, b, a)


def write_all_rows(spots, laws, bodies, rows, targets, y, i, c, b, a):
    """Write the rows of active contact i, point c."""
    k = CONTACT_ROWS * i
    B, A = state_of(y, b), state_of(y, a)
    n, p = vec(spots, c, NORMAL), vec(spots, c, POINT)
    t1, t2 = perpendicular(n)
    axes, none = (n, t1, t2), (0.0, 0.0, 0.0)
    r_B, r_A = sub(p, B.p_WC), sub(p, A.p_WC)
    moved, spun = vec(spots, c, MOVES), vec(spots, c, TURNS_AT)
    for j in range(3):
        write_row(rows, k + j, bodies, B, A, b, a, axes[j], none, r_B, r_A)
        targets[k + j] = dot(axes[j], moved)
    if laws[c, ROLLING_ARM] > 0.0 or laws[c, SPINNING_ARM] > 0.0:
        around = (t1, t2, n)
        for j in range(3):
            write_row(rows, k + 3 + j, bodies, B, A, b, a, none, around[j], none, none)
            targets[k + 3 + j] = dot(around[j], spun)


def speed_at(rows, k, y, b, a):
    """Rate of row k of a contact of these bodies at the velocities of y."""
    s = 0.0
    for j in range(6):
        s += rows[k, j] * y[STATE * b + 7 + j]
    if a >= 0:
        for j in range(6):
            s += rows[k, 6 + j] * y[STATE * a + 7 + j]
    return s


def write_rules(
    scales, laws, bodies, slides, gap, rows, targets, rules, bends, turning, u, y, i, c, b, a, h,
    addresses, constants, scratch,
):  # fmt: skip
    """Write friction, compliance and targets of active contact i, point c.

    slides: its mode in the previous step, negative without one; turning: velocities without the
    loads; addresses, constants: of the traced laws; scratch: workspace.
    """
    k, bend = CONTACT_ROWS * i, bends[i, 0]
    before = rate_of(rows, k, turning, b, a) - targets[k]
    now = rate_of(rows, k, u, b, a) - targets[k]
    s1 = speed_at(rows, k + 1, y, b, a) - targets[k + 1]
    s2 = speed_at(rows, k + 2, y, b, a) - targets[k + 2]
    slip = math.sqrt(s1 * s1 + s2 * s2)
    stuck = slides == STUCK if slides >= 0.0 else slip <= SOLVED * scales[1]
    rules[i, PULLS], rules[i, COMPLIANCE], rules[i, LEAST] = laws[c, BILATERAL], 0.0, 0.0
    rules[i, ROLLS], rules[i, SPINS] = laws[c, ROLLING_ARM], laws[c, SPINNING_ARM]
    rules[i, BOUND] = laws[c, STATIC] if stuck else laws[c, KINETIC]
    if laws[c, TRACTION] != 0.0:
        slip = max(slip, SOLVED * scales[1])
        own = part(pointer(constants), int(laws[c, FIRST_CONSTANT]))
        law = addresses[int(laws[c, TRACTION])]
        per_normal, alone = traction_at(law, slip, own, pointer(scratch))
        rules[i, VISCOUS_PER_NORMAL], rules[i, VISCOUS] = per_normal / slip, h * alone / slip
        if laws[c, STATIC] == 0.0:
            strikes = is_impact(1.0, before - bend, now - bend)  # as in problem.impacts
            rules[i, BOUND] = per_normal if per_normal > 0.0 and strikes else -1.0
        elif not stuck:
            rules[i, BOUND] = per_normal
    if laws[c, COMPLIANT] == 1.0:
        stiff = h * laws[c, STIFFNESS] + laws[c, DAMPING]
        rules[i, COMPLIANCE] = 1.0 / (h * stiff)
        targets[k] -= laws[c, STIFFNESS] * gap / stiff
    elif is_impact(laws[c, RESTITUTION], before - bend, now - bend):
        targets[k] -= laws[c, RESTITUTION] * (before - bend)
    elif laws[c, BILATERAL] == 0.0:
        # at the middle of a step over a curved surface the body is on a chord, above its ends
        near = nearness(scales, bodies, y, b, a, h) + 0.25 * h * max(0.0, bend)
        # a body that leaves must not be pulled back faster than it left
        closing = bend + max(0.0, gap - near) / h
        targets[k] -= closing if bends[i, CROWDED] == 1.0 else max(closing, before)
    else:
        targets[k] -= bend
    targets[k + 1], targets[k + 2] = targets[k + 1] - bends[i, 1], targets[k + 2] - bends[i, 2]


def nearness(scales, bodies, y, b, a, h):
    """Gap [m] between moving bodies that counts as closed, far below the error of the step: the
    velocities that close tiny gaps of many contacts exactly contradict each other."""
    length, B = scales[0], state_of(y, b)
    speed = norm(B.v_WC) + length * norm(B.w_WB_B)
    pull = norm(vec(bodies, b, LOAD)) / bodies[b, MASS]
    if a >= 0:
        A = state_of(y, a)
        speed += norm(A.v_WC) + length * norm(A.w_WB_B)
        pull = max(pull, norm(vec(bodies, a, LOAD)) / bodies[a, MASS])
    if speed <= MOVES_AT * h * pull:
        return COMPUTED_ROUNDING * length
    return COMPUTED_ROUNDING * length + min(NEAR * h * h * pull, NEAREST * length)


def is_impact(e, before, now):
    """Whether a speed of approach is an impact: more than the loads cause in two steps, so that a
    body at rest does not bounce."""
    return e > 0.0 and before < 0.0 and before < 2.0 * (now - before)


def fastest_of(u, y):
    """(largest speed, largest angular speed) of all bodies before the impulses, with and without
    the loads."""
    speed, spin = 0.0, 0.0
    for i in range(u.shape[0]):
        k = STATE * i
        speed = max(speed, max(norm(vec(u, i, 0)), norm((y[k + 7], y[k + 8], y[k + 9]))))
        with_loads = norm(vec(u, i, 3))
        spin = max(spin, max(with_loads, norm((y[k + 10], y[k + 11], y[k + 12]))))
    return speed, spin


def is_far(spots, y, c, b, a, within):
    """Whether the gap is too wide to close in a step, as of most pairs of a heap.

    within: (largest closing speed of two centres, largest angular speed, length of the step). It
    takes the arrays one by one, since counting the references of all tables would cost more.
    """
    gap, p = spots[c, GAP], vec(spots, c, POINT)
    k = STATE * b
    arms = norm(sub(p, (y[k], y[k + 1], y[k + 2])))
    if a >= 0:
        k = STATE * a
        arms += norm(sub(p, (y[k], y[k + 1], y[k + 2])))
    closing = within[0] + within[1] * arms + norm(vec(spots, c, MOVES))
    return gap > FARTHER * within[2] * closing


def takes_part(spots, laws, u, y, c, b, a, h, slow):
    """Whether the gap of point c may close within the step; slow: a negligible speed."""
    gap = spots[c, GAP]
    if laws[c, BILATERAL] == 1.0 or gap <= 0.0:
        return True
    B, n, p = state_of(y, b), vec(spots, c, NORMAL), vec(spots, c, POINT)
    arm = unrotate(B.q_WB, sub(p, B.p_WC))
    spin = rotate(B.q_WB, cross(vec(u, b, 3), arm))
    rate = dot(n, sub(add(vec(u, b, 0), spin), vec(spots, c, MOVES)))
    at_start = rotate(B.q_WB, cross(B.w_WB_B, arm))
    before = dot(n, sub(add(B.v_WC, at_start), vec(spots, c, MOVES)))
    if a >= 0:
        A = state_of(y, a)
        arm = unrotate(A.q_WB, sub(p, A.p_WC))
        rate -= dot(n, add(vec(u, a, 0), rotate(A.q_WB, cross(vec(u, a, 3), arm))))
        before -= dot(n, add(A.v_WC, rotate(A.q_WB, cross(A.w_WB_B, arm))))
    if laws[c, COMPLIANT] == 1.0 or is_impact(laws[c, RESTITUTION], before, rate):
        return gap + 0.5 * h * min(rate, 0.0) <= 0.0
    # other bodies may push this one: include every gap that could close
    speed = norm(vec(u, b, 0)) + norm(vec(u, a, 0)) if a >= 0 else 0.0
    return gap + h * min(rate, before) <= h * (speed * 1e-3 + slow)


def gather(tables, memory, workspace, y, h):
    """Write rows, laws and initial impulses of the active points; returns their number."""
    found, notes = 0, workspace.notes
    ratio = h / notes[LENGTH] if notes[LENGTH] > 0.0 else 0.0
    owners, laws, bodies, scales = tables.owners, tables.laws, tables.bodies, tables.scales
    spots, rows, targets, bends = (
        workspace.spots,
        workspace.rows,
        workspace.targets,
        workspace.bends,
    )
    active, ends, u, turning = workspace.active, workspace.ends, workspace.u, workspace.turning
    speed, spin = fastest_of(u, y)
    within = 2.0 * speed + 1e-3 * (2.0 * speed + scales[1]), spin, h
    for c in range(owners.shape[0]):
        b, a, gap = owners[c, 0], owners[c, 1], spots[c, GAP]
        looked_at = gap < 1e299
        if gap > 0.0 and laws[c, BILATERAL] == 0.0:
            looked_at = looked_at and not is_far(spots, y, c, b, a, within)
        if not (looked_at and takes_part(spots, laws, u, y, c, b, a, h, 1e-3 * scales[1])):
            memory[c, CLOSED] = memory[c, SLIDE] = memory[c, ROLL] = memory[c, SPIN] = 0.0
            keep(memory, c, IMPULSE, (0.0, 0.0, 0.0))
            keep(memory, c, TWIST, (0.0, 0.0, 0.0))
            continue
        i, k = found, CONTACT_ROWS * found
        active[i], ends[i, 0], ends[i, 1] = c, b, a
        write_all_rows(spots, laws, bodies, rows, targets, y, i, c, b, a)
        rates = (
            rate_of(rows, k, turning, b, a) - targets[k],
            rate_of(rows, k + 1, turning, b, a) - targets[k + 1],
            rate_of(rows, k + 2, turning, b, a) - targets[k + 2],
        )
        find_bend(memory, laws, bends, spots, y, i, c, b, rates, ratio, h)
        found += 1
    straighten_crowds(laws, bends, active, ends, workspace.held, found)
    begin_with_rules(tables, memory, workspace, y, found, h, ratio)
    return found


def begin_with_rules(tables, memory, workspace, y, n, h, ratio):
    """Write laws and initial impulses of the n active points, after their rows; ratio: length of
    the step h relative to that of the last one."""
    laws, bodies, scales, notes = tables.laws, tables.bodies, tables.scales, workspace.notes
    spots, rows, targets, rules = (
        workspace.spots,
        workspace.rows,
        workspace.targets,
        workspace.rules,
    )
    bends, turning, x, u = workspace.bends, workspace.turning, workspace.x, workspace.u
    for i in range(n):
        c, k, b, a = (
            workspace.active[i],
            CONTACT_ROWS * i,
            workspace.ends[i, 0],
            workspace.ends[i, 1],
        )
        slides = -1.0 if notes[FRESH] == 1.0 else memory[c, SLIDE]
        gap = spots[c, GAP]
        write_rules(
            scales, laws, bodies, slides, gap, rows, targets, rules, bends, turning, u, y,
            i, c, b, a, h, tables.addresses, tables.constants, workspace.scratch,
        )  # fmt: skip
        normal = vec(spots, c, NORMAL)
        t1, t2 = perpendicular(normal)
        impulse, twist = vec(memory, c, IMPULSE), vec(memory, c, TWIST)
        x[k] = ratio * dot(normal, impulse)
        if rules[i, BOUND] != 0.0:
            x[k + 1], x[k + 2] = ratio * dot(t1, impulse), ratio * dot(t2, impulse)
        x[k + 3], x[k + 4] = ratio * dot(t1, twist), ratio * dot(t2, twist)
        x[k + 5] = ratio * dot(normal, twist)


def gather_joints(tables, workspace, h):
    """Write the rows of the joints, and their impulses of the previous step."""
    ratio = h / workspace.notes[LENGTH] if workspace.notes[LENGTH] > 0.0 else 0.0
    for k in range(tables.joints.shape[0]):
        b, a = tables.joints[k, 0], tables.joints[k, 1]
        for j in range(12):
            workspace.joint_rows[k, j] = tables.joint_rows[k, j]
        respond(workspace.joint_rows, k, tables.bodies, b, a)
        # a bend as of contacts (see geometry), since the previous step has ended on the joints
        bend = (
            rate_of(workspace.joint_rows, k, workspace.turning, b, a) - tables.joint_rows[k, RATE]
        )
        workspace.joint_targets[k] = tables.joint_rows[k, RATE] - bend
        workspace.joint_x[k] *= ratio


def graph_of(tables, workspace, n):
    """The graph of the first n contacts of the workspace, and of the joints."""
    return Graph(
        workspace.ends[:n],
        workspace.rows[: CONTACT_ROWS * n],
        workspace.targets[: CONTACT_ROWS * n],
        workspace.rules[:n],
        workspace.blocks[:n],
        tables.joints,
        workspace.joint_rows,
        workspace.joint_targets,
        workspace.joint_factor,
        workspace.joint_spare,
    )
