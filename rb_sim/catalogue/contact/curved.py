"""Smooth bodies on round supports: where the contact point has to be sought.

A smooth convex surface touches a sphere or a cylinder where its point p(n) of inward normal n lies
straight along n from the support's centre or axis:  t . (p(n) - c) = 0  for every tangent t.  This
is solved by Newton's method from the direction of the body's centre; the rate of n follows from the
same linear equations, differentiated in time.
"""

from __future__ import annotations

from typing import NamedTuple

from rb_sim.catalogue.contact.pairs import Touch, carried_direction, carried_point, touching
from rb_sim.catalogue.contact_shapes import support, support_rate
from rb_sim.catalogue.types import Vec3
from rb_sim.maths.jit import inline
from rb_sim.maths.vectors import add, cross, dot, norm, perpendicular, rotate, scale, sub, unrotate

ROUNDS = 30
SOUGHT = 1e-15
"""Change of the normal at which Newton's iteration ends."""
LARGEST_TURN = 0.5
"""Of the normal in one round [rad]."""


class SurfaceOnSphere(NamedTuple):
    """A smooth convex surface and the parent's sphere."""

    surface: tuple
    r_A: Vec3
    curved: float
    """radius of the parent's sphere [m]."""
    side: float
    """+1: the body is outside, -1: inside."""


class SurfaceOnCylinder(NamedTuple):
    """A smooth convex surface and the parent's infinite circular cylinder."""

    surface: tuple
    r_A: Vec3
    """a point of the axis."""
    axis_A: Vec3
    curved: float
    side: float


@inline
def moved(surface, q, n, turn):
    """Change of the surface's point of inward normal n (world) when n turns by `turn`, world."""
    return rotate(q, support_rate(surface, unrotate(q, n), unrotate(q, turn)))


@inline
def normalised(a):
    return scale(1.0 / norm(a), a)


@inline
def slopes(surface, q, n, t1, t2, reach):
    """d(t_i . (p - c)) per turn of n along t_j, as (11, 12, 21, 22); reach = n . (p - c)."""
    a, b = moved(surface, q, n, t1), moved(surface, q, n, t2)
    return dot(t1, a) - reach, dot(t1, b), dot(t2, a), dot(t2, b) - reach


@inline
def solved(m, x, y):
    """(u, v) with m (u, v) = (x, y)."""
    determinant = m[0] * m[3] - m[1] * m[2]
    return (m[3] * x - m[1] * y) / determinant, (m[0] * y - m[2] * x) / determinant


@inline
def limited(u, v):
    size = (u * u + v * v) ** 0.5
    s = LARGEST_TURN / size if size > LARGEST_TURN else 1.0
    return s * u, s * v


@inline
def normal_on_sphere(pair, B, c):
    """The normal at which the surface's point lies straight along it from c."""
    n = scale(pair.side, normalised(sub(B.p_WC, c)))
    for _ in range(ROUNDS):
        t1, t2 = perpendicular(n)
        far = sub(add(B.p_WC, rotate(B.q_WB, support(pair.surface, unrotate(B.q_WB, n)))), c)
        m = slopes(pair.surface, B.q_WB, n, t1, t2, dot(n, far))
        u, v = solved(m, -dot(t1, far), -dot(t2, far))
        u, v = limited(u, v)
        n = normalised(add(n, add(scale(u, t1), scale(v, t2))))
        if abs(u) + abs(v) <= SOUGHT:
            break
    return n


@touching.register(SurfaceOnSphere)
def surface_on_sphere(pair, B, A):
    c, c_dot = carried_point(A, pair.r_A)
    spin_B = rotate(B.q_WB, B.w_WB_B)
    n = normal_on_sphere(pair, B, c)
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
    return Touch(reach - pair.side * pair.curved, n, n_dot, p, p_dot)


@touching.register(SurfaceOnCylinder)
def surface_on_cylinder(pair, B, A):
    c, c_dot = carried_point(A, pair.r_A)
    e, e_dot = carried_direction(A, pair.axis_A)
    spin_B = rotate(B.q_WB, B.w_WB_B)
    away = sub(B.p_WC, c)
    n = scale(pair.side, normalised(sub(away, scale(dot(away, e), e))))
    for _ in range(ROUNDS):
        t = cross(e, n)
        far = sub(add(B.p_WC, rotate(B.q_WB, support(pair.surface, unrotate(B.q_WB, n)))), c)
        slope = dot(t, moved(pair.surface, B.q_WB, n, t)) - dot(n, far)
        u, _ = limited(-dot(t, far) / slope, 0.0)
        n = normalised(add(n, scale(u, t)))
        if abs(u) <= SOUGHT:
            break
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
    return Touch(reach - pair.side * pair.curved, n, n_dot, p, p_dot)
