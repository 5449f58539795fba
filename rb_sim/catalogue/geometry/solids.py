"""Nearest point of a solid to a given point, by its formula for each face, edge and corner.

`nearest` works in the body axes of the solid, from its centre of mass.  A ball that touches a
solid, or a solid that touches a ball, needs no more: the nearest point to the ball's centre is
the point of contact.  Inside a solid the distance is negative, to the nearest face.
"""

from __future__ import annotations

from typing import NamedTuple

from rb_sim.catalogue.types import Vec3
from rb_sim.numerics.kernels import branching, dispatch, inline
from rb_sim.numerics.vectors import ZERO, add, dot, neg, norm, perpendicular, scale, sub

SPARE = (0.0, 0.0, 1.0)
"""Direction taken where none is better than another."""


@dispatch
def nearest(solid, x, x_dot):
    """(distance of x from the surface, unit vector u away from it, rate of u)."""


@inline
def direction_rate(along, rate, length):
    """Rate of the unit vector u of a vector of this length that changes at `rate`."""
    return scale(1.0 / length, sub(rate, scale(dot(along, rate), along)))


@branching
def direction(away, away_dot, spare):
    """(length, unit vector, its rate) of `away`; the unit vector `spare` where it is zero."""
    length = norm(away)
    if length > 0.0:
        u = scale(1.0 / length, away)
        return length, u, direction_rate(u, away_dot, length)
    return length, spare, ZERO


@branching
def off_segment(far, far_dot, along, length):
    """(away, its rate): from the nearest point of a segment to what is `far` from its start."""
    s, s_dot = dot(far, along), dot(far_dot, along)
    if s < 0.0:
        s, s_dot = 0.0, 0.0
    elif s > length:
        s, s_dot = length, 0.0
    return sub(far, scale(s, along)), sub(far_dot, scale(s_dot, along))


class Box(NamedTuple):
    """Edges along the body axes."""

    centre: Vec3
    half: Vec3
    """half edges [m]."""


@branching
def clamped(x, half):
    """(nearest value within +-half, 1 outside of it and 0 inside)."""
    if x > half:
        return half, 1.0
    if x < -half:
        return -half, 1.0
    return x, 0.0


@branching
def nearest_face(x, half):
    """(distance <= 0 to the face nearest to a point inside the box, its outward normal)."""
    best, axis = -1e300, 0
    for i in range(3):
        depth = abs(x[i]) - half[i]
        if depth > best:
            best, axis = depth, i
    sign = 1.0 if x[axis] >= 0.0 else -1.0
    n = (
        sign if axis == 0 else 0.0,
        sign if axis == 1 else 0.0,
        sign if axis == 2 else 0.0,
    )
    return best, n


@nearest.register(Box)
def nearest_of_box(box, x, x_dot):
    far = sub(x, box.centre)
    qx, fx = clamped(far[0], box.half[0])
    qy, fy = clamped(far[1], box.half[1])
    qz, fz = clamped(far[2], box.half[2])
    away = (far[0] - qx, far[1] - qy, far[2] - qz)
    away_dot = (fx * x_dot[0], fy * x_dot[1], fz * x_dot[2])
    distance, u, u_dot = direction(away, away_dot, SPARE)
    if distance > 0.0:
        return distance, u, u_dot
    depth, n = nearest_face(far, box.half)
    return depth, n, ZERO


class Cylinder(NamedTuple):
    """A circular cylinder; without length it is a disk."""

    centre: Vec3
    radius: float
    half: float
    """half length [m]."""
    axis: Vec3


@inline
def about_axis(cylinder, x, x_dot):
    """Of a point x that moves by x_dot: (place along the axis from the middle, its rate, distance
    from the axis, unit vector away from it, its rate)."""
    far, e = sub(x, cylinder.centre), cylinder.axis
    along, along_dot = dot(far, e), dot(x_dot, e)
    across, across_dot = sub(far, scale(along, e)), sub(x_dot, scale(along_dot, e))
    any_way, _ = perpendicular(e)
    return along, along_dot, *direction(across, across_dot, any_way)


@nearest.register(Cylinder)
def nearest_of_cylinder(cylinder, x, x_dot):
    e = cylinder.axis
    along, along_dot, wide, out, out_dot = about_axis(cylinder, x, x_dot)
    beside, above = wide - cylinder.radius, abs(along) - cylinder.half
    up = e if along >= 0.0 else neg(e)
    if beside > 0.0 and above >= 0.0:  # the rim; a disk in its own plane has it as well
        away = add(scale(beside, out), scale(above, up))
        swept = add(scale(dot(out, x_dot), out), scale(beside, out_dot))
        return direction(away, add(swept, scale(along_dot, e)), out)
    return (above, up, ZERO) if above >= beside else (beside, out, out_dot)


class Rod(NamedTuple):
    """A segment, without thickness."""

    end: Vec3
    axis: Vec3
    """from this end to the other."""
    length: float


@nearest.register(Rod)
def nearest_of_rod(rod, x, x_dot):
    away, away_dot = off_segment(sub(x, rod.end), x_dot, rod.axis, rod.length)
    spare, _ = perpendicular(rod.axis)
    return direction(away, away_dot, spare)
