# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Spots: gap, normal and position of each contact point.

All points of two boxes are computed here at once, every other pair by the traced law of its kind
(`contact_laws.spot_law`), called by address.
"""

from __future__ import annotations

import math

from rb_sim.catalogue.geometry.solids import boxes_touching
from rb_sim.contact.problem import rate_of
from rb_sim.contact.stepping.scene_tables import (
    BODY,
    BOXES,
    CONSTANT,
    FIRST,
    LAW,
    PARENT,
    RESTS,
    TRACTION,
)
from rb_sim.contact.stepping.step_workspace import (
    AIM,
    ANCHOR,
    CLOSED,
    ENDS,
    GAP,
    MEMORY,
    MOVES,
    NORMAL,
    PLACE,
    POINT,
    SLIDE,
    SPOT,
    THEN,
    TOO_FAR,
    USED,
)
from rb_sim.mechanics.contact.contact_bodies import (
    COMPLIANT,
    STATIC,
    keep,
)
from rb_sim.mechanics.contact.contact_kinematics import STUCK
from rb_sim.mechanics.systems.many_bodies import WIDTH as STATE
from rb_sim.mechanics.systems.many_bodies import state_of, vec
from rb_sim.numerics.kernels import call_law, part, pointer
from rb_sim.numerics.vectors import (
    add,
    dot,
    norm,
    perpendicular,
    rotate,
    scale,
    sub,
    unrotate,
)

FAR = 1e300
SAME_PLACE = 0.1
"""Largest motion of a contact point in a step, relative to a box's edge, up to which it counts as
the same point."""


def put_state(out, k, B):
    """Write the state of a body for the law of a pair, from index k on."""
    for j in range(3):
        out[k + j], out[k + 7 + j], out[k + 10 + j] = B.p_WC[j], B.v_WC[j], B.w_WB_B[j]
    for j in range(4):
        out[k + 3 + j] = B.q_WB[j]


def spot_at(tables, scratch, e, t, B, A, out):
    """Write the SPOT numbers of entry e for these states of body and parent to `out`."""
    put_state(scratch, 0, B)
    put_state(scratch, STATE, A)
    own = part(pointer(tables.constants), tables.entries[e, CONSTANT])
    call_law(tables.addresses[tables.entries[e, LAW]], t, pointer(scratch), own, out)


def had_impulse(memory, c):
    """Whether a normal impulse acted at point c in the step."""
    return memory[c, AIM] != 0.0 or memory[c, AIM + 1] != 0.0 or memory[c, AIM + 2] != 0.0


def place_points(tables, memory, spots, workspace, e, count, n, B, forget):
    """Assign the points of two boxes to their previous slots, or to free ones; forget: clear the
    memory of slots without a point."""
    first = tables.entries[e, FIRST]
    near = SAME_PLACE * min(tables.sizes[e, 3], min(tables.sizes[e, 4], tables.sizes[e, 5]))
    points, taken = workspace[2], workspace[3]
    for k in range(8):
        spots[first + k, GAP] = FAR
        taken[k, 0] = 0.0
    for turn in range(2):  # previous points first
        for k in range(count):
            if turn == 1 and points[k, 4] == 1.0:
                continue
            p = vec(points, k, 0)
            place = unrotate(B.q_WB, sub(p, B.p_WC))
            best, slot = near * near, -1
            for c in range(8):
                if taken[c, 0] == 1.0 or (turn == 1 and had_impulse(memory, first + c)):
                    continue  # its impulse of this step is still to be reported
                if turn == 1:
                    slot = c
                    break
                away = sub(place, vec(memory, first + c, PLACE))
                if memory[first + c, USED] == 1.0 and dot(away, away) < best:
                    best, slot = dot(away, away), c
            points[k, 4] = 1.0 if slot >= 0 else 0.0
            if slot >= 0:
                taken[slot, 0] = 1.0
                if turn == 1:
                    for j in range(MEMORY):
                        memory[first + slot, j] = 0.0
                spots[first + slot, GAP] = points[k, 3]
                keep(spots, first + slot, NORMAL, n)
                keep(spots, first + slot, POINT, p)
                keep(memory, first + slot, PLACE, place)
                memory[first + slot, USED] = 1.0
    for c in range(8):
        if forget and taken[c, 0] == 0.0:
            for j in range(MEMORY):
                memory[first + c, j] = 0.0


def find_spots(tables, memory, spots, workspace, scratch, t, y, reach, again):
    """Write the table of spots at (t, y); boxes farther apart than `reach` [m] have no points.

    again: second search of a step, in which pairs that were farther apart are left out.
    """
    s, entries = tables.sizes, tables.entries
    for e in range(entries.shape[0]):
        c = entries[e, FIRST]
        if (
            again
            and entries[e, RESTS] == 1
            and spots[c, GAP] > reach
            and not had_impulse(memory, c)
        ):
            continue
        B, A = state_of(y, entries[e, BODY]), state_of(y, entries[e, PARENT])
        if entries[e, LAW] != BOXES:
            spot_at(tables, scratch, e, t, B, A, part(pointer(spots), SPOT * c))
            continue
        half_B, half_A = vec(s, e, 3), vec(s, e, 9)
        c_B = add(B.p_WC, rotate(B.q_WB, vec(s, e, 0)))
        c_A = add(A.p_WC, rotate(A.q_WB, vec(s, e, 6)))
        count, n = boxes_touching(
            workspace[2], workspace, A.q_WB, c_A, half_A, B.q_WB, c_B, half_B, reach
        )
        place_points(tables, memory, spots, workspace, e, count, n, B, not again)


# Bends: rotation of the contact normal within a step.
#
# A contact that stays closed has no normal velocity at the end of a step, n_1 . u = 0. The impulses
# of the step act at its middle, where the same velocity is n . u = -b: until the end the normal
# rotates, and the point moves along curved surfaces, which changes n . u by b = d(n . u)/dt h/2. If
# n . u were 0 at the middle, each step would end with the velocity b, and the impulse N h of the
# next step, which acts on the mean of the velocities before and after it, would do the work
# N h b/2: energy lost in a hollow and gained on a hump, of first order in the step. With -b the
# error of the energy is of third order (Hairer, Lubich, Wanner, *Geometric Numerical Integration*,
# section VII.1.4).
#
# b is the change of the normal velocity from the end of the previous step to here, half a step
# later. A sticking contact has the same for its tangential velocity. If a point jumps, its velocity
# changes by more, and the contact has an impact.


ALIKE = 0.5
"""Largest relative difference between the change of velocity in half a step and that extrapolated
from the half step before; above it the point has jumped."""


FREEDOMS, CROWD = 6.0, 1e300
"""Degrees of freedom of a body; mark of the bodies of a crowd."""
CROWDED = 3
"""Column of Workspace.bends: 1 for contacts between bodies of a crowd."""


def has_turned(memory, spots, y, c, b, h):
    """Whether the only point of contact c has moved to another direction from its body b since the
    end of the last step. y: state half a step later, with the velocities of that time."""
    B = state_of(y, b)
    now = sub(vec(spots, c, POINT), B.p_WC)
    then = sub(vec(memory, c, ANCHOR), sub(B.p_WC, scale(0.5 * h, B.v_WC)))
    return dot(now, then) < math.cos(TOO_FAR) * norm(now) * norm(then)


def sticks(memory, laws, c):
    """Whether the laws determine the tangential velocity of point c: it sticks, or friction is
    viscous."""
    return memory[c, SLIDE] == STUCK or (laws[c, TRACTION] != 0.0 and laws[c, STATIC] == 0.0)


def find_bend(memory, laws, bends, spots, y, i, c, b, rates, ratio, h):
    """Write the bend of contact i, point c: change of its velocity since the end of the last step,
    along the normal and both tangents; 0 if it was open, has jumped, or is compliant.

    rates: relative velocity along the three, before loads and impulses; ratio: length of the step h
    relative to that of the last one.
    """
    bends[i, 0] = bends[i, 1] = bends[i, 2] = 0.0
    if memory[c, CLOSED] == 0.0 or laws[c, COMPLIANT] == 1.0:
        return
    if has_turned(memory, spots, y, c, b, h):
        return
    here = rates[0] - memory[c, ENDS]
    if abs(ratio * (memory[c, ENDS] - memory[c, THEN]) - here) <= ALIKE * abs(here):
        bends[i, 0] = here
    if not sticks(memory, laws, c):
        return
    t1, t2 = perpendicular(vec(spots, c, NORMAL))
    end = vec(memory, c, ENDS + 1)
    across = sub(add(scale(rates[1], t1), scale(rates[2], t2)), end)
    before = scale(ratio, sub(end, vec(memory, c, THEN + 1)))
    if norm(sub(before, across)) <= ALIKE * norm(across):
        bends[i, 1], bends[i, 2] = dot(t1, across), dot(t2, across)


def find_crowds(laws, active, ends, held, n):
    """Write CROWD for groups of bodies in contact with each other in which contacts may act on a
    body by more than six rows; n: number of contacts. A body on fixed supports only is no crowd."""
    for i in range(held.shape[0]):
        held[i] = 0.0
    for i in range(n):
        c, b, a = active[i], ends[i, 0], ends[i, 1]
        row_count = 3.0 if laws[c, TRACTION] != 0.0 or laws[c, STATIC] > 0.0 else 1.0
        held[b] += row_count
        if a >= 0:
            held[a] += row_count
    changed = True
    while changed:
        changed = False
        for i in range(n):
            b, a = ends[i, 0], ends[i, 1]
            if a < 0 or (held[b] == CROWD and held[a] == CROWD):
                continue
            if max(held[b], held[a]) > FREEDOMS:
                held[b] = held[a] = CROWD
                changed = True


def straighten_crowds(laws, bends, active, ends, held, n):
    """Set the bends of the n contacts of a crowd to zero, and mark these contacts: in a moving heap
    the bends contradict each other."""
    find_crowds(laws, active, ends, held, n)
    for i in range(n):
        bends[i, CROWDED] = 1.0 if held[ends[i, 0]] == CROWD else 0.0
        if bends[i, CROWDED] == 1.0:
            bends[i, 0] = bends[i, 1] = bends[i, 2] = 0.0


def note_middle(memory, spots, rows, u, c, k, t1, t2, b, a):
    """Store the relative velocity of point c (rows from k on) after the impulses."""
    n, moved = vec(spots, c, NORMAL), vec(spots, c, MOVES)
    memory[c, THEN] = rate_of(rows, k, u, b, a) - dot(n, moved)
    s1 = rate_of(rows, k + 1, u, b, a) - dot(t1, moved)
    s2 = rate_of(rows, k + 2, u, b, a) - dot(t2, moved)
    keep(memory, c, THEN + 1, add(scale(s1, t1), scale(s2, t2)))
