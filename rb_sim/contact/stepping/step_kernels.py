# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The loop of time stepping: steps and their parts, corrections at their ends, rows of samples."""

from __future__ import annotations

import math

import numpy as np

from rb_sim.base.rounding import COMPUTED_ROUNDING, SOLVED
from rb_sim.catalogue.spec import BodyState
from rb_sim.contact.problem import CONTACT_ROWS, add_impulse, coupled, finite, rate_of
from rb_sim.contact.stepping.constraint_rows import write_row
from rb_sim.contact.stepping.geometry import FAR, find_spots, spot_at
from rb_sim.contact.stepping.scene_tables import (
    ARM,
    BODY,
    BOXES,
    FIRST,
    LAW,
    LOADS,
    PARENT,
    RADIUS,
    RESTS,
    ROWS,
)
from rb_sim.contact.stepping.step import (
    STATE,
    after_turn,
    drift,
    fastest_of,
    move,
    solve_step,
)
from rb_sim.contact.stepping.step_workspace import (
    AIM,
    ANCHOR,
    ASTRAY,
    ASTRAY_AT,
    ASTRAY_OF,
    CLOSED,
    ENDS,
    GAINED,
    GAP,
    IMPULSE,
    LENGTH,
    MADE,
    MOVES,
    NORMAL,
    OPEN,
    OPEN_AT,
    OPEN_BEFORE,
    OPEN_NOW,
    OPEN_OF,
    OPEN_OF_NOW,
    POINT,
    SEPARATION_ROUNDS,
    SEPARATION_SWEEPS,
    SHIFT_ROUNDS,
    SLIDE,
    TURNS_AT,
    TWIST,
    WORK,
)
from rb_sim.integrate.attempt import LOST, ByLaws, copy, return_to_positions
from rb_sim.integrate.layout import SETTLE, VELOCITY
from rb_sim.mechanics.contact.contact_bodies import (
    BILATERAL,
    COMPLIANT,
    KINETIC,
    STATIC,
    keep,
)
from rb_sim.mechanics.contact.contact_kinematics import STUCK, velocity_at
from rb_sim.mechanics.systems.many_bodies import INERTIA, LOAD, MASS, six, state_of, vec
from rb_sim.numerics.kernels import call_law, entry, integers, part, pointer
from rb_sim.numerics.vectors import add, cross, dot, norm, rotate, scale, sub, symmetric_times

# Bodies that overlap after a step are separated by the smallest displacements.


MARGIN = 4.0
"""Contacts with a gap below this multiple of the deepest overlap are included, since they may
overlap when bodies are displaced."""


def deepest_overlap(tables, workspace):
    """(least negative gap of the rigid contacts, its point); (0, -1) without overlap."""
    deepest, found = 0.0, -1
    for c in range(tables.owners.shape[0]):
        if tables.laws[c, COMPLIANT] == 0.0 and workspace.spots[c, GAP] < deepest:
            deepest, found = workspace.spots[c, GAP], c
    return deepest, found


def near_normals(tables, workspace, y, margin):
    """Write the normal rows of the rigid contacts with a gap below the margin; returns their
    number."""
    found, none = 0, (0.0, 0.0, 0.0)
    for c in range(tables.owners.shape[0]):
        if tables.laws[c, COMPLIANT] == 1.0 or not workspace.spots[c, GAP] <= margin:
            continue
        b, a = tables.owners[c, 0], tables.owners[c, 1]
        B, A = state_of(y, b), state_of(y, a)
        n, p = vec(workspace.spots, c, NORMAL), vec(workspace.spots, c, POINT)
        k = CONTACT_ROWS * found
        r_B, r_A = sub(p, B.p_WC), sub(p, A.p_WC)
        write_row(workspace.rows, k, tables.bodies, B, A, b, a, n, none, r_B, r_A)
        workspace.ends[found, 0], workspace.ends[found, 1] = b, a
        workspace.targets[k], workspace.x[k] = -workspace.spots[c, GAP], 0.0
        workspace.blocks[found, 0] = coupled(workspace.rows, k, k, a)
        found += 1
    return found


def separate(tables, workspace, y):
    """One round: the least displacements, weighted by mass, after which no gap is negative to first
    order. Call after the spots at y have been found. Returns whether nothing overlaps."""
    deepest, _ = deepest_overlap(tables, workspace)
    if deepest >= -COMPUTED_ROUNDING * tables.scales[0]:
        return True
    n, shift = near_normals(tables, workspace, y, -MARGIN * deepest), workspace.turning
    for i in range(shift.shape[0]):
        for j in range(6):
            shift[i, j] = 0.0
    for made in range(SEPARATION_SWEEPS):
        change, largest = 0.0, 0.0
        for turn in range(n):
            i = turn if made % 2 == 0 else n - 1 - turn
            k, b, a = CONTACT_ROWS * i, workspace.ends[i, 0], workspace.ends[i, 1]
            missing = workspace.targets[k] - rate_of(workspace.rows, k, shift, b, a)
            value = max(0.0, workspace.x[k] + missing / workspace.blocks[i, 0])
            add_impulse(workspace.rows, k, shift, b, a, value - workspace.x[k])
            change, largest = max(change, abs(value - workspace.x[k])), max(largest, value)
            workspace.x[k] = value
        if change <= SOLVED * largest:
            break
    for i in range(shift.shape[0]):
        move(y, i, vec(shift, i, 0), vec(shift, i, 3), 1.0)
    return False


def shift_deepest(tables, workspace, y):
    """Shift the pair with the deepest overlap along its normal, if `separate` has not converged
    after a long step. Returns whether nothing overlaps."""
    deepest, c = deepest_overlap(tables, workspace)
    if deepest >= -COMPUTED_ROUNDING * tables.scales[0]:
        return True
    b, a = tables.owners[c, 0], tables.owners[c, 1]
    light_B = 1.0 / tables.bodies[b, MASS]
    light_A = 1.0 / tables.bodies[a, MASS] if a >= 0 else 0.0
    for j in range(3):
        way = -deepest * workspace.spots[c, NORMAL + j] / (light_A + light_B)
        y[STATE * b + j] += light_B * way
        if a >= 0:
            y[STATE * a + j] -= light_A * way
    return False


def find_carried(tables, memory, workspace, carried):
    """Write 1 for each body on a driven support, whose work may lift it."""
    for c in range(tables.owners.shape[0]):
        if memory[c, CLOSED] != 1.0:
            continue
        moves, turns = vec(workspace.spots, c, MOVES), vec(workspace.spots, c, TURNS_AT)
        if dot(moves, moves) + dot(turns, turns) > 0.0:
            carried[tables.owners[c, 0]] = 1.0


def find_supports(tables, memory, links):
    """Write for each body the contact point that connects it to the world by the fewest bodies, of
    several points of a pair that with the largest impulse; -1: none."""
    for i in range(links.shape[0]):
        links[i] = -1
    changed = True
    while changed:
        changed = False
        for c in range(tables.owners.shape[0]):
            b, a = tables.owners[c, 0], tables.owners[c, 1]
            if memory[c, CLOSED] != 1.0:
                continue
            if links[b] < 0 and (a < 0 or links[a] >= 0):
                links[b], changed = c, True
            elif a >= 0 and links[a] < 0 and links[b] >= 0:
                links[a], changed = c, True
    for c in range(tables.owners.shape[0]):
        for side in range(2):
            i = tables.owners[c, side]
            at = links[i] if i >= 0 and memory[c, CLOSED] == 1.0 else -1
            same = tables.owners[at, 0] == tables.owners[c, 0] if at >= 0 else False
            same = same and tables.owners[at, 1] == tables.owners[c, 1]
            if same and norm(vec(memory, c, AIM)) > norm(vec(memory, at, AIM)):
                links[i] = c


LEAST_SHARE = 0.05
"""Smallest fraction of the lifted energy that is taken from a body's velocity."""


def cone_has_room(tables, memory, c, more):
    """Whether the impulse of point c stays in its friction cone with another one added."""
    aim, total = vec(memory, c, AIM), add(vec(memory, c, IMPULSE), more)
    if norm(aim) == 0.0:
        return False
    n = scale(1.0 / norm(aim), aim)
    normal_impulse = dot(total, n)
    bound = min(tables.laws[c, STATIC], tables.laws[c, KINETIC])
    return norm(sub(total, scale(normal_impulse, n))) <= bound * normal_impulse


def led_to_world(tables, memory, links, i, impulse, final):
    """Whether all points between body i and the world have room for a further impulse on it; final:
    add it to them."""
    while i >= 0:
        c = links[i]
        if c < 0:
            return False
        on_body = tables.owners[c, 0] == i
        more = impulse if on_body else scale(-1.0, impulse)
        if final:
            keep(memory, c, IMPULSE, add(vec(memory, c, IMPULSE), more))
        elif not cone_has_room(tables, memory, c, more):
            return False
        i = tables.owners[c, 1] if on_body else tables.owners[c, 0]
    return True


def book_lift(tables, memory, workspace, y):
    """Account for the energy that bodies gain against the loads when they are separated.

    Their velocities are reduced by it, so that they come to rest, as far as the friction cones of
    the contacts that connect them to the world have room; the impulse is added to those of these
    contacts, so that impulses still equal the change of momentum. The rest is work of the contacts
    (last entry of y), and counts as energy made by them unless a driven support lifts the body.
    Call before `note_ends`.
    """
    n, before, made = tables.bodies.shape[0], workspace.before, workspace.notes[GAINED]
    carried, links, known = np.zeros(n), np.empty(n, np.int64), False
    find_carried(tables, memory, workspace, carried)
    for i in range(n):
        B, k, m, lifted = state_of(y, i), STATE * i, tables.bodies[i, MASS], 0.0
        for j in range(3):
            lifted -= tables.bodies[i, LOAD + j] * (y[k + j] - before[k + j])
        if lifted > 0.0 and carried[i] == 0.0:
            if not known:
                find_supports(tables, memory, links)
                known = True
            spin = symmetric_times(six(tables.bodies, i, INERTIA), B.w_WB_B)
            kinetic = 0.5 * (m * dot(B.v_WC, B.v_WC) + dot(B.w_WB_B, spin))
            slower = math.sqrt(1.0 - lifted / kinetic) if kinetic > lifted else 0.0
            loss, share = scale(m * (slower - 1.0), B.v_WC), 1.0
            while share > LEAST_SHARE and not led_to_world(
                tables, memory, links, i, scale(share, loss), False
            ):
                share *= 0.5
            if share > LEAST_SHARE:
                led_to_world(tables, memory, links, i, scale(share, loss), True)
                slower = 1.0 - share * (1.0 - slower)
                lifted -= min(lifted, (1.0 - slower * slower) * kinetic)
                for j in range(7, STATE):
                    y[k + j] *= slower
        y[y.shape[0] - 1] += lifted
        if carried[i] == 0.0:
            made += lifted
    workspace.notes[MADE] += max(0.0, made)


# Parts of a step: a step is divided where a fast body meets a round surface.
#
# The impulses of a step are along the normals at its middle. If a body moves along a round surface
# by much of its radius within the step, that normal is arbitrary: the body would be deflected in a
# wrong direction, or hit where it would have passed. The motion of each such pair is followed along
# a straight line to the instant at which they meet, and a part of the step has its middle there. In
# the other parts, and if the two pass each other, the pair has no contact. Bodies of heaps move by
# little of their radii in a step and take whole steps.


TURN = 0.05
"""Largest motion along a round surface in a whole step, relative to its radius."""
LOOKS, HALVINGS = 64, 40
"""Minimum number of instants at which a gap is evaluated in a step, and bisections of its zero."""
MOST_PARTS = 16
"""Maximum number of parts of a step; the rest of the step is one part."""
LEAST_PART = 1.0 / 128.0
"""Shortest part relative to the rest of the step."""
TOUCHES, BEARS, SOON = 1e-9, 0.1, 1e-3
"""TOUCHES: gap up to which surfaces touch, relative to the length of the scene, and fraction of
the remaining step within which a meeting counts as at its start or end. BEARS: a touching pair is
in lasting contact if its speed of approach within the fraction SOON of the step is at most this
fraction of its speed; a faster one meets."""
FAR_ENOUGH = 4.0
"""A gap larger than this multiple of the motion of the fastest surface does not close in a step."""
NEVER, PASSES = -1.0, 1e300
"""Values of the meeting time of a pair that is not followed, and of one that does not meet."""


def later(B, t):
    """State of a body after the time t at constant velocities."""
    p, q = add(B.p_WC, scale(t, B.v_WC)), after_turn(B.q_WB, B.w_WB_B, t)
    return BodyState(p, q, B.v_WC, B.w_WB_B)


def gap_at(tables, scratch, e, B, A, t):
    """Gap of entry e after the time t; scratch: of the workspace."""
    out = part(pointer(scratch), 2 * STATE)
    spot_at(tables, scratch, e, 0.0, later(B, t), later(A, t), out)
    return out[GAP]


def meeting(tables, scratch, e, B, A, h, speed, touches):
    """Time within h at which the gap of the pair vanishes [s]; PASSES if it does not, NEVER if the
    pair is in lasting contact or separates. speed: upper bound of the rate of the gap."""
    t, gap, soon = 0.0, gap_at(tables, scratch, e, B, A, 0.0), SOON * h
    if gap <= touches:
        falls = gap - gap_at(tables, scratch, e, B, A, soon)
        return 0.0 if falls > BEARS * speed * soon else NEVER
    for _ in range(2 * LOOKS):
        before = t
        t = min(h, t + max(gap / speed, h / LOOKS))
        gap = gap_at(tables, scratch, e, B, A, t)
        if gap <= 0.0:
            after = t
            for _ in range(HALVINGS):
                t = 0.5 * (before + after)
                if gap_at(tables, scratch, e, B, A, t) > 0.0:
                    before = t
                else:
                    after = t
            return after
        if t >= h:
            break
    return PASSES


def ahead(tables, y, i, h):
    """State of body i with its mean velocity in h, without contacts."""
    B = state_of(y, i)
    if i < 0:
        return B
    v = add(B.v_WC, scale(0.5 * h, vec(tables.gravity, i, 0)))
    return BodyState(B.p_WC, B.q_WB, v, B.w_WB_B)


def find_meetings(tables, workspace, y, h, number):
    """Write the times at which fast pairs meet into the workspace; returns the first, or NEVER.

    number: of the part; all pairs count as fast after the first one."""
    sizes, entries, laws = tables.sizes, tables.entries, tables.laws
    first, far = PASSES, FAR_ENOUGH * h * max(fastest_of(tables, y), tables.scales[1])
    for e in range(entries.shape[0]):
        c = entries[e, FIRST]
        workspace.meets[c] = NEVER
        if far < workspace.spots[c, GAP] < FAR or entries[e, LAW] == BOXES:
            continue
        if entries[e, RESTS] == 0 or not sizes[e, RADIUS] > 0.0:
            continue
        if laws[c, COMPLIANT] == 1.0 or laws[c, BILATERAL] == 1.0:
            continue
        B, A = ahead(tables, y, entries[e, BODY], h), ahead(tables, y, entries[e, PARENT], h)
        speed = norm(sub(B.v_WC, A.v_WC)) + norm(B.w_WB_B) * sizes[e, ARM]
        speed += norm(A.w_WB_B) * norm(sub(B.p_WC, A.p_WC))
        if speed > 0.0 and (number > 0 or speed * h > TURN * sizes[e, RADIUS]):
            touches = TOUCHES * tables.scales[0]
            workspace.meets[c] = meeting(tables, workspace.scratch, e, B, A, h, speed, touches)
            if workspace.meets[c] >= 0.0:
                first = min(first, workspace.meets[c])
    return first if first < PASSES else NEVER


def next_part(tables, workspace, y, left, number):
    """Length of the next part of a step, of which `left` remains; the workspace then has the pairs
    without contact in this part."""
    first = find_meetings(tables, workspace, y, left, number)
    part, centred = left, False
    if number + 1 < MOST_PARTS and first >= 0.0:
        half = min(0.5 * LEAST_PART * left, left - first)
        if first <= TOUCHES * left:
            part, centred = LEAST_PART * left, True
        elif first <= 2.0 * half:
            part, centred = min(2.0 * first, left), True
        elif half > TOUCHES * left:
            part = first - half
    if left - part <= TOUCHES * left:
        part = left
    for c in range(workspace.meets.shape[0]):
        within = number + 1 >= MOST_PARTS or (centred and workspace.meets[c] <= part)
        if workspace.meets[c] >= 0.0 and within:
            workspace.meets[c] = NEVER
    return part


def set_gaps(workspace, gap):
    """Set the gaps of the pairs without contact in this part."""
    for c in range(workspace.meets.shape[0]):
        if workspace.meets[c] >= 0.0:
            workspace.spots[c, GAP] = gap


def add_up(memory, workspace, number, last, h):
    """Sum the impulses of all parts; after the last one they are those of the step of length h."""
    for c in range(memory.shape[0]):
        for j in range(3):
            before = workspace.summed[c, j] if number > 0 else 0.0
            turned = workspace.summed[c, 3 + j] if number > 0 else 0.0
            workspace.summed[c, j] = before + memory[c, IMPULSE + j]
            workspace.summed[c, 3 + j] = turned + memory[c, TWIST + j]
            if last:
                memory[c, IMPULSE + j] = workspace.summed[c, j]
                memory[c, TWIST + j] = workspace.summed[c, 3 + j]
    for k in range(workspace.joint_x.shape[0]):
        workspace.joint_summed[k] = workspace.joint_x[k] + (
            workspace.joint_summed[k] if number > 0 else 0.0
        )
        if last:
            workspace.joint_x[k] = workspace.joint_summed[k]
    if last:
        workspace.notes[LENGTH] = h


# The functions that Python calls: steps, the need of a new search for neighbours, rows of samples.


REACH = 1e-6
"""Margin added to the distance that surfaces can lose in a step, relative to the length of the
scene: boxes within it are examined for contact."""


def reach_of(tables, y, h):
    """Upper bound of the approach of two surfaces in a step [m]."""
    length = tables.scales[0]
    fastest = max(fastest_of(tables, y), tables.scales[1])
    return min(2.0 * h * fastest, length) + REACH * length


def note_ends(tables, memory, workspace, t, y):
    """Store contact points and velocities of closed contacts relative to their supports at the end
    of a step, t; and the largest error of a velocity change in it because a normal has rotated
    since its middle: velocity given by the impulse times rotation of the normal."""
    for c in range(memory.shape[0]):
        given = vec(memory, c, AIM)
        keep(memory, c, AIM, (0.0, 0.0, 0.0))
        if not workspace.spots[c, GAP] < 1e299:
            continue
        n, p, size = vec(workspace.spots, c, NORMAL), vec(workspace.spots, c, POINT), norm(given)
        keep(memory, c, ANCHOR, p)
        wrong = norm(sub(scale(size, n), given))
        if wrong > workspace.notes[ASTRAY]:
            workspace.notes[ASTRAY], workspace.notes[ASTRAY_AT] = wrong, t
            workspace.notes[ASTRAY_OF] = c
        if memory[c, CLOSED] != 0.0:
            B, A = state_of(y, tables.owners[c, 0]), state_of(y, tables.owners[c, 1])
            v = sub(velocity_at(B, sub(p, B.p_WC)), velocity_at(A, sub(p, A.p_WC)))
            v = sub(v, vec(workspace.spots, c, MOVES))
            memory[c, ENDS] = dot(n, v)
            keep(memory, c, ENDS + 1, sub(v, scale(dot(n, v), n)))


def note_open(workspace, t):
    """Store the first non-uniqueness of contact forces that lasts two steps, up to t.

    In a single step, in which a body has an impact or comes to rest, the laws of the step may be
    not unique although those of the instant are.
    """
    notes = workspace.notes
    figure = min(notes[OPEN_BEFORE], notes[OPEN_NOW])
    if notes[OPEN] == 0.0 and figure > 0.0:
        notes[OPEN], notes[OPEN_AT], notes[OPEN_OF] = figure, t, notes[OPEN_OF_NOW]
    notes[OPEN_BEFORE] = notes[OPEN_NOW]


def write_loads(tables, t, y):
    """Set the loads to those of all effects at (t, y)."""
    law, n, b = tables.addresses[LOADS], tables.bodies.shape[0], tables.bodies
    for i in range(n):
        for j in range(3):
            b[i, LOAD + j] = b[i, MASS] * tables.gravity[i, j]
            b[i, LOAD + 3 + j] = 0.0
    if law == 0:
        return
    loads = pointer(tables.loads)
    call_law(law, t, pointer(y), pointer(tables.inputs), loads)
    for i in range(n):
        for j in range(6):
            b[i, LOAD + j] += loads[6 * i + j]
    for i in range(tables.loads.shape[0] - 6 * n):
        tables.inputs[i] = loads[6 * n + i]


def write_joint_rows(tables, workspace, t, y):
    """Write the rows of the joints at (t, y)."""
    rows, out = tables.joint_rows, workspace.joint_out
    if rows.shape[0] == 0:
        return
    inputs = pointer(tables.joint_inputs)
    call_law(tables.joint_laws[ROWS], t, pointer(y), inputs, pointer(out))
    width = rows.shape[1]
    for k in range(rows.shape[0]):
        for j in range(width):
            rows[k, j] = out[width * k + j]


def project_joints(tables, workspace, t, y):
    """Project y onto the manifold of the joints, in place: unit quaternions, then positions, then
    velocities, whose impulses are added to `joint_back` [N s].

    y becomes NaN if the projection fails, e.g. after a far too large step.
    """
    rows, out, n = tables.joint_rows, workspace.joint_out, STATE * tables.bodies.shape[0]
    if rows.shape[0] == 0:
        return
    laws, inputs, at = tables.joint_laws, pointer(tables.joint_inputs), pointer(out)
    state = pointer(y)
    call_law(laws[SETTLE], t, state, inputs, at)
    copy(n, state, at)
    length = tables.scales[0]
    worst, _ = return_to_positions(ByLaws(integers(laws), inputs, at, n), t, state, length, 0.0)
    if not worst <= LOST * length:
        y[0] = math.nan
    call_law(laws[VELOCITY], t, state, inputs, at)
    copy(n, state, at)
    for k in range(rows.shape[0]):
        workspace.joint_back[k] += out[n + k]


def find_all_spots(tables, memory, workspace, t, y, h, again):
    """As `find_spots`, for all pairs that can touch within h."""
    reach, spots, polygons = reach_of(tables, y, h), workspace.spots, workspace.polygons
    find_spots(tables, memory, spots, polygons, workspace.scratch, t, y, reach, again)


def find_at_end(tables, memory, workspace, t, y, h):
    """The spots at the end of a step, after projection onto the joints."""
    project_joints(tables, workspace, t, y)
    find_all_spots(tables, memory, workspace, t, y, h, True)


def has_strayed(tables, y, h):
    """Whether bodies that are not neighbours may meet in the next step of length h, by their motion
    since the last search for neighbours."""
    near, fastest, pull = tables.near, 0.0, 0.0
    for i in range(near.shape[0]):
        B = state_of(y, i)
        fastest = max(fastest, norm(B.v_WC) + near[i, 3] * norm(B.w_WB_B))
        pull = max(pull, norm(vec(tables.gravity, i, 0)))
    way = 2.0 * h * (fastest + h * pull)
    for i in range(near.shape[0]):
        moved = norm(sub(state_of(y, i).p_WC, vec(near, i, 0)))
        if not 2.0 * (moved + way) <= tables.margin[0]:
            return True
    return False


def one_step(tables, memory, workspace, t, y, h):
    """A step of length h from t in its parts; y in place."""
    left, at, number = h, t, 0
    for k in range(workspace.joint_back.shape[0]):
        workspace.joint_back[k] = 0.0
    while left > 0.0:
        part = next_part(tables, workspace, y, left, number)
        one_part(tables, memory, workspace, at, y, part)
        if number > 0 or part < left:
            add_up(memory, workspace, number, part == left, h)
        left, at, number = left - part, at + part, number + 1


def one_part(tables, memory, workspace, t, y, h):
    """A part of length h of a step; y in place."""
    drift(tables, y, 0.5 * h)
    write_loads(tables, t + 0.5 * h, y)
    write_joint_rows(tables, workspace, t + 0.5 * h, y)
    find_all_spots(tables, memory, workspace, t + 0.5 * h, y, h, False)
    set_gaps(workspace, FAR)
    solve_step(tables, memory, workspace, y, h)
    set_gaps(workspace, 0.0)  # other contacts may have driven these pairs together
    drift(tables, y, 0.5 * h)
    y[y.shape[0] - 1] += workspace.notes[WORK]
    for i in range(y.shape[0]):
        workspace.before[i] = y[i]
    apart = False
    for _ in range(SEPARATION_ROUNDS):
        find_at_end(tables, memory, workspace, t + h, y, h)
        apart = separate(tables, workspace, y)
        if apart:
            break
    for _ in range(SHIFT_ROUNDS):
        if apart:
            break
        find_at_end(tables, memory, workspace, t + h, y, h)
        apart = shift_deepest(tables, workspace, y)
    if not apart:
        find_at_end(tables, memory, workspace, t + h, y, h)
    book_lift(tables, memory, workspace, y)
    note_open(workspace, t + h)
    note_ends(tables, memory, workspace, t + h, y)


@entry
def steps(tables, memory, workspace, origin, first, count, h, y, y_before, memory_before):
    """Take the steps first to first + count - 1 of the grid origin + k h; y and memory in place.

    y_before, memory_before: become those before the last step. Returns the number of steps taken:
    fewer if the state is no longer finite, or if the next step needs a new search for neighbours.
    """
    for k in range(first, first + count):
        if k > first and has_strayed(tables, y, h):
            return k - first
        for i in range(y.shape[0]):
            y_before[i] = y[i]
        for c in range(memory.shape[0]):
            for j in range(memory.shape[1]):
                memory_before[c, j] = memory[c, j]
        one_step(tables, memory, workspace, origin + k * h, y, h)
        if not finite(y):
            return k - first
    return count


@entry
def strayed(tables, y, h):
    """1 if a step of length h from y needs a new search for neighbours, else 0."""
    return 1 if has_strayed(tables, y, h) else 0


def put_balance(tables, y, out, at):
    """Write kinetic energy, energy in gravity, total momentum and angular momentum."""
    kinetic, potential = 0.0, 0.0
    momentum, angular = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(tables.bodies.shape[0]):
        B, m = state_of(y, i), tables.bodies[i, MASS]
        p = scale(m, B.v_WC)
        spin = symmetric_times(six(tables.bodies, i, INERTIA), B.w_WB_B)
        kinetic += 0.5 * (dot(p, B.v_WC) + dot(spin, B.w_WB_B))
        potential -= m * dot(vec(tables.gravity, i, 0), B.p_WC)
        momentum = add(momentum, p)
        angular = add(angular, add(cross(B.p_WC, p), rotate(B.q_WB, spin)))
    out[at], out[at + 1], out[at + 2] = kinetic, potential, 0.0
    for j in range(3):
        out[at + 3 + j], out[at + 6 + j] = momentum[j], angular[j]


def power_at(tables, y, c, force, torque, point):
    """Power of the reaction at point c on its bodies [W]."""
    b, a = tables.owners[c, 0], tables.owners[c, 1]
    B = state_of(y, b)
    spin = rotate(B.q_WB, B.w_WB_B)
    power = dot(force, velocity_at(B, sub(point, B.p_WC))) + dot(torque, spin)
    if a >= 0:
        A = state_of(y, a)
        spin = rotate(A.q_WB, A.w_WB_B)
        power -= dot(force, velocity_at(A, sub(point, A.p_WC))) + dot(torque, spin)
    return power


def put_reaction(tables, memory, members, o, joints, y, h, out, at):
    """Write force, torque about the anchor and anchor of reaction o, by impulses over a step h."""
    main = members[o, 0]
    force, torque = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if main >= 0:
        anchor = vec(memory, main - joints, ANCHOR)
    else:
        anchor = state_of(y, -1 - main).p_WC
    for c in range(members.shape[1] - 1 - joints):
        if members[o, 1 + joints + c] == 0:
            continue
        f = scale(1.0 / h, vec(memory, c, IMPULSE))
        arm = sub(vec(memory, c, ANCHOR), anchor)
        force = add(force, f)
        torque = add(torque, add(scale(1.0 / h, vec(memory, c, TWIST)), cross(arm, f)))
    for j in range(3):
        out[at + j], out[at + 3 + j], out[at + 6 + j] = force[j], torque[j], anchor[j]


def put_shares(tables, memory, y, c, h, out, at):
    """Add point c of a pair of neighbours to the reactions on both bodies, about their C."""
    f, p = scale(1.0 / h, vec(memory, c, IMPULSE)), vec(memory, c, ANCHOR)
    free, sign = scale(1.0 / h, vec(memory, c, TWIST)), 1.0
    for side in range(2):
        k = at + 9 * tables.shares[c, side]
        turn = add(free, cross(sub(p, state_of(y, tables.owners[c, side]).p_WC), f))
        for j in range(3):
            out[k + j] += sign * f[j]
            out[k + 3 + j] += sign * turn[j]
        sign = -1.0


@entry
def report(tables, memory, workspace, members, joints, y, h, out):
    """Write the row of a sample at y after a step of length h; joints: number of parts that are not
    contacts.

    Reactions are impulses over the step, including those of contacts that are open after it.
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
        force = scale(1.0 / h, vec(memory, c, IMPULSE))
        torque = scale(1.0 / h, vec(memory, c, TWIST))
        out[at + 2] += power_at(tables, y, c, force, torque, vec(memory, c, ANCHOR))
        if tables.laws[c, COMPLIANT] == 0.0 and workspace.spots[c, GAP] < 1e299:
            overlap = max(overlap, -workspace.spots[c, GAP])
        state = 0.0 if memory[c, CLOSED] == 0.0 else 1.0
        state = 2.0 if state == 1.0 and memory[c, SLIDE] == STUCK else state
        if c < fixed:
            out[at + 11 + c] = state
            continue
        for side in range(2):
            k = at + 11 + tables.shares[c, 2 + side]
            out[k] = state if out[k] == 0.0 or 0.0 < state < out[k] else out[k]
    out[at + 9], out[at + 10] = overlap / tables.scales[0], y[STATE * bodies]
