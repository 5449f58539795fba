# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Contact pairs: gap, normal and contact point of each kind of pair, with their rates.

`touching` gives them at one instant. The normal n points from the parent's surface A towards the
body B; P is the point of B's surface that is nearest to A's. P and n move over the bodies: their
rates are those of the geometric point and direction, not of a material point, as needed for the
derivative of the velocity constraint n . (v_B(P) - v_A(P)) = 0 (LL 38.2). Vectors stored in a pair
are from the centre of mass of their body.
"""

from __future__ import annotations

from typing import NamedTuple

from rb_sim.catalogue.geometry.smooth_surfaces import support, support_rate
from rb_sim.catalogue.geometry.solids import SPARE, direction, nearest
from rb_sim.catalogue.spec import BodyState, Vec3
from rb_sim.numerics.kernels import dispatch
from rb_sim.numerics.vectors import (
    add,
    cos,
    cross,
    dot,
    neg,
    norm,
    perpendicular,
    rotate,
    scale,
    sin,
    sub,
    unrotate,
)

# Motion of a support that is not a body of the scene: at rest, or prescribed. `carrier` gives the
# support's state at time t, its acceleration and angular acceleration (world axes), and 1 if it is
# driven: its work on the body is external work then.


class Resting(NamedTuple):
    """The support is a body of the scene, or the world at rest."""


class Turntable(NamedTuple):
    """Support that turns about an axis through a point at a constant rate."""

    point: Vec3
    """a point of the axis, world [m]."""
    spin: Vec3
    """angular velocity, world [rad/s]."""


class Shaken(NamedTuple):
    """Support displaced by amplitude sin(frequency t + phase)."""

    amplitude: Vec3
    """amplitude vector, world [m]."""
    frequency: float
    """angular frequency [rad/s]."""
    phase: float


@dispatch
def carrier(motion, t, A):
    """(state of the support, its acceleration, its angular acceleration, 1 if it is driven)."""


@carrier.register(Resting)
def resting(motion, t, A):
    """The parent's own state; not driven, so that its work on the body is not external."""
    return A, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0


@carrier.register(Turntable)
def turntable(motion, t, A):
    """The state at t of a support that turns about a fixed axis, unrotated at t = 0."""
    rate = norm(motion.spin)
    half = 0.5 * rate * t
    s = sin(half) / rate if rate > 0.0 else 0.0
    q = (s * motion.spin[0], s * motion.spin[1], s * motion.spin[2], cos(half))
    arm = rotate(q, motion.point)
    p = sub(motion.point, arm)
    v = cross(motion.spin, sub(p, motion.point))
    a = cross(motion.spin, v)
    # the angular velocity is along the axis: the same in world and support axes
    return BodyState(p, q, v, motion.spin), a, (0.0, 0.0, 0.0), 1.0


@carrier.register(Shaken)
def shaken(motion, t, A):
    """The state at t of a support that oscillates without turning."""
    w = motion.frequency
    s, c = sin(w * t + motion.phase), cos(w * t + motion.phase)
    state = BodyState(
        add((0.0, 0.0, 0.0), scale(s, motion.amplitude)),
        (0.0, 0.0, 0.0, 1.0),
        scale(w * c, motion.amplitude),
        (0.0, 0.0, 0.0),
    )
    return state, scale(-w * w * s, motion.amplitude), (0.0, 0.0, 0.0), 1.0


class ContactPoint(NamedTuple):
    """The geometry of one contact at one instant, world axes."""

    gap: float
    """distance of the surfaces, negative for an overlap [m]."""
    normal: Vec3
    """unit normal, from A's surface towards B."""
    normal_rate: Vec3
    """rate of the normal [1/s]."""
    point: Vec3
    """contact point P [m]."""
    point_rate: Vec3
    """rate of P [m/s]."""


@dispatch
def touching(pair, B, A):
    """The ContactPoint of a body in state B with a support in state A."""


def carried_point(S, r):
    """World position and velocity of the body-fixed point r."""
    return (
        add(S.p_WC, rotate(S.q_WB, r)),
        add(S.v_WC, rotate(S.q_WB, cross(S.w_WB_B, r))),
    )


def carried_direction(S, a):
    """World components of the body-fixed direction a, and their rate."""
    d = rotate(S.q_WB, a)
    return d, cross(rotate(S.q_WB, S.w_WB_B), d)


class PointOnPlane(NamedTuple):
    """A corner or end of the body and the parent's plane through r_A with normal n_A."""

    r_B: Vec3
    r_A: Vec3
    n_A: Vec3


@touching.register(PointOnPlane)
def point_on_plane(pair, B, A):
    """A fixed point of the body, with the normal of the parent's plane."""
    p, v = carried_point(B, pair.r_B)
    on, _ = carried_point(A, pair.r_A)
    n, n_dot = carried_direction(A, pair.n_A)
    return ContactPoint(dot(n, sub(p, on)), n, n_dot, p, v)


class SurfaceOnPlane(NamedTuple):
    """A smooth convex surface (smooth_surfaces) and the parent's plane."""

    surface: tuple
    r_A: Vec3
    n_A: Vec3


@touching.register(SurfaceOnPlane)
def surface_on_plane(pair, B, A):
    """The lowest point of a smooth surface, which moves over it as the body turns."""
    n, n_dot = carried_direction(A, pair.n_A)
    spin_B, spin_A = rotate(B.q_WB, B.w_WB_B), rotate(A.q_WB, A.w_WB_B)
    gamma = unrotate(B.q_WB, n)
    gamma_dot = cross(gamma, sub(B.w_WB_B, unrotate(B.q_WB, spin_A)))
    r = rotate(B.q_WB, support(pair.surface, gamma))
    r_dot = rotate(B.q_WB, support_rate(pair.surface, gamma, gamma_dot))
    on, _ = carried_point(A, pair.r_A)
    p = add(B.p_WC, r)
    p_dot = add(B.v_WC, add(r_dot, cross(spin_B, r)))
    return ContactPoint(dot(n, sub(p, on)), n, n_dot, p, p_dot)


def ball_on_round(centre, velocity, radius, away, away_rate, curved, side, spare):
    """ContactPoint of a ball at `centre` with a round support; away: from the support's middle to
    `centre`.

    curved: radius of the support [m]; side: +1 outside it, -1 inside; spare: unit vector taken as
    the normal if `away` is zero.
    """
    distance, u, u_dot = direction(away, away_rate, spare)
    n, n_dot = scale(side, u), scale(side, u_dot)
    gap = side * (distance - curved) - radius
    p, p_dot = sub(centre, scale(radius, n)), sub(velocity, scale(radius, n_dot))
    return ContactPoint(gap, n, n_dot, p, p_dot)


class BallOnSphere(NamedTuple):
    """A ball (a point, with radius 0) and the parent's sphere."""

    r_B: Vec3
    radius: float
    r_A: Vec3
    curved: float
    """radius of the parent's sphere [m]."""
    side: float
    """+1: the ball is outside, -1: inside."""


@touching.register(BallOnSphere)
def ball_on_sphere(pair, B, A):
    """The ball's point on the line through both centres."""
    c, v = carried_point(B, pair.r_B)
    c_A, v_A = carried_point(A, pair.r_A)
    away, away_dot = sub(c, c_A), sub(v, v_A)
    return ball_on_round(c, v, pair.radius, away, away_dot, pair.curved, pair.side, SPARE)


class BallOnCylinder(NamedTuple):
    """A ball (a point, with radius 0) and the parent's infinite circular cylinder."""

    r_B: Vec3
    radius: float
    r_A: Vec3
    """a point of the cylinder's axis, from the parent's C [m]."""
    axis_A: Vec3
    curved: float
    side: float


@touching.register(BallOnCylinder)
def ball_on_cylinder(pair, B, A):
    """The ball's point on the perpendicular from the cylinder's axis to its centre."""
    c, v = carried_point(B, pair.r_B)
    c_A, v_A = carried_point(A, pair.r_A)
    e, e_dot = carried_direction(A, pair.axis_A)
    far, far_dot = sub(c, c_A), sub(v, v_A)
    along = dot(far, e)
    along_dot = dot(far_dot, e) + dot(far, e_dot)
    away = sub(far, scale(along, e))
    away_dot = sub(far_dot, add(scale(along_dot, e), scale(along, e_dot)))
    across, _ = perpendicular(e)
    return ball_on_round(c, v, pair.radius, away, away_dot, pair.curved, pair.side, across)


def into_solid(S, c, v):
    """Position and velocity of the world point c (velocity v) relative to a solid of state S, in
    the axes of the solid."""
    spin, far = rotate(S.q_WB, S.w_WB_B), sub(c, S.p_WC)
    return unrotate(S.q_WB, far), unrotate(S.q_WB, sub(sub(v, S.v_WC), cross(spin, far)))


def out_of_solid(S, u, u_dot):
    """World components of the direction u of a solid of state S, and of its rate; u_dot in its
    axes."""
    n, turned = carried_direction(S, u)
    return n, add(rotate(S.q_WB, u_dot), turned)


def off_solid(surface, S, c, v):
    """(distance, its rate, direction n, its rate) of the world point c from a solid of state S.

    v: velocity of c; the nearest point of the surface is c - distance n.
    """
    x, x_dot = into_solid(S, c, v)
    distance, u, u_dot = nearest(surface, x, x_dot)
    n, n_dot = out_of_solid(S, u, u_dot)
    return distance, dot(u, x_dot), n, n_dot


class BallOnSolid(NamedTuple):
    """A ball (a point, with radius 0) outside the parent's solid."""

    r_B: Vec3
    radius: float
    surface: tuple
    """the parent's solid, see solids."""


@touching.register(BallOnSolid)
def ball_on_solid(pair, B, A):
    """The ball's point nearest to the parent's solid."""
    c, v = carried_point(B, pair.r_B)
    distance, _, n, n_dot = off_solid(pair.surface, A, c, v)
    p, p_dot = sub(c, scale(pair.radius, n)), sub(v, scale(pair.radius, n_dot))
    return ContactPoint(distance - pair.radius, n, n_dot, p, p_dot)


class SolidOnSphere(NamedTuple):
    """A solid of the body (see solids) outside the parent's sphere."""

    surface: tuple
    r_A: Vec3
    curved: float
    """radius of the parent's sphere [m]."""


@touching.register(SolidOnSphere)
def solid_on_sphere(pair, B, A):
    """The body's point nearest to the centre of the parent's sphere."""
    c, v = carried_point(A, pair.r_A)
    distance, gap_rate, n, n_dot = off_solid(pair.surface, B, c, v)
    p = sub(c, scale(distance, n))
    p_dot = sub(v, add(scale(gap_rate, n), scale(distance, n_dot)))
    return ContactPoint(distance - pair.curved, neg(n), neg(n_dot), p, p_dot)
