# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Constraint rows: equations linear in the velocities u = (v_C, w_B) of body and parent.

Each row is  J u = b  and, if it is holonomic, g(q) = 0; differentiated once more it is
J du/dt + bias = 0 (LL 38.2; mechanics of the non-free solid). `fill` writes J (12 columns: v_WC of
the body in world axes, its angular velocity in body axes, the same of the parent), bias, error g,
rate b, and whether the row is holonomic. Vectors stored in a row are from the centre of mass of
their body.
"""

from __future__ import annotations

from typing import NamedTuple

from rb_sim.catalogue.curves import curve_nearest, curve_point
from rb_sim.catalogue.spec import Quaternion, Vec3
from rb_sim.numerics.kernels import dispatch
from rb_sim.numerics.vectors import (
    add,
    cross,
    dot,
    neg,
    norm,
    perpendicular,
    rotate,
    scale,
    sub,
    unrotate,
)

BIAS, ERROR, RATE, HOLONOMIC, ROW_WIDTH = 12, 13, 14, 15, 16
"""Columns of the table of rows after the 12 of the Jacobian: second derivative's bias, error, rate,
flag of a holonomic row, and the number of columns. One array, so that a kernel call passes few
arguments."""


@dispatch
def fill(row, t, B, A, G, k):
    """Write the rows of one constraint into G from row k on."""


@dispatch
def anchor(row, B, A):
    """Point of application of the reaction, world [m]."""


COUNT: dict[type, int] = {}
"""Number of rows that each row class fills."""
ANGLES: set[type] = set()
"""Row classes whose errors and rates are angles, not lengths."""


def put(G, k, force, torque_B, torque_A, bias, error, rate, holonomic):
    """Write row k of G: force direction (world) on the body, its opposite on the parent, both
    torques."""
    for i in range(3):
        G[k, i] = force[i]
        G[k, 3 + i] = torque_B[i]
        G[k, 6 + i] = -force[i]
        G[k, 9 + i] = torque_A[i]
    G[k, BIAS] = bias
    G[k, ERROR] = error
    G[k, RATE] = rate
    G[k, HOLONOMIC] = holonomic


def material_point(S, r):
    """World position, velocity and velocity-dependent acceleration of the point r of a body."""
    w_r = cross(S.w_WB_B, r)
    return (
        add(S.p_WC, rotate(S.q_WB, r)),
        add(S.v_WC, rotate(S.q_WB, w_r)),
        rotate(S.q_WB, cross(S.w_WB_B, w_r)),
    )


def put_along(G, k, d, p, c, B, A, r_B, rho, v_rel, spin_A, error):
    """Write the holonomic row d . (velocity of r_B relative to the parent's frame) = 0, d fixed in
    that frame.

    p, c: position and centripetal acceleration of r_B; rho = p - p_A; v_rel: relative velocity.
    """
    turn_B = cross(r_B, unrotate(B.q_WB, d))
    turn_A = unrotate(A.q_WB, cross(d, rho))
    bias = (
        dot(d, c) - dot(d, cross(spin_A, cross(spin_A, rho))) - 2.0 * dot(d, cross(spin_A, v_rel))
    )
    put(G, k, d, turn_B, turn_A, bias, error, 0.0, 1.0)


def relative_motion(B, A, r_B):
    """(p, c, rho, v_rel, spin_A) of the body's point r_B, world axes, as `put_along` takes them."""
    p, v, c = material_point(B, r_B)
    spin_A = rotate(A.q_WB, A.w_WB_B)
    rho = sub(p, A.p_WC)
    return p, c, rho, sub(v, add(A.v_WC, cross(spin_A, rho))), spin_A


def hold_along(row, B, A, G, k, directions):
    """Rows from k on that keep r_B at r_A along each of these directions of the parent."""
    p, c, rho, v_rel, spin_A = relative_motion(B, A, row.r_B)
    gap = sub(rho, rotate(A.q_WB, row.r_A))
    for i in range(len(directions)):
        d = rotate(A.q_WB, directions[i])
        put_along(G, k + i, d, p, c, B, A, row.r_B, rho, v_rel, spin_A, dot(d, gap))


class PointRow(NamedTuple):
    """r_B of the body stays at r_A of the parent: 3 rows along the world's axes."""

    r_B: Vec3
    r_A: Vec3


COUNT[PointRow] = 3


@fill.register(PointRow)
def fill_point(row, t, B, A, G, k):
    """3 rows: the points coincide, along each of the world's axes."""
    p, v, c = material_point(B, row.r_B)
    p_A, v_A, c_A = material_point(A, row.r_A)
    gap, bias = sub(p, p_A), sub(c, c_A)
    e = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    for i in range(3):
        torque_B = cross(row.r_B, unrotate(B.q_WB, e[i]))
        torque_A = cross(unrotate(A.q_WB, e[i]), row.r_A)
        put(G, k + i, e[i], torque_B, torque_A, bias[i], gap[i], 0.0, 1.0)


class SeatRow(NamedTuple):
    """As PointRow, but with the 3 rows along the parent's axes and formed as those of a SlotRow.

    A seat and a slot on the same two bodies then agree to the last bit also in a stage of a step
    that is off the manifold, where quaternions are not of length 1.
    """

    r_B: Vec3
    r_A: Vec3


COUNT[SeatRow] = 3


@fill.register(SeatRow)
def fill_seat(row, t, B, A, G, k):
    """3 rows: the points coincide, along each of the parent's axes."""
    hold_along(row, B, A, G, k, ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))


class SlotRow(NamedTuple):
    """r_B of the body stays on the parent's line through r_A normal to t1_A and t2_A: 2 rows."""

    r_B: Vec3
    r_A: Vec3
    t1_A: Vec3
    t2_A: Vec3


COUNT[SlotRow] = 2


@fill.register(SlotRow)
def fill_slot(row, t, B, A, G, k):
    """2 rows: the points coincide along the directions t1_A and t2_A of the parent."""
    hold_along(row, B, A, G, k, (row.t1_A, row.t2_A))


class PlaneRow(NamedTuple):
    """r_B of the body stays in the parent's plane through r_A with normal n_A: 1 row."""

    r_B: Vec3
    r_A: Vec3
    n_A: Vec3


COUNT[PlaneRow] = 1


@fill.register(PlaneRow)
def fill_plane(row, t, B, A, G, k):
    """1 row: the distance of r_B from the parent's plane through r_A is zero."""
    hold_along(row, B, A, G, k, (row.n_A,))


def put_normal(G, k, b, a, B, A):
    """Write the row b . a = 0, b fixed in the body and a in the parent, both given in world
    axes."""
    spin_B, spin_A = rotate(B.q_WB, B.w_WB_B), rotate(A.q_WB, A.w_WB_B)
    turn = cross(b, a)
    turn_rate = add(cross(cross(spin_B, b), a), cross(b, cross(spin_A, a)))
    bias = dot(sub(spin_B, spin_A), turn_rate)
    torque_A = neg(unrotate(A.q_WB, turn))
    put(G, k, (0.0, 0.0, 0.0), unrotate(B.q_WB, turn), torque_A, bias, dot(b, a), 0.0, 1.0)


class ParallelRow(NamedTuple):
    """The body's axis a_B stays normal to t1_A and t2_A of the parent: 2 rows."""

    a_B: Vec3
    t1_A: Vec3
    t2_A: Vec3


COUNT[ParallelRow] = 2


@fill.register(ParallelRow)
def fill_parallel(row, t, B, A, G, k):
    """2 rows: a_B is normal to t1_A and to t2_A; the errors are sines of angles."""
    b = rotate(B.q_WB, row.a_B)
    put_normal(G, k, b, rotate(A.q_WB, row.t1_A), B, A)
    put_normal(G, k + 1, b, rotate(A.q_WB, row.t2_A), B, A)


class LockRow(NamedTuple):
    """The body keeps its orientation relative to its parent: 3 rows."""

    q_AB: Quaternion
    """rotation from body axes to parent axes, constant at its initial value."""
    r_B: Vec3
    """point of the body about which the reaction torque is taken, from C, body axes [m]."""


COUNT[LockRow] = 3
ANGLES.update((ParallelRow, LockRow))


@fill.register(LockRow)
def fill_lock(row, t, B, A, G, k):
    """3 rows: each body axis stays normal to the initial direction of another one in the parent."""
    e = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    for i in range(3):
        b = rotate(B.q_WB, e[(i + 1) % 3])
        a = rotate(A.q_WB, rotate(row.q_AB, e[(i + 2) % 3]))
        put_normal(G, k + i, b, a, B, A)


@anchor.register(ParallelRow)
def com_anchor(row, B, A):
    """The centre of mass of the body, world [m]: a pure torque has no point of application."""
    return B.p_WC


class DistanceRow(NamedTuple):
    """r_B of the body keeps its distance from r_A of the parent: 1 row."""

    r_B: Vec3
    r_A: Vec3
    length: float


COUNT[DistanceRow] = 1


@fill.register(DistanceRow)
def fill_distance(row, t, B, A, G, k):
    """1 row along the line through both points; its error is distance - length [m].

    The points may not coincide: the row has no direction then.
    """
    p, c, rho, v_rel, spin_A = relative_motion(B, A, row.r_B)
    gap = sub(rho, rotate(A.q_WB, row.r_A))
    length = norm(gap)
    u = scale(1.0 / length, gap)
    put_along(G, k, u, p, c, B, A, row.r_B, rho, v_rel, spin_A, length - row.length)
    along = dot(u, v_rel)  # u turns relative to the parent; put_along takes it as fixed
    G[k, BIAS] += (dot(v_rel, v_rel) - along * along) / length


class VelocityRow(NamedTuple):
    """Linear velocity constraint l . v_P + angular . w = b: 1 row.

    l and a are fixed in the body (`in_body`) or in the world.
    """

    r_B: Vec3
    linear: Vec3
    angular: Vec3
    b: float
    in_body: bool


COUNT[VelocityRow] = 1


@fill.register(VelocityRow)
def fill_velocity(row, t, B, A, G, k):
    """1 row on the velocity of r_B and the spin; not holonomic, and without a parent."""
    p, v, c = material_point(B, row.r_B)
    if row.in_body:
        force, turn = rotate(B.q_WB, row.linear), row.angular
        bias = dot(force, c) + dot(rotate(B.q_WB, cross(B.w_WB_B, row.linear)), v)
    else:
        force, turn = row.linear, unrotate(B.q_WB, row.angular)
        bias = dot(force, c)
    torque_B = add(turn, cross(row.r_B, unrotate(B.q_WB, force)))
    put(G, k, force, torque_B, (0.0, 0.0, 0.0), bias, 0.0, row.b, 0.0)
    for i in range(6):
        G[k, 6 + i] = 0.0


# Rows that keep a point of a body on a curve.


class CurveRow(NamedTuple):
    """r_B of the body stays on a curve fixed in the world: 2 rows."""

    r_B: Vec3
    curve: tuple


COUNT[CurveRow] = 2


@fill.register(CurveRow)
def fill_curve(row, t, B, A, G, k):
    """2 rows normal to the tangent at the nearest point of the curve; without a parent."""
    p, v, c = material_point(B, row.r_B)
    on, slope, bend = curve_point(row.curve, curve_nearest(row.curve, p))
    inverse = 1.0 / dot(slope, slope)
    s_dot = dot(v, slope) * inverse
    e1, e2 = perpendicular(scale(inverse**0.5, slope))
    gap, normal = sub(p, on), sub(c, scale(s_dot * s_dot, bend))
    r_B, none = row.r_B, (0.0, 0.0, 0.0)
    for i, e in ((0, e1), (1, e2)):
        turn = cross(r_B, unrotate(B.q_WB, e))
        put(G, k + i, e, turn, none, dot(e, normal), dot(e, gap), 0.0, 1.0)


@anchor.register(PointRow, SeatRow, SlotRow, PlaneRow, LockRow, DistanceRow, VelocityRow, CurveRow)
def point_anchor(row, B, A):
    """The body's point r_B, world [m]."""
    return add(B.p_WC, rotate(B.q_WB, row.r_B))
