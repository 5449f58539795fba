"""Where the points of contact are: distance, normal and place of each, by the kind of its pair.

The formulas are those of the catalogue, called with the fields that its classes have; what they
give of rates is not used and falls away in compilation.
"""

from __future__ import annotations

from rb_sim.catalogue.geometry.boxes import boxes_touching
from rb_sim.catalogue.geometry.carriers import Shaken, Turntable, carrier
from rb_sim.catalogue.geometry.pairs import (
    BallOnCylinder,
    BallOnSolid,
    BallOnSphere,
    PointOnPlane,
    SolidOnSphere,
    SurfaceOnPlane,
    carried_direction,
    carried_point,
    touching,
)
from rb_sim.catalogue.geometry.smooth_surfaces import EllipsoidSurface, SphereSurface
from rb_sim.catalogue.geometry.solids import Box, Cylinder, Rod
from rb_sim.contact.stepping.scene_tables import (
    BALL_BOX,
    BALL_CYLINDER,
    BALL_PLANE,
    BALL_SOLID_CYLINDER,
    BALL_SPHERE,
    BODY,
    BOX_BOX,
    BOX_SPHERE,
    CARRIER,
    CYLINDER_SPHERE,
    FIRST,
    KIND,
    OTHER,
    PARENT,
    POINT_PLANE,
    RESTS,
    RIM_PLANE,
    TURNS,
)
from rb_sim.mechanics.systems.many_bodies import state_of
from rb_sim.numerics.kernels import inline
from rb_sim.numerics.vectors import (
    ZERO,
    add,
    cross,
    dot,
    norm,
    perpendicular,
    rotate,
    scale,
    sub,
    unrotate,
)

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
FLAT = 1e-9
"""Tilt of a rim [rad] below which its low point is any."""


@inline
def triple(a, i, k):
    return (a[i, k], a[i, k + 1], a[i, k + 2])


@inline
def put(a, i, k, v):
    a[i, k], a[i, k + 1], a[i, k + 2] = v[0], v[1], v[2]


@inline
def short(touch):
    return touch.gap, touch.normal, touch.point


@inline
def rim_point(s, e, B, A):
    """A point of a rim at a fixed angle from its low one; s: fields of a RimOnPlane."""
    n, _ = carried_direction(A, triple(s, e, 13))
    on, _ = carried_point(A, triple(s, e, 10))
    k, gamma = triple(s, e, 4), unrotate(B.q_WB, n)
    up = sub(gamma, scale(dot(gamma, k), k))
    tilt = norm(up)
    low = scale(-1.0 / tilt, up) if tilt > FLAT else perpendicular(k)[0]
    r = add(scale(s[e, 7], low), scale(s[e, 8], cross(k, low)))
    r = add(triple(s, e, 0), scale(s[e, 3], r))
    p = add(B.p_WC, rotate(B.q_WB, r))
    return dot(n, sub(p, on)), n, p


@inline
def on_flat(kind, s, e, B, A):
    """(gap, n, P) of a body on a plane."""
    a, b, c = triple(s, e, 0), triple(s, e, 3), triple(s, e, 6)
    if kind == POINT_PLANE:
        return short(touching(PointOnPlane(a, b, c), B, A))
    if kind == BALL_PLANE:
        ball = SphereSurface(a, s[e, 3])
        return short(touching(SurfaceOnPlane(ball, triple(s, e, 4), triple(s, e, 7)), B, A))
    if kind == RIM_PLANE:
        return rim_point(s, e, B, A)
    return short(touching(SurfaceOnPlane(EllipsoidSurface(a, b), c, triple(s, e, 9)), B, A))


@inline
def on_round(kind, s, e, B, A):
    """(gap, n, P) of a ball on what is curved or has corners, or the other way round."""
    a, r = triple(s, e, 0), s[e, 3]
    if kind == BALL_SPHERE:
        return short(touching(BallOnSphere(a, r, triple(s, e, 4), s[e, 7], s[e, 8]), B, A))
    if kind == BALL_CYLINDER:
        pair = BallOnCylinder(a, r, triple(s, e, 4), triple(s, e, 7), s[e, 10], s[e, 11])
        return short(touching(pair, B, A))
    if kind == BALL_BOX:
        box = Box(triple(s, e, 4), triple(s, e, 7))
        return short(touching(BallOnSolid(a, r, box), B, A))
    if kind == BALL_SOLID_CYLINDER:
        solid = Cylinder(triple(s, e, 4), s[e, 7], s[e, 8], triple(s, e, 9))
        return short(touching(BallOnSolid(a, r, solid), B, A))
    if kind == BOX_SPHERE:
        box = Box(a, triple(s, e, 3))
        return short(touching(SolidOnSphere(box, triple(s, e, 6), s[e, 9]), B, A))
    if kind == CYLINDER_SPHERE:
        solid = Cylinder(a, r, s[e, 4], triple(s, e, 5))
        return short(touching(SolidOnSphere(solid, triple(s, e, 8), s[e, 11]), B, A))
    rod = Rod(a, triple(s, e, 3), s[e, 6])
    return short(touching(SolidOnSphere(rod, triple(s, e, 7), s[e, 10]), B, A))


@inline
def support_of(kind, m, e, t, A):
    """(state of the support, 1 where it is driven) of entry e; m: the motions."""
    if kind == RESTS:
        return A, 0.0
    if kind == TURNS:
        state, _, _, driven = carrier(Turntable(triple(m, e, 0), triple(m, e, 3)), t, A)
        return state, driven
    state, _, _, driven = carrier(Shaken(triple(m, e, 0), m[e, 3], m[e, 4]), t, A)
    return state, driven


@inline
def put_spot(spots, c, A, driven, gap, n, p):
    spots[c, GAP] = gap
    put(spots, c, NORMAL, n)
    put(spots, c, POINT, p)
    if driven == 1.0:
        spin = rotate(A.q_WB, A.w_WB_B)
        put(spots, c, MOVES, add(A.v_WC, cross(spin, sub(p, A.p_WC))))
        put(spots, c, TURNS_AT, spin)
    else:
        put(spots, c, MOVES, ZERO)
        put(spots, c, TURNS_AT, ZERO)


@inline
def place_points(tables, memory, spots, workspace, e, count, n, B, A, driven, forget):
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
                put_spot(spots, first + slot, A, driven, points[k, 3], n, p)
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
def find_spots(tables, memory, spots, workspace, t, y, reach, again):
    """Fill the table of spots at (t, y); boxes that are apart by `reach` [m] have no points.

    again: they have been found in this step; what was farther apart then is left as it was.
    """
    s, entries, motions = tables.sizes, tables.entries, tables.motions
    for e in range(entries.shape[0]):
        kind, c = entries[e, KIND], entries[e, FIRST]
        rests = kind != BOX_BOX and entries[e, CARRIER] == RESTS
        if kind == OTHER or (again and rests and spots[c, GAP] > reach and not pushed(memory, c)):
            continue
        B, A = state_of(y, entries[e, BODY]), state_of(y, entries[e, PARENT])
        A, driven = support_of(entries[e, CARRIER], motions, e, t, A)
        if kind == BOX_BOX:
            half_B, half_A = triple(s, e, 3), triple(s, e, 9)
            c_B = add(B.p_WC, rotate(B.q_WB, triple(s, e, 0)))
            c_A = add(A.p_WC, rotate(A.q_WB, triple(s, e, 6)))
            count, n = boxes_touching(
                workspace[2], workspace, A.q_WB, c_A, half_A, B.q_WB, c_B, half_B, reach
            )
            place_points(tables, memory, spots, workspace, e, count, n, B, A, driven, not again)
            continue
        if kind <= RIM_PLANE:
            gap, n, p = on_flat(kind, s, e, B, A)
        else:
            gap, n, p = on_round(kind, s, e, B, A)
        put_spot(spots, c, A, driven, gap, n, p)
