"""Joints of a point or of all axes: free, fixed_point, weld."""

from __future__ import annotations

from typing import Literal

from rb_sim.catalogue.constraints.rows import LockRow, PointRow
from rb_sim.catalogue.spec import Name, Spec, Vector3
from rb_sim.catalogue.types import Part, Place
from rb_sim.maths.vectors import ZERO, conjugate, quaternion_product


class Free(Spec):
    """No constraint: the body is free (said for clarity; leaving it out means the same)."""

    type: Literal["free"]
    body: Name

    def reaction_suffixes(self, place: Place) -> tuple[str, ...]:
        return ()

    def parts(self, place: Place) -> list[Part]:
        return []


class FixedPoint(Spec):
    """Spherical hinge: point_B of the body stays at point_A. Reaction R = m a_C - F."""

    type: Literal["fixed_point"]
    body: Name
    parent: Name | None = None
    point_B: Vector3 = ZERO
    """from the body origin, body axes [m]."""
    point_A: Vector3 | None = None
    """on the parent, from its origin, or in the world; left out: where point_B starts."""

    def parts(self, place: Place) -> list[Part]:
        r_B = place.from_com(self.body, self.point_B)
        r_A = place.partner_point(self.parent, self.point_A, self.body, self.point_B)
        return [Part(PointRow(r_B, r_A))]


class Weld(Spec):
    """The body does not move relative to its parent: 6 rows, reaction about point_B."""

    type: Literal["weld"]
    body: Name
    parent: Name | None = None
    point_B: Vector3 = ZERO

    def parts(self, place: Place) -> list[Part]:
        r_B = place.from_com(self.body, self.point_B)
        r_A = place.partner_point(self.parent, None, self.body, self.point_B)
        return [
            Part(PointRow(r_B, r_A)),
            Part(LockRow(relative_turn(place, self.parent, self.body), r_B)),
        ]


def relative_turn(place: Place, parent: str | None, body: str) -> tuple[float, float, float, float]:
    """Initial quaternion from body axes to parent axes."""
    return quaternion_product(conjugate(place.state(parent).q_WB), place.state(body).q_WB)
