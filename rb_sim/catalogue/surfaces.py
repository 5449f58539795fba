# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Contact points of each body shape, and the kinds of supports.

A sphere touches at one point; an ellipsoid or a disk at the point of its surface nearest to the
support; a cylinder at the nearest points of its two rims, and at five more for a rim that may lie
flat on a plane; a box at its 8 corners, a rod at its two ends; or the scene lists the points. On
the outside of a sphere each shape touches at the one nearest point of its whole surface, or of the
convex hull of the points. The support is a plane, a sphere or a cylinder (outside or inside), fixed
in the world or in the parent body, or the parent's own sphere, box or cylinder.
"""

from __future__ import annotations

import math
from itertools import chain
from typing import Any, Literal, NamedTuple

from rb_sim.catalogue.geometry import corners_and_rims, curved, pairs, solids
from rb_sim.catalogue.geometry.corners_and_rims import RimOnCylinder
from rb_sim.catalogue.geometry.hull import hull_of
from rb_sim.catalogue.geometry.smooth_surfaces import EllipsoidSurface, LyingRimSurface
from rb_sim.catalogue.geometry.smooth_surfaces import SphereSurface as BallSurface
from rb_sim.catalogue.spec import Place, Positive, Spec, UnitVector3, Vec3, Vector3, refuse
from rb_sim.numerics.vectors import ZERO, add, scale, sub


class PlaneSurface(Spec):
    """Half space below the plane through `point` with `normal` (towards the body)."""

    type: Literal["plane"] = "plane"
    point: Vector3 = ZERO
    """a point of the plane [m]."""
    normal: UnitVector3 = (0.0, 0.0, 1.0)
    """normal of the plane, towards the body."""


class SphereSurface(Spec):
    """Sphere that the body touches from outside or, as a bowl, from inside."""

    type: Literal["sphere"] = "sphere"
    center: Vector3 = ZERO
    """centre of the sphere [m]."""
    radius: Positive
    """radius of the sphere [m]."""
    side: Literal["outside", "inside"] = "outside"
    """side of the surface on which the body is."""


class CylinderSurface(Spec):
    """Infinite circular cylinder that the body touches from inside or from outside."""

    type: Literal["cylinder"] = "cylinder"
    point: Vector3 = ZERO
    """a point of the axis [m]."""
    axis: UnitVector3 = (0.0, 0.0, 1.0)
    """direction of the axis."""
    radius: Positive
    """radius of the cylinder [m]."""
    side: Literal["outside", "inside"] = "inside"
    """side of the surface on which the body is."""


class BodySurface(Spec):
    """The parent's own shape: a sphere, a box or a cylinder."""

    type: Literal["shape"] = "shape"


SURFACES: dict[str, type[Spec]] = {
    "plane": PlaneSurface,
    "sphere": SphereSurface,
    "cylinder": CylinderSurface,
    "shape": BodySurface,
}
"""Surfaces by the name of their type. One with a method `pairs(place, body, parent, points)` makes
its own pairs."""


RIM_POINTS = 6
"""Number of points that support a rim lying flat: the inscribed circle of their polygon has 0.87 of
its radius."""


class Flat(NamedTuple):
    """A plane, in the parent's coordinates from its centre of mass."""

    r_A: Vec3
    n_A: Vec3


class Round(NamedTuple):
    """A sphere, or with an axis an infinite cylinder; side +1 is outside, -1 inside."""

    r_A: Vec3
    axis_A: Vec3 | None
    radius: float
    side: float


class Solid(NamedTuple):
    """The parent's own box or cylinder."""

    surface: NamedTuple


Support = Flat | Round | Solid


def support_of(place: Place, parent: str | None, surface: Any) -> Support:
    """The support that the surface describes."""
    if isinstance(surface, PlaneSurface):
        return Flat(place.from_com(parent, surface.point), surface.normal)
    if isinstance(surface, BodySurface):
        shape = place.shape(parent)  # type: ignore[arg-type]
        if shape is None or shape.type not in ("sphere", "box", "cylinder"):
            kind = "none" if shape is None else shape.type
            raise refuse(f"on a parent whose shape is sphere, box or cylinder; {parent} has {kind}")
        r_A = place.from_com(parent, shape.center_B)
        if shape.type == "sphere":
            return Round(r_A, None, shape.radius, 1.0)
        return Solid(SOLIDS[shape.type](r_A, shape))
    side = 1.0 if surface.side == "outside" else -1.0
    if isinstance(surface, SphereSurface):
        return Round(place.from_com(parent, surface.center), None, surface.radius, side)
    return Round(place.from_com(parent, surface.point), surface.axis, surface.radius, side)


def pairs_of(
    place: Place,
    body: str,
    parent: str | None,
    surface: Any,
    points: Any,
    lies_flat: bool | None = None,
    opens_rigidly: bool = True,
    bilateral: bool = False,
) -> list[NamedTuple]:
    """The compiled pair of each contact point; refuses a shape that cannot touch the surface.

    lies_flat: a rim touches a plane at RIM_POINTS points; None: only for a cylinder whose contact
    `opens_rigidly`.
    bilateral: a rim on a cylinder uses the first of its two points only.
    """
    if hasattr(surface, "pairs"):
        return surface.pairs(place, body, parent, points)
    support = support_of(place, parent, surface)
    shape = place.shape(body)
    has_rims = points is None and shape is not None and shape.type in RIMS
    if lies_flat is not None and not (has_rims and isinstance(support, Flat)):
        raise refuse("a disk or a cylinder on a plane, where lies_flat is given")
    ball = on_outer_sphere(support)
    if points is not None:
        listed = [place.from_com(body, p) for p in points]
        if ball is not None and len(listed) > 1:
            return [pairs.SolidOnSphere(hull_of(listed), ball.r_A, ball.radius)]
        return [ball_on(support, p, 0.0) for p in listed]
    if shape is None:
        kinds = ", ".join(MAKERS)
        raise refuse(f"on a body with a shape ({kinds}) or with points; {body} has none")
    centre = place.from_com(body, shape.center_B)
    if ball is not None and shape.type in SOLIDS:
        return [pairs.SolidOnSphere(SOLIDS[shape.type](centre, shape), ball.r_A, ball.radius)]
    if has_rims and isinstance(support, Flat):
        flat = shape.type == "cylinder" and opens_rigidly if lies_flat is None else lies_flat
        rims_of_points = [
            rim_points(rim, shape, support, RIM_POINTS if flat else 1)
            for rim in rims_of(centre, shape)
        ]
        low, others = [p[0] for p in rims_of_points], [p[1:] for p in rims_of_points]
        return [*low, *chain.from_iterable(others)]
    found = MAKERS[shape.type](centre, shape, support)
    if found is None:
        kinds = ", ".join(touched_by(centre, shape))
        raise refuse(f"on one of {kinds}, which its {shape.type} can touch, or with given points")
    return [pair for pair in found if not (bilateral and getattr(pair, "second", 0.0))]


def ball_on(support: Support, centre: Vec3, radius: float) -> NamedTuple:
    """The pair of a ball (or a point, with radius 0) and the support."""
    if isinstance(support, Flat):
        if radius > 0.0:
            return pairs.SurfaceOnPlane(BallSurface(centre, radius), support.r_A, support.n_A)
        return pairs.PointOnPlane(centre, support.r_A, support.n_A)
    if isinstance(support, Solid):
        return pairs.BallOnSolid(centre, radius, support.surface)
    r_A, axis, curved_radius, side = support
    if side < 0.0 and radius >= curved_radius:
        kind = "sphere" if axis is None else "cylinder"
        raise refuse(f"on a ball smaller than the {kind} that it is in ({curved_radius:g} m)")
    if axis is None:
        return pairs.BallOnSphere(centre, radius, r_A, curved_radius, side)
    return pairs.BallOnCylinder(centre, radius, r_A, axis, curved_radius, side)


def smooth_on(support: Support, surface: NamedTuple) -> NamedTuple | None:
    """The pair of a smooth convex surface and the support; None if there is none."""
    if isinstance(support, Flat):
        return pairs.SurfaceOnPlane(surface, support.r_A, support.n_A)
    if isinstance(support, Solid):
        return None
    r_A, axis, radius, side = support
    if axis is None:
        return curved.SurfaceOnSphere(surface, r_A, radius, side)
    return curved.SurfaceOnCylinder(surface, r_A, axis, radius, side)


def on_outer_sphere(support: Support) -> Round | None:
    """The support if it is a sphere touched from outside, else None."""
    outer = isinstance(support, Round) and support.axis_A is None and support.side > 0.0
    return support if outer else None  # type: ignore[return-value]


def box_solid(centre: Vec3, shape: Any) -> NamedTuple:
    """The box as a solid with its centre and half edges."""
    x, y, z = shape.size
    return solids.Box(centre, (0.5 * x, 0.5 * y, 0.5 * z))


def cylinder_solid(centre: Vec3, shape: Any) -> NamedTuple:
    """The solid of a cylinder, or of a disk (length 0)."""
    half = 0.5 * getattr(shape, "length", 0.0)
    return solids.Cylinder(centre, shape.radius, half, shape.axis_B)


def rod_solid(centre: Vec3, shape: Any) -> NamedTuple:
    """The rod as a solid with one end, direction and length."""
    end = sub(centre, scale(0.5 * shape.length, shape.axis_B))
    return solids.Rod(end, shape.axis_B, shape.length)


SOLIDS = {
    "disk": cylinder_solid,
    "cylinder": cylinder_solid,
    "box": box_solid,
    "rod": rod_solid,
}
"""Shapes that touch a sphere from outside at the nearest point of their whole surface."""


def all_or_none(found: list[NamedTuple | None]) -> list[NamedTuple] | None:
    """The pairs of all points; None if one of them cannot touch the support."""
    kept = [pair for pair in found if pair is not None]
    return kept if len(kept) == len(found) else None


def sphere_pairs(centre: Vec3, shape: Any, support: Support) -> list[NamedTuple] | None:
    """The one contact pair of a sphere."""
    return [ball_on(support, centre, shape.radius)]


def ellipsoid_pairs(centre: Vec3, shape: Any, support: Support) -> list[NamedTuple] | None:
    """The contact pair of an ellipsoid; refused if two of its points could touch the inside of a
    round support at once."""
    flattest = max(shape.semi_axes) ** 2 / min(shape.semi_axes)
    if isinstance(support, Round) and support.side < 0.0 and flattest >= support.radius:
        raise refuse(
            f"on an ellipsoid whose largest radius of curvature (largest semi-axis squared over "
            f"the smallest), {flattest:g} m, is below the radius of the hollow, "
            f"{support.radius:g} m; otherwise two of its points may touch at once"
        )
    return all_or_none([smooth_on(support, EllipsoidSurface(centre, shape.semi_axes))])


RIMS = ("disk", "cylinder")
"""Shapes with rims."""


def rims_of(centre: Vec3, shape: Any) -> list[Vec3]:
    """Centres of the rims of a disk or a cylinder."""
    if shape.type == "disk":
        return [centre]
    half = scale(0.5 * shape.length, shape.axis_B)
    return [add(centre, half), sub(centre, half)]


def rim_points(centre: Vec3, shape: Any, support: Flat, count: int) -> list[NamedTuple]:
    """The lowest point of a rim and further points at equal angles from it."""
    turns = [2.0 * math.pi * i / count for i in range(count)]
    alone = 1.0 if count == 1 else 0.0
    sizes = centre, shape.radius, shape.axis_B
    return [
        corners_and_rims.RimOnPlane(
            *sizes, math.cos(a), math.sin(a), alone, support.r_A, support.n_A
        )
        for a in turns
    ]


def rim_pairs(centre: Vec3, shape: Any, support: Support) -> list[NamedTuple] | None:
    """The pairs of rims on a round support; None outside a cylinder for a cylinder, which would
    touch with its side."""
    if shape.type == "cylinder" and isinstance(support, Round) and support.side > 0.0:
        return None
    centres = rims_of(centre, shape)
    if isinstance(support, Round) and support.axis_A is not None:
        cylinder = support.r_A, support.axis_A, support.radius, support.side
        found: list[NamedTuple] = [
            RimOnCylinder(rim, shape.radius, shape.axis_B, *cylinder, second)
            for second in (0.0, 1.0)
            for rim in centres
        ]
        return found
    lying = [LyingRimSurface(rim, shape.radius, shape.axis_B) for rim in centres]
    return all_or_none([smooth_on(support, rim) for rim in lying])


def box_pairs(centre: Vec3, shape: Any, support: Support) -> list[NamedTuple] | None:
    """The contact pairs of the 8 corners of a box."""
    x, y, z = (0.5 * edge for edge in shape.size)
    signs = [(i, j, k) for k in (-1, 1) for j in (-1, 1) for i in (-1, 1)]
    return [ball_on(support, add(centre, (i * x, j * y, k * z)), 0.0) for i, j, k in signs]


def rod_pairs(centre: Vec3, shape: Any, support: Support) -> list[NamedTuple] | None:
    """The contact pairs of the 2 ends of a rod."""
    arm = scale(0.5 * shape.length, shape.axis_B)
    return [ball_on(support, end, 0.0) for end in (add(centre, arm), sub(centre, arm))]


MAKERS = {
    "sphere": sphere_pairs,
    "ellipsoid": ellipsoid_pairs,
    "disk": rim_pairs,
    "cylinder": rim_pairs,
    "box": box_pairs,
    "rod": rod_pairs,
}
"""Functions that make the contact pairs of each shape on other supports; None if it cannot
touch."""

ORIGIN, UPWARD = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)

WIDE: dict[str, Support] = {
    "plane": Flat(ORIGIN, UPWARD),
    "sphere": Round(ORIGIN, None, math.inf, 1.0),
    "sphere from inside": Round(ORIGIN, None, math.inf, -1.0),
    "cylinder": Round(ORIGIN, UPWARD, math.inf, 1.0),
    "cylinder from inside": Round(ORIGIN, UPWARD, math.inf, -1.0),
    "box of a parent": Solid(solids.Box(ORIGIN, (math.inf, math.inf, math.inf))),
}
"""A support of each kind, larger than any shape."""


def touched_by(centre: Vec3, shape: Any) -> list[str]:
    """The kinds of support that a shape can touch."""
    return [
        name
        for name, support in WIDE.items()
        if (shape.type in SOLIDS and on_outer_sphere(support) is not None)
        or MAKERS[shape.type](centre, shape, support) is not None
    ]
