"""A corner or an end on another body's box or cylinder: what holds it is a face, and no more.

The nearest point of the solid tells the gap in flight.  A point that is held keeps to the face on
which it came to be, whose surface goes on beyond the edge, until it has left the face by OVER:
there nothing presses it, and the contact opens.  The nearest point of the edge would turn the
normal aside at once, and a step back to the manifold would take the point back to the edge, and
energy from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from rb_sim.catalogue.types import Vec3
from rb_sim.contact.geometry.pairs import (
    BallOnSolid,
    Touch,
    carried_point,
    into_solid,
    out_of_solid,
    touching,
)
from rb_sim.contact.geometry.rims import IN_FLIGHT, UPRIGHT, Lean
from rb_sim.contact.geometry.rims_on_cylinders import ABSENT
from rb_sim.contact.geometry.solids import Box, Cylinder, about_axis, nearest
from rb_sim.graph.functions import maximum, where
from rb_sim.maths.jit import dispatch
from rb_sim.maths.vectors import ZERO, dot, scale, sub

OVER = 1e-12
"""Way beyond the edge of a face, over the size of the solid, by which a point has left it: corners
that lie on edges, as those of a stack of equal boxes, are off by rounding."""
SQUARE = 1e-12
"""By how much a component of the normal of a face may differ from 1."""


class PointOnSolid(BallOnSolid):
    """A corner or an end of the body, whose radius is 0, outside the parent's box or cylinder."""

    __slots__ = ()


def held_by_faces(found: Sequence[NamedTuple]) -> list[NamedTuple]:
    """The pairs, corners and ends on solids as such."""
    return [
        PointOnSolid(*pair) if isinstance(pair, BallOnSolid) and pair.radius == 0.0 else pair
        for pair in found
    ]


@dispatch
def face_of(solid, u):
    """The face whose normal is u, as three numbers; zeros where u is that of an edge or corner.

    Of a box they are the normal; of a cylinder (1, 0, 0) and (-1, 0, 0) its ends, (0, 1, 0) its
    round side.
    """


@dispatch
def off_face(solid, face, x, x_dot):
    """(signed distance of x from the surface of the face, unit vector away from it, its rate, way
    of x beyond the edge of the face over the size of the solid, negative within)."""


def whole(x: Any) -> Any:
    """1 or -1 where x is that but for rounding, else 0."""
    return where(x >= 1.0 - SQUARE, 1.0, where(x <= SQUARE - 1.0, -1.0, 0.0))


@face_of.register(Box)
def face_of_box(box, u):
    return (whole(u[0]), whole(u[1]), whole(u[2]))


@off_face.register(Box)
def off_face_of_box(box, face, x, x_dot):
    far, half = sub(x, box.centre), box.half
    across = [abs(face[i]) * half[i] for i in range(3)]
    beyond = [where(abs(face[i]) > 0.5, -half[i], abs(far[i]) - half[i]) for i in range(3)]
    over = maximum(maximum(beyond[0], beyond[1]), beyond[2])
    size = maximum(maximum(half[0], half[1]), half[2])
    return dot(face, far) - (across[0] + across[1] + across[2]), face, ZERO, over / size


@face_of.register(Cylinder)
def face_of_cylinder(cylinder, u):
    along = dot(u, cylinder.axis)
    return (whole(along), where(abs(along) <= SQUARE, 1.0, 0.0), 0.0)


@off_face.register(Cylinder)
def off_face_of_cylinder(cylinder, face, x, x_dot):
    along, _, wide, out, out_dot = about_axis(cylinder, x, x_dot)
    beside, above = wide - cylinder.radius, abs(along) - cylinder.half
    on_end, size = abs(face[0]) > 0.5, maximum(cylinder.radius, cylinder.half)
    distance = where(on_end, face[0] * along - cylinder.half, beside)
    u = where(on_end, scale(face[0], cylinder.axis), out)
    return distance, u, where(on_end, ZERO, out_dot), where(on_end, beside, above) / size


def point_on_solid_touching(pair: PointOnSolid, B: Any, A: Any, before: Lean) -> tuple[Touch, Lean]:
    """(Touch, Lean) of the point, given the Lean at the start of the step: `low` is the face that
    holds it, zero where none is known, and `sense` is ABSENT where it has left that."""
    c, v = carried_point(B, pair.r_B)
    x, x_dot = into_solid(A, c, v)
    near, u, u_dot = nearest(pair.surface, x, x_dot)
    distance, away, away_dot, over = off_face(pair.surface, before.low, x, x_dot)
    known: Vec3 = before.low
    held = (before.sense != IN_FLIGHT) & (dot(known, known) > 0.5)
    gap = where(held, distance, near)
    u, u_dot = where(held, away, u), where(held, away_dot, u_dot)
    low = where(held, known, face_of(pair.surface, u))
    n, n_dot = out_of_solid(A, u, u_dot)
    sense = where(held & (over > OVER), ABSENT, before.sense)
    return Touch(gap, n, n_dot, c, v), Lean(low, ZERO, sense)


@touching.register(PointOnSolid)
def point_on_solid(pair, B, A):
    return point_on_solid_touching(pair, B, A, UPRIGHT._replace(sense=IN_FLIGHT))[0]
