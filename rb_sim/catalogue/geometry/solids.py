# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Solids: nearest point of a solid to a point, and contact points of two boxes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rb_sim.base.rounding import WRITTEN_ROUNDING
from rb_sim.catalogue.spec import Vec3
from rb_sim.numerics.kernels import branching, dispatch
from rb_sim.numerics.vectors import (
    ZERO,
    add,
    cross,
    dot,
    neg,
    norm,
    perpendicular,
    rotate,
    scale,
    sub,
)

SPARE = (0.0, 0.0, 1.0)
"""Direction taken if the direction is undefined."""


@dispatch
def nearest(solid, x, x_dot):
    """(distance of x from the surface, unit vector u away from it, rate of u)."""


def direction_rate(along, rate, length):
    """Rate of the unit vector `along` of a vector of this length with the given rate."""
    return scale(1.0 / length, sub(rate, scale(dot(along, rate), along)))


@branching
def direction(away, away_dot, spare):
    """(length, unit vector, its rate) of `away`; the unit vector `spare` if it is zero."""
    length = norm(away)
    if length > 0.0:
        u = scale(1.0 / length, away)
        return length, u, direction_rate(u, away_dot, length)
    return length, spare, ZERO


@branching
def off_segment(far, far_dot, along, length):
    """(vector from the nearest point of a segment to a point, its rate); far: the point from its
    start."""
    s, s_dot = dot(far, along), dot(far_dot, along)
    if s < 0.0:
        s, s_dot = 0.0, 0.0
    elif s > length:
        s, s_dot = length, 0.0
    return sub(far, scale(s, along)), sub(far_dot, scale(s_dot, along))


class Box(NamedTuple):
    """A box with its edges along the body axes."""

    centre: Vec3
    half: Vec3
    """half edge lengths [m]."""


@branching
def clamped(x, half):
    """(nearest value within +-half, 1 if x is outside and 0 inside)."""
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
    """Outside, the nearest point of the box; inside, the nearest face at a negative distance."""
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
    """A circular cylinder; a disk if its length is 0."""

    centre: Vec3
    radius: float
    half: float
    """half the length [m]."""
    axis: Vec3


def about_axis(cylinder, x, x_dot):
    """Cylinder coordinates of a point x with velocity x_dot: (position along the axis from the
    middle, its rate, distance from the axis, radial unit vector, its rate)."""
    far, e = sub(x, cylinder.centre), cylinder.axis
    along, along_dot = dot(far, e), dot(x_dot, e)
    across, across_dot = sub(far, scale(along, e)), sub(x_dot, scale(along_dot, e))
    any_way, _ = perpendicular(e)
    return along, along_dot, *direction(across, across_dot, any_way)


@nearest.register(Cylinder)
def nearest_of_cylinder(cylinder, x, x_dot):
    """The nearest of the rim, an end and the round side; inside at a negative distance."""
    e = cylinder.axis
    along, along_dot, wide, out, out_dot = about_axis(cylinder, x, x_dot)
    beside, above = wide - cylinder.radius, abs(along) - cylinder.half
    up = e if along >= 0.0 else neg(e)
    if beside > 0.0 and above >= 0.0:  # the rim; a disk in its own plane has this case, too
        away = add(scale(beside, out), scale(above, up))
        swept = add(scale(dot(out, x_dot), out), scale(beside, out_dot))
        return direction(away, add(swept, scale(along_dot, e)), out)
    return (above, up, ZERO) if above >= beside else (beside, out, out_dot)


class Rod(NamedTuple):
    """A segment without thickness."""

    end: Vec3
    axis: Vec3
    """unit vector from `end` to the other end."""
    length: float


@nearest.register(Rod)
def nearest_of_rod(rod, x, x_dot):
    """The distance from the segment, which has no interior."""
    away, away_dot = off_segment(sub(x, rod.end), x_dot, rod.axis, rod.length)
    spare, _ = perpendicular(rod.axis)
    return direction(away, away_dot, spare)


# Contact points of two boxes: corners on faces both ways, and edge on edge.
#
# The direction of least overlap (or of largest distance) among the normals of the six faces and the
# nine products of edges is the normal of all points (separating axis theorem; Gottschalk 1996). If
# it is the normal of a face, the opposite face of the other box is clipped to the prism over that
# face; the polygon that remains has up to eight corners: those of either box, and crossings of
# edges.


MOST_POINTS = 8
FACE_FIRST = 1e-3
"""Separation, over the size of the smaller box, by which an edge pair must exceed the best face to
be taken: nearly parallel edges lie close to the face, which has more contact points."""


def axes_of(q):
    """The three body axes of the orientation q, world."""
    return (
        rotate(q, (1.0, 0.0, 0.0)),
        rotate(q, (0.0, 1.0, 0.0)),
        rotate(q, (0.0, 0.0, 1.0)),
    )


def reach_along(axes, half, n):
    """Half extent of a box along n."""
    return (
        half[0] * abs(dot(axes[0], n))
        + half[1] * abs(dot(axes[1], n))
        + half[2] * abs(dot(axes[2], n))
    )


def best_face(axes, half, other_axes, other_half, d):
    """(separation, axis, sign) of the face of the first box with the largest separation along d."""
    best, axis, sign = -1e300, 0, 1.0
    for i in range(3):
        along = dot(axes[i], d)
        apart = abs(along) - half[i] - reach_along(other_axes, other_half, axes[i])
        if apart > best:
            best, axis, sign = apart, i, 1.0 if along >= 0.0 else -1.0
    return best, axis, sign


def best_edges(axes_A, half_A, axes_B, half_B, d):
    """(separation, edge of A, edge of B, normal from A to B) of the edge pair with the largest
    one."""
    best, first, second, normal = -1e300, -1, -1, (0.0, 0.0, 0.0)
    for i in range(3):
        for j in range(3):
            n = cross(axes_A[i], axes_B[j])
            size = norm(n)
            if size < WRITTEN_ROUNDING:
                continue
            n = scale((1.0 if dot(n, d) >= 0.0 else -1.0) / size, n)
            apart = dot(n, d) - reach_along(axes_A, half_A, n) - reach_along(axes_B, half_B, n)
            if apart > best:
                best, first, second, normal = apart, i, j, n
    return best, first, second, normal


def farthest(centre, axes, half, n):
    """The corner of a box that is farthest along n."""
    p = centre
    for i in range(3):
        p = add(p, scale(half[i] if dot(axes[i], n) >= 0.0 else -half[i], axes[i]))
    return p


def edge_points(points, c_A, axes_A, half_A, c_B, axes_B, half_B, i, j, n, apart):
    """Write the contact point of two edges: the point of B's edge nearest to A's; returns 1."""
    p = farthest(c_A, axes_A, half_A, n)
    r = farthest(c_B, axes_B, half_B, scale(-1.0, n))
    e, f = axes_A[i], axes_B[j]
    d, b = sub(p, r), dot(e, f)
    s = (dot(d, f) - dot(d, e) * b) / (1.0 - b * b)
    r = add(r, scale(s, f))
    points[0, 0], points[0, 1], points[0, 2], points[0, 3] = r[0], r[1], r[2], apart
    return 1


def cut(polygon, count, out, n, height):
    """Clip a polygon (rows of points) to n . x <= height; returns the number of corners."""
    kept = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        a = (polygon[i, 0], polygon[i, 1], polygon[i, 2])
        b = (polygon[j, 0], polygon[j, 1], polygon[j, 2])
        over_a, over_b = dot(n, a) - height, dot(n, b) - height
        if over_a <= 0.0:
            out[kept, 0], out[kept, 1], out[kept, 2] = a
            kept += 1
        if (over_a > 0.0 and over_b < 0.0) or (over_a < 0.0 and over_b > 0.0):
            p = add(a, scale(over_a / (over_a - over_b), sub(b, a)))
            out[kept, 0], out[kept, 1], out[kept, 2] = p
            kept += 1
    return kept


def face_points(points, workspace, c, axes, half, axis, sign, c_I, axes_I, half_I):
    """Corners of the other box's (I) face, clipped to the prism over a face of the first box.

    points: rows (x, y, z, distance from that face) [m]; workspace: two polygons.
    """
    n = scale(sign, axes[axis])
    facing, side = 0, 1.0
    for i in range(3):
        if abs(dot(axes_I[i], n)) > abs(dot(axes_I[facing], n)):
            facing = i
    side = -1.0 if dot(axes_I[facing], n) > 0.0 else 1.0
    middle = add(c_I, scale(side * half_I[facing], axes_I[facing]))
    u, v = (facing + 1) % 3, (facing + 2) % 3
    for k in range(4):
        su = half_I[u] if k == 0 or k == 3 else -half_I[u]
        sv = half_I[v] if k < 2 else -half_I[v]
        p = add(middle, add(scale(su, axes_I[u]), scale(sv, axes_I[v])))
        workspace[0, k, 0], workspace[0, k, 1], workspace[0, k, 2] = p
    count, now = 4, 0
    for k in range(1, 3):
        i = (axis + k) % 3
        slack = WRITTEN_ROUNDING * half[i]
        for way in range(2):
            e = axes[i] if way == 0 else scale(-1.0, axes[i])
            count = cut(workspace[now], count, workspace[1 - now], e, dot(e, c) + half[i] + slack)
            now = 1 - now
    level = dot(n, c) + half[axis]
    for k in range(count):
        p = (workspace[now, k, 0], workspace[now, k, 1], workspace[now, k, 2])
        points[k, 0], points[k, 1], points[k, 2] = p
        points[k, 3] = dot(n, p) - level
    return count


def boxes_touching(points, workspace, q_A, c_A, half_A, q_B, c_B, half_B, reach):
    """(number of contact points, normal from A to B) of two boxes; none beyond the distance
    `reach`.

    points: rows (x, y, z, gap) with x on B's surface [m]; c: centres, half: half edge lengths.
    """
    d = sub(c_B, c_A)
    spheres = norm(half_A) + norm(half_B) + reach
    if dot(d, d) > spheres * spheres:
        return 0, (0.0, 0.0, 1.0)
    axes_A, axes_B = axes_of(q_A), axes_of(q_B)
    size = min(min(half_A), min(half_B))
    of_A, axis_A, sign_A = best_face(axes_A, half_A, axes_B, half_B, d)
    of_B, axis_B, sign_B = best_face(axes_B, half_B, axes_A, half_A, scale(-1.0, d))
    if max(of_A, of_B) > reach:
        return 0, (0.0, 0.0, 1.0)
    edges, i, j, n = best_edges(axes_A, half_A, axes_B, half_B, d)
    if edges > reach:
        return 0, n
    if i >= 0 and edges > max(of_A, of_B) + FACE_FIRST * size:
        count = edge_points(points, c_A, axes_A, half_A, c_B, axes_B, half_B, i, j, n, edges)
        return count, n
    if of_B > of_A + FACE_FIRST * size:
        count = face_points(
            points, workspace, c_B, axes_B, half_B, axis_B, sign_B, c_A, axes_A, half_A
        )
        n = scale(-sign_B, axes_B[axis_B])
        for k in range(count):
            for m in range(3):
                points[k, m] += points[k, 3] * n[m]
        return count, n
    count = face_points(points, workspace, c_A, axes_A, half_A, axis_A, sign_A, c_B, axes_B, half_B)
    return count, scale(sign_A, axes_A[axis_A])


def box_points(q_A, c_A, half_A, q_B, c_B, half_B, reach):
    """(points, normal) of two boxes as arrays, for tests."""
    points, workspace = np.zeros((12, 4)), np.zeros((2, 12, 3))
    count, n = boxes_touching(points, workspace, q_A, c_A, half_A, q_B, c_B, half_B, reach)
    return points[:count].copy(), np.array(n)
