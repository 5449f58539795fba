"""Block that slides straight up or down an inclined plane, stops, and stays or slides back.

While it slides s'' = g_s - mu g_n sign(s'); at rest it stays if |g_t| <= mu_s g_n (Coulomb 1785).
"""

from __future__ import annotations

from typing import NamedTuple

from scipy.optimize import nnls

from rb_sim.accuracy.closed_forms.contact.single import (
    Single,
    coordinates_of,
    normal_of,
    single_of,
    small,
)
from rb_sim.accuracy.closed_forms.exact import Exact
from rb_sim.accuracy.closed_forms.extended import Array, Long, long, np, turned
from rb_sim.contact.friction import Coulomb
from rb_sim.contact.geometry.pairs import PointOnPlane
from rb_sim.scene.compiled import Compiled


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

    def coordinates(times: Array) -> Array:
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


def stands(body: Single, n: Array, e: Array, kinetic: Long, slope: Array) -> bool:
    """Whether the points that touch can take up every moment of the motion by pushing alone.

    A traction T under a centre of mass at the height h needs the normal force at -h T/N from it.
    """
    points = [body.p + turned(body.q, long(row.pair.r_B)) for row in body.rows]
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
