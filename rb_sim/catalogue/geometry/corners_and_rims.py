# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Contact geometry of corners on solids, and of rims of disks and cylinders on planes and
cylinders."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from rb_sim.base.rounding import COMPUTED_ROUNDING, SUM_ROUNDING, WRITTEN_ROUNDING
from rb_sim.catalogue.geometry.curved import three
from rb_sim.catalogue.geometry.pairs import (
    BallOnSolid,
    ContactPoint,
    ball_on_round,
    carried_direction,
    carried_point,
    into_solid,
    out_of_solid,
    touching,
)
from rb_sim.catalogue.geometry.smooth_surfaces import FLAT
from rb_sim.catalogue.geometry.solids import Box, Cylinder, about_axis, direction_rate, nearest
from rb_sim.catalogue.spec import Vec3
from rb_sim.compiler.graph.symbols import External, call, maximum, where
from rb_sim.numerics.kernels import dispatch, routine
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

# A rim on a plane: the edge of a disk, or of an end of a cylinder, which may come to lie flat.
#
# A tilted rim touches with its lowest point alone. A flat one touches all round: the points that
# represent it depend on its motion before and stay fixed in the body until it tilts again. The
# lowest and the highest point, opposite each other, form one line that continues through flat: the
# lowest point on one side becomes the highest on the other. Only a rim that falls straight comes to
# lie flat. If it misses flat by an angle, its contact point races round the rim, faster for a
# smaller angle, and it rises again on another side (Srinivasan and Ruina, "Rocking and rolling: A
# can that appears to rock might actually roll", Phys. Rev. E 78, 2008). A rim that is supported at
# a point and falls straight therefore keeps that point in the step in which it comes to lie; for
# every other rim the lowest point follows from the state alone, however far it turns in a step.


class RimOnPlane(NamedTuple):
    """One point of a rim and the parent's plane."""

    centre_C: Vec3
    """centre of the rim, from C, body axes [m]."""
    radius: float
    axis_B: Vec3
    along: float
    """cosine of the angle about the axis from the lowest point to this one."""
    across: float
    """sine of that angle."""
    alone: float
    """1: the only point of its rim, which then cannot lie flat; 0: one of several."""
    r_A: Vec3
    n_A: Vec3


class Lean(NamedTuple):
    """Tilt of a rim against a plane, with its history."""

    low: Vec3
    """unit vector from the rim's centre to its lowest point, body axes; zero if it is not known."""
    axis: Vec3
    """upward axis of the rim projected on the plane, world axes: its length is the sine of the
    tilt, and it points to the lowest point."""
    sense: float
    """1: `low` is the lowest point; -1: it is the highest, after passing through flat; SLAMS times
    either: it stays fixed in the body; 0: a single point that has passed through flat; IN_FLIGHT:
    `low` is the lowest point, whatever the history."""


IN_FLIGHT = 2.0
"""Sense of a rim that has no contact."""
SLAMS = 3.0
"""|sense| of a rim that falls straight on its flat side and has almost reached it."""
UPRIGHT = Lean(ZERO, ZERO, 1.0)
"""Lean of a rim without a history."""


def keeps_low(tilt, before):
    """True if the lowest point stays that of the step before: the rim was flat, or is becoming
    flat."""
    lost = FLAT if norm(before.axis) < FLAT else SUM_ROUNDING
    return abs(before.sense) == SLAMS or tilt < lost


def lean_of(pair, gamma, axis, before):
    """The Lean for the plane normal gamma (body axes), given the Lean at the start of the step."""
    k = pair.axis_B
    up = sub(gamma, scale(dot(gamma, k), k))
    tilt = norm(up)
    if abs(before.sense) == SLAMS:
        sense = SLAMS if dot(up, before.low) <= 0.0 else pair.alone * SLAMS - SLAMS
        return Lean(before.low, axis, sense)
    if keeps_low(tilt, before):
        low, _ = perpendicular(k)
        if dot(before.low, before.low) > 0.0:
            low = before.low
        return Lean(low, axis, before.sense)
    low, sense = scale(-1.0 / tilt, up), before.sense
    if sense == IN_FLIGHT:
        return Lean(low, axis, sense)
    if norm(before.axis) < FLAT:
        sense = 1.0 if dot(low, before.low) >= 0.0 else -1.0
    return Lean(scale(sense, low), axis, sense * (1.0 - pair.alone) if sense < 0.0 else 1.0)


def rim_touching(pair, B, A, before):
    """(ContactPoint, Lean) of a rim point on a plane, given the Lean at the start of the step."""
    n, n_dot = carried_direction(A, pair.n_A)
    spin_B, spin_A = rotate(B.q_WB, B.w_WB_B), rotate(A.q_WB, A.w_WB_B)
    k, gamma = pair.axis_B, unrotate(B.q_WB, n)
    gamma_dot = cross(gamma, sub(B.w_WB_B, unrotate(B.q_WB, spin_A)))
    axis = rotate(B.q_WB, k)
    axis = sub(axis, scale(dot(axis, n), n))
    if dot(gamma, k) < 0.0:
        axis = scale(-1.0, axis)
    lean = lean_of(pair, gamma, axis, before)
    up = sub(gamma, scale(dot(gamma, k), k))
    low_dot = ZERO
    if not keeps_low(norm(up), before):
        up_dot = sub(gamma_dot, scale(dot(gamma_dot, k), k))
        sign = -1.0 if dot(up, lean.low) < 0.0 else 1.0
        low_dot = direction_rate(lean.low, scale(sign, up_dot), norm(up))
    r = add(scale(pair.along, lean.low), scale(pair.across, cross(k, lean.low)))
    r_dot = add(scale(pair.along, low_dot), scale(pair.across, cross(k, low_dot)))
    r = rotate(B.q_WB, add(pair.centre_C, scale(pair.radius, r)))
    r_dot = rotate(B.q_WB, scale(pair.radius, r_dot))
    on, _ = carried_point(A, pair.r_A)
    p = add(B.p_WC, r)
    p_dot = add(B.v_WC, add(r_dot, cross(spin_B, r)))
    return ContactPoint(dot(n, sub(p, on)), n, n_dot, p, p_dot), lean


@touching.register(RimOnPlane)
def rim_on_plane(pair, B, A):
    """The lowest point of a rim without a history."""
    touch, _ = rim_touching(pair, B, A, UPRIGHT)
    return touch


# A rim on a circular cylinder, from inside or outside: the edge of a disk, or of a cylinder's end.
#
# The squared distance of the rim's points from the axis is, up to a constant,
#
#     +- (p cos a + q sin a + w cos^2 a),
#
# with a measured from the direction normal to the axis (inside) or from the one closest to it
# (outside). It has two local extremes, farthest (inside) or nearest (outside) points, if |p|^(2/3)
# + |q|^(2/3) < (2 w)^(2/3), as for a disk across a trough; else one. Each half of the rim, cos a >
# 0 and cos a < 0, has at most one of them; the first contact keeps to its half as long as there are
# two, the second is the other one, or does not exist. In free flight the first one is the nearer
# one to the support.


ROUNDS = 80
"""Most iterations of the search for an angle (Newton's method within a bracket)."""
QUARTER = 0.5 * math.pi
ABSENT = 0.0
"""Sense of a second point that does not exist."""


class RimOnCylinder(NamedTuple):
    """One of the two points of a rim that may touch the parent's infinite circular cylinder."""

    centre_C: Vec3
    """centre of the rim, from C, body axes [m]."""
    radius: float
    axis_B: Vec3
    r_A: Vec3
    """a point of the cylinder's axis, from the parent's C [m]."""
    axis_A: Vec3
    curved: float
    """radius of the parent's cylinder [m]."""
    side: float
    """+1: the body is outside, -1: inside."""
    second: float
    """0: the first point of the rim, 1: the second."""


def slope_of(p, q, w, a):
    """Derivative of p cos a + q sin a + w cos^2 a by a."""
    return q * math.cos(a) - p * math.sin(a) - w * math.sin(2.0 * a)


def highest(p, q, w):
    """(angle, 1) of the local maximum of p cos a + q sin a + w cos^2 a with |a| <= pi/2 [rad]; (0,
    0) if there is none.

    The slope over cos a decreases for cos^3 a > -p/(2 w) and only there: at most one zero.
    """
    high = QUARTER
    if p < 0.0:
        if -p >= 2.0 * w:
            return 0.0, 0.0
        high = math.acos((-p / (2.0 * w)) ** (1.0 / 3.0))
        if not (slope_of(p, q, w, -high) > 0.0 and slope_of(p, q, w, high) < 0.0):
            return 0.0, 0.0
    elif p == 0.0 and abs(q) >= 2.0 * w:
        return math.copysign(QUARTER, q), 1.0
    low, a = -high, 0.0
    for _ in range(ROUNDS):
        slope = slope_of(p, q, w, a)
        if slope > 0.0:
            low = a
        else:
            high = a
        bend = -q * math.sin(a) - p * math.cos(a) - 2.0 * w * math.cos(2.0 * a)
        after = a - slope / bend if bend < 0.0 else low - 1.0
        if not low <= after <= high:
            after = 0.5 * (low + high)
        change = abs(after - a)
        a = after
        if change <= 1e-16 or slope == 0.0:
            break
    return a, 1.0


def half_of(p, w, before, flies, there):
    """The half of the rim, +1 or -1, of the first point; there: 1 if both halves have a point."""
    nearer = 1.0 if p >= 0.0 else -1.0
    if there == 0.0 or before == 0.0:
        return nearer
    if flies and abs(p) > WRITTEN_ROUNDING * w:
        return nearer
    return before


def point_of_rim(second, before, flies, side, away, axis, radius, e):
    """(unit vector from the rim's centre to the point, half of the first point, 1 if the point
    exists), world axes.

    away: from a point of the support's axis e to the rim's centre; axis: of the rim; before: half
    of the first point at the start of the step, 0 if it is not known.
    """
    across = cross(e, axis)
    tilt = norm(across)
    if tilt > 0.0:
        across = scale(1.0 / tilt, across)
    else:
        across, _ = perpendicular(axis)
    along = cross(axis, across)
    first, other = (across, along) if side < 0.0 else (along, across)
    far = sub(away, scale(dot(away, e), e))
    p = -2.0 * side * radius * dot(far, first)
    q = -2.0 * side * radius * dot(far, other)
    w = radius * radius * tilt * tilt
    nearer = 1.0 if p >= 0.0 else -1.0
    near, _ = highest(nearer * p, nearer * q, w)
    back, both = highest(-nearer * p, -nearer * q, w)
    half = half_of(p, w, before, flies, both)
    wanted = half if second == 0.0 or both == 0.0 else -half
    a = near if wanted == nearer else back
    low = add(scale(wanted * math.cos(a), first), scale(wanted * math.sin(a), other))
    return low, half, 1.0 if second == 0.0 else both


@routine
def point_by_numbers(arguments, results):
    """arguments: second, before, sense, side, away, axis, radius, e; results: see point_of_rim."""
    a = arguments
    low, half, there = point_of_rim(
        a[0], a[1], a[2] == IN_FLIGHT, a[3], three(a, 4), three(a, 7), a[10], three(a, 11)
    )
    for i in range(3):
        results[i] = low[i]
    results[3], results[4] = half, there


def _point_plainly(*a: float) -> tuple[float, ...]:
    low, half, there = point_of_rim(
        a[0], a[1], a[2] == IN_FLIGHT, a[3], a[4:7], a[7:10], a[10], a[11:14]
    )
    return (*low, half, there)


POINT = External(
    "rb_sim_point_of_rim_on_cylinder", 5, _point_plainly, lambda: point_by_numbers.address
)


def rim_on_cylinder_touching(
    pair: RimOnCylinder, B: Any, A: Any, before: Lean
) -> tuple[ContactPoint, Lean]:
    """(ContactPoint, Lean) of a rim point on a cylinder, given the Lean at the start of the step.

    The first component of `low` is the half of the rim that has the first point; `sense` is ABSENT
    for a second point that does not exist, which is placed at the first one.
    """
    c, c_dot = carried_point(B, pair.centre_C)
    o, o_dot = carried_point(A, pair.r_A)
    axis, e = rotate(B.q_WB, pair.axis_B), rotate(A.q_WB, pair.axis_A)
    away, spin = sub(c, o), rotate(B.q_WB, B.w_WB_B)
    numbers = pair.second, before.low[0], before.sense, pair.side, *away, *axis, pair.radius, *e
    found = call(POINT, *numbers)
    low, half, there = found[0:3], found[3], found[4]
    r, ahead = scale(pair.radius, low), scale(pair.radius, cross(axis, low))
    far, far_dot = add(away, r), add(sub(c_dot, o_dot), cross(spin, r))
    off, off_dot = across_axis(A, pair.axis_A, far, far_dot)
    # the contact point keeps dr/da . off = 0: `ahead` is dr/da
    _, ahead_off_rate = across_axis(A, pair.axis_A, ahead, cross(spin, ahead))
    flat = sub(ahead, scale(dot(ahead, e), e))
    slope_rate = dot(ahead_off_rate, off) + dot(flat, off_dot)
    turn = -slope_rate / (dot(flat, flat) - dot(r, off))
    point, rate = add(o, far), add(add(o_dot, far_dot), scale(turn, ahead))
    off_dot = add(off_dot, scale(turn, flat))
    spare, _ = perpendicular(e)
    touch = ball_on_round(point, rate, 0.0, off, off_dot, pair.curved, pair.side, spare)
    held = where(before.sense == IN_FLIGHT, IN_FLIGHT, 1.0)
    return touch, Lean((half, 0.0, 0.0), ZERO, where(there > 0.5, held, ABSENT))


def across_axis(A, axis_A, a, a_dot):
    """Component of `a` normal to the support's axis, and its rate."""
    e, e_dot = carried_direction(A, axis_A)
    along, along_dot = dot(a, e), dot(a_dot, e) + dot(a, e_dot)
    return sub(a, scale(along, e)), sub(a_dot, add(scale(along_dot, e), scale(along, e_dot)))


@touching.register(RimOnCylinder)
def rim_on_cylinder(pair, B, A):
    """The rim point in free flight; a second point that does not exist gets a large gap."""
    touch, lean = rim_on_cylinder_touching(pair, B, A, UPRIGHT._replace(sense=IN_FLIGHT))
    return touch._replace(gap=where(lean.sense == ABSENT, touch.gap + pair.curved, touch.gap))


# A corner or an end on another body's box or cylinder: it is supported by one face only.
#
# In flight the gap is that to the nearest point of the solid. A point in contact keeps to the face
# that it touched first, whose surface is continued beyond its edge, until it is beyond the edge by
# more than rounding (corners that lie on edges, as in a stack of equal boxes, are off by some): no
# force presses it there, and the contact opens. With the nearest point of the edge instead the
# normal would jump, and the projection onto the manifold would take the point back to the edge, and
# energy from it.


class PointOnSolid(BallOnSolid):
    """A corner or an end of the body, whose radius is 0, outside the parent's box or cylinder."""

    __slots__ = ()


def held_by_faces(found: Sequence[NamedTuple]) -> list[NamedTuple]:
    """The pairs, with each corner or end on a solid as a PointOnSolid."""
    return [
        PointOnSolid(*pair) if isinstance(pair, BallOnSolid) and pair.radius == 0.0 else pair
        for pair in found
    ]


@dispatch
def face_of(solid, u):
    """The face with the normal u, as three numbers; zeros if u belongs to an edge or a corner.

    For a box they are the normal; for a cylinder (1, 0, 0) and (-1, 0, 0) are its ends, (0, 1, 0)
    its round side.
    """


@dispatch
def off_face(solid, face, x, x_dot):
    """(signed distance of x from the continued surface of the face, unit normal, its rate, distance
    of x beyond the edge of the face over the size of the solid, negative inside)."""


def whole(x: Any) -> Any:
    """1 or -1 if x equals it up to rounding, else 0."""
    return where(x >= 1.0 - COMPUTED_ROUNDING, 1.0, where(x <= COMPUTED_ROUNDING - 1.0, -1.0, 0.0))


@face_of.register(Box)
def face_of_box(box, u):
    """The normal itself if it is along an axis, else zeros."""
    return (whole(u[0]), whole(u[1]), whole(u[2]))


@off_face.register(Box)
def off_face_of_box(box, face, x, x_dot):
    """Distance from the plane of the face; beyond its edges, measured along the other two axes."""
    far, half = sub(x, box.centre), box.half
    across = [abs(face[i]) * half[i] for i in range(3)]
    beyond = [where(abs(face[i]) > 0.5, -half[i], abs(far[i]) - half[i]) for i in range(3)]
    over = maximum(maximum(beyond[0], beyond[1]), beyond[2])
    size = maximum(maximum(half[0], half[1]), half[2])
    return dot(face, far) - (across[0] + across[1] + across[2]), face, ZERO, over / size


@face_of.register(Cylinder)
def face_of_cylinder(cylinder, u):
    """(+-1, 0, 0) on an end, (0, 1, 0) on the round side, zeros elsewhere."""
    along = dot(u, cylinder.axis)
    return (whole(along), where(abs(along) <= COMPUTED_ROUNDING, 1.0, 0.0), 0.0)


@off_face.register(Cylinder)
def off_face_of_cylinder(cylinder, face, x, x_dot):
    """Distance from the end's plane or from the round side."""
    along, _, wide, out, out_dot = about_axis(cylinder, x, x_dot)
    beside, above = wide - cylinder.radius, abs(along) - cylinder.half
    on_end, size = abs(face[0]) > 0.5, maximum(cylinder.radius, cylinder.half)
    distance = where(on_end, face[0] * along - cylinder.half, beside)
    u = where(on_end, scale(face[0], cylinder.axis), out)
    return distance, u, where(on_end, ZERO, out_dot), where(on_end, beside, above) / size


def point_on_solid_touching(
    pair: PointOnSolid, B: Any, A: Any, before: Lean
) -> tuple[ContactPoint, Lean]:
    """(ContactPoint, Lean) of a corner on a solid, given the Lean at the start of the step.

    `low` is the supporting face, zero if none is known; `sense` is ABSENT if the point has left
    that face.
    """
    c, v = carried_point(B, pair.r_B)
    x, x_dot = into_solid(A, c, v)
    near, u, u_dot = nearest(pair.surface, x, x_dot)
    distance, away, away_dot, over = off_face(pair.surface, before.low, x, x_dot)
    known: Vec3 = before.low
    held = (before.sense != IN_FLIGHT) & (dot(known, known) > 0.5)
    gap = where(held, distance, near)
    u, u_dot = where(held, away, u), where(held, away_dot, u_dot)
    low = where(held, known, face_of(pair.surface, u))
    n, n_dot = out_of_solid(A, u, u_dot)
    sense = where(held & (over > COMPUTED_ROUNDING), ABSENT, before.sense)
    return ContactPoint(gap, n, n_dot, c, v), Lean(low, ZERO, sense)


@touching.register(PointOnSolid)
def point_on_solid(pair, B, A):
    """The nearest point of the solid, without a history of the supporting face."""
    return point_on_solid_touching(pair, B, A, UPRIGHT._replace(sense=IN_FLIGHT))[0]
