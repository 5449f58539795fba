# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A prismatic joint: what somebody adds as a constraint, one file and one line."""

from __future__ import annotations

from typing import Literal

from rb_sim.catalogue.constraints.joints import relative_turn
from rb_sim.catalogue.constraints.rows import LockRow, SlotRow
from rb_sim.catalogue.spec import Name, Spec, UnitVector3, Vector3
from rb_sim.catalogue.types import Part, Place
from rb_sim.numerics.vectors import ZERO, perpendicular


class Prismatic(Spec):
    """point_B of the body slides along axis_A of its parent, and the body does not turn on it."""

    type: Literal["prismatic"]
    body: Name
    parent: Name | None = None
    point_B: Vector3 = ZERO
    axis_A: UnitVector3

    def parts(self, place: Place) -> list[Part]:
        r_B = place.from_com(self.body, self.point_B)
        r_A = place.partner_point(self.parent, None, self.body, self.point_B)
        slot = SlotRow(r_B, r_A, *perpendicular(self.axis_A))
        return [Part(slot), Part(LockRow(relative_turn(place, self.parent, self.body), r_B))]
