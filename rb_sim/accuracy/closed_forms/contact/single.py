"""A single body under gravity alone whose only constraint is one contact: what is read of it."""

from __future__ import annotations

from typing import Any, NamedTuple

from rb_sim.accuracy.closed_forms.extended import Array, Long, long, np, turned, unit, unturned
from rb_sim.accuracy.closed_forms.parabola import gravity_of, only_gravity
from rb_sim.contact.friction import NoResistance
from rb_sim.contact.geometry.carriers import Resting
from rb_sim.contact.geometry.pairs import SurfaceOnPlane
from rb_sim.contact.geometry.shapes import SphereSurface
from rb_sim.engine.systems.many_bodies import INERTIA, MASS
from rb_sim.scene.compiled import Compiled

CENTRE = (0.0, 0.0, 0.0)
NEAR = 1e-14
"""Relative size of a component that is only rounding, in what the scene says."""


class Single(NamedTuple):
    """The body at its start and the points of its contact."""

    mass: Long
    inertia: Array
    """xx, yy, zz, xy, xz, yz."""
    g: Array
    """(3,)."""
    p: Array
    q: Array
    v: Array
    w: Array
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
        pair: Any = self.pair
        return Long(getattr(pair, "surface", pair).radius)


def single_of(compiled: Compiled, *, resting: bool = True) -> Single | None:
    """The body, or None where there is more than one rigid contact of one body and gravity.

    resting: whether the support must be at rest.
    """
    system, laws = compiled.system, compiled.contact_laws
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
        gravity_of(effects), y[0:3], q, y[7:10], turned(q, y[10:13]), rows, laws[0],
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


def normal_of(pair: Any) -> Array:
    """Of a plane at rest."""
    n = long(pair.n_A)
    return n / np.sqrt(n @ n)


def small(value: Any, size: Any) -> bool:
    """Whether a vector or number is only rounding beside `size`."""
    return bool(np.abs(value).max() <= NEAR * size)


def coordinates_of(body: Single, p: Array, q: Array, v: Array, w: Array) -> Array:
    """y = (p, q, v, w of the body, work of the contact): what it did is the change of energy."""
    spin = unturned(q, w)
    xx, yy, zz, xy, xz, yz = body.inertia
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=Long)
    kinetic = (body.mass * (v * v).sum(axis=1) + (spin * (spin @ tensor)).sum(axis=1)) / 2
    first = unturned(body.q, body.w)
    start = (body.mass * (body.v @ body.v) + first @ tensor @ first) / 2
    work = kinetic - start - body.mass * ((p - body.p) @ body.g)
    return np.concatenate([p, q, v, spin, work[:, None]], axis=1).astype(float)
