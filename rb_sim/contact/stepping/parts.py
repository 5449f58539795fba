"""Parts of a step: where something fast meets what is round, the step is split there.

The impulses of a step go along the normals at its middle.  Where a body passes a round surface by
much of its radius in a step, that normal is any: the body is sent off a wrong way, or struck where
it would have passed.  The way of each such pair within the step is followed, straight ahead, to the
instant at which the two meet; a part of the step has its middle there.  In the other parts, and
where the two pass each other, the pair has no contact.  Heaps, whose bodies move by little of their
radii in a step, take whole steps.
"""

from __future__ import annotations

from rb_sim.catalogue.types import BodyState
from rb_sim.contact.stepping.geometry import FAR, GAP, IMPULSE, TWIST, on_round, triple
from rb_sim.contact.stepping.room import LENGTH
from rb_sim.contact.stepping.step import after_turn, fastest_of
from rb_sim.contact.stepping.tables import (
    BALL_BOX,
    BALL_CYLINDER,
    BALL_SOLID_CYLINDER,
    BALL_SPHERE,
    BILATERAL,
    BODY,
    BOX_BOX,
    BOX_SPHERE,
    CARRIER,
    COMPLIANT,
    CYLINDER_SPHERE,
    FIRST,
    KIND,
    PARENT,
    RESTS,
)
from rb_sim.engine.systems.many_bodies import state_of
from rb_sim.maths.jit import inline
from rb_sim.maths.vectors import add, norm, scale, sub

TURN = 0.05
"""Part of its radius by which a body may pass a round surface in a step that is not split."""
SHARP = 0.05
"""Of the scene's length: radius that corners and edges count as."""
LOOKS, HALVINGS = 64, 40
"""Places on the way at which a gap is looked at, at least; halvings of where it vanishes."""
MOST_PARTS = 16
"""Of a step; what is left then is one part, as if nothing were fast."""
LEAST_PART = 1.0 / 128.0
"""Of what is left of a step: shorter parts are none."""
AT_END = 1e-9
"""The same of what meets at the end of a step: it does so at the start of the next one."""
TOUCHES, BEARS, SOON = 1e-9, 0.1, 1e-3
"""Gap, relative to the scene's length, of what touches; part of its speed that it may come nearer
with and bear, or leave, in that part of the step; what comes nearer faster meets."""
FAR_ENOUGH = 4.0
"""Times the way of the fastest surface in a step: a gap that was as large half a step ago is not
closed in it."""
NEVER, PASSES = -1.0, 1e300
"""Instants of what is not followed, and of what passes."""


@inline
def radius_of(s, e, kind, length):
    """Distance over which the normal of a round pair turns by 1 rad; 0 of what is hollow."""
    if kind == BALL_SPHERE:
        return s[e, 3] + s[e, 7] if s[e, 8] > 0.0 else 0.0
    if kind == BALL_CYLINDER:
        return s[e, 3] + s[e, 10] if s[e, 11] > 0.0 else 0.0
    if kind == BALL_BOX or kind == BALL_SOLID_CYLINDER:
        return max(s[e, 3], SHARP * length)
    if kind == BOX_SPHERE:
        return s[e, 9]
    return s[e, 11] if kind == CYLINDER_SPHERE else s[e, 10]


@inline
def closing_speed(s, e, kind, length, B, A):
    """Speed [m/s] that the two surfaces do not exceed towards each other."""
    arm = norm(triple(s, e, 0)) if kind <= BALL_SOLID_CYLINDER else length
    speed = norm(sub(B.v_WC, A.v_WC)) + norm(B.w_WB_B) * arm
    return speed + norm(A.w_WB_B) * norm(sub(B.p_WC, A.p_WC))


@inline
def later(B, t):
    """Where a body is after t, at its velocities."""
    p, q = add(B.p_WC, scale(t, B.v_WC)), after_turn(B.q_WB, B.w_WB_B, t)
    return BodyState(p, q, B.v_WC, B.w_WB_B)


@inline
def gap_at(s, e, kind, B, A, t):
    gap, _, _ = on_round(kind, s, e, later(B, t), later(A, t))
    return gap


@inline
def meeting(s, e, kind, B, A, h, speed, touches):
    """When within h the gap of the pair vanishes [s]; PASSES if it does not, NEVER if one bears the
    other, or leaves it.  speed: that the gap does not fall faster than."""
    t, gap, soon = 0.0, gap_at(s, e, kind, B, A, 0.0), SOON * h
    if gap <= touches:
        falls = gap - gap_at(s, e, kind, B, A, soon)
        return 0.0 if falls > BEARS * speed * soon else NEVER
    for _ in range(2 * LOOKS):
        before = t
        t = min(h, t + max(gap / speed, h / LOOKS))
        gap = gap_at(s, e, kind, B, A, t)
        if gap <= 0.0:
            after = t
            for _ in range(HALVINGS):
                t = 0.5 * (before + after)
                if gap_at(s, e, kind, B, A, t) > 0.0:
                    before = t
                else:
                    after = t
            return after
        if t >= h:
            break
    return PASSES


@inline
def ahead(tables, y, i, h):
    """State of body i with the velocity that it has on the mean in h, if nothing touches it."""
    B = state_of(y, i)
    if i < 0:
        return B
    v = add(B.v_WC, scale(0.5 * h, triple(tables.gravity, i, 0)))
    return BodyState(B.p_WC, B.q_WB, v, B.w_WB_B)


@inline
def find_meetings(tables, room, y, h, number):
    """Write the instants at which fast pairs meet into the room; returns the first, or NEVER.

    Where one of them has split the step already, all count as fast."""
    s, entries, laws, length = tables.sizes, tables.entries, tables.laws, tables.scales[0]
    first, far = PASSES, FAR_ENOUGH * h * fastest_of(tables, y)
    for e in range(entries.shape[0]):
        kind, c = entries[e, KIND], entries[e, FIRST]
        room.meets[c] = NEVER
        if far < room.spots[c, GAP] < FAR:
            continue
        if kind < BALL_SPHERE or kind >= BOX_BOX or entries[e, CARRIER] != RESTS:
            continue
        if laws[c, COMPLIANT] == 1.0 or laws[c, BILATERAL] == 1.0:
            continue
        B, A = ahead(tables, y, entries[e, BODY], h), ahead(tables, y, entries[e, PARENT], h)
        speed = closing_speed(s, e, kind, length, B, A)
        radius = radius_of(s, e, kind, length)
        if radius > 0.0 and speed > 0.0 and (number > 0 or speed * h > TURN * radius):
            room.meets[c] = meeting(s, e, kind, B, A, h, speed, TOUCHES * length)
            if room.meets[c] >= 0.0:
                first = min(first, room.meets[c])
    return first if first < PASSES else NEVER


@inline
def next_part(tables, room, y, left, number):
    """Length of the next part of a step of which this is left; the room then tells which pairs have
    no contact in it."""
    first = find_meetings(tables, room, y, left, number)
    part, centred = left, False
    if number + 1 < MOST_PARTS and first >= 0.0:
        half = min(0.5 * LEAST_PART * left, left - first)
        if first <= AT_END * left:
            part, centred = LEAST_PART * left, True
        elif first <= 2.0 * half:
            part, centred = min(2.0 * first, left), True
        elif half > AT_END * left:
            part = first - half
    if left - part <= AT_END * left:
        part = left
    for c in range(room.meets.shape[0]):
        within = number + 1 >= MOST_PARTS or (centred and room.meets[c] <= part)
        if room.meets[c] >= 0.0 and within:
            room.meets[c] = NEVER
    return part


@inline
def leave_out(room):
    """The pairs that have no contact in the part are far apart."""
    for c in range(room.meets.shape[0]):
        if room.meets[c] >= 0.0:
            room.spots[c, GAP] = FAR


@inline
def look_again(room):
    """The pairs that had no contact in the part are looked at where it ends: something else may
    have sent them at each other."""
    for c in range(room.meets.shape[0]):
        if room.meets[c] >= 0.0:
            room.spots[c, GAP] = 0.0


@inline
def add_up(memory, room, number, last, h):
    """Impulses of all parts so far; after the last one they are those of the step of length h."""
    for c in range(memory.shape[0]):
        for j in range(3):
            before = room.summed[c, j] if number > 0 else 0.0
            turned = room.summed[c, 3 + j] if number > 0 else 0.0
            room.summed[c, j] = before + memory[c, IMPULSE + j]
            room.summed[c, 3 + j] = turned + memory[c, TWIST + j]
            if last:
                memory[c, IMPULSE + j] = room.summed[c, j]
                memory[c, TWIST + j] = room.summed[c, 3 + j]
    for k in range(room.joint_x.shape[0]):
        room.joint_summed[k] = room.joint_x[k] + (room.joint_summed[k] if number > 0 else 0.0)
        if last:
            room.joint_x[k] = room.joint_summed[k]
    if last:
        room.notes[LENGTH] = h
