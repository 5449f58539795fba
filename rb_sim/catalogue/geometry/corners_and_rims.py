# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Corners of bodies on solids, and rims of disks and cylinders on planes and cylinders."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from rb_sim.base.rounding import COMPUTED_ROUNDING, SUM_ROUNDING, WRITTEN_ROUNDING
from rb_sim.catalogue.geometry.curved import three
from rb_sim.catalogue.geometry.pairs import (
    BallOnSolid,
    Touch,
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
from rb_sim.graph.symbols import External, call, maximum, where
from rb_sim.numerics.kernels import dispatch, inline, routine
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
# Tilted, it touches with its lowest point alone.  Flat, all of it touches at once, and which of its
# points are there for all depends on how it came to lie: they keep their places in the body until
# it tilts again.  The lowest point and the highest, opposite, are one line that goes on through
# flat: what was the lowest on one side is the highest on the other.  Only a rim that falls straight
# comes to lie, though: one that misses flat by whatever angle has its low point run round it, the
# faster the less it misses, and rises again on another side (Srinivasan and Ruina, "Rocking and
# rolling: A can that appears to rock might actually roll", Phys. Rev. E 78, 2008).  A rim that is
# held at a point and falls straight therefore keeps that point in the step in which it comes to
# lie; of all others what is low follows from the state alone, however far they turn in a step.


class RimOnPlane(NamedTuple):
    """One point of a rim and the parent's plane."""

    centre_C: Vec3
    """of the rim, from C, body axes [m]."""
    radius: float
    axis_B: Vec3
    along: float
    """cosine of the angle, about the axis, from the point that is low to this one."""
    across: float
    """its sine."""
    alone: float
    """1: the lowest point only; it cannot lie flat."""
    r_A: Vec3
    n_A: Vec3


class Lean(NamedTuple):
    """How a rim leans."""

    low: Vec3
    """unit vector from its centre to its low point, body axes; zero where nothing is known."""
    axis: Vec3
    """its axis, upwards, across the plane's normal, world axes: as long as the sine of the tilt, it
    points to where the rim is low."""
    sense: float
    """1: `low` is low; -1: it is high, after the rim has gone through flat; SLAMS times either: it
    stays in the body; 0: it is alone, and has gone through flat; IN_FLIGHT: `low` is low, whatever
    was before."""


IN_FLIGHT = 2.0
"""Sense of a rim that nothing holds."""
SLAMS = 3.0
"""Size of the sense of a rim that falls straight on its flat side, and is nearly there."""
UPRIGHT = Lean(ZERO, ZERO, 1.0)
"""Where nothing is known of before."""


@inline
def keeps_low(tilt, before):
    """True if the low point is that of before: of a rim that lay flat, or will."""
    lost = FLAT if norm(before.axis) < FLAT else SUM_ROUNDING
    return abs(before.sense) == SLAMS or tilt < lost


@inline
def lean_of(pair, gamma, axis, before):
    """The Lean with plane normal gamma (body axes), given that at the start of the step."""
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


@inline
def rim_touching(pair, B, A, before):
    """(Touch, Lean) of a point of the rim, given the Lean at the start of the step."""
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
    return Touch(dot(n, sub(p, on)), n, n_dot, p, p_dot), lean


@touching.register(RimOnPlane)
def rim_on_plane(pair, B, A):
    """The lowest point of the rim, for no history of how it leaned."""
    touch, _ = rim_touching(pair, B, A, UPRIGHT)
    return touch


# A rim on a circular cylinder, from inside or outside: the edge of a disk, or of a cylinder's end.
#
# The square of the distance of the rim's points from the axis is, but for a constant,
#
#     +- (p cos a + q sin a + w cos^2 a),
#
# a measured from the direction across the axis (inside) or the one most along it (outside).  It has
# two farthest (inside) or nearest (outside) points, a third of them no less, where |p|^(2/3) +
# |q|^(2/3) < (2 w)^(2/3), as where a disk lies across a trough; else there is one.  Each half of
# the rim, cos a > 0 and cos a < 0, has one of them at most; the first contact keeps to its half as
# long as there are two, the second is the other one, or not there.  In free flight the first is the
# one that is nearer to the support.


ROUNDS = 80
"""Of the search for an angle, by Newton's method within a bracket."""
QUARTER = 0.5 * math.pi
ABSENT = 0.0
"""Sense of a second point that is not there."""


class RimOnCylinder(NamedTuple):
    """One of the two points of a rim that may touch the parent's endless circular cylinder."""

    centre_C: Vec3
    """of the rim, from C, body axes [m]."""
    radius: float
    axis_B: Vec3
    r_A: Vec3
    """a point of the axis."""
    axis_A: Vec3
    curved: float
    """radius of the parent's cylinder [m]."""
    side: float
    """+1: the body is outside, -1: inside."""
    second: float
    """1: the other point than the one of the contact that has 0 here."""


@inline
def slope_of(p, q, w, a):
    """Derivative by a of p cos a + q sin a + w cos^2 a."""
    return q * math.cos(a) - p * math.sin(a) - w * math.sin(2.0 * a)


@inline
def highest(p, q, w):
    """(angle, 1) of the highest point of p cos a + q sin a + w cos^2 a with |a| <= pi/2 where it is
    higher than all others near it; (0, 0) if none is.

    The slope over cos a falls where cos^3 a > -p/(2 w), and only there: one zero at most.
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


@inline
def half_of(p, w, before, flies, there):
    """The half, +1 or -1, of the first point; there: 1 where both halves have one."""
    nearer = 1.0 if p >= 0.0 else -1.0
    if there == 0.0 or before == 0.0:
        return nearer
    if flies and abs(p) > WRITTEN_ROUNDING * w:
        return nearer
    return before


@inline
def point_of_rim(second, before, flies, side, away, axis, radius, e):
    """(unit vector to the point from the rim's centre, the half of the first point, 1 where the
    point is there), world axes.

    away: from a point of the support's axis e to the rim's centre; axis: of the rim; before: half
    of the first point at the start of the step, 0 where it is not known.
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
) -> tuple[Touch, Lean]:
    """(Touch, Lean) of the point, given the Lean at the start of the step: of that the half of the
    first point is the first number of `low`, and `sense` is ABSENT for a point that is not there,
    which lies where the first one does."""
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
    # it stays where the distance has no slope: (r' . off) = 0, r' = ahead with the angle
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


@inline
def across_axis(A, axis_A, a, a_dot):
    """The part of `a` across the support's axis, and its rate."""
    e, e_dot = carried_direction(A, axis_A)
    along, along_dot = dot(a, e), dot(a_dot, e) + dot(a, e_dot)
    return sub(a, scale(along, e)), sub(a_dot, add(scale(along_dot, e), scale(along, e_dot)))


@touching.register(RimOnCylinder)
def rim_on_cylinder(pair, B, A):
    """In free flight; a second point that is not there is far away."""
    touch, lean = rim_on_cylinder_touching(pair, B, A, UPRIGHT._replace(sense=IN_FLIGHT))
    return touch._replace(gap=where(lean.sense == ABSENT, touch.gap + pair.curved, touch.gap))


# A corner or an end on another body's box or cylinder: what holds it is a face, and no more.
#
# The nearest point of the solid tells the gap in flight.  A point that is held keeps to the face on
# which it came to be, whose surface goes on beyond the edge, until it is off the face by more than
# rounding (corners that lie on edges, as those of a stack of equal boxes, are off by some): there
# nothing presses it, and the contact opens.  The nearest point of the edge would turn the
# normal aside at once, and a step back to the manifold would take the point back to the edge, and
# energy from it.


class PointOnSolid(BallOnSolid):
    """A corner or an end of the body, whose radius is 0, outside the parent's box or cylinder."""

    __slots__ = ()


def held_by_faces(found: Sequence[NamedTuple]) -> list[NamedTuple]:
    """The pairs, corners and ends on solids as such."""
    return [
        PointOnSolid(*pair) if isinstance(pair, BallOnSolid) and pair.radius == 0.0 else pair
        for pair in found
    ]


@dispatch
def face_of(solid, u):
    """The face whose normal is u, as three numbers; zeros where u is that of an edge or corner.

    Of a box they are the normal; of a cylinder (1, 0, 0) and (-1, 0, 0) its ends, (0, 1, 0) its
    round side.
    """


@dispatch
def off_face(solid, face, x, x_dot):
    """(signed distance of x from the surface of the face, unit vector away from it, its rate, way
    of x beyond the edge of the face over the size of the solid, negative within)."""


def whole(x: Any) -> Any:
    """1 or -1 where x is that but for rounding, else 0."""
    return where(x >= 1.0 - COMPUTED_ROUNDING, 1.0, where(x <= COMPUTED_ROUNDING - 1.0, -1.0, 0.0))


@face_of.register(Box)
def face_of_box(box, u):
    """The normal itself if it is along an axis, zeros if not."""
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


def point_on_solid_touching(pair: PointOnSolid, B: Any, A: Any, before: Lean) -> tuple[Touch, Lean]:
    """(Touch, Lean) of the point, given the Lean at the start of the step: `low` is the face that
    holds it, zero where none is known, and `sense` is ABSENT where it has left that."""
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
    return Touch(gap, n, n_dot, c, v), Lean(low, ZERO, sense)


@touching.register(PointOnSolid)
def point_on_solid(pair, B, A):
    """The nearest point of the solid, for no history of which face held the point."""
    return point_on_solid_touching(pair, B, A, UPRIGHT._replace(sense=IN_FLIGHT))[0]
