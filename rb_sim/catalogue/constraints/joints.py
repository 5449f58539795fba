# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Joints of a point or of all axes: free, fixed_point, weld."""

from __future__ import annotations

from typing import ClassVar, Literal

from rb_sim.catalogue.constraints.rows import LockRow, PointRow
from rb_sim.catalogue.spec import Name, Spec, Vector3
from rb_sim.catalogue.types import Part, Place
from rb_sim.numerics.vectors import ZERO, conjugate, quaternion_product


class Free(Spec):
    """No constraint: the body moves freely, as it does without this entry."""

    type: Literal["free"]
    body: Name

    EQUATION: ClassVar[str] = """
    m dV/dt = F
    I dw/dt + w x I w = R^T K        about C, body axes
    """

    def reaction_suffixes(self, place: Place) -> tuple[str, ...]:
        """None: no constraint, no reaction."""
        return ()

    def parts(self, place: Place) -> list[Part]:
        """No parts: the body is not held."""
        return []


class FixedPoint(Spec):
    """Spherical hinge: point_B of the body stays at point_A. Reaction R = m a_C - F."""

    type: Literal["fixed_point"]
    body: Name
    parent: Name | None = None
    point_B: Vector3 = ZERO
    """point of the body that is held, from the body origin, body axes [m]."""
    point_A: Vector3 | None = None
    """point at which it is held: on the parent, from its origin, or in the world [m]."""

    EQUATION: ClassVar[str] = """
    p_B = p_A                        of the points point_B and point_A
    V_B = V_A                        of the material points there
    on the body: a force lambda at point_B; where the parent is the world, R = m a_C - F
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
    """the point about which the reaction is given, from the body origin, body axes [m]."""

    EQUATION: ClassVar[str] = """
    p_B = p_A,  q_AB = q_AB(0)       the pose relative to the parent stays constant
    on the body: a force and a torque about point_B
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
