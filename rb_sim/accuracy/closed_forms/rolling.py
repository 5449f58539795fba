# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Closed forms of balls that roll on a plane, a turntable, a sphere, or in a cylinder."""

from __future__ import annotations

from typing import Any

from rb_sim.accuracy.closed_forms.exact import (
    EPS,
    Exact,
    Long,
    LongArray,
    Spin,
    about,
    attitudes,
    long,
    np,
    unturned,
)
from rb_sim.accuracy.closed_forms.impacts_and_sliding import (
    Ball,
    ball_of,
    coordinates_of,
    normal_of,
    small,
)
from rb_sim.accuracy.closed_forms.rotors import PI, about_hanging
from rb_sim.catalogue.contacts.friction import Rough, Smooth
from rb_sim.catalogue.effects.gravity import GravityRow
from rb_sim.catalogue.effects.wrench import WorldWrenchRow
from rb_sim.catalogue.geometry.pairs import BallOnCylinder, BallOnSphere, SurfaceOnPlane, Turntable
from rb_sim.catalogue.geometry.smooth_surfaces import SphereSurface
from rb_sim.mechanics.systems.rolling import RollingBody
from rb_sim.numerics.rotations import product, rotate, unit
from rb_sim.scene.compiled import Compiled

# Homogeneous sphere that rolls on a plane under a constant world wrench (LL 38, problem 1).
#
# About the contact (I + m a^2) dw/dt = K + a n x F across the normal n, I dw_n/dt = K_n along it;
# so w = w_0 + alpha t, and where w_0 is along alpha the sphere turns about one fixed direction.


CENTRE = (0.0, 0.0, 0.0)


def rolling_sphere(compiled: Compiled) -> Exact | None:
    """The exact motion of a sphere that turns about a fixed direction, or None."""
    system, y = compiled.system, compiled.y
    if not isinstance(system, RollingBody) or not is_homogeneous_sphere(system):
        return None
    wrench = constant_wrench(system)
    if wrench is None:
        return None
    force, torque = wrench
    surface: Any = system.surface
    n, a = long(system.normal), Long(surface.radius)
    n = n / np.sqrt(n @ n)
    mass, inertia = Long(system.body.mass), Long(system.body.inertia[0])
    moment = torque + a * np.cross(n, force)
    along = (torque @ n) * n
    alpha = (moment - (moment @ n) * n) / (inertia + mass * a * a) + along / inertia
    q0 = unit(long(y[3:7]))
    w0 = rotate(q0, long(y[7:10]))
    largest = max(np.sqrt(alpha @ alpha), np.sqrt(w0 @ w0))
    if np.abs(np.cross(w0, alpha)).max() > 0:
        return None
    main = alpha if alpha @ alpha > 0 else w0
    axis = main / np.sqrt(main @ main) if largest > 0 else n
    p0 = long(y[0:3])

    def coordinates(times: LongArray) -> LongArray:
        t = long(times)
        angle = (w0 @ axis) * t + (alpha @ axis) * t * t / 2
        q = unit(product(about(axis, angle), q0))
        w = w0 + alpha * t[:, None]
        p = p0 + a * np.cross(angle[:, None] * axis, n)
        return np.concatenate([p, q, unturned(q, w)], axis=1).astype(float)

    return Exact("rolling sphere under a constant wrench; LL 38, problem 1", coordinates)


def is_homogeneous_sphere(system: RollingBody) -> bool:
    """Whether the centre of mass is the centre and all moments are equal."""
    surface, inertia = system.surface, system.body.inertia
    return (
        isinstance(surface, SphereSurface)
        and tuple(surface.centre_C) == CENTRE
        and len(set(inertia[:3])) == 1
        and not any(inertia[3:])
    )


def constant_wrench(system: RollingBody) -> tuple[LongArray, LongArray] | None:
    """Force at the centre and torque in world axes, or None where they are not constant."""
    force, torque = np.zeros(3, dtype=Long), np.zeros(3, dtype=Long)
    for row in system.effects:
        if isinstance(row, GravityRow):
            force = force + Long(system.body.mass) * long(row.acceleration_W)
        elif isinstance(row, WorldWrenchRow) and tuple(row.r_B) == CENTRE:
            force, torque = force + long(row.force_W), torque + long(row.torque_W)
        else:
            return None
    return force, torque


# Ball that rolls inside a vertical cylinder: the golfer's dilemma (Gualtieri et al. 2006).
#
# Along e_r (outward), e_phi and up, with b = R - a: the rate W about the axis is constant,
# w_z = -b W/a, w_phi = z'/a, dw_r/dt = W z'/a, and z'' = -k W (a w_r) - (1 - k) g with
# k = I / (I + m a^2): the height oscillates at the rate sqrt(k) W.


def rolling_in_cylinder(compiled: Compiled) -> Exact | None:
    """The exact motion of a ball inside a vertical, perfectly rough cylinder at rest, or None."""
    ball = ball_of(compiled, BallOnCylinder)
    if ball is None or not isinstance(ball.friction, Rough) or ball.pair.side > 0:
        return None
    body, a = ball.body, ball.radius
    up = long(ball.pair.axis_A)
    up = up / np.sqrt(up @ up)
    up = -up if body.g @ up > 0 else up
    fall = -(body.g @ up)
    arm = body.p - long(ball.pair.r_A)
    arm = arm - (arm @ up) * up
    b = np.sqrt(arm @ arm)
    out = arm / b
    ahead = np.cross(up, out)
    rate, z0 = (body.v @ ahead) / b, body.v @ up
    w_r = body.w @ out
    w0 = w_r * out + z0 / a * ahead - b * rate / a * up
    if not small(np.cross(up, body.g), max(fall, Long(1))) or rate == 0:
        return None
    if not small(body.v @ out, 1e4 * body.speed) or not small(w0 - body.w, 1e4 * body.speed / a):
        return None
    if abs(b + a - Long(ball.pair.curved)) > 1e-12 * body.length:
        return None
    k = ball.share
    swing = np.sqrt(k) * rate
    # z = z_m + (-z_m) cos + (z0 / swing) sin, from the start; z_m: where gravity is balanced
    z_m = -(k * rate * a * w_r + (1 - k) * fall) / (swing * swing)
    high = z0 / swing
    # in axes that turn with the ball about the cylinder's, whose own turning is taken off
    spin = Spin(
        (w_r + rate / a * z_m) * out - (b * rate / a + rate) * up,
        np.zeros(3, dtype=Long),
        -rate / a * z_m * out + swing / a * high * ahead,
        rate / a * high * out + swing / a * z_m * ahead,
        swing,
    )

    def coordinates(times: LongArray) -> LongArray:
        t = long(times)
        turn = about(up, rate * t)
        cos, sin = np.cos(swing * t), np.sin(swing * t)
        z, rise = z_m * (1 - cos) + high * sin, swing * (z_m * sin + high * cos)
        p = body.p + b * (rotate(turn, out) - out) + z[:, None] * up
        v = b * rate * rotate(turn, ahead) + rise[:, None] * up
        q = product(turn, attitudes(body.q, spin, t))
        w = rotate(turn, spin.at(t)) + rate * up
        return coordinates_of(body, p, q, v, w)

    return Exact("ball inside a vertical cylinder", coordinates)


# Ball that rolls on a level turntable: its centre goes round a circle (Milne 1948; LL 38).
#
# With v = W n x r + a w x n and the equations of motion dv/dt = k n x v, k = W I / (I + m a^2): 2/7
# of the table's rate for a solid ball, whatever the start.


def turntable(compiled: Compiled) -> Exact | None:
    """The exact motion of a ball on a perfectly rough turntable, or None."""
    ball = ball_of(compiled, SurfaceOnPlane, resting=False)
    if ball is None or not isinstance(ball.friction, Rough):
        return None
    body, n, a = ball.body, normal_of(ball.pair), ball.radius
    carrier, fall = body.rows[0].carrier, -(body.g @ n)
    if not isinstance(carrier, Turntable) or not fall > 0 or not small(np.cross(n, body.g), fall):
        return None
    table = long(carrier.spin) @ n
    if table == 0 or not small(np.cross(n, long(carrier.spin)), abs(table)):
        return None
    arm = body.p - long(carrier.point)
    arm = arm - (arm @ n) * n
    # the slip that is left at the start is rounding, which the run projects out as well
    v0 = body.v - (body.v @ n) * n
    w0 = (body.w @ n) * n + (np.cross(n, v0) + table * arm) / a
    if not small(w0 - body.w, 1e4 * body.speed / a) or not small(body.v - v0, body.speed):
        return None
    rate = table * ball.share
    reach = -np.cross(n, v0) / rate
    """from the middle of the circle to the ball's centre."""
    middle = arm - reach
    factor = (table - rate) / a
    spin = Spin(
        (body.w @ n) * n + table * middle / a,
        np.zeros(3, dtype=Long),
        factor * reach,
        factor * np.cross(n, reach),
        rate,
    )

    def coordinates(times: LongArray) -> LongArray:
        t = long(times)
        cos, sin = np.cos(rate * t)[:, None], np.sin(rate * t)[:, None]
        round_ = reach * cos + np.cross(n, reach) * sin
        p = body.p + round_ - reach
        return coordinates_of(
            body, p, attitudes(body.q, spin, t), rate * np.cross(n, round_), spin.at(t)
        )

    return Exact("ball on a turntable", coordinates)


# Ball that rolls (or slides without friction) down a fixed sphere and leaves it.
#
# theta'' = k^2 sin theta with theta from the vertical and k^2 = g m a^2 / ((R + a) (I + m a^2)), or
# g / (R + a) on a smooth sphere: a pendulum's equation.  It leaves where the normal force vanishes,
# g cos theta = (R + a) theta'^2, on a parabola and with the spin it has.


def off_a_sphere(compiled: Compiled) -> Exact | None:
    """The exact motion of a ball on top of a fixed sphere, in a vertical plane, or None."""
    ball = ball_of(compiled, BallOnSphere)
    if ball is None or ball.pair.side < 0 or ball.body.law.bilateral:
        return None
    if not isinstance(ball.friction, Rough | Smooth):
        return None
    body, reach = ball.body, Long(ball.pair.curved) + ball.radius
    fall = np.sqrt(body.g @ body.g)
    arm = body.p - long(ball.pair.r_A)
    if not fall > 0 or abs(np.sqrt(arm @ arm) - reach) > 1e-12 * body.length:
        return None
    up = -body.g / fall
    across = np.cross(up, arm)
    size = np.sqrt(across @ across)
    if size <= 1e-9 * reach:
        return None
    axis = across / size
    theta, rate = np.arctan2(size, arm @ up), Long(np.cross(arm, body.v) @ axis / reach**2)
    rolls = isinstance(ball.friction, Rough)
    # of the ball, where it rolls: v = theta' axis x arm = a w x n
    turning = rate * reach / ball.radius if rolls else Long(0)
    if not small(body.w - turning * axis, 1e4 * body.speed / ball.radius):
        return None
    if not small(body.v - rate * np.cross(axis, arm), 1e4 * body.speed):
        return None
    k2 = (1 - ball.share if rolls else Long(1)) * fall / reach
    if fall * np.cos(theta) <= reach * rate**2:
        return None
    motion = about_hanging(theta - PI, rate, k2)
    if motion is None:
        return None
    leaves = lift_off(motion, fall / reach)
    if leaves is None:
        return None
    return Exact(
        "ball that leaves a fixed sphere", path(ball, motion, leaves, axis, up, reach, rolls)
    )


def lift_off(motion: Any, ratio: Long) -> Long | None:
    """The instant at which ratio cos theta = theta'^2, by halving; None if it is far off."""

    def push(t: Long) -> Long:
        angle, speed = motion(long([t]))
        return (-ratio * np.cos(angle) - speed**2)[0]  # angle: from hanging

    late = Long(1) / np.sqrt(ratio)
    for _ in range(10):
        if push(late) < 0:
            break
        late *= 2
    else:
        return None
    # the first zero: the force falls monotonically from the top to where the ball leaves, and the
    # ball may go over the top once before
    grid = np.linspace(Long(0), late, 400)
    angle, speed = motion(grid)
    first = int(np.argmax(-ratio * np.cos(angle) - speed**2 < 0))
    early, late = grid[first - 1], grid[first]
    while late - early > 2 * EPS * late:
        middle = (early + late) / 2
        if not early < middle < late:
            break
        early, late = (early, middle) if push(middle) < 0 else (middle, late)
    return late


def path(
    ball: Ball, motion: Any, leaves: Long, axis: LongArray, up: LongArray, reach: Long, rolls: bool
) -> Any:
    """Coordinates over time."""
    body, centre = ball.body, long(ball.pair.r_A)
    forward = np.cross(axis, up)
    ratio = reach / ball.radius if rolls else Long(0)
    first = motion(long([0]))[0][0]

    def coordinates(times: LongArray) -> LongArray:
        t = long(times)
        s = np.minimum(t, leaves)
        angle, rate = motion(s)
        sin, cos = -np.sin(angle)[:, None], -np.cos(angle)[:, None]
        flown, speed = (t - s)[:, None], (reach * rate)[:, None]
        v = speed * (forward * cos - up * sin)
        p = centre + reach * (forward * sin + up * cos) + v * flown + body.g * flown**2 / 2
        turn = ratio * (angle - first + rate * (t - s))
        q = unit(product(about(axis, turn), body.q))
        return coordinates_of(body, p, q, v + body.g * flown, (ratio * rate)[:, None] * axis)

    return coordinates
