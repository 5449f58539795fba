"""What a statics scene may say: bodies, the supports that hold them, the loads on them.

Frames as in the dynamic scenes: W world, B the body that a support names, A its parent (the world
when there is none). Points are given from the origin of their frame, in its axes [m].
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PlainValidator,
    PrivateAttr,
    Strict,
    model_validator,
)

from rb_sim.catalogue.spec import (
    Name,
    NonNegative,
    Spec,
    UnitQuaternion,
    Vector3,
    one_of,
    refuse,
    refuse_at,
    spec_of_type,
)
from rb_sim.scene import shapes
from rb_sim.scene.shapes import AnyShape
from rb_sim.statics.support_kinds import ORIGIN, AnySupport, Contact, Rod, String, SupportSpec

Array = NDArray[np.float64]
SAME_POINT = 1e-9
"""Distance [m], or share of the distance from the world origin if that is more than 1 m, below
which two points given in numbers are one."""


class StaticBody(Spec):
    """A rigid body at rest."""

    mass: NonNegative = 0.0
    """[kg]; 0 is a body whose weight does not count."""
    center_of_mass: Vector3 = ORIGIN
    """from the body origin, body axes [m]."""
    position: Vector3 = ORIGIN
    """of the body origin, world [m]."""
    orientation: UnitQuaternion = (0.0, 0.0, 0.0, 1.0)
    """[x, y, z, w], body to world."""
    shape: AnyShape | None = None
    """drawn; contacts must lie within the ends of a rod. Statics needs no inertia."""

    def rotation(self) -> Array:
        """Matrix from body to world axes, (3, 3)."""
        x, y, z, w = self.orientation
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )


def placed(body: StaticBody | None, point: tuple[float, float, float]) -> Array:
    """A point of a body (of the world for None) in the world [m], (3,)."""
    if body is None:
        return np.array(point)
    return np.array(body.position) + body.rotation() @ np.array(point)


def beyond_the_end(body: StaticBody, point: Array) -> float:
    """How far along its axis a point (world) lies beyond the end of a rod [m]; 0 if it does not,
    or the body is no rod."""
    if not isinstance(body.shape, shapes.Rod):
        return 0.0
    centre = placed(body, body.shape.center_B)
    along = abs(float((point - centre) @ (body.rotation() @ np.array(body.shape.axis_B))))
    beyond = along - 0.5 * body.shape.length
    size = max(1.0, float(np.linalg.norm(point)), float(np.linalg.norm(centre)))
    return beyond if beyond > SAME_POINT * size else 0.0


class Gravity(Spec):
    """Uniform gravity on all bodies, or on those listed."""

    type: Literal["gravity"]
    acceleration: Vector3 = (0.0, 0.0, -9.81)
    """world [m/s^2]."""
    bodies: Annotated[tuple[Name, ...], Strict(False)] | None = None


class Wrench(Spec):
    """A force at a point of a body and a free torque."""

    type: Literal["wrench"]
    body: Name
    frame: Literal["world", "body"] = "world"
    """axes in which the components are given."""
    point_B: Vector3 = ORIGIN
    """where the force acts."""
    force: Vector3 = ORIGIN
    """[N]."""
    torque: Vector3 = ORIGIN
    """[N m]."""


LOADS: dict[str, type[Spec]] = {"gravity": Gravity, "wrench": Wrench}
AnyLoad = Annotated[Gravity | Wrench, PlainValidator(lambda value: spec_of_type(LOADS, value))]


def _some_body(value: Any) -> Any:
    if not isinstance(value, Mapping) or not value:
        raise refuse("a mapping NAME: {mass: ...} of at least one body")
    return value


class StaticsScene(Spec):
    """Bodies at rest, the supports that hold them and the loads on them."""

    description: Annotated[str, AfterValidator(lambda text: " ".join(text.split()))] = ""
    bodies: Annotated[dict[Name, StaticBody], BeforeValidator(_some_body)]
    supports: dict[Name, AnySupport] = Field(default_factory=dict)
    loads: dict[Name, AnyLoad] = Field(default_factory=dict)

    _name: str = PrivateAttr(default="statics")

    @property
    def name(self) -> str:
        """Name of the scene: the file's without its extension."""
        return self._name

    def named(self, name: str) -> StaticsScene:
        """The same scene under another name."""
        scene = self.model_copy()
        scene._name = name
        return scene

    def parent(self, support: SupportSpec) -> StaticBody | None:
        """The parent body of a support; None for the world."""
        return None if support.parent is None else self.bodies[support.parent]

    @model_validator(mode="before")
    @classmethod
    def _empty_sections(cls, data: Any) -> Any:
        """A heading with nothing below it (null in YAML) says nothing."""
        if isinstance(data, Mapping):
            optional = ("description", "supports", "loads")
            return {k: v for k, v in data.items() if v is not None or k not in optional}
        return data

    @model_validator(mode="after")
    def _bodies_exist(self) -> StaticsScene:
        """Refuse supports and loads on bodies that do not exist, or between a body and itself."""
        problems: list[Any] = []
        for section in ("supports", "loads"):
            for name, spec in getattr(self, section).items():
                for path, body in spec.body_references():
                    if body not in self.bodies:
                        allowed = f"a body of the scene: {one_of(body, self.bodies)}"
                    elif path == ("parent",) and body == spec.body:
                        allowed = "another body than the one that is held"
                    else:
                        continue
                    problems.append(((section, name, *path), body, refuse(allowed)))
        if problems:
            raise refuse_at(*problems)
        return self

    @model_validator(mode="after")
    def _touch_within_rods(self) -> StaticsScene:
        """Refuse points of contact beyond the ends of a rod."""
        for name, support in self.supports.items():
            if not isinstance(support, Contact):
                continue
            field = "point_B" if support.point_B is not None else "point_A"
            point = getattr(support, field)
            touched = support.body if field == "point_B" else support.parent
            at = placed(None if touched is None else self.bodies[touched], point)
            for body in (support.body, support.parent):
                beyond = 0.0 if body is None else beyond_the_end(self.bodies[body], at)
                if beyond > 0.0:
                    allowed = f"a point of rod {body} (this one is {beyond:.3g} m beyond its end)"
                    raise refuse_at((("supports", name, field), list(point), refuse(allowed)))
        return self

    @model_validator(mode="after")
    def _ends_fit(self) -> StaticsScene:
        """Refuse strings without length and supports whose two points are not one."""
        for name, support in self.supports.items():
            if support.point_A is None:
                continue
            far = placed(self.parent(support), support.point_A)
            near = placed(self.bodies[support.body], support.point_B or ORIGIN)
            apart = float(np.linalg.norm(far - near))
            size = max(1.0, float(np.linalg.norm(far)), float(np.linalg.norm(near)))
            if isinstance(support, (String, Rod)):
                fits, allowed = apart > SAME_POINT * size, "a point away from point_B"
            else:
                fits = support.point_B is None or apart <= SAME_POINT * size
                allowed = f"the same point as point_B (they are {apart:.3g} m apart)"
            if not fits:
                path = ("supports", name, "point_A")
                raise refuse_at((path, list(support.point_A), refuse(allowed)))
        return self
