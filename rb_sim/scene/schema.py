# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Data model of a scene: bodies, constraints, effects and integration options. SI units, frozen.

Frames: W world, B the body, with its origin O anywhere fixed in the body and its centre of mass C.
Quaternions are [x, y, z, w], body to world. The models only describe a scene; `load` reads files
and turns validation errors into one line.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PlainValidator,
    PrivateAttr,
    SerializeAsAny,
    TypeAdapter,
    ValidationError,
    model_validator,
)
from pydantic_core import PydanticCustomError

from rb_sim.base.names import clashes
from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.catalogue.spec import (
    Name,
    NonNegative,
    Positive,
    Problem,
    Spec,
    State3,
    UnitQuaternion,
    Vector3,
    body_references,
    one_of,
    problems_of,
    refuse,
    refuse_at,
    spec_of_type,
)
from rb_sim.mechanics import methods
from rb_sim.scene.shapes import AnyShape, SymmetricInertia

METHODS: tuple[str, ...] = (*methods.METHODS, "auto")
"""Methods that a scene may name; auto selects one that keeps the tolerance."""


def _known_method(name: Any) -> str:
    if name not in METHODS:
        raise refuse(one_of(name, METHODS))
    return name


Method = Annotated[str, PlainValidator(_known_method)]

FIXED_STEP_METHODS = tuple(k for k, e in methods.METHODS.items() if e.adaptive is None)
ADAPTIVE_METHODS = (*(k for k, e in methods.METHODS.items() if e.adaptive is not None), "auto")
TOLERANCE_METHODS = (*(k for k, e in methods.METHODS.items() if e.fixed is None), "auto")
"""Adaptive methods that take no fixed step."""
DEFAULT_STEP = 1e-3
"""Default step of the fixed-step methods [s]."""
SMALLEST_TOLERANCE = 1e-16
"""Half an ulp of 1: a smaller error cannot be resolved in double precision, and steps would shrink
to zero."""
DEFAULT_TOLERANCE = 1e-10
"""Default tolerance of adaptive methods other than auto."""


_inertia_check = TypeAdapter(SymmetricInertia)


class Body(Spec):
    """One rigid body and its initial state."""

    mass: Positive = Field(description="mass [kg]")
    shape: AnyShape | None = None
    """shape of uniform density: for pictures, contacts and the inertia."""
    given_inertia: SymmetricInertia | None = Field(default=None, alias="inertia")
    """inertia: 3 principal moments or 3 rows, about the centre of mass, body axes [kg m^2];
    replaces that of the shape."""
    center_of_mass: Vector3 = (0.0, 0.0, 0.0)
    """position of the centre of mass from the body origin O, body axes [m]."""
    position: State3 = (0.0, 0.0, 0.0)
    """initial position of O, world [m]."""
    orientation: UnitQuaternion = (0.0, 0.0, 0.0, 1.0)
    """initial attitude, body to world: [x, y, z, w], or {axis: [x, y, z], angle: rad}."""
    linear_velocity: State3 = (0.0, 0.0, 0.0)
    """initial velocity of O, world [m/s]."""
    angular_velocity: State3 = (0.0, 0.0, 0.0)
    """initial angular velocity, body axes [rad/s]."""
    absolute_tolerance: Positive | None = None
    """absolute local error of this body, in m, m/s and rad/s; default: from the amplitude of the
    motion."""

    @property
    def inertia(self) -> np.ndarray:
        """Inertia tensor about the centre of mass, body axes, (3, 3) [kg m^2]; read-only."""
        if self.given_inertia is not None:
            tensor = np.array(self.given_inertia)
        else:
            assert self.shape is not None  # checked by _has_inertia
            tensor = self.mass * self.shape.unit_inertia
        tensor.flags.writeable = False
        return tensor

    @model_validator(mode="after")
    def _has_inertia(self) -> Body:
        """Refuse a body without inertia, or with a shape whose centre is not the centre of mass."""
        if self.given_inertia is not None:
            return self
        if self.shape is None:
            raise refuse_at((("inertia",), None, refuse("given unless the body has a shape")))
        centre, com = np.array(self.shape.center_B), np.array(self.center_of_mass)
        if np.abs(centre - com).max() > COMPUTED_ROUNDING * self.shape.reach:
            allowed = refuse(
                f"the centre of the shape, {list(self.shape.center_B)}; set shape.center_B: "
                f"{list(self.center_of_mass)}, or give inertia"
            )
            raise refuse_at((("center_of_mass",), list(self.center_of_mass), allowed))
        try:
            with np.errstate(over="ignore"):
                _inertia_check.validate_python(self.inertia)
        except (ValidationError, OverflowError):
            allowed = refuse("a mass and a shape whose inertia is finite and > 0 as a number")
            raise refuse_at((("shape",), self.shape.model_dump(), allowed)) from None
        return self


def _options_for(method: object) -> dict[str, float]:
    """Default step or tolerance of a method."""
    if method in FIXED_STEP_METHODS:
        return {"step": DEFAULT_STEP}
    chosen_by_tolerance = method in ADAPTIVE_METHODS and method != "auto"
    return {"tolerance": DEFAULT_TOLERANCE} if chosen_by_tolerance else {}


MOST_RATE = 1e9
"""Highest rate of samples [Hz]: stamps of messages are in whole nanoseconds."""


class SimulationOptions(Spec):
    """Integration options. Exactly one of `step` and `tolerance` is set (the default included)."""

    duration: Positive = 10.0
    """simulated time [s]."""
    rate: Annotated[Positive, Field(le=MOST_RATE)] = 100.0
    """samples per second [Hz]."""
    method: Method = "dopri853"
    """euler, rk4, dopri853, gauss6, radau5, taylor, time_stepping or auto."""
    step: Positive | None = None
    """fixed step [s]; default: 0.001 for methods without a tolerance."""
    tolerance: Positive | None = None
    """relative local error of an adaptive step, default 1e-10; for auto the global error of the
    pose [m, rad]."""
    project_initial: bool = False
    """whether an initial state that violates a constraint is projected onto it."""
    impacts: Literal["together", "one_by_one"] = "together"
    """simultaneous impacts: solved together, or one contact after the other."""

    @property
    def adaptive(self) -> bool:
        """True if the step length follows from a tolerance."""
        return self.tolerance is not None

    @model_validator(mode="before")
    @classmethod
    def _defaults(cls, data: Any) -> Any:
        if isinstance(data, Mapping) and data.get("step") is None and data.get("tolerance") is None:
            return {**data, **_options_for(data.get("method", "dopri853"))}
        return data

    @model_validator(mode="after")
    def _step_or_tolerance(self) -> SimulationOptions:
        step, tolerance, method = self.step, self.tolerance, self.method
        if step is not None and tolerance is not None:
            problem = "step", step, "omitted if tolerance is given"
        elif tolerance is not None and method in FIXED_STEP_METHODS:
            adaptive = f"{', '.join(ADAPTIVE_METHODS[:-1])} or {ADAPTIVE_METHODS[-1]}"
            allowed = (
                f"omitted for method {method}, which has a fixed step (give step, or use "
                f"{adaptive})"
            )
            problem = "tolerance", tolerance, allowed
        elif method in TOLERANCE_METHODS and step is not None:
            problem = "step", step, f"omitted for method {method}, which needs a tolerance"
        elif method == "auto" and tolerance is None:
            problem = "tolerance", None, "given for method auto: a number > 0"
        elif method != "auto" and tolerance is not None and tolerance < SMALLEST_TOLERANCE:
            allowed = f"at least {SMALLEST_TOLERANCE:g} (double precision)"
            problem = "tolerance", tolerance, allowed
        elif method == "time_stepping" and self.impacts != "together":
            problem = "impacts", self.impacts, "together for method time_stepping"
        else:
            return self
        key, value, allowed = problem
        raise refuse_at(((key,), value, refuse(allowed)))


def _some_body(value: Any) -> Any:
    if not isinstance(value, Mapping) or not value:
        raise refuse("a mapping NAME: {mass: ...} of at least one body")
    return value


def _not_world(name: str) -> str:
    if name == "world":
        raise refuse("another name: world is the fixed frame")
    return name


def constraint_specs() -> Mapping[str, type[Spec]]:
    """The constraint kinds by type name."""
    from rb_sim.catalogue import constraints

    return constraints.SPECS


def support_specs() -> Mapping[str, type[Spec]]:
    """The short forms of supports by type name."""
    from rb_sim.catalogue.constraints import supports

    return supports.SUPPORTS


def effect_specs() -> Mapping[str, type[Spec]]:
    """The effect kinds by type name."""
    from rb_sim.catalogue import effects

    return effects.SPECS


BodyName = Annotated[Name, AfterValidator(_not_world)]
if TYPE_CHECKING:
    from rb_sim.catalogue.spec import ConstraintKind as ConstraintSpec
    from rb_sim.catalogue.spec import EffectKind as EffectSpec
else:
    ConstraintSpec = Annotated[
        SerializeAsAny[Spec],
        PlainValidator(
            lambda value: spec_of_type(constraint_specs(), value, ("effects", effect_specs()))
        ),
    ]
    EffectSpec = Annotated[
        SerializeAsAny[Spec],
        PlainValidator(
            lambda value: spec_of_type(effect_specs(), value, ("constraints", constraint_specs()))
        ),
    ]
SupportSpec = Annotated[
    SerializeAsAny[Spec], PlainValidator(lambda value: spec_of_type(support_specs(), value))
]


SECTIONS = ("constraints", "effects", "supports", "loads")
"""Sections of a scene: constraints and effects on its bodies."""


class Scene(Spec):
    """A whole validated scene; `name`, `file` and `text` give its origin.

    Entries in the short form, `supports` and `loads`, are part of `constraints` and `effects`.
    """

    description: Annotated[str, AfterValidator(lambda text: " ".join(text.split()))] = ""
    bodies: Annotated[dict[BodyName, Body], BeforeValidator(_some_body)]
    constraints: dict[Name, ConstraintSpec] = Field(default_factory=dict)
    effects: dict[Name, EffectSpec] = Field(default_factory=dict)
    supports: dict[Name, SupportSpec] = Field(default_factory=dict, exclude=True)
    """constraints in the short form."""
    loads: dict[Name, EffectSpec] = Field(default_factory=dict, exclude=True)
    """effects in the short form."""
    simulation: SimulationOptions = SimulationOptions()

    at_rest: ClassVar[bool] = False
    """whether mass and inertia may be omitted since no body moves."""

    _name: str = PrivateAttr(default="scene")
    _file: str = PrivateAttr(default="<scene>")
    _text: str | Callable[[], str] = PrivateAttr(default="")

    @property
    def name(self) -> str:
        """Name of the scene: the file name without its extension."""
        return self._name

    @property
    def file(self) -> str:
        """Path of the file as given, or "<scene>" for a scene made in memory."""
        return self._file

    @property
    def text(self) -> str:
        """The YAML text as read; overrides are not in it.

        For a scene made in memory it is written on access (a sweep does not need it).
        """
        return self._text if isinstance(self._text, str) else self._text()

    def with_options(self, **changes: Any) -> Scene:
        """The same scene with these fields of its section `simulation` changed, unchecked."""
        options = self.simulation.model_copy(update=changes)
        return self.model_copy(update={"simulation": options})

    def from_source(self, name: str, file: str, text: str | Callable[[], str]) -> Scene:
        """The same scene with its origin set."""
        scene = self.model_copy()
        scene._name, scene._file, scene._text = name, file, text
        return scene

    @model_validator(mode="wrap")  # type: ignore[arg-type]  # pydantic takes class methods
    @classmethod
    def _whole(cls, data: Any, validate: Callable[[Any], Scene]) -> Scene:
        """Write out contacts of many bodies; refuse what concerns several entries (names that are
        taken, bodies that do not exist) together with all else that is wrong with the scene."""
        plain, further = _each_body(_without_empty(data))
        try:
            scene = validate(plain)
        except ValidationError as error:
            found = problems_of(error)
            seen = {_plain_path(path) for path, _, _ in found}
            further += _misnamed(_sections_of(plain))
            others = [problem for problem in further if _plain_path(problem[0]) not in seen]
            raise refuse_at(*found, *others) from None
        if further or (further := _misnamed(scene.__dict__)):
            raise refuse_at(*further)
        return scene._written_out()

    def _written_out(self) -> Scene:
        """Move supports to the constraints and loads to the effects."""
        if not self.supports and not self.loads:
            return self
        made = {name: self._support(name, spec) for name, spec in self.supports.items()}
        finished = {
            "constraints": {**self.constraints, **made},
            "effects": {**self.effects, **self.loads},
            "supports": {},
            "loads": {},
        }
        for section, entries in finished.items():
            object.__setattr__(self, section, entries)  # the model is frozen once validated
        return self

    def _support(self, name: str, spec: Any) -> Any:
        """The constraint equivalent to a support."""
        from rb_sim.catalogue.constraints.supports import PointContact, Pose

        if not isinstance(spec, PointContact):
            return spec
        key = "supports", name
        if spec.normal_B is not None and not self.at_rest:
            allowed = refuse(
                "omitted for bodies that move: an edge has no normal of its own; for their "
                "reactions at rest: rb_sim statics"
            )
            raise refuse_at(((*key, "normal_B"), list(spec.normal_B), allowed))
        poses = {n: Pose(b.position, b.orientation, b.shape) for n, b in self.bodies.items()}
        try:
            return spec.written_out(poses[spec.body], poses.get(spec.parent or "", Pose()))
        except ValidationError as error:
            detail: dict[str, Any] = {**error.errors(include_url=False)[0]}
            allowed = refuse(detail["ctx"]["allowed"])
            raise refuse_at(((*key, *detail["loc"]), detail["input"], allowed)) from None


class BodyAtRest(Body):
    """A rigid body at rest; mass and inertia default to zero."""

    mass: NonNegative = 0.0  # type: ignore[assignment]
    """mass [kg]; 0 is a body without weight."""

    @property
    def inertia(self) -> np.ndarray:
        """Inertia tensor about the centre of mass, (3, 3) [kg m^2]; zero if the scene gives
        none."""
        return np.zeros((3, 3)) if self.given_inertia is self.shape is None else super().inertia

    @model_validator(mode="after")
    def _has_inertia(self) -> BodyAtRest:
        """No check: a body at rest needs no inertia."""
        return self


class StaticsScene(Scene):
    """A scene of bodies at rest."""

    bodies: Annotated[dict[BodyName, BodyAtRest], BeforeValidator(_some_body)]  # type: ignore[assignment]

    at_rest: ClassVar[bool] = True


KEY = "[key]"
"""The end of a path by which pydantic says that the key is wrong, not its value."""


def _plain_path(path: tuple[int | str, ...]) -> tuple[int | str, ...]:
    return tuple(part for part in path if part != KEY)


def _without_empty(data: Any) -> Any:
    """The scene without sections that have no entries (null in YAML)."""
    if not isinstance(data, Mapping):
        return data
    optional = ("description", "simulation", *SECTIONS)
    return {k: v for k, v in data.items() if v is not None or k not in optional}


def _each_body(data: Any) -> tuple[Any, list[Problem]]:
    """The scene in which a contact of all bodies, or between several, is one for each body; and
    the problems of these contacts. An entry with errors keeps its own name."""
    if not isinstance(data, Mapping):
        return data, []
    bodies, constraints = data.get("bodies"), data.get("constraints")
    if not isinstance(bodies, Mapping) or not isinstance(constraints, Mapping):
        return data, []
    problems: list[Problem] = []
    spread: dict[str, Any] = {}
    for name, value in constraints.items():
        names = _names_of(value, bodies)
        made = {name: value}
        if names is not None:
            key, allowed = _no_group(value, names, bodies)
            if allowed:
                problems.append((("constraints", name, key), value[key], refuse(allowed)))
            made = _spread(name, value, names, bodies)
        for key in made:
            if key != name and (key in constraints or key in spread):
                allowed = refuse(f"another name: {name} makes {key} as well")
                problems.append((("constraints", key, KEY), key, allowed))
        spread |= made
    return {**data, "constraints": spread}, problems


def _names_of(value: Any, bodies: Mapping[str, Any]) -> list[str] | None:
    """Names of the bodies for which a contact is expanded; None for other constraints."""
    if not isinstance(value, Mapping) or value.get("type") != "contact":
        return None
    between = value.get("between")
    if between is None:
        return list(bodies) if value.get("body") == "all" and "all" not in bodies else None
    if between == "all":
        return [name for name, body in bodies.items() if _shape_of(body) is not None]
    return [n for n in between if isinstance(n, str)] if isinstance(between, (list, tuple)) else []


def _shape_of(body: Any) -> Any:
    return body.get("shape") if isinstance(body, Mapping) else getattr(body, "shape", None)


def _no_group(
    value: Mapping[str, Any], names: list[str], bodies: Mapping[str, Any]
) -> tuple[str, str]:
    """Why a contact has no bodies to be between: the key, and what is allowed there; or "", ""."""
    if value.get("between") is None:
        return "", ""
    if "body" in value:
        return "body", "omitted if between is given"
    if value["between"] == "all" and len(names) < 2:
        return "between", "omitted unless two bodies have a shape"
    if shapeless := [n for n in names if n in bodies and _shape_of(bodies[n]) is None]:
        return "between", f"bodies with a shape: {', '.join(shapeless)} has none"
    return "", ""


def _spread(
    name: str, value: Mapping[str, Any], names: list[str], bodies: Mapping[str, Any]
) -> dict[str, Any]:
    """One contact per body; an invalid contact stays a single entry under its own name."""
    first = {**value, "body": next(iter([*names, *bodies]), "all")}
    if not set(names) <= set(bodies):
        return {name: first}
    try:
        spec = spec_of_type(constraint_specs(), first)
    except (ValidationError, PydanticCustomError):
        return {name: first}
    return {f"{name}_{body}": spec.model_copy(update={"body": body}) for body in names}


def _sections_of(data: Any) -> dict[str, Any]:
    """The sections of an invalid scene that are mappings."""
    given = data if isinstance(data, Mapping) else {}
    sections = {name: given.get(name) for name in ("bodies", *SECTIONS)}
    return {name: of for name, of in sections.items() if isinstance(of, Mapping)}


def _misnamed(sections: Mapping[str, Mapping[str, Any]]) -> list[Problem]:
    """Problems of names: two that coincide in topics, one in both forms, references to no body."""
    found: list[Problem] = []
    for section, taken in (("bodies", "world"), ("constraints", ""), ("supports", "")):
        for name, other, called in clashes(map(str, sections.get(section, ())), taken):
            allowed = refuse(f"another name: topics call both {other} and {name} {called}")
            found.append(((section, name, KEY), name, allowed))
    for short, long in (("supports", "constraints"), ("loads", "effects")):
        for name in (name for name in sections.get(short, {}) if name in sections.get(long, {})):
            allowed = refuse(f"another name: {long} have one called {name}")
            found.append(((short, name, KEY), name, allowed))
    bodies = sections.get("bodies")
    for section in SECTIONS if bodies else ():
        for name, entry in sections.get(section, {}).items():
            for path, value, error in _bad_references(entry, bodies or {}):
                found.append(((section, str(name), *path), value, error))
    return found


def _bad_references(entry: Any, bodies: Mapping[str, Any]) -> Iterator[Problem]:
    """Invalid references of `entry` (validated or as given) to bodies."""
    named = dict(body_references(entry)) if isinstance(entry, (Spec, Mapping)) else {}
    for path, name in named.items():
        if name not in bodies:
            hint = "; omit parent for the world" if path == ("parent",) else ""
            yield path, name, refuse(f"a body of the scene: {one_of(name, bodies)}{hint}")
        elif path == ("parent",) and name == named.get(("body",)):
            yield path, name, refuse("another body than the constrained one")
