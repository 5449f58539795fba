# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Smooth bodies on spheres and cylinders, whose contact point is found by iteration.

A smooth convex surface touches a sphere or a cylinder at its point p(n) of inward normal n for
which n passes through the support's centre or axis c: t . (p(n) - c) = 0 for every tangent t. This
is solved by Newton's method from the direction of the body's centre; the rate of n follows from the
same linear equations, differentiated in time.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from rb_sim.base.rounding import SUM_ROUNDING
from rb_sim.catalogue.geometry.pairs import ContactPoint, carried_direction, carried_point, touching
from rb_sim.catalogue.geometry.smooth_surfaces import (
    EllipsoidSurface,
    LyingRimSurface,
    support,
    support_rate,
)
from rb_sim.catalogue.spec import Vec3
from rb_sim.compiler.graph.symbols import External, call, graph_of
from rb_sim.numerics.kernels import routine
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

ROUNDS = 30
LARGEST_TURN = 0.5
"""Largest rotation of the normal in one iteration [rad]."""


class SurfaceOnSphere(NamedTuple):
    """An ellipsoid or a rim and the parent's sphere."""

    surface: Any
    r_A: Vec3
    curved: float
    """radius of the parent's sphere [m]."""
    side: float
    """+1: the body is outside, -1: inside."""


class SurfaceOnCylinder(NamedTuple):
    """An ellipsoid or a rim and the parent's infinite circular cylinder."""

    surface: Any
    r_A: Vec3
    """a point of the cylinder's axis, from the parent's C [m]."""
    axis_A: Vec3
    curved: float
    side: float


def moved(surface, q, n, turn):
    """Change of the surface point with inward normal n (world) if n changes by `turn`, world."""
    return rotate(q, support_rate(surface, unrotate(q, n), unrotate(q, turn)))


def normalised(a):
    """a/|a|; a may not be zero."""
    return scale(1.0 / norm(a), a)


def slopes(surface, q, n, t1, t2, reach):
    """d(t_i . (p - c)) per rotation of n towards t_j, as (11, 12, 21, 22); reach = n . (p - c)."""
    a, b = moved(surface, q, n, t1), moved(surface, q, n, t2)
    return dot(t1, a) - reach, dot(t1, b), dot(t2, a), dot(t2, b) - reach


def solved(m, x, y):
    """Solution (u, v) of the 2 x 2 system m (u, v) = (x, y)."""
    determinant = m[0] * m[3] - m[1] * m[2]
    return (m[3] * x - m[1] * y) / determinant, (m[0] * y - m[2] * x) / determinant


def limited(u, v):
    """(u, v) shortened to a rotation of LARGEST_TURN [rad]."""
    size = (u * u + v * v) ** 0.5
    s = LARGEST_TURN / size if size > LARGEST_TURN else 1.0
    return s * u, s * v


def normal_on_sphere(surface, side, p_WC, q, c):
    """The normal n for which the surface point p(n) lies on the line through c along n."""
    n = scale(side, normalised(sub(p_WC, c)))
    for _ in range(ROUNDS):
        t1, t2 = perpendicular(n)
        far = sub(add(p_WC, rotate(q, support(surface, unrotate(q, n)))), c)
        m = slopes(surface, q, n, t1, t2, dot(n, far))
        u, v = solved(m, -dot(t1, far), -dot(t2, far))
        u, v = limited(u, v)
        n = normalised(add(n, add(scale(u, t1), scale(v, t2))))
        if abs(u) + abs(v) <= SUM_ROUNDING:
            break
    return n


def normal_on_cylinder(surface, side, p_WC, q, c, e):
    """The normal n for which p(n) lies on the line along n through the axis e (through c)."""
    away = sub(p_WC, c)
    n = scale(side, normalised(sub(away, scale(dot(away, e), e))))
    for _ in range(ROUNDS):
        t = cross(e, n)
        far = sub(add(p_WC, rotate(q, support(surface, unrotate(q, n)))), c)
        slope = dot(t, moved(surface, q, n, t)) - dot(n, far)
        u, _ = limited(-dot(t, far) / slope, 0.0)
        n = normalised(add(n, scale(u, t)))
        if abs(u) <= SUM_ROUNDING:
            break
    return n


def three(a, i):
    """Three consecutive arguments of a routine, from index i on."""
    return (a[i], a[i + 1], a[i + 2])


def ellipsoid(a):
    """The ellipsoid in a routine's arguments: centre and semi-axes from index 11 on."""
    return EllipsoidSurface(three(a, 11), three(a, 14))


def rim(a):
    """The rim in a routine's arguments: centre, radius and axis from index 11 on."""
    return LyingRimSurface(three(a, 11), a[14], three(a, 15))


def normal_for(surface, side, p_WC, q, c, axis):
    """The normal on a cylinder with this axis through c, or on a sphere if the axis is zero."""
    if axis[0] == 0.0 and axis[1] == 0.0 and axis[2] == 0.0:
        return normal_on_sphere(surface, side, p_WC, q, c)
    return normal_on_cylinder(surface, side, p_WC, q, c, axis)


def normal_by(surface, a, axis):
    """The normal for the first 11 numbers of `a`: side, p, q, c."""
    return normal_for(surface, a[0], three(a, 1), (a[4], a[5], a[6], a[7]), three(a, 8), axis)


@routine
def normal_of_ellipsoid(arguments, results):
    """arguments: side, p, q, c, centre, semi-axes, axis of the support; results: the normal."""
    n = normal_by(ellipsoid(arguments), arguments, three(arguments, 17))
    results[0], results[1], results[2] = n


@routine
def normal_of_rim(arguments, results):
    """arguments: side, p, q, c, centre, radius, axis, axis of the support; results: the normal."""
    n = normal_by(rim(arguments), arguments, three(arguments, 18))
    results[0], results[1], results[2] = n


OF_ELLIPSOID = External(
    "rb_sim_normal_of_ellipsoid",
    3,
    lambda *a: normal_by(ellipsoid(a), a, a[-3:]),
    lambda: normal_of_ellipsoid.address,
)
OF_RIM = External(
    "rb_sim_normal_of_rim",
    3,
    lambda *a: normal_by(rim(a), a, a[-3:]),
    lambda: normal_of_rim.address,
)


def sought(pair, B, c, axis):
    """The normal; traced laws find it by one external function for all contacts of such
    surfaces."""
    surface, at = pair.surface, (pair.side, *B.p_WC, *B.q_WB, *c)
    if graph_of(at) is None:
        return normal_for(surface, pair.side, B.p_WC, B.q_WB, c, axis)
    if isinstance(surface, EllipsoidSurface):
        return call(OF_ELLIPSOID, *at, *surface.centre_C, *surface.semi_axes, *axis)
    return call(OF_RIM, *at, *surface.centre_C, surface.radius, *surface.axis_B, *axis)


@touching.register(SurfaceOnSphere)
def surface_on_sphere(pair, B, A):
    """The surface point whose normal n solves t . (p(n) - c) = 0 for both tangents t."""
    c, c_dot = carried_point(A, pair.r_A)
    spin_B = rotate(B.q_WB, B.w_WB_B)
    n = sought(pair, B, c, ZERO)
    t1, t2 = perpendicular(n)
    r = rotate(B.q_WB, support(pair.surface, unrotate(B.q_WB, n)))
    p = add(B.p_WC, r)
    reach = dot(n, sub(p, c))
    # p' = v + w x r + (dp/dn)(n' - w x n), and t . (p' - c') = reach t . n'
    fixed = sub(add(B.v_WC, cross(spin_B, r)), moved(pair.surface, B.q_WB, n, cross(spin_B, n)))
    m = slopes(pair.surface, B.q_WB, n, t1, t2, reach)
    late = sub(c_dot, fixed)
    u, v = solved(m, dot(t1, late), dot(t2, late))
    n_dot = add(scale(u, t1), scale(v, t2))
    p_dot = add(fixed, moved(pair.surface, B.q_WB, n, n_dot))
    return ContactPoint(reach - pair.side * pair.curved, n, n_dot, p, p_dot)


@touching.register(SurfaceOnCylinder)
def surface_on_cylinder(pair, B, A):
    """The surface point whose normal n, normal to the cylinder's axis, passes through that axis."""
    c, c_dot = carried_point(A, pair.r_A)
    e, e_dot = carried_direction(A, pair.axis_A)
    spin_B = rotate(B.q_WB, B.w_WB_B)
    n = sought(pair, B, c, e)
    t = cross(e, n)
    r = rotate(B.q_WB, support(pair.surface, unrotate(B.q_WB, n)))
    p = add(B.p_WC, r)
    far = sub(p, c)
    reach = dot(n, far)
    # n stays normal to the axis: n' = u t - (n . e') e, and t' = -u n - (t . e') e
    tilted = scale(-dot(n, e_dot), e)
    fixed = sub(add(B.v_WC, cross(spin_B, r)), moved(pair.surface, B.q_WB, n, cross(spin_B, n)))
    fixed = add(fixed, moved(pair.surface, B.q_WB, n, tilted))
    slope = dot(t, moved(pair.surface, B.q_WB, n, t)) - reach
    u = (dot(t, sub(c_dot, fixed)) + dot(t, e_dot) * dot(e, far)) / slope
    n_dot = add(scale(u, t), tilted)
    p_dot = add(fixed, moved(pair.surface, B.q_WB, n, scale(u, t)))
    return ContactPoint(reach - pair.side * pair.curved, n, n_dot, p, p_dot)
