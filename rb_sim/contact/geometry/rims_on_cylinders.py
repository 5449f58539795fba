"""A rim on a circular cylinder, from inside or outside: the edge of a disk, or of a cylinder's end.

The square of the distance of the rim's points from the axis is, but for a constant,

    +- (p cos a + q sin a + w cos^2 a),

a measured from the direction across the axis (inside) or the one most along it (outside).  It has
two farthest (inside) or nearest (outside) points, a third of them no less, where
|p|^(2/3) + |q|^(2/3) < (2 w)^(2/3), as where a disk lies across a trough; else there is one.  Each
half of the rim, cos a > 0 and cos a < 0, has one of them at most; the first contact keeps to its
half as long as there are two, the second is the other one, or not there.  In free flight the first
is the one that is nearer to the support.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from rb_sim.catalogue.types import Vec3
from rb_sim.contact.geometry.curved import three
from rb_sim.contact.geometry.pairs import (
    Touch,
    ball_on_round,
    carried_direction,
    carried_point,
    touching,
)
from rb_sim.contact.geometry.rims import IN_FLIGHT, UPRIGHT, Lean
from rb_sim.graph.functions import call, where
from rb_sim.graph.symbols import External
from rb_sim.loops.compiled import routine
from rb_sim.maths.jit import inline
from rb_sim.maths.vectors import ZERO, add, cross, dot, norm, perpendicular, rotate, scale, sub

ROUNDS = 80
"""Of the search for an angle, by Newton's method within a bracket."""
QUARTER = 0.5 * math.pi
LEVEL = 1e-9
"""Difference of the two points, relative to that which would leave one of them, that is none."""
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
    if flies and abs(p) > LEVEL * w:
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
