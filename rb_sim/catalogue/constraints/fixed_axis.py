# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Fixed axis on two bearings A and B with separate reactions.

Bearing A sits at point_B of the body, bearing B at point_B + bearing_distance axis_B. Both carry
transverse force. The `floating` bearing carries no axial force. With `floating: none` the axial
load distribution is not unique; the minimum-norm one, half each, is reported.
"""

from __future__ import annotations

from typing import ClassVar, Literal

from rb_sim.catalogue.constraints.rows import PointRow, SlotRow
from rb_sim.catalogue.spec import Name, Positive, Spec, UnitVector3, Vector3
from rb_sim.catalogue.types import Part, Place
from rb_sim.numerics.vectors import ZERO, add, perpendicular, scale


class FixedAxis(Spec):
    """The body turns about an axis on two bearings.

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
    """position of bearing A on the parent, from its origin, or in the world [m]."""
    axis_A: UnitVector3 | None = None
    """direction of the axis in the axes of the parent or the world."""
    bearing_distance: Positive = 1.0
    """distance from bearing A to bearing B [m]."""
    floating: Literal["A", "B", "none"] = "B"
    """the bearing that carries no axial force."""

    EQUATION: ClassVar[str] = """
    p_A = point_A,  axis_B . s = axis_B . t = 0     s, t: two directions normal to axis_A
    on the body: a force R_A at bearing A and R_B at bearing B = A + bearing_distance axis_B
    against the world: J phi'' = K_n,  J = n . I_O n
    """

    def reaction_suffixes(self, place: Place) -> tuple[str, ...]:
        """The total, and the force at each of the bearings A and B."""
        return ("", "A", "B")

    def parts(self, place: Place) -> list[Part]:
        """A PointRow at each bearing; a SlotRow, free along the axis, at the floating one."""
        r_B = place.from_com(self.body, self.point_B)
        r_A = place.partner_point(self.parent, self.point_A, self.body, self.point_B)
        n_A = place.partner_axis(self.parent, self.axis_A, self.body, self.axis_B)
        far_B = add(r_B, scale(self.bearing_distance, self.axis_B))
        far_A = add(r_A, scale(self.bearing_distance, n_A))
        t1, t2 = perpendicular(n_A)
        first = SlotRow(r_B, r_A, t1, t2) if self.floating == "A" else PointRow(r_B, r_A)
        second = SlotRow(far_B, far_A, t1, t2) if self.floating == "B" else PointRow(far_B, far_A)
        return [Part(first, ("", "A")), Part(second, ("", "B"))]
