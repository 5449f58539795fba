"""The kinds of supports that a statics scene may have."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, PlainValidator, model_validator

from rb_sim.catalogue.spec import Name, Spec, UnitVector3, Vector3, refuse, spec_of_type

ORIGIN = (0.0, 0.0, 0.0)


def coefficient(value: Any) -> Any:
    """Refuse what is neither a word nor a finite coefficient >= 0."""
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if value in ("smooth", "rough") or (number and math.isfinite(value) and value >= 0.0):
        return value
    raise refuse("smooth, rough or a coefficient of friction >= 0")


Friction = Annotated[Any, AfterValidator(coefficient)]
"""smooth: along the normal only; a number: Coulomb's coefficient; rough: any tangential force."""


class SupportSpec(Spec):
    """What all supports share."""

    body: Name
    """the body that is held; reactions are reported as they act on it."""
    parent: Name | None = None
    """what holds it; the world when absent."""


class String(SupportSpec):
    """Light string between two points: T >= 0 along it; only pulls."""

    type: Literal["string"]
    point_B: Vector3 = ORIGIN
    point_A: Vector3
    """the other end."""


class Rod(SupportSpec):
    """Light strut hinged at both ends: a force along it of either sign."""

    type: Literal["rod"]
    point_B: Vector3 = ORIGIN
    point_A: Vector3
    """the other end."""


class Contact(SupportSpec):
    """Touch at a point: N >= 0 along the normal, |friction force| <= friction N across it.

    Say the point on one side, point_B or point_A, and the normal on one side; if both points are
    given they must coincide. An edge has the normal of what lies on it: take normal_B there.
    """

    type: Literal["contact"]
    point_B: Vector3 | None = None
    point_A: Vector3 | None = None
    normal_B: UnitVector3 | None = None
    """into the body, body axes."""
    normal_A: UnitVector3 | None = None
    """into the body, axes of the parent."""
    friction: Friction = "smooth"

    @model_validator(mode="after")
    def _one_side(self) -> Contact:
        if self.point_B is None and self.point_A is None:
            raise refuse("a contact with point_B (on the body) or point_A (on the parent)")
        if (self.normal_B is None) == (self.normal_A is None):
            raise refuse("a contact with one normal: normal_A or normal_B, pointing into the body")
        return self


class Hinge(SupportSpec):
    """Smooth hinge: a force in any direction; with an axis (a pin) also the torques across it."""

    type: Literal["hinge"]
    point_B: Vector3 | None = None
    point_A: Vector3 | None = None
    axis_B: UnitVector3 | None = None
    """free axis of a pin, body axes; none: a ball joint."""
    axis_A: UnitVector3 | None = None
    """the same in the axes of the parent."""

    @model_validator(mode="after")
    def _one_axis(self) -> Hinge:
        if self.axis_B is not None and self.axis_A is not None:
            raise refuse("a hinge with at most one of axis_B and axis_A")
        return self


class Weld(SupportSpec):
    """Clamp: force and torque in any direction."""

    type: Literal["weld"]
    point_B: Vector3 | None = None
    point_A: Vector3 | None = None


SUPPORTS: dict[str, type[Spec]] = {
    "string": String,
    "rod": Rod,
    "contact": Contact,
    "hinge": Hinge,
    "weld": Weld,
}
Support = String | Rod | Contact | Hinge | Weld
AnySupport = Annotated[Support, PlainValidator(lambda value: spec_of_type(SUPPORTS, value))]
