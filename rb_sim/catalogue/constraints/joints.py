# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Joints of bodies: pivots, hinges, welds, and translation along a guide."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from rb_sim.catalogue.constraints.rows import CurveRow, LockRow, PointRow
from rb_sim.catalogue.curves import CircleCurve, LineCurve, curve_point, spline_through
from rb_sim.catalogue.spec import (
    Name,
    Part,
    Place,
    Points,
    Positive,
    Spec,
    UnitVector3,
    Vector3,
    refuse,
)
from rb_sim.numerics.vectors import ZERO, conjugate, perpendicular, quaternion_product


class Free(Spec):
    """No constraint: the body moves freely, as without this entry."""

    type: Literal["free"]
    body: Name

    EQUATION: ClassVar[str] = r"""
    $$
    m\,\dot{\mathbf V} = \mathbf F , \qquad
    \mathbf I\,\dot{\boldsymbol\omega} + \boldsymbol\omega\times\mathbf I\,\boldsymbol\omega
    = R^{T}\mathbf K
    $$

    The second equation is about C, in body axes.
    """

    def reaction_suffixes(self, place: Place) -> tuple[str, ...]:
        """Empty: a free body has no reaction."""
        return ()

    def parts(self, place: Place) -> list[Part]:
        """Empty: a free body has no constraint rows."""
        return []


class FixedPoint(Spec):
    """Spherical joint: point_B of the body stays at point_A."""

    type: Literal["fixed_point"]
    body: Name
    parent: Name | None = None
    point_B: Vector3 = ZERO
    """joint point on the body, from the body origin, body axes [m]."""
    point_A: Vector3 | None = None
    """joint point on the parent, from its origin, or in the world [m]; default: the initial
    position of point_B."""

    EQUATION: ClassVar[str] = r"""
    $$
    \mathbf p_B = \mathbf p_A , \qquad \mathbf V_B = \mathbf V_A
    $$

    These are `point_B` and `point_A` and the velocities of the material points there. The reaction
    is a force at `point_B`; if the parent is the world, it is
    $\mathbf R = m\,\mathbf a_C - \mathbf F$.
    """

    def parts(self, place: Place) -> list[Part]:
        """One PointRow: 3 rows that keep the two points together."""
        r_B = place.from_com(self.body, self.point_B)
        r_A = place.partner_point(self.parent, self.point_A, self.body, self.point_B)
        return [Part(PointRow(r_B, r_A))]


class Weld(Spec):
    """The body does not move relative to its parent; the reaction is about point_B."""

    type: Literal["weld"]
    body: Name
    parent: Name | None = None
    point_B: Vector3 = ZERO
    """the point about which the reaction is taken, from the body origin, body axes [m]."""

    EQUATION: ClassVar[str] = r"""
    $$
    \mathbf p_B = \mathbf p_A , \qquad q_{AB} = q_{AB}(0)
    $$

    The pose relative to the parent stays constant. The reaction is a force and a torque about
    `point_B`.
    """

    def parts(self, place: Place) -> list[Part]:
        """A PointRow and a LockRow, which keeps the relative orientation of the start."""
        r_B = place.from_com(self.body, self.point_B)
        r_A = place.partner_point(self.parent, None, self.body, self.point_B)
        return [
            Part(PointRow(r_B, r_A)),
            Part(LockRow(relative_turn(place, self.parent, self.body), r_B)),
        ]


def relative_turn(place: Place, parent: str | None, body: str) -> tuple[float, float, float, float]:
    """Initial quaternion from body axes to parent axes."""
    return quaternion_product(conjugate(place.state(parent).q_WB), place.state(body).q_WB)


class LineGuide(Spec):
    """Straight line through `point`, or through the initial position of point_B."""

    type: Literal["line"]
    direction: UnitVector3
    """direction of the line, world."""
    point: Vector3 | None = None
    """a point of the line, world [m]; default: the initial position of point_B."""


class CircleGuide(Spec):
    """Circle with a given centre, normal and radius (world)."""

    type: Literal["circle"]
    center: Vector3
    """centre of the circle, world [m]."""
    normal: UnitVector3
    """normal of the plane of the circle, world."""
    radius: Positive
    """radius of the circle [m]."""


class CurveGuide(Spec):
    """Smooth curve through points (world): a spline of degree 7 in the chord length."""

    type: Literal["curve"]
    points: Points
    """points that the curve passes through, world [m]."""
    closed: bool = False
    """whether the curve closes from the last point to the first."""

    @model_validator(mode="after")
    def _enough(self) -> CurveGuide:
        if len(self.points) < 4:
            raise refuse("a curve through at least 4 points")
        steps = np.linalg.norm(np.diff(np.array(self.points), axis=0), axis=1)
        if not np.all(steps > 0.0):
            raise refuse("a curve whose neighbouring points differ")
        return self

    def points_along(self, count: int) -> np.ndarray:
        """`count` points along the curve from its start to its end, world [m], shape (count, 3)."""
        curve = spline_through(np.array(self.points), self.closed)
        breaks = curve.pieces.breaks
        ways = np.linspace(breaks[0], breaks[-1], count).tolist()
        return np.array([curve_point(curve, s)[0] for s in ways])


class Translation(Spec):
    """The body does not turn, and point_B stays on the `guide` if given; reaction about point_B."""

    type: Literal["translation"]
    body: Name
    point_B: Vector3 = ZERO
    """guided point, about which the reaction torque is taken, from the body origin [m]."""
    guide: Annotated[LineGuide | CircleGuide | CurveGuide, Field(discriminator="type")] | None = (
        None
    )
    """curve along which point_B moves; default: none, point_B moves freely."""

    EQUATION: ClassVar[str] = r"""
    $$
    \boldsymbol\omega = 0 , \qquad \mathbf p_B = \mathbf c(s) , \qquad
    m\,\dot v = \mathbf F\cdot\boldsymbol\tau
    $$

    $\mathbf c$ is the guide, $\boldsymbol\tau$ its tangent, $v$ the speed along it. The reaction is
    a force normal to the guide and the torque that prevents rotation.
    """

    def curve(self, place: Place) -> tuple | None:
        """The guide as a compiled curve, or None."""
        guide = self.guide
        if guide is None:
            return None
        if isinstance(guide, LineGuide):
            start = place.partner_point(None, guide.point, self.body, self.point_B)
            return LineCurve(start, guide.direction)
        if isinstance(guide, CircleGuide):
            e1, e2 = perpendicular(guide.normal)
            return CircleCurve(guide.center, e1, e2, guide.radius)
        return spline_through(np.array(guide.points, dtype=float), guide.closed)

    def parts(self, place: Place) -> list[Part]:
        """A LockRow to the world; with a guide a CurveRow before it."""
        r_B = place.from_com(self.body, self.point_B)
        parts = [Part(LockRow(relative_turn(place, None, self.body), r_B))]
        curve = self.curve(place)
        if curve is not None:
            parts.insert(0, Part(CurveRow(r_B, curve)))
        return parts
