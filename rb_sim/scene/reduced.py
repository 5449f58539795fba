# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Reduced coordinates of scenes with one body and at most one joint: the system and its y.

`reduce_scene` returns None if no such coordinates are known; the scene is then integrated in
maximal coordinates. An initial state off the joint is projected onto it: its position along the
joint's own free direction, its velocity to the nearest admissible one in the metric of the kinetic
energy.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rb_sim.base.rounding import TWO_ULPS, WRITTEN_ROUNDING
from rb_sim.catalogue.constraints.joints import FixedPoint, Free, Translation
from rb_sim.catalogue.constraints.rolling import Rolling, levelled
from rb_sim.catalogue.constraints.simple import FixedAxis
from rb_sim.catalogue.curves import curve_nearest, curve_point
from rb_sim.catalogue.geometry.smooth_surfaces import RimSurface, support
from rb_sim.catalogue.spec import (
    CENTRAL,
    BodyState,
    ConstraintKind,
    Inertial,
    Quaternion,
    Symmetric,
    Vec3,
)
from rb_sim.mechanics.systems.fixed_point import FixedAxisBody, FixedPointBody
from rb_sim.mechanics.systems.free import FreeBody, free_rotor
from rb_sim.mechanics.systems.multibody import inverse_symmetric
from rb_sim.mechanics.systems.rolling_body import LineRollingBody, RollingBody
from rb_sim.mechanics.systems.translation import GuidedBody, TranslatingBody
from rb_sim.numerics.vectors import (
    ZERO,
    add,
    cross,
    dot,
    neg,
    norm,
    quaternion_product,
    quaternion_unit,
    rotate,
    scale,
    shifted_inertia,
    sub,
    symmetric_times,
    unrotate,
)
from rb_sim.scene.place import InitialPlace, quaternion, symmetric, vector

# Principal axes of an inertia tensor (LL 32), by Jacobi rotations in long double.
#
# That keeps the digits of the small moment of a slender body: the usual routines in double
# precision leave errors of the size of a rounding of the largest moment.


SWEEPS = 12


def principal_axes(inertia: Symmetric) -> tuple[Vec3, Quaternion]:
    """Principal moments and the quaternion from principal to body axes.

    A diagonal tensor keeps its axes and their order.
    """
    xx, yy, zz, xy, xz, yz = inertia
    A = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=np.longdouble)
    q: Quaternion = (0.0, 0.0, 0.0, 1.0)
    if xy == xz == yz == 0.0:
        return (xx, yy, zz), q
    for _ in range(SWEEPS):
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            if A[i, j] == 0.0:
                continue
            gap = A[i, i] - A[j, j]
            side = 1.0 if gap >= 0.0 else -1.0
            angle = 0.5 * np.arctan2(side * 2.0 * A[i, j], side * gap)  # at most 45 degrees
            c, s = np.cos(angle), np.sin(angle)
            J = np.eye(3, dtype=np.longdouble)
            J[i, i], J[i, j], J[j, i], J[j, j] = c, -s, s, c
            A = J.T @ A @ J
            A[i, j] = A[j, i] = 0.0
            turn = [0.0, 0.0, 0.0, float(np.cos(0.5 * angle))]
            turn[k] = float(np.sin(0.5 * angle))
            q = quaternion_product(q, quaternion(turn))
    return together(vector(np.diag(A))), quaternion_unit(q)


def together(moments: tuple[float, ...]) -> Vec3:
    """The moments, with those equal up to rounding made equal: their difference would be a
    torque."""
    a, b, c = moments
    near = TWO_ULPS * max(moments)
    if abs(a - b) <= near:
        a = b = 0.5 * (a + b)
    if abs(b - c) <= near:
        b = c = 0.5 * (b + c)
    if abs(a - c) <= near:
        a = c = 0.5 * (a + c)
    return (a, b, c)


class Reduced(NamedTuple):
    """A one-body system, its initial coordinates, and the state they stand for."""

    system: NamedTuple
    y: tuple[float, ...]
    state: BodyState
    length: float
    """length of the joint, to which an initial violation is relative [m]."""
    indeterminate: bool = False


def reduce_scene(
    place: InitialPlace, specs: Sequence[ConstraintKind], effects: tuple[Any, ...]
) -> Reduced | None:
    """Reduced coordinates of the scene; None if no such coordinates are known."""
    names = place.body_names()
    joints = [spec for spec in specs if not isinstance(spec, Free)]
    if len(names) != 1 or len(joints) > 1:
        return None
    body, B = place.inertial(names[0]), place.state(names[0])
    if not joints:
        if all(type(row) in CENTRAL for row in effects):
            system, y = free_rotor(body, *principal_axes(body.inertia), B, effects)
            return Reduced(system, y, B, 1.0)
        system = FreeBody(body, symmetric(inverse_symmetric(body.inertia)), effects)
        return Reduced(system, B.p_WC + B.q_WB + B.v_WC + B.w_WB_B, B, 1.0)
    maker = MAKERS.get(type(joints[0]))
    return maker(place, joints[0], body, B, effects) if maker else None


def projected_alone(place: InitialPlace, specs: Sequence[ConstraintKind]) -> dict[str, BodyState]:
    """States, projected onto their joint, of the bodies with one joint to the world and no other
    constraint: the same as if the body were alone in the scene."""
    held: dict[str, list[ConstraintKind]] = {}
    for spec in specs:
        parent = getattr(spec, "parent", None)
        for name in {spec.body} if parent is None else {spec.body, parent}:
            held.setdefault(name, []).append(spec)
    found = {}
    for name, own in held.items():
        joints = [spec for spec in own if not isinstance(spec, Free)]
        alone = len(joints) == 1 and getattr(joints[0], "parent", None) is None
        maker = MAKERS.get(type(joints[0])) if alone else None
        if maker is not None:
            body, B = place.inertial(name), place.start(name)
            found[name] = maker(place, joints[0], body, B, ()).state
    return found


def nearest_speeds(body: Inertial, B: BodyState, columns: list[tuple[Vec3, Vec3]]) -> np.ndarray:
    """Speeds s of the motion sum s_i (V_i, w_i) closest to that of B in the metric of M."""
    metric = np.zeros((6, 6))
    metric[:3, :3] = body.mass * np.eye(3)
    for j in range(3):
        axis = tuple(1.0 if i == j else 0.0 for i in range(3))
        metric[3:, 3 + j] = symmetric_times(body.inertia, axis)
    N = np.array([v + w for v, w in columns]).T
    u = np.array(B.v_WC + B.w_WB_B)
    return np.linalg.solve(N.T @ metric @ N, N.T @ metric @ u)


def spin_about(q: Any, rho: Vec3, w: Vec3) -> tuple[Vec3, Vec3]:
    """(V, w) of a rotation w (body axes) about the point at C - rho; V in world axes."""
    return rotate(q, cross(w, rho)), w


def gyration(body: Inertial) -> float:
    """Largest radius of gyration about the body axes [m]."""
    return math.sqrt(max(body.inertia[:3]) / body.mass)


UNIT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def _reduce_fixed_point(
    place: InitialPlace, spec: FixedPoint, body: Inertial, B: BodyState, effects: tuple[Any, ...]
) -> Reduced:
    r_B = place.from_com(spec.body, spec.point_B)
    point = place.partner_point(None, spec.point_A, spec.body, spec.point_B)
    rho = neg(r_B)
    w = vector(nearest_speeds(body, B, [spin_about(B.q_WB, rho, e) for e in UNIT]))
    inertia_O = shifted_inertia(body.inertia, body.mass, rho)
    inverse_O = symmetric(inverse_symmetric(inertia_O))
    system = FixedPointBody(body, rho, point, inertia_O, inverse_O, effects)
    p = add(point, rotate(B.q_WB, rho))
    state = BodyState(p, B.q_WB, spin_about(B.q_WB, rho, w)[0], w)
    return Reduced(system, B.q_WB + w, state, max(norm(rho), gyration(body)))


def _reduce_fixed_axis(
    place: InitialPlace, spec: FixedAxis, body: Inertial, B: BodyState, effects: tuple[Any, ...]
) -> Reduced:
    n = vector(spec.axis_B)
    rho = neg(place.from_com(spec.body, spec.point_B))
    point = place.partner_point(None, spec.point_A, spec.body, spec.point_B)
    n_W = place.partner_axis(None, spec.axis_A, spec.body, n)
    q = aligned(B.q_WB, n, n_W)
    omega = float(nearest_speeds(body, B._replace(q_WB=q), [spin_about(q, rho, n)])[0])
    J = dot(n, symmetric_times(shifted_inertia(body.inertia, body.mass, rho), n))
    share = {"A": 0.0, "B": 1.0, "none": 0.5}[spec.floating]
    distance = float(spec.bearing_distance)
    system = FixedAxisBody(body, rho, point, n, q, 1.0 / J, distance, share, effects)
    v, w = spin_about(q, rho, scale(omega, n))
    state = BodyState(add(point, rotate(q, rho)), q, v, w)
    # not the bearing distance (a metre by default), which may be far larger than the body
    size = max(norm(rho), gyration(body))
    return Reduced(system, (0.0, omega), state, size, spec.floating == "none")


def aligned(q: Any, a_B: Vec3, a_W: Vec3) -> Any:
    """q rotated by the smallest angle that brings the body's axis a_B to the direction a_W."""
    a = rotate(q, a_B)
    if norm(sub(a, a_W)) == 0.0:
        return q
    turn = cross(a, a_W) + (1.0 + dot(a, a_W),)
    return quaternion_unit(quaternion_product(quaternion_unit(turn), q))


def _reduce_translation(
    place: InitialPlace, spec: Translation, body: Inertial, B: BodyState, effects: tuple[Any, ...]
) -> Reduced:
    r_B, curve = place.from_com(spec.body, spec.point_B), spec.curve(place)
    if curve is None:
        state = B._replace(w_WB_B=ZERO)
        return Reduced(TranslatingBody(body, B.q_WB, r_B, effects), B.p_WC + B.v_WC, state, 1.0)
    arm = rotate(B.q_WB, r_B)
    s = float(curve_nearest(curve, add(B.p_WC, arm)))
    c, slope, _ = curve_point(curve, s)
    s_dot = dot(B.v_WC, slope) / dot(slope, slope)
    state = BodyState(sub(c, arm), B.q_WB, scale(s_dot, slope), ZERO)
    return Reduced(GuidedBody(body, B.q_WB, r_B, curve, effects), (s, s_dot), state, norm(slope))


def _reduce_rolling(
    place: InitialPlace, spec: Rolling, body: Inertial, B: BodyState, effects: tuple[Any, ...]
) -> Reduced:
    surface, normal = spec.surface(place), vector(spec.normal_A)
    offset = dot(normal, vector(spec.point_A))
    rim = surface if isinstance(surface, RimSurface) and spec.has_line_contact(place) else None
    q = B.q_WB
    if rim is not None:
        q = aligned(q, rim.axis_B, levelled(rotate(q, rim.axis_B), normal))
    r_CP = support(surface, unrotate(q, normal))
    p = add(B.p_WC, scale(offset - dot(normal, add(B.p_WC, rotate(q, r_CP))), normal))
    turns = UNIT if rim is None else (rim.axis_B,)
    speeds = nearest_speeds(body, B._replace(q_WB=q), [spin_about(q, neg(r_CP), e) for e in turns])
    w = vector(speeds) if rim is None else scale(float(speeds[0]), rim.axis_B)
    state = BodyState(p, q, spin_about(q, neg(r_CP), w)[0], w)
    if rim is None:
        y = p + q + w
        return Reduced(RollingBody(body, surface, normal, offset, effects), y, state, norm(r_CP))
    centre = add(p, rotate(q, rim.centre_C))
    forward = cross(rotate(q, rim.axis_B), normal)
    system = LineRollingBody(body, rim, normal, offset, q, centre, forward, effects)
    return Reduced(system, (0.0, float(speeds[0])), state, norm(r_CP))


MAKERS: dict[type, Any] = {
    FixedPoint: _reduce_fixed_point,
    FixedAxis: _reduce_fixed_axis,
    Translation: _reduce_translation,
    Rolling: _reduce_rolling,
}


def rolling_spin(system: Any, B: BodyState, misfit: float) -> tuple[float, Vec3 | None]:
    """(slip of the contact point [m/s], nearest angular velocity without slip, body axes, or None).

    None if more than the fraction `misfit` of the slip remains at every angular velocity.
    """
    surface: Any = system.surface
    arm = support(surface, unrotate(B.q_WB, system.normal))
    slip = add(unrotate(B.q_WB, B.v_WC), cross(B.w_WB_B, arm))
    lever = arm
    if isinstance(system, LineRollingBody):  # it turns about its axis only
        axis = surface.axis_B
        lever = sub(arm, scale(dot(arm, axis), axis))
    turn = scale(1.0 / dot(lever, lever), cross(slip, lever))
    left = norm(add(slip, cross(turn, arm)))
    return norm(slip), add(B.w_WB_B, turn) if left <= misfit * norm(slip) else None


def misfit(given: BodyState, admissible: BodyState, length: float) -> tuple[float, str, str]:
    """(largest difference relative to the state's scale, quantity that differs, its amount with
    unit)."""
    turn = abs(sum(a * b for a, b in zip(given.q_WB, admissible.q_WB, strict=True)))
    arm = max(length, 1e-12)
    speed = norm(given.v_WC) + arm * norm(given.w_WB_B)
    speed = max(speed, WRITTEN_ROUNDING * math.sqrt(9.81 * arm))
    angle = 2.0 * math.acos(min(1.0, turn)) if turn < 1.0 - 1e-15 else 0.0
    differences = {
        "position": (norm(sub(given.p_WC, admissible.p_WC)), arm, "m"),
        "orientation": (angle, 1.0, "rad"),
        "linear_velocity": (norm(sub(given.v_WC, admissible.v_WC)), speed, "m/s"),
        "angular_velocity": (norm(sub(given.w_WB_B, admissible.w_WB_B)), speed / arm, "rad/s"),
    }
    what = max(differences, key=lambda key: differences[key][0] / differences[key][1])
    size, scale, unit = differences[what]
    return size / scale, what, f"{size:.2g} {unit}"
