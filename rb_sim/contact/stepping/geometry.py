"""Where the points of contact are: distance, normal and place of each.

Two boxes are looked at here, all their points at once; every other pair by the law of its kind,
traced from the catalogue's function (`scene_tables.spot_law`) and called by its address.
"""

from __future__ import annotations

from rb_sim.catalogue.geometry.boxes import boxes_touching
from rb_sim.contact.stepping.scene_tables import (
    BODY,
    BOXES,
    CONSTANT,
    FIRST,
    LAW,
    PARENT,
    RESTS,
)
from rb_sim.mechanics.systems.many_bodies import WIDTH as STATE
from rb_sim.mechanics.systems.many_bodies import state_of
from rb_sim.numerics.kernels import call_law, inline, part, pointer
from rb_sim.numerics.vectors import add, dot, rotate, sub, unrotate

GAP, NORMAL, POINT, MOVES, TURNS_AT, SPOT = 0, 1, 4, 7, 10, 13
"""Columns of the table of spots: distance, n, P, velocity and spin of a support that is driven."""
IMPULSE, TWIST, PLACE, USED, CLOSED, SLIDE, ROLL, SPIN, ANCHOR, STAYS, AIM = (
    0, 3, 6, 9, 10, 11, 12, 13, 14, 17, 18,
)  # fmt: skip
"""Columns of the table of memory: impulse and its moment about P in the last step, P in the body's
axes, whether a point of two boxes is there, modes, P at the end of the step, and whether it neither
closes nor opens then; change of velocity that the normal impulse of the step is for its body."""
THEN, ENDS, MEMORY = 21, 25, 29
"""The same: velocity of the body relative to its support at P, along the normal and across it (3,
world axes), with which the step ended, in its middle and at its end."""
FAR = 1e300
SAME_PLACE = 0.1
"""Of a box's edge: how far a point of contact moves at most in a step and remains the same."""


@inline
def triple(a, i, k):
    return (a[i, k], a[i, k + 1], a[i, k + 2])


@inline
def put(a, i, k, v):
    a[i, k], a[i, k + 1], a[i, k + 2] = v[0], v[1], v[2]


@inline
def put_state(out, k, B):
    """The state of a body as a law of a pair gets it, from place k on."""
    for j in range(3):
        out[k + j], out[k + 7 + j], out[k + 10 + j] = B.p_WC[j], B.v_WC[j], B.w_WB_B[j]
    for j in range(4):
        out[k + 3 + j] = B.q_WB[j]


@inline
def spot_at(tables, scratch, e, t, B, A, out):
    """Into `out` the SPOT numbers of entry e for these states of body and parent."""
    put_state(scratch, 0, B)
    put_state(scratch, STATE, A)
    own = part(pointer(tables.constants), tables.entries[e, CONSTANT])
    call_law(tables.addresses[tables.entries[e, LAW]], t, pointer(scratch), own, out)


@inline
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
            p = triple(points, k, 0)
            place = unrotate(B.q_WB, sub(p, B.p_WC))
            best, slot = near * near, -1
            for c in range(8):
                if taken[c, 0] == 1.0:
                    continue
                if turn == 1:
                    slot = c
                    break
                away = sub(place, triple(memory, first + c, PLACE))
                if memory[first + c, USED] == 1.0 and dot(away, away) < best:
                    best, slot = dot(away, away), c
            points[k, 4] = 1.0 if slot >= 0 else 0.0
            if slot >= 0:
                taken[slot, 0] = 1.0
                if turn == 1:
                    for j in range(MEMORY):
                        memory[first + slot, j] = 0.0
                spots[first + slot, GAP] = points[k, 3]
                put(spots, first + slot, NORMAL, n)
                put(spots, first + slot, POINT, p)
                put(memory, first + slot, PLACE, place)
                memory[first + slot, USED] = 1.0
    for c in range(8):
        if forget and taken[c, 0] == 0.0:
            for j in range(MEMORY):
                memory[first + c, j] = 0.0


@inline
def pushed(memory, c):
    """True if a normal impulse of the step acted at point c."""
    return memory[c, AIM] != 0.0 or memory[c, AIM + 1] != 0.0 or memory[c, AIM + 2] != 0.0


@inline
def find_spots(tables, memory, spots, workspace, scratch, t, y, reach, again):
    """Fill the table of spots at (t, y); boxes that are apart by `reach` [m] have no points.

    again: they have been found in this step; what was farther apart then is left as it was.
    """
    s, entries = tables.sizes, tables.entries
    for e in range(entries.shape[0]):
        c = entries[e, FIRST]
        if again and entries[e, RESTS] == 1 and spots[c, GAP] > reach and not pushed(memory, c):
            continue
        B, A = state_of(y, entries[e, BODY]), state_of(y, entries[e, PARENT])
        if entries[e, LAW] != BOXES:
            spot_at(tables, scratch, e, t, B, A, part(pointer(spots), SPOT * c))
            continue
        half_B, half_A = triple(s, e, 3), triple(s, e, 9)
        c_B = add(B.p_WC, rotate(B.q_WB, triple(s, e, 0)))
        c_A = add(A.p_WC, rotate(A.q_WB, triple(s, e, 6)))
        count, n = boxes_touching(
            workspace[2], workspace, A.q_WB, c_A, half_A, B.q_WB, c_B, half_B, reach
        )
        place_points(tables, memory, spots, workspace, e, count, n, B, not again)
