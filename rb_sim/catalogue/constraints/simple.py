# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Constraints of one or two rows: distance, plane, parallel, velocity."""

from __future__ import annotations

from typing import ClassVar, Literal

from rb_sim.catalogue.constraints.rows import DistanceRow, ParallelRow, PlaneRow, VelocityRow
from rb_sim.catalogue.spec import Finite, Name, Positive, Spec, UnitVector3, Vector3, refuse
from rb_sim.catalogue.types import Part, Place, Vec3
from rb_sim.numerics.vectors import ZERO, add, norm, perpendicular, rotate, sub


def distance_at_start(place: Place, body: str, r_B: Vec3, parent: str | None, r_A: Vec3) -> float:
    """How far two points, each from the centre of mass of its body, are apart at the start [m]."""
    B, A = place.state(body), place.state(parent)
    return norm(sub(add(B.p_WC, rotate(B.q_WB, r_B)), add(A.p_WC, rotate(A.q_WB, r_A))))


class Distance(Spec):
    """Rigid massless rod: |p_B - p_A| = length."""

    type: Literal["distance"]
    body: Name
    parent: Name | None = None
    point_B: Vector3 = ZERO
    """end of the rod on the body, from its origin, body axes [m]."""
    point_A: Vector3
    """end of the rod on the parent, from its origin, or in the world [m]."""
    length: Positive | None = None
    """length of the rod [m]."""

    EQUATION: ClassVar[str] = """
    |p_B - p_A| = length
    on the body: the force lambda (p_B - p_A) / length at point_B; lambda > 0 pushes
    """

    def parts(self, place: Place) -> list[Part]:
        """One DistanceRow; a length that is not given is that at the start [m].

        Raises ValueError if the points coincide at the start.
        """
        r_B, r_A = (
            place.from_com(self.body, self.point_B),
            place.from_com(self.parent, self.point_A),
        )
        distance = distance_at_start(place, self.body, r_B, self.parent, r_A)
        if distance == 0.0:  # a length that is given does not tell in which direction, either
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
    """a point of the plane, on the parent or in the world [m]."""
    normal_A: UnitVector3
    """normal to the plane, axes of the parent or the world."""

    EQUATION: ClassVar[str] = """
    normal_A . (p_B - p_A) = 0
    on the body: the force lambda normal_A at point_B
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
    """direction that the axis keeps, axes of the parent or the world."""

    EQUATION: ClassVar[str] = """
    axis_B . s = axis_B . t = 0      s, t: two directions of the parent normal to axis_A
    on the body: a torque normal to the axis
    """

    def parts(self, place: Place) -> list[Part]:
        """One ParallelRow."""
        n_A = place.partner_axis(self.parent, self.axis_A, self.body, self.axis_B)
        return [Part(ParallelRow(self.axis_B, *perpendicular(n_A)))]


class Velocity(Spec):
    """General linear velocity constraint: linear . v_P + angular . w = rate (LL 38.2).

    Coefficients are constant in the body's or in the world's axes; v_P is the velocity of point_B,
    w the angular velocity.  A knife edge along x: linear [0, 1, 0] in body axes.
    """

    type: Literal["velocity"]
    body: Name
    point_B: Vector3 = ZERO
    """P, from the body origin, body axes [m]."""
    linear: Vector3 = ZERO
    """factors of the velocity of P, without a unit."""
    angular: Vector3 = ZERO
    """factors of the angular velocity [m]; without a unit if `linear` is zero."""
    frame: Literal["world", "body"] = "body"
    """axes in which `linear` and `angular` are constant."""
    rate: Finite = 0.0
    """right-hand side [m/s]; [rad/s] if `linear` is zero."""

    EQUATION: ClassVar[str] = """
    linear . v_P + angular . w = rate
    on the body: the force lambda linear at point_B and the torque lambda angular
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
