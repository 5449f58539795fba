"""What a statics scene may say: bodies, supports, loads; read from a file or a mapping."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

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
    UnitVector3,
    Vector3,
    one_of,
    refuse,
    refuse_at,
    spec_of_type,
)
from rb_sim.scene import shapes, yaml_reader
from rb_sim.scene.errors_text import render, scene_error, validated
from rb_sim.scene.listing import scene_folders
from rb_sim.scene.shapes import AnyShape

# One support as it enters the equilibrium: its wrench per unknown, and the unknowns' bounds.


Array = NDArray[np.float64]
Law = Literal["two-way", "one-way"]


class Bound(NamedTuple):
    """|x[tails]| <= coefficient N, N the push x[0], or `push` where that is given."""

    gives: Literal["slips", "rolls", "spins"]
    """what happens beyond it."""
    coefficient: float
    """of friction, or the arm of a resistance to turning [m]."""
    tails: tuple[int, ...]
    """one or two unknowns of the element."""
    push: float | None = None
    """[N], of a support that gives way: its depth says how hard it pushes."""


@dataclass(frozen=True)
class Element:
    """One support placed in the world, m unknowns."""

    name: str
    kind: str
    body: str
    parent: str | None
    anchor_W: Array
    """where it acts on the body, world [m], (3,)."""
    parent_anchor_W: Array
    """where it acts on the parent; differs from anchor_W for strings and rods, (3,)."""
    force_W: Array
    """force on the body per unknown, (3, m)."""
    torque_W: Array
    """torque on the body about anchor_W per unknown, (3, m)."""
    law: Law
    """two-way: any x; one-way: x[0] >= 0; its bounds hold besides."""
    friction: float = 0.0
    bounds: tuple[Bound, ...] = ()
    given_W: Array = field(default_factory=lambda: np.zeros(3))
    """force on the body whatever the unknowns are, (3,)."""
    normal_W: Array | None = None
    """of a contact without unknowns along it, (3,)."""

    @property
    def size(self) -> int:
        """m."""
        return self.force_W.shape[1]

    @property
    def rubs(self) -> bool:
        """Whether it is a contact with friction."""
        return self.direction is not None and self.friction > 0.0

    @property
    def direction(self) -> Array | None:
        """Unit vector of the first unknown: a contact's normal, a string's or rod's line; (3,)."""
        if self.normal_W is not None:
            return self.normal_W
        return self.force_W[:, 0] if self.kind in ("contact", "string", "rod") else None


# The kinds of supports that a statics scene may have.


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


# What a statics scene may say: bodies, the supports that hold them, the loads on them.
#
# Frames as in the dynamic scenes: W world, B the body that a support names, A its parent (the world
# when there is none). Points are given from the origin of their frame, in its axes [m].


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


# Supports in the world: where they hold, and in which directions.


def place_support(scene: StaticsScene, name: str) -> Element:
    """The element of one support."""
    support = scene.supports[name]
    anchor, far = anchors(scene, support)
    force, torque, law, friction = unknowns_of(scene, support, anchor, far)
    return Element(
        name=name,
        kind=support.type,
        body=support.body,
        parent=support.parent,
        anchor_W=anchor,
        parent_anchor_W=far,
        force_W=force,
        torque_W=torque,
        law=law,
        friction=friction,
        bounds=(Bound("slips", friction, (1, 2)),) if 0.0 < friction < np.inf else (),
    )


def anchors(scene: StaticsScene, support: Support) -> tuple[Array, Array]:
    """Points of application on the body and on the parent, world [m]."""
    body = scene.bodies[support.body]
    parent = scene.parent(support)
    if isinstance(support, (String, Rod)):
        return placed(body, support.point_B), placed(parent, support.point_A)
    if support.point_B is None and support.point_A is not None:
        point = placed(parent, support.point_A)
    else:
        point = placed(body, support.point_B or ORIGIN)
    return point, point


def unknowns_of(
    scene: StaticsScene, support: Support, anchor: Array, far: Array
) -> tuple[Array, Array, Law, float]:
    """Force and torque columns on the body, law and friction coefficient."""
    none = np.zeros((3, 1))
    match support:
        case String() | Rod():
            toward = (far - anchor) / np.linalg.norm(far - anchor)
            return toward[:, None], none, "one-way" if support.type == "string" else "two-way", 0.0
        case Contact():
            normal = contact_normal(scene, support)
            if support.friction == "smooth" or support.friction == 0.0:
                return normal[:, None], none, "one-way", 0.0
            frame = np.column_stack([normal, *tangents(normal)])
            if support.friction == "rough":
                return frame, np.zeros((3, 3)), "one-way", np.inf
            return frame, np.zeros((3, 3)), "one-way", float(support.friction)
        case Hinge():
            if support.axis_A is not None:
                axis = in_world(scene.parent(support), support.axis_A)
            elif support.axis_B is not None:
                axis = in_world(scene.bodies[support.body], support.axis_B)
            else:
                return np.eye(3), np.zeros((3, 3)), "two-way", 0.0
            across = np.column_stack(tangents(axis))
            forces = np.hstack([np.eye(3), np.zeros((3, 2))])
            return forces, np.hstack([np.zeros((3, 3)), across]), "two-way", 0.0
        case Weld():
            zero = np.zeros((3, 3))
            return np.hstack([np.eye(3), zero]), np.hstack([zero, np.eye(3)]), "two-way", 0.0


def contact_normal(scene: StaticsScene, contact: Contact) -> Array:
    """Unit normal into the body, world, (3,)."""
    if contact.normal_B is not None:
        return in_world(scene.bodies[contact.body], contact.normal_B)
    assert contact.normal_A is not None
    return in_world(scene.parent(contact), contact.normal_A)


def in_world(body, direction) -> Array:
    vector = np.array(direction)
    return vector if body is None else body.rotation() @ vector


def tangents(normal: Array) -> tuple[Array, Array]:
    """Two unit vectors across a unit normal, right-handed with it."""
    away = np.zeros(3)
    away[np.argmin(np.abs(normal))] = 1.0
    first = np.cross(normal, away)
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)


# Statics files -> StaticsScene; whatever is wrong comes out as one SceneError of one line.


STATICS = "statics"
"""Folder of the scenes of bodies at rest, among the shipped ones."""


def load_statics(source: str | PathLike[str] | Mapping[str, Any]) -> StaticsScene:
    """Statics scene of a YAML file, of a bare name of a shipped one, or of a mapping.

    Raises SceneError with file, key, value and what is allowed.
    """
    if isinstance(source, Mapping):
        return validated(StaticsScene, source, "<scene>")
    path = Path(source)
    if path.name == str(source) and not path.suffix and not path.exists():
        shipped = (folder / STATICS / f"{path}.yaml" for folder in scene_folders())
        path = next((file for file in shipped if file.is_file()), path)
    data = read(path)
    if not isinstance(data, Mapping):
        message = f"got {render(data)}; a statics scene must be a mapping with bodies"
        raise scene_error(message, (), str(path))
    return validated(StaticsScene, data, str(path)).named(path.stem)


def is_statics(path: Path) -> bool:
    """Whether a file is of bodies at rest: it says what holds or loads them.

    Raises SceneError if it is no YAML file.
    """
    data = read(path)
    return isinstance(data, Mapping) and ("supports" in data or "loads" in data)


def read(path: Path) -> Any:
    """What a YAML file says."""
    return yaml_reader.parse(yaml_reader.read_text(path), str(path))
