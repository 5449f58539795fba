# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Closed forms of bodies on supports: balls that roll on a plane, a turntable, a sphere or in a
cylinder; a ball that bounces, a block that slides, a ball that slips until it rolls.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from scipy.optimize import nnls

from rb_sim.accuracy.closed_forms.rotors import (
    EPS,
    PI,
    Exact,
    Long,
    LongArray,
    Spin,
    about,
    about_hanging,
    attitudes,
    gravity_of,
    long,
    np,
    only_gravity,
    steady_spin,
    unturned,
)
from rb_sim.base.rounding import COMPUTED_ROUNDING, SUM_ROUNDING
from rb_sim.catalogue.effects.gravity import GravityRow
from rb_sim.catalogue.effects.wrench import WorldWrenchRow
from rb_sim.catalogue.friction import Coulomb, NoResistance, Rough, Smooth
from rb_sim.catalogue.geometry.pairs import (
    BallOnCylinder,
    BallOnSphere,
    PointOnPlane,
    Resting,
    SurfaceOnPlane,
    Turntable,
)
from rb_sim.catalogue.geometry.smooth_surfaces import SphereSurface
from rb_sim.mechanics.compiled import Compiled
from rb_sim.mechanics.systems.many_bodies import INERTIA, MASS
from rb_sim.mechanics.systems.rolling_body import RollingBody
from rb_sim.numerics.rotations import product, rotate, unit

# A single body under gravity alone whose only constraint is one contact: what is read of it.


class Single(NamedTuple):
    """The body at its start and the points of its contact."""

    mass: Long
    inertia: LongArray
    """xx, yy, zz, xy, xz, yz."""
    g: LongArray
    """(3,)."""
    p: LongArray
    q: LongArray
    v: LongArray
    w: LongArray
    """world axes."""
    rows: tuple[Any, ...]
    """ContactRow of each point."""
    law: Any
    length: float
    speed: float


class Ball(NamedTuple):
    """A homogeneous sphere that touches at one point."""

    body: Single
    pair: Any
    friction: Any
    moment: Long
    """of inertia about any axis."""

    @property
    def share(self) -> Long:
        """I / (I + m a^2), 2/7 of a solid sphere."""
        extra = self.body.mass * self.radius**2
        return self.moment / (self.moment + extra)

    @property
    def radius(self) -> Long:
        """Radius of the sphere [m]."""
        pair: Any = self.pair
        return Long(getattr(pair, "surface", pair).radius)


def single_of(compiled: Compiled, *, resting: bool = True) -> Single | None:
    """The body, or None where there is more than one rigid contact of one body and gravity.

    resting: whether the support must be at rest.
    """
    system, laws = compiled.system, compiled.contact_laws
    if not laws:
        return None
    effects = tuple(placed.row for placed in system.effects)
    points = [placed for group in system.contacts for placed in group]
    if len(system.bodies) != 1 or system.constraints or not only_gravity(effects):
        return None
    if any(law != laws[0] or law.compliant for law in laws):
        return None
    rows = tuple(point.row for point in points)
    if any(not isinstance(row.resistance, NoResistance) for row in rows):
        return None
    if resting and any(not isinstance(row.carrier, Resting) for row in rows):
        return None
    y = long(compiled.y)
    q = unit(y[3:7])
    return Single(
        Long(system.bodies[0, MASS]), long(system.bodies[0, INERTIA : INERTIA + 6]),
        gravity_of(effects), y[0:3], q, y[7:10], rotate(q, y[10:13]), rows, laws[0],
        system.length, system.speed,
    )  # fmt: skip


def ball_of(compiled: Compiled, kind: type, *, resting: bool = True) -> Ball | None:
    """The homogeneous sphere whose only point of contact is a pair of this kind, or None."""
    body = single_of(compiled, resting=resting)
    if body is None or len(body.rows) != 1 or not isinstance(body.rows[0].pair, kind):
        return None
    row = body.rows[0]
    if kind is SurfaceOnPlane:
        if not isinstance(row.pair.surface, SphereSurface) or row.pair.surface.centre_C != CENTRE:
            return None
    elif row.pair.r_B != CENTRE:
        return None
    moments = body.inertia
    if any(moments[3:] != 0) or len(set(moments[:3])) != 1:
        return None
    return Ball(body, row.pair, row.friction, moments[0])


def normal_of(pair: Any) -> LongArray:
    """Of a plane at rest."""
    n = long(pair.n_A)
    return n / np.sqrt(n @ n)


def small(value: Any, size: Any) -> bool:
    """Whether a vector or number is only rounding beside `size`."""
    return bool(np.abs(value).max() <= SUM_ROUNDING * size)


def coordinates_of(
    body: Single, p: LongArray, q: LongArray, v: LongArray, w: LongArray
) -> LongArray:
    """y = (p, q, v, w of the body, work of the contact): what it did is the change of energy."""
    spin = unturned(q, w)
    xx, yy, zz, xy, xz, yz = body.inertia
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=Long)
    kinetic = (body.mass * (v * v).sum(axis=1) + (spin * (spin @ tensor)).sum(axis=1)) / 2
    first = unturned(body.q, body.w)
    start = (body.mass * (body.v @ body.v) + first @ tensor @ first) / 2
    work = kinetic - start - body.mass * ((p - body.p) @ body.g)
    return np.concatenate([p, q, v, spin, work[:, None]], axis=1).astype(float)


# Ball that bounces on a smooth plane: parabolas whose speeds fall by e (any text on mechanics).
#
# After impacts at T_1, T_k+1 = T_k + 2 e^k s / g with s the speed of the first, at the limit
# T_1 + 2 s e / (g (1 - e)) it rests on the plane, and slides on as on a smooth one.


MOST_IMPACTS = 100_000


def bouncing_ball(compiled: Compiled) -> Exact | None:
    """The exact motion of a ball on a smooth plane at rest, or None."""
    ball = ball_of(compiled, SurfaceOnPlane)
    if ball is None or not isinstance(ball.friction, Smooth) or ball.body.law.bilateral:
        return None
    body, n = ball.body, normal_of(ball.pair)
    fall = -(body.g @ n)
    height = max(n @ (body.p - long(ball.pair.r_A)) - ball.radius, Long(0))
    if not fall > 0:
        return None
    along = body.g + fall * n
    rise = body.v @ n
    slide = body.v - rise * n
    e = Long(body.law.restitution)

    def coordinates(times: LongArray) -> LongArray:
        t = long(times)
        starts, heights, speeds, rest = flights(height, rise, fall, e, t[-1])
        i = np.searchsorted(starts, t, side="right") - 1
        s = t - starts[i]
        high, up = heights[i] + speeds[i] * s - fall * s * s / 2, speeds[i] - fall * s
        high, up = np.where(t >= rest, 0, high), np.where(t >= rest, 0, up)
        t = t[:, None]
        p = body.p + (high - height)[:, None] * n + slide * t + along * t * t / 2
        v = slide + along * t + up[:, None] * n
        w = np.tile(body.w, (len(times), 1))
        return coordinates_of(body, p, attitudes(body.q, steady_spin(body.w), t[:, 0]), v, w)

    return Exact("ball that bounces on a smooth plane", coordinates)


def flights(
    height: Long, rise: Long, fall: Long, e: Long, end: Long
) -> tuple[LongArray, LongArray, LongArray, Long]:
    """Start, height and speed of each flight up to `end`, and the time of rest."""
    speed = np.sqrt(rise * rise + 2 * fall * height)
    t = (rise + speed) / fall
    starts, heights, speeds = [Long(0)], [height], [rise]
    rest = t + 2 * e * speed / (fall * (1 - e)) if e < 1 else Long(np.inf)
    while t <= min(end, rest) and len(starts) < MOST_IMPACTS:
        speed *= e
        if 2 * speed <= np.finfo(Long).eps * fall * max(t, Long(1)):
            break
        starts.append(t)
        heights.append(Long(0))
        speeds.append(speed)
        t += 2 * speed / fall
    return long(starts), long(heights), long(speeds), rest


# Block that slides straight up or down an inclined plane, stops, and stays or slides back.
#
# While it slides s'' = g_s - mu g_n sign(s'); at rest it stays if |g_t| <= mu_s g_n (Coulomb 1785).


class Phase(NamedTuple):
    """Uniform acceleration along the way from an instant on."""

    start: Long
    way: Long
    speed: Long
    acceleration: Long


def sliding_block(compiled: Compiled) -> Exact | None:
    """The exact motion of a block that slides along the steepest line without tipping, or None."""
    body = single_of(compiled)
    if body is None or not all(isinstance(row.pair, PointOnPlane) for row in body.rows):
        return None
    friction = body.rows[0].friction
    if not isinstance(friction, Coulomb) or body.w.any():
        return None
    n = normal_of(body.rows[0].pair)
    fall = -(body.g @ n)
    along = body.g + fall * n
    pull, speed = np.sqrt(along @ along), np.sqrt(body.v @ body.v)
    if not fall > 0 or (pull == 0 and speed == 0):
        return None
    e = body.v / speed if speed > 0 else along / pull
    steepest = small(np.cross(along, e), 10 * fall) and small(body.v @ n, 10 * body.speed)
    if not steepest or not stands(body, n, e, Long(friction.kinetic), along / fall):
        return None
    path = phases(speed, along @ e, fall * Long(friction.kinetic), fall * Long(friction.static))

    def coordinates(times: LongArray) -> LongArray:
        t = long(times)
        i = np.searchsorted([phase.start for phase in path], t, side="right") - 1
        start, way, first, rate = long(path)[i].T
        s = t - start
        moved, v = way + first * s + rate * s * s / 2, first + rate * s
        q = np.tile(body.q, (len(t), 1))
        p = body.p + moved[:, None] * e
        return coordinates_of(body, p, q, v[:, None] * e, np.zeros_like(p))

    return Exact("block that slides on an incline; Coulomb's law", coordinates)


def phases(speed: Long, pull: Long, kinetic: Long, static: Long) -> list[Phase]:
    """Of the motion along e from the speed >= 0; pull: along e; kinetic, static: mu g_n."""
    found, start, way = [], Long(0), Long(0)
    if speed > 0:
        found.append(Phase(start, way, speed, pull - kinetic))
        if pull - kinetic >= 0:
            return found
        start = speed / (kinetic - pull)
        way = speed * start / 2
    rate = pull - np.sign(pull) * kinetic if abs(pull) > static else Long(0)
    return [*found, Phase(start, way, Long(0), rate)]


def stands(body: Single, n: LongArray, e: LongArray, kinetic: Long, slope: LongArray) -> bool:
    """Whether the points that touch can take up every moment of the motion by pushing alone.

    A traction T under a centre of mass at the height h needs the normal force at -h T/N from it.
    """
    points = [body.p + rotate(body.q, long(row.pair.r_B)) for row in body.rows]
    gaps = [n @ (point - long(row.pair.r_A)) for point, row in zip(points, body.rows, strict=True)]
    touching = [
        np.asarray(point - body.p, dtype=float)
        for point, gap in zip(points, gaps, strict=True)
        if abs(gap) <= 1e-12 * body.length
    ]
    if len(touching) < 3:
        return False
    high = n @ (body.p - long(body.rows[0].pair.r_A))
    feet = np.array([np.append(r - (r @ n.astype(float)) * n.astype(float), 1.0) for r in touching])
    for traction in (-kinetic * e, kinetic * e, -slope):
        under = np.append(np.asarray(-high * traction, dtype=float), 1.0)
        if nnls(feet.T, under)[1] > 1e-9 * float(high):
            return False
    return True


# Ball thrown on a level plane: it slips, then rolls (Landau & Lifshitz 38; Coriolis 1835).
#
# While it slips, Coulomb's friction has the fixed direction -e of the slip s = v - a w x n, so
# dv/dt = -mu g e, dw/dt = (mu m g a / I) n x e, and |s| falls at the rate mu g (1 + m a^2 / I).
# Then v and w are constant.


def slipping_ball(compiled: Compiled) -> Exact | None:
    """The exact motion of a ball that touches a level plane with Coulomb friction, or None."""
    ball = ball_of(compiled, SurfaceOnPlane)
    if ball is None or not isinstance(ball.friction, Coulomb) or not ball.friction.kinetic > 0:
        return None
    body, n, a = ball.body, normal_of(ball.pair), ball.radius
    fall = -(body.g @ n)
    gap = n @ (body.p - long(ball.pair.r_A)) - a
    if not fall > 0 or not small(np.cross(n, body.g), fall):
        return None
    if (
        abs(gap) > COMPUTED_ROUNDING * body.length
        or abs(body.v @ n) > COMPUTED_ROUNDING * body.speed
    ):
        return None
    slip = body.v - a * np.cross(body.w, n)
    slip = slip - (slip @ n) * n
    size = np.sqrt(slip @ slip)
    rolls = size <= COMPUTED_ROUNDING * body.speed
    e = np.zeros(3, dtype=Long) if rolls else slip / size
    brake = Long(ball.friction.kinetic) * fall
    turn = brake * body.mass * a / ball.moment * np.cross(n, e)
    end = size * ball.share / brake
    none = np.zeros(3, dtype=Long)
    spin = Spin(body.w, turn, none, none, Long(0))

    def coordinates(times: LongArray) -> LongArray:
        t = long(times)
        s = np.minimum(t, end)[:, None]
        v = body.v - brake * e * s
        p = body.p + body.v * s - brake * e * s * s / 2 + v * (t[:, None] - s)
        early = int(np.searchsorted(t, end))
        q = attitudes(body.q, spin, np.append(t[:early], end))
        later = np.concatenate([[end], t[early:]])
        q = np.concatenate([q[:-1], attitudes(q[-1], steady_spin(body.w + turn * end), later)[1:]])
        return coordinates_of(body, p, q, v, body.w + turn * s)

    return Exact("ball that slips and then rolls; LL 38", coordinates)


# Homogeneous sphere that rolls on a plane under a constant world wrench (LL 38, problem 1).
#
# About the contact (I + m a^2) dw/dt = K + a n x F across the normal n, I dw_n/dt = K_n along it;
# so w = w_0 + alpha t.


CENTRE = (0.0, 0.0, 0.0)


def rolling_sphere(compiled: Compiled) -> Exact | None:
    """The exact motion of a homogeneous sphere that rolls under a constant wrench, or None."""
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
    p0, none = long(y[0:3]), np.zeros(3, dtype=Long)
    spin = Spin(w0, alpha, none, none, Long(0))

    def coordinates(times: LongArray) -> LongArray:
        t = long(times)
        q, turned = attitudes(q0, spin, t), t[:, None] * w0 + t[:, None] ** 2 / 2 * alpha
        p = p0 + a * np.cross(turned, n)
        return np.concatenate([p, q, unturned(q, spin.at(t))], axis=1).astype(float)

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
