# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Constraints of a few rows: distance, string, plane, parallel, velocity, fixed axis."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from rb_sim.catalogue import friction
from rb_sim.catalogue.constraints.rows import (
    DistanceRow,
    ParallelRow,
    PlaneRow,
    PointRow,
    SlotRow,
    VelocityRow,
)
from rb_sim.catalogue.contact import Compliance, ContactLaw, ContactRow, Touching
from rb_sim.catalogue.geometry import pairs as carriers
from rb_sim.catalogue.geometry.pairs import BallOnSphere
from rb_sim.catalogue.spec import (
    Finite,
    Name,
    NonNegative,
    Part,
    Place,
    Positive,
    Spec,
    UnitVector3,
    Vec3,
    Vector3,
    refuse,
    refuse_at,
)
from rb_sim.numerics.vectors import ZERO, add, norm, perpendicular, rotate, scale, sub


def distance_at_start(place: Place, body: str, r_B: Vec3, parent: str | None, r_A: Vec3) -> float:
    """Initial distance of two points, each given from the centre of mass of its body [m]."""
    B, A = place.state(body), place.state(parent)
    return norm(sub(add(B.p_WC, rotate(B.q_WB, r_B)), add(A.p_WC, rotate(A.q_WB, r_A))))


class Distance(Spec):
    """Rigid massless rod between point_B and point_A."""

    type: Literal["distance"]
    body: Name
    parent: Name | None = None
    point_B: Vector3 = ZERO
    """end of the rod on the body, from its origin, body axes [m]."""
    point_A: Vector3
    """end of the rod on the parent, from its origin, or in the world [m]."""
    length: Positive | None = None
    """length of the rod [m]; default: the initial distance of its ends."""

    EQUATION: ClassVar[str] = r"""
    $$
    |\mathbf p_B - \mathbf p_A| = \ell , \qquad
    \mathbf F = \lambda\,\frac{\mathbf p_B - \mathbf p_A}{\ell}
    $$

    The force acts on the body at `point_B`; $\lambda > 0$ pushes.
    """

    def parts(self, place: Place) -> list[Part]:
        """One DistanceRow; `length` defaults to the initial distance of the points [m].

        Raises ValueError if the points coincide at the start.
        """
        r_B, r_A = (
            place.from_com(self.body, self.point_B),
            place.from_com(self.parent, self.point_A),
        )
        distance = distance_at_start(place, self.body, r_B, self.parent, r_A)
        if distance == 0.0:  # a given length does not define a direction either
            raise ValueError("its points coincide at the start; move them apart or use fixed_point")
        return [Part(DistanceRow(r_B, r_A, self.length or distance))]


class Plane(Spec):
    """point_B of the body stays in the plane through point_A with normal_A."""

    type: Literal["plane"]
    body: Name
    parent: Name | None = None
    point_B: Vector3 = ZERO
    """the point that stays in the plane, from the body origin, body axes [m]."""
    point_A: Vector3 | None = None
    """a point of the plane, on the parent or in the world [m]; default: the initial position of
    point_B."""
    normal_A: UnitVector3
    """normal to the plane, axes of the parent or the world."""

    EQUATION: ClassVar[str] = r"""
    $$
    \mathbf n_A\cdot(\mathbf p_B - \mathbf p_A) = 0 , \qquad \mathbf F = \lambda\,\mathbf n_A
    $$

    The force acts on the body at `point_B`; $\mathbf n_A$ is `normal_A`.
    """

    def parts(self, place: Place) -> list[Part]:
        """One PlaneRow."""
        r_B = place.from_com(self.body, self.point_B)
        r_A = place.partner_point(self.parent, self.point_A, self.body, self.point_B)
        return [Part(PlaneRow(r_B, r_A, self.normal_A))]


class Parallel(Spec):
    """axis_B of the body stays parallel to axis_A; the reaction is a torque normal to it."""

    type: Literal["parallel"]
    body: Name
    parent: Name | None = None
    axis_B: UnitVector3
    """axis of the body, body axes."""
    axis_A: UnitVector3 | None = None
    """direction of the axis, axes of the parent or the world; default: the initial direction of
    axis_B."""

    EQUATION: ClassVar[str] = r"""
    $$
    \mathbf e_B\cdot\mathbf s = \mathbf e_B\cdot\mathbf t = 0
    $$

    $\mathbf e_B$ is `axis_B`; $\mathbf s$ and $\mathbf t$ are two directions of the parent normal
    to `axis_A`.
    """

    def parts(self, place: Place) -> list[Part]:
        """One ParallelRow."""
        n_A = place.partner_axis(self.parent, self.axis_A, self.body, self.axis_B)
        return [Part(ParallelRow(self.axis_B, *perpendicular(n_A)))]


class Velocity(Spec):
    """General linear constraint on the velocity of point_B and the angular velocity (LL 38.2).

    Coefficients are constant in the body's or in the world's axes. A knife edge along x: linear
    [0, 1, 0] in body axes.
    """

    type: Literal["velocity"]
    body: Name
    point_B: Vector3 = ZERO
    """P, from the body origin, body axes [m]."""
    linear: Vector3 = ZERO
    """coefficients of the velocity of P, dimensionless."""
    angular: Vector3 = ZERO
    """coefficients of the angular velocity [m]; dimensionless if `linear` is zero."""
    frame: Literal["world", "body"] = "body"
    """axes in which `linear` and `angular` are constant."""
    rate: Finite = 0.0
    """right-hand side [m/s]; [rad/s] if `linear` is zero."""

    EQUATION: ClassVar[str] = r"""
    $$
    \mathbf a\cdot\mathbf v_P + \mathbf b\cdot\boldsymbol\omega = r , \qquad
    \mathbf F = \lambda\,\mathbf a , \quad \mathbf K = \lambda\,\mathbf b
    $$

    $\mathbf a$ is `linear`, $\mathbf b$ `angular`, $r$ `rate`; $\mathbf v_P$ is the velocity of
    `point_B`, where the force acts.
    """

    def parts(self, place: Place) -> list[Part]:
        """One VelocityRow.

        Raises: an error of the scene if all coefficients are zero.
        """
        if self.linear == ZERO and self.angular == ZERO:
            raise refuse("a velocity constraint with a coefficient that is not zero")
        r_B = place.from_com(self.body, self.point_B)
        in_body = self.frame == "body"
        return [Part(VelocityRow(r_B, self.linear, self.angular, self.rate, in_body))]


class FixedAxis(Spec):
    """The body turns about an axis on two bearings.

    Bearing A sits at point_B of the body, bearing B at point_B + bearing_distance axis_B. Both
    carry transverse force. The `floating` bearing carries no axial force. With `floating: none` the
    axial load distribution is not unique; the minimum-norm one, half each, is reported.

    Outputs: NAME, the total about bearing A; NAME/A and NAME/B, a force at each bearing.
    """

    type: Literal["fixed_axis"]
    body: Name
    parent: Name | None = None
    point_B: Vector3 = ZERO
    """position of bearing A, from the body origin, body axes [m]."""
    axis_B: UnitVector3
    """direction of the axis from bearing A to bearing B, body axes."""
    point_A: Vector3 | None = None
    """position of bearing A on the parent, from its origin, or in the world [m]; default: the
    initial position of point_B."""
    axis_A: UnitVector3 | None = None
    """direction of the axis in the axes of the parent or the world; default: the initial direction
    of axis_B."""
    bearing_distance: Positive = 1.0
    """distance from bearing A to bearing B [m]."""
    floating: Literal["A", "B", "none"] = "B"
    """the bearing that carries no axial force."""

    EQUATION: ClassVar[str] = r"""
    $$
    \mathbf p_B = \mathbf p_A , \qquad
    \mathbf e_B\cdot\mathbf s = \mathbf e_B\cdot\mathbf t = 0 , \qquad
    \text{against the world: } J\,\ddot\varphi = K_n , \quad
    J = \mathbf n\cdot\mathbf I_O\,\mathbf n
    $$

    $\mathbf e_B$ is `axis_B`; $\mathbf s$ and $\mathbf t$ are two directions normal to `axis_A`,
    whose unit vector is $\mathbf n$. The reactions are forces at both bearings.
    """

    def reaction_suffixes(self, place: Place) -> tuple[str, ...]:
        """Suffixes "" for the total, "A" and "B" for the force at each bearing."""
        return ("", "A", "B")

    def parts(self, place: Place) -> list[Part]:
        """A PointRow at each bearing; at the floating one a SlotRow, free along the axis."""
        r_B = place.from_com(self.body, self.point_B)
        r_A = place.partner_point(self.parent, self.point_A, self.body, self.point_B)
        n_A = place.partner_axis(self.parent, self.axis_A, self.body, self.axis_B)
        far_B = add(r_B, scale(self.bearing_distance, self.axis_B))
        far_A = add(r_A, scale(self.bearing_distance, n_A))
        t1, t2 = perpendicular(n_A)
        first = SlotRow(r_B, r_A, t1, t2) if self.floating == "A" else PointRow(r_B, r_A)
        second = SlotRow(far_B, far_A, t1, t2) if self.floating == "B" else PointRow(far_B, far_A)
        return [Part(first, ("", "A")), Part(second, ("", "B"))]


INSIDE = -1.0
"""Sign of a contact from inside: point_B stays in the sphere of radius `length` about point_A."""


class Reach(Spec):
    """Ends of a string, as pictures draw it: point_B of the body and point_A."""

    type: Literal["string"] = "string"
    point_B: Vector3
    point_A: Vector3


class String(Touching):
    """Massless string: while it is taut, its tension pulls the body towards point_A.

    It is a smooth contact of point_B with the inside of a sphere of radius `length` around
    point_A; its gap is the slack. It has no mass, and passes through bodies. Events: impact, taut,
    slack. Output: NAME, the pull on the body at point_B.
    """

    type: Literal["string"]
    point_B: Vector3 = ZERO
    """end of the string on the body, from the body origin, body axes [m]."""
    point_A: Vector3
    """other end of the string, on the parent from its origin, or in the world [m]."""
    length: Positive | None = None
    """largest distance of the ends [m]; default: the initial distance (just taut)."""
    restitution: Annotated[NonNegative, Field(le=1.0)] = 0.0
    """coefficient of restitution e of the jerk: approach speed of the ends after it over separation
    speed before it."""
    compliance: Compliance | None = None
    """stiffness and damping of an elastic string: N = stiffness (distance - length) + damping (rate
    of the distance), at least 0."""

    EQUATION: ClassVar[str] = r"""
    $$
    g = \ell - |\mathbf p_B - \mathbf p_A| \ge 0 , \quad N \ge 0 , \quad N g = 0 , \qquad
    \mathbf F = N\,\frac{\mathbf p_A - \mathbf p_B}{|\mathbf p_B - \mathbf p_A|}
    $$

    $$
    \text{jerk: } \dot g^{+} = -e\,\dot g^{-} , \qquad
    \text{elastic, } g < 0: \; N = \max\left(0,\; -k\,g - c\,\dot g\right)
    $$

    The force acts on the body at `point_B`.
    """

    @model_validator(mode="after")
    def _no_jerk_of_an_elastic_one(self) -> String:
        if self.compliance is not None and self.restitution > 0.0:
            allowed = refuse("omitted for an elastic string (compliance)")
            raise refuse_at((("restitution",), self.restitution, allowed))
        return self

    def law(self) -> ContactLaw:
        """Law of a frictionless contact with the string's restitution and compliance; closed means
        taut."""
        soft = self.compliance
        return ContactLaw(
            restitution=self.restitution,
            bilateral=False,
            compliant=soft is not None,
            static=0.0,
            kinetic=0.0,
            rolling_arm=0.0,
            spinning_arm=0.0,
            spring=(0.0, 0.0) if soft is None else soft.spring,
            closes="taut",
            opens="slack",
        )

    def parts(self, place: Place) -> list[Part]:
        """One ContactRow: point_B as a ball of radius 0 inside a sphere about point_A."""
        r_B = place.from_com(self.body, self.point_B)
        r_A = place.from_com(self.parent, self.point_A)
        pair = BallOnSphere(r_B, 0.0, r_A, self._length(place, r_B, r_A), INSIDE)
        spring = () if self.compliance is None else self.compliance.spring
        row = ContactRow(
            pair, friction.Smooth(), friction.NoResistance(), carriers.Resting(), spring
        )
        return [Part(row)]

    def _length(self, place: Place, r_B: tuple, r_A: tuple) -> float:
        if self.length is not None:
            return float(self.length)
        length = distance_at_start(place, self.body, r_B, self.parent, r_A)
        if length == 0.0:
            raise ValueError("its points coincide at the start; move them apart or give a length")
        return length

    @property
    def surface(self) -> Reach:
        """The ends of the string, as pictures draw it."""
        return Reach(point_B=self.point_B, point_A=self.point_A)
