# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Short form of supports, as `supports` of a scene lists them: each acts at one point of a body.

Each is a constraint like the others, except `contact`, which is converted to the contact of a point
of the body with a plane of its parent.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import AfterValidator, model_validator

from rb_sim.base.rounding import WRITTEN_ROUNDING
from rb_sim.catalogue.constraints.joints import Weld
from rb_sim.catalogue.constraints.rows import ParallelRow, PointRow
from rb_sim.catalogue.constraints.simple import Distance, String
from rb_sim.catalogue.contact import Contact, CoulombLaw, RoughLaw, SmoothLaw
from rb_sim.catalogue.spec import (
    Name,
    Part,
    Place,
    Quaternion,
    Spec,
    UnitVector3,
    Vec3,
    Vector3,
    refuse,
    refuse_at,
)
from rb_sim.catalogue.surfaces import PlaneSurface
from rb_sim.numerics.vectors import ZERO, add, dot, norm, perpendicular, rotate, sub, unrotate


class Pose(NamedTuple):
    """Initial pose of a body's origin and axes; without arguments that of the world."""

    position: Vec3 = ZERO
    """origin of the body, world [m]."""
    orientation: Quaternion = (0.0, 0.0, 0.0, 1.0)
    """[x, y, z, w], body to world."""
    shape: Any = None

    def point(self, p: Vec3) -> Vec3:
        """World position of the body's point p [m]."""
        return add(self.position, rotate(self.orientation, p))

    def local(self, p: Vec3) -> Vec3:
        """Body coordinates of the world point p [m]."""
        return unrotate(self.orientation, sub(p, self.position))


def _coefficient(value: Any) -> Any:
    """Validator: "smooth", "rough" or a finite coefficient >= 0."""
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if value in ("smooth", "rough") or (number and math.isfinite(value) and value >= 0.0):
        return value
    raise refuse("smooth, rough or a coefficient of friction >= 0")


class PointContact(Spec):
    """Point contact: N >= 0 along the normal, |friction force| <= friction N tangentially.

    Give the point on one side, point_B or point_A, and the normal on one side; if both points are
    given they must coincide. An edge has no normal: give normal_B of the body in contact with it,
    for bodies at rest.
    """

    type: Literal["contact"]
    body: Name
    parent: Name | None = None
    point_B: Vector3 | None = None
    point_A: Vector3 | None = None
    normal_B: UnitVector3 | None = None
    """normal pointing into the body, body axes."""
    normal_A: UnitVector3 | None = None
    """normal pointing into the body, axes of the parent."""
    friction: Annotated[Any, AfterValidator(_coefficient)] = "smooth"
    """smooth: frictionless; a number: Coulomb's coefficient; rough: any tangential force."""

    @model_validator(mode="after")
    def _one_side(self) -> PointContact:
        if self.point_B is None and self.point_A is None:
            raise refuse("a contact with point_B (on the body) or point_A (on the parent)")
        if (self.normal_B is None) == (self.normal_A is None):
            raise refuse("a contact with one normal: normal_A or normal_B, pointing into the body")
        return self

    def written_out(self, B: Pose, A: Pose) -> Contact:
        """The equivalent contact of the point with a plane of the parent, for the initial poses.

        Raises ValidationError if both points are given and differ, or a point lies beyond the end
        of a rod.
        """
        at = B.point(self.point_B) if self.point_B is not None else A.point(self.point_A or ZERO)
        if self.point_A is not None and (apart := norm(sub(A.point(self.point_A), at))):
            if apart > WRITTEN_ROUNDING * max(1.0, norm(at)):
                allowed = f"the same point as point_B (they are {apart:.3g} m apart)"
                raise refuse_at((("point_A",), list(self.point_A), refuse(allowed)))
        for name, pose in ((self.body, B), (self.parent, A)):
            if (beyond := beyond_the_end(pose, at)) > 0.0:
                field = "point_A" if self.point_B is None else "point_B"
                allowed = f"a point of rod {name} (this one is {beyond:.3g} m beyond its end)"
                raise refuse_at(((field,), list(getattr(self, field)), refuse(allowed)))
        normal: Vec3 = self.normal_A or ZERO
        if self.normal_B is not None:
            normal = unrotate(A.orientation, rotate(B.orientation, self.normal_B))
        laws = {"smooth": SmoothLaw(), "rough": RoughLaw()}
        law = laws.get(self.friction) or CoulombLaw(static=float(self.friction))
        return Contact(
            type="contact",
            body=self.body,
            parent=self.parent,
            points=(self.point_B if self.point_B is not None else B.local(at),),
            surface=PlaneSurface(point=self.point_A or A.local(at), normal=normal),
            friction=law,
        )


def beyond_the_end(pose: Pose, point: Vec3) -> float:
    """Distance by which a world point lies beyond the end of a rod, along its axis [m].

    0 if it does not, or if the body is not a rod.
    """
    if getattr(pose.shape, "type", "") != "rod":
        return 0.0
    centre = pose.point(pose.shape.center_B)
    along = abs(dot(sub(point, centre), rotate(pose.orientation, pose.shape.axis_B)))
    beyond = along - 0.5 * pose.shape.length
    return beyond if beyond > WRITTEN_ROUNDING * max(1.0, norm(point), norm(centre)) else 0.0


class Rod(Distance):
    """Light rod hinged at both ends: an axial force of either sign."""

    type: Literal["rod"]  # type: ignore[assignment]


class Hinge(Spec):
    """Frictionless hinge: a force in any direction; with an axis (pin) also torques normal to
    it."""

    type: Literal["hinge"]
    body: Name
    parent: Name | None = None
    point_B: Vector3 | None = None
    """hinge point on the body, from the body origin, body axes [m]; default: the place of point_A,
    or the body origin."""
    point_A: Vector3 | None = None
    """hinge point on the parent, from its origin, or in the world [m]; default: the place of
    point_B."""
    axis_B: UnitVector3 | None = None
    """axis of a pin, about which the body turns freely, body axes; without an axis: a ball
    joint."""
    axis_A: UnitVector3 | None = None
    """the same axis, in the axes of the parent."""

    EQUATION: ClassVar[str] = r"""
    $$
    \mathbf p_B = \mathbf p_A , \qquad
    \text{with an axis: } \mathbf e_B\cdot\mathbf s = \mathbf e_B\cdot\mathbf t = 0
    $$

    $\mathbf s$ and $\mathbf t$ are two directions normal to `axis_A`. The reaction is a force at
    `point_B`, and a torque normal to the axis.
    """

    @model_validator(mode="after")
    def _one_axis(self) -> Hinge:
        if self.axis_B is not None and self.axis_A is not None:
            raise refuse("a hinge with at most one of axis_B and axis_A")
        return self

    def parts(self, place: Place) -> list[Part]:
        """A PointRow; with an axis, given on the body or on the parent, also a ParallelRow."""
        if self.point_B is None and self.point_A is not None:
            r_A = place.from_com(self.parent, self.point_A)
            r_B = place.partner_point(self.body, None, self.parent, self.point_A)
        else:
            r_B = place.from_com(self.body, self.point_B or ZERO)
            r_A = place.partner_point(self.parent, self.point_A, self.body, self.point_B or ZERO)
        parts = [Part(PointRow(r_B, r_A))]
        if self.axis_B is not None:
            n_A = place.partner_axis(self.parent, None, self.body, self.axis_B)
            parts.append(Part(ParallelRow(self.axis_B, *perpendicular(n_A))))
        elif self.axis_A is not None:
            n_B = place.partner_axis(self.body, None, self.parent, self.axis_A)
            parts.append(Part(ParallelRow(n_B, *perpendicular(self.axis_A))))
        return parts


SUPPORTS: dict[str, type[Spec]] = {
    "string": String,
    "rod": Rod,
    "contact": PointContact,
    "hinge": Hinge,
    "weld": Weld,
}
