# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A light string between two points: it pulls when taut and does nothing when slack."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from rb_sim.catalogue.constraints.simple import distance_at_start
from rb_sim.catalogue.contacts import friction
from rb_sim.catalogue.contacts.touching import Compliance, ContactLaw, ContactRow, Touching
from rb_sim.catalogue.geometry import pairs as carriers
from rb_sim.catalogue.geometry.pairs import BallOnSphere
from rb_sim.catalogue.spec import NonNegative, Positive, Spec, Vector3, refuse, refuse_at
from rb_sim.catalogue.types import Part, Place
from rb_sim.numerics.vectors import ZERO

INSIDE = -1.0
"""The side of the sphere around point_A, of radius `length`, that point_B may not leave."""


class Reach(Spec):
    """What a string holds, for pictures: point_B of the body on a string from point_A."""

    type: Literal["string"] = "string"
    point_B: Vector3
    point_A: Vector3


class String(Touching):
    """|p_B - p_A| <= length: the tension N >= 0 pulls the body towards point_A while it is taut.

    It is a smooth contact of point_B with the inside of a sphere of radius `length` around
    point_A; its gap is the slack. It has no mass, and passes through bodies. Events: impact, taut,
    slack. Output: NAME, the pull on the body at point_B.
    """

    type: Literal["string"]
    point_B: Vector3 = ZERO
    """from the body origin, body axes [m]."""
    point_A: Vector3
    """the other end, on the parent from its origin, or in the world [m]."""
    length: Positive | None = None
    """largest distance of the points [m]; default: the initial distance, just taut."""
    restitution: Annotated[NonNegative, Field(le=1.0)] = 0.0
    """e: speed at which the points approach after a jerk, over the speed at which they parted."""
    compliance: Compliance | None = None
    """of an elastic string: N = stiffness (distance - length) + damping (its rate), at least 0."""

    EQUATION: ClassVar[str] = """
    g = length - |p_B - p_A| >= 0,  N >= 0,  N g = 0      jerk: g'_after = -e g'_before
    elastic:  N = max(0, -k g - c g') where g < 0, else 0
    on the body: the force N (p_A - p_B) / |p_B - p_A| at point_B
    """

    @model_validator(mode="after")
    def _no_jerk_of_an_elastic_one(self) -> String:
        if self.compliance is not None and self.restitution > 0.0:
            allowed = refuse("omitted for an elastic string (compliance)")
            raise refuse_at((("restitution",), self.restitution, allowed))
        return self

    def law(self) -> ContactLaw:
        """A smooth contact with the string's restitution and compliance: taut is closed."""
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
        """What pictures draw."""
        return Reach(point_B=self.point_B, point_A=self.point_A)
