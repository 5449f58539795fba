# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Closed forms of one body in contact: bouncing ball, sliding block, slipping ball."""

from __future__ import annotations

from typing import Any, NamedTuple

from scipy.optimize import nnls

from rb_sim.accuracy.closed_forms.exact import (
    Exact,
    Long,
    LongArray,
    Spin,
    attitudes,
    gravity_of,
    long,
    np,
    only_gravity,
    steady_spin,
    unturned,
)
from rb_sim.base.rounding import COMPUTED_ROUNDING, SUM_ROUNDING
from rb_sim.catalogue.contacts.friction import Coulomb, NoResistance, Smooth
from rb_sim.catalogue.geometry.pairs import PointOnPlane, Resting, SurfaceOnPlane
from rb_sim.catalogue.geometry.smooth_surfaces import SphereSurface
from rb_sim.mechanics.systems.many_bodies import INERTIA, MASS
from rb_sim.numerics.rotations import rotate, unit
from rb_sim.scene.compiled import Compiled

# A single body under gravity alone whose only constraint is one contact: what is read of it.


CENTRE = (0.0, 0.0, 0.0)


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
