# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Where the points of contact are: distance, normal and place of each.

Two boxes are looked at here, all their points at once; every other pair by the law of its kind,
traced from the catalogue's function (`contact_laws.spot_law`) and called by its address.
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
from rb_sim.mechanics.contact.contact_kinematics import STUCK, velocity_at
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
"""Of a box's edge: how far a point of contact moves at most in a step and remains the same."""


def put_state(out, k, B):
    """The state of a body as a law of a pair gets it, from place k on."""
    for j in range(3):
        out[k + j], out[k + 7 + j], out[k + 10 + j] = B.p_WC[j], B.v_WC[j], B.w_WB_B[j]
    for j in range(4):
        out[k + 3 + j] = B.q_WB[j]


def spot_at(tables, scratch, e, t, B, A, out):
    """Into `out` the SPOT numbers of entry e for these states of body and parent."""
    put_state(scratch, 0, B)
    put_state(scratch, STATE, A)
    own = part(pointer(tables.constants), tables.entries[e, CONSTANT])
    call_law(tables.addresses[tables.entries[e, LAW]], t, pointer(scratch), own, out)


def had_impulse(memory, c):
    """True if a normal impulse of the step acted at point c."""
    return memory[c, AIM] != 0.0 or memory[c, AIM + 1] != 0.0 or memory[c, AIM + 2] != 0.0


def place_points(tables, memory, spots, workspace, e, count, n, B, forget):
    """Give the points of two boxes to the slots that had them before, or to free ones; forget what
    was in slots that have none any more."""
    first = tables.entries[e, FIRST]
    near = SAME_PLACE * min(tables.sizes[e, 3], min(tables.sizes[e, 4], tables.sizes[e, 5]))
    points, taken = workspace[2], workspace[3]
    for k in range(8):
        spots[first + k, GAP] = FAR
        taken[k, 0] = 0.0
    for turn in range(2):  # first what was there before
        for k in range(count):
            if turn == 1 and points[k, 4] == 1.0:
                continue
            p = vec(points, k, 0)
            place = unrotate(B.q_WB, sub(p, B.p_WC))
            best, slot = near * near, -1
            for c in range(8):
                if taken[c, 0] == 1.0 or (turn == 1 and had_impulse(memory, first + c)):
                    continue  # an impulse of this step is still to be told
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
    """Fill the table of spots at (t, y); boxes that are apart by `reach` [m] have no points.

    again: they have been found in this step; what was farther apart then is left as it was.
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


# How lines of contact turn within a step.
#
# What keeps touching has no velocity along the normal at the end of a step, n_1 . u = 0.  The
# step gives its impulses in the middle, where the same velocity is n . u = -b: until the end the
# normal turns on, and the point moves on along what is curved, by b = d(n . u)/dt h/2 at
# constant velocity. With n . u = 0 in the middle each step would end with b, of either sign, and
# the impulse N h of the next one, which acts on the mean of the velocities before and after it,
# would do the work N h b/2: energy that a hollow takes and a hump gives, of first order in the
# step.  With -b it does none but of third order (Hairer, Lubich, Wanner, *Geometric Numerical
# Integration*, section VII.1.4).
#
# b follows from what the step before has left: its velocity at the end of it and here, half a step
# later.  Across the normal the same holds of what sticks.  A point that jumps has another velocity
# after it, which is no b: it is struck.


ALIKE = 0.5
"""Of a change of velocity in half a step: how far that of the half step before it, extrapolated,
may be from it; farther apart they are those of a point that has jumped."""


FREEDOMS, CROWD = 6.0, 1e300
"""Of a body; mark of the bodies of a crowd."""
CROWDED = 3
"""Column of Workspace.bends: 1 of contacts between bodies of a crowd."""


def has_turned(memory, spots, y, c, b, h):
    """Whether the only point of contact c, which has borne, lies in another direction from its body
    than at the end of the last step: y is half a step later, at the velocities of that time."""
    B = state_of(y, b)
    now = sub(vec(spots, c, POINT), B.p_WC)
    then = sub(vec(memory, c, ANCHOR), sub(B.p_WC, scale(0.5 * h, B.v_WC)))
    return dot(now, then) < math.cos(TOO_FAR) * norm(now) * norm(then)


def sticks(memory, laws, c):
    """Whether the laws tell of the velocity across the normal of point c what it will be: not where
    it slips, since corners of a face that slips and turns bend apart and cannot all be held so."""
    return memory[c, SLIDE] == STUCK or (laws[c, TRACTION] != 0.0 and laws[c, STATIC] == 0.0)


def find_bend(memory, laws, bends, spots, y, i, c, b, rates, ratio, h):
    """Write the change of velocity of contact i, point c, since the end of the last step, along the
    normal and both tangents; 0 where it did not bear, has jumped, or its support gives way.

    rates: its relative velocity along the three, before loads and impulses; ratio: length of the
    step h over that of the last one.
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
    """Write CROWD for bodies that touch each other, of which the rows that may hold one are more
    than its freedoms; n contacts.  What touches fixed supports alone is none, whatever holds it."""
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
    """Take away the bends of the n contacts at bodies of a crowd, and mark these contacts: the laws
    of a heap that moves are kept about, and what its bends ask for contradicts itself."""
    find_crowds(laws, active, ends, held, n)
    for i in range(n):
        bends[i, CROWDED] = 1.0 if held[ends[i, 0]] == CROWD else 0.0
        if bends[i, CROWDED] == 1.0:
            bends[i, 0] = bends[i, 1] = bends[i, 2] = 0.0


def note_middle(memory, spots, rows, u, c, k, t1, t2, b, a):
    """Keep the relative velocity of point c with rows from k on after the impulses."""
    n, moved = vec(spots, c, NORMAL), vec(spots, c, MOVES)
    memory[c, THEN] = rate_of(rows, k, u, b, a) - dot(n, moved)
    s1 = rate_of(rows, k + 1, u, b, a) - dot(t1, moved)
    s2 = rate_of(rows, k + 2, u, b, a) - dot(t2, moved)
    keep(memory, c, THEN + 1, add(scale(s1, t1), scale(s2, t2)))


def note_ends(tables, memory, workspace, y):
    """Keep the relative velocities at the end of the step, of what bears."""
    for c in range(memory.shape[0]):
        if memory[c, CLOSED] == 0.0 or not workspace.spots[c, GAP] < 1e299:
            continue
        B, A = state_of(y, tables.owners[c, 0]), state_of(y, tables.owners[c, 1])
        n, p = vec(workspace.spots, c, NORMAL), vec(workspace.spots, c, POINT)
        v = sub(velocity_at(B, sub(p, B.p_WC)), velocity_at(A, sub(p, A.p_WC)))
        v = sub(v, vec(workspace.spots, c, MOVES))
        memory[c, ENDS] = dot(n, v)
        keep(memory, c, ENDS + 1, sub(v, scale(dot(n, v), n)))
