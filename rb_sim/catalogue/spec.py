# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Base of the catalogue: specs of parameters, their field types, and the data that kernels take.

Every kind describes its parameters by a subclass of `Spec`. The field types check common rules:
numbers are finite, a string is never read as a number nor a boolean as 0 or 1, directions and
quaternions are normalised, an inertia tensor is physically admissible. Vectors are tuples, so that
a spec is hashable and immutable.

Kernels take the constants of a body, its state, and the dispatched laws of the catalogue. Frames: W
world, B the body that a kind names, A its parent (the world if there is none).
"""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import Annotated, Any, ClassVar, NamedTuple, Protocol

import numpy as np
from annotated_types import Ge, Gt, Le
from pydantic import (
    AfterValidator,
    AllowInfNan,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Strict,
    StringConstraints,
    ValidationError,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError

from rb_sim.base.names import a_mapping_of, known_key, one_of
from rb_sim.numerics.kernels import dispatch

WHOLE_TURN = 6.2832
"""Largest angle of an orientation [rad], to four digits: a larger one is not in radians."""

UNIT_SLACK = 4.0 * float(np.finfo(float).eps)
"""Deviation from length 1 up to which a vector counts as normalised."""


def refuse(allowed: str) -> PydanticCustomError:
    """The error for a value that is not `allowed` (a phrase after "must be ...")."""
    return PydanticCustomError("rb_sim", "must be {allowed}", {"allowed": allowed})


Problem = tuple[tuple[str | int, ...], object, PydanticCustomError]
"""(path, value, error) of one invalid value."""


def problems_of(error: ValidationError) -> list[Problem]:
    """The problems of a validation error, to be reported together with others."""
    return [
        (of["loc"], of["input"], PydanticCustomError(of["type"], of["msg"], of.get("ctx")))  # type: ignore[arg-type]
        for of in error.errors(include_url=False)
    ]


def refuse_at(*problems: Problem) -> ValidationError:
    """The error for fields nested in the value being validated."""
    details = [
        InitErrorDetails(type=error, loc=path, input=value) for path, value, error in problems
    ]
    return ValidationError.from_exception_data("Spec", details)


def _unknown_key(key: object, known: Iterable[str]) -> PydanticCustomError:
    allowed = known_key(key, known)
    return PydanticCustomError("rb_sim_key", "must be {allowed}", {"allowed": allowed})


class Spec(BaseModel):
    """Base of every model read from a scene: unknown keys are refused, values frozen and finite.

    Fields are strict (no string or bool as a number). For sequences use the types of this module or
    add `Strict(False)`, since YAML gives lists and the models hold tuples.
    """

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        strict=True,
        allow_inf_nan=False,
        validate_default=True,
        # validators of a kind are built when a scene names it: scenes name few kinds
        defer_build=True,
    )

    @model_validator(mode="wrap")
    @classmethod
    def _unknown_keys(cls, data: Any, validate: Callable[[Any], Any]) -> Any:
        """Refuse unknown keys with the keys that exist, together with all other problems.

        A missing key is not reported then: it is probably the one meant by the unknown key.
        """
        if not isinstance(data, Mapping):
            return validate(data)
        known = {field.alias or name for name, field in cls.model_fields.items()}
        unknown = [((str(key),), key, _unknown_key(key, known)) for key in data if key not in known]
        if not unknown:
            return validate(data)
        beside: list[Problem] = []
        try:
            validate({key: value for key, value in data.items() if key in known})
        except ValidationError as error:
            beside = [of for of in problems_of(error) if of[0] and of[0][0] in data]
        raise refuse_at(*unknown, *beside)

    EQUATION: ClassVar[str] = ""
    """section of the law's page: the equation in LaTeX, its symbols as on docs/laws/index.md."""

    commandable: ClassVar[bool] = False
    """for effects: whether its rows hold a wrench that is set from outside."""

    def breakpoints(self) -> tuple[float, ...]:
        """Instants at which an effect's law is not smooth [s]; no step crosses them."""
        return ()

    def reaction_suffixes(self, place: Any) -> tuple[str, ...]:
        """Suffixes of the reactions that a constraint reports: "" is the total NAME, "A" is
        NAME/A."""
        return ("",)

    def contact_suffixes(self, place: Any) -> tuple[str, ...]:
        """Suffixes of the contact points of a constraint, as its reactions; none for a joint."""
        return ()


def body_references(entry: Spec | Mapping[str, Any]) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """(path, name) of each body that the fields `body`, `parent`, `bodies` and `between` name.

    entry: validated, or as in the file.
    """
    value_of = entry.get if isinstance(entry, Mapping) else partial(getattr, entry)
    for field in ("body", "parent", "bodies", "between"):
        value = value_of(field, None)
        if isinstance(value, (list, tuple)):
            yield from (((field, i), name) for i, name in enumerate(value) if isinstance(name, str))
        elif isinstance(value, str) and field in ("body", "parent"):
            yield (field,), value


def _needed_keys(registry: Mapping[str, type[Spec]], kind: str) -> list[str]:
    fields = registry[kind].model_fields if kind in registry else {}
    required = (field.alias or name for name, field in fields.items() if field.is_required())
    return [key for key in required if key not in ("type", "body")]


def spec_of_type(
    registry: Mapping[str, type[Spec]],
    value: Any,
    other: tuple[str, Mapping[str, type[Spec]]] = ("", {}),
) -> Spec:
    """The spec described by the mapping `value`: its `type` names a class of `registry`.

    other: section of a scene and its registry, which an error names if the type is one of those.
    """
    if not isinstance(value, Mapping):
        if isinstance(value, tuple(registry.values())):
            return value
        needed, such = partial(_needed_keys, registry), _example(registry, value)
        raise refuse(a_mapping_of(one_of(value, registry), needed, such))
    kind = value.get("type")
    if not isinstance(kind, str) or kind not in registry:
        section, types = other
        there = (
            f"listed under {section}, or here " if isinstance(kind, str) and kind in types else ""
        )
        raise refuse_at((("type",), kind, refuse(there + one_of(kind, registry))))
    return registry[kind].model_validate(value)


def _example(registry: Mapping[str, type[Spec]], value: Any) -> str:
    """How a number is given to the first class that needs no more than one; else ""."""
    for name, kind in registry.items():
        needed = _needed_keys(registry, name)
        if len(needed) == 1 and isinstance(value, (int, float)):
            with contextlib.suppress(ValidationError):
                kind.model_validate({"type": name, needed[0]: value})
                return f" as {{type: {name}, {needed[0]}: {value:g}}}"
    return ""


def _normalised(vector: tuple[float, ...], what: str) -> tuple[float, ...]:
    """vector / |vector| without overflow or underflow; refuses the zero vector.

    A vector of length 1 up to rounding is returned unchanged, bit for bit.
    """
    largest = max(abs(component) for component in vector)
    if largest == 0.0:
        raise refuse(what)
    if abs(math.hypot(*vector) - 1.0) <= UNIT_SLACK:
        return vector
    scaled = [component / largest for component in vector]
    norm = math.hypot(*scaled)
    return tuple(component / norm for component in scaled)


def _listed(allowed: str, length: int | None = None) -> Callable[[Any], Any]:
    """Validator of a non-empty list (of this length) whose error says "must be `allowed`"."""

    def check(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            value = value.tolist()
        if not isinstance(value, (list, tuple)) or len(value) != (length or max(len(value), 1)):
            raise refuse(allowed)
        return value

    return check


def _text(name: Any) -> Any:
    if not isinstance(name, str):
        raise refuse("the name of a body")  # keys are already text
    return name


# An own constraint for each type instead of a shared Field(): pydantic 2.7 writes the default of
# one field into the Field that it shares with all others.
Finite = Annotated[float, Strict(), AllowInfNan(False)]
"""Any finite number."""
Positive = Annotated[Finite, Gt(0.0)]
"""A finite number > 0."""
NonNegative = Annotated[Finite, Ge(0.0)]
"""A finite number >= 0."""
Name = Annotated[
    str,
    StringConstraints(
        strict=True,
        pattern=r"^[\p{L}\p{N}]([\p{L}\p{M}\p{N}_ .:+()-]*[\p{L}\p{M}\p{N}_.:+()-])?$",
        max_length=64,
    ),
    BeforeValidator(_text),
]
"""Name of a body, constraint or effect, as CAD programs give them; rb_sim.base.names derives
stricter names (topics, files) from it."""
Identifier = Annotated[
    str, StringConstraints(strict=True, pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=64)
]
"""Name that can be used in expressions: a letter, then letters, digits, underscores."""
Vector3 = Annotated[
    tuple[Finite, Finite, Finite], Strict(False), BeforeValidator(_listed("3 numbers [x, y, z]", 3))
]
"""Three finite numbers."""
STRONGEST = 1e100
"""Largest force [N], torque [N m], acceleration [m/s^2], position [m] and velocity [m/s], [rad/s]:
squares of much larger values overflow."""
_Strength = Annotated[Finite, Ge(-STRONGEST), Le(STRONGEST)]
Strength3 = Annotated[
    tuple[_Strength, _Strength, _Strength],
    Strict(False),
    BeforeValidator(_listed("3 numbers [x, y, z]", 3)),
]
"""A force, torque or acceleration: three numbers, none beyond STRONGEST."""
State3 = Strength3
"""A position or a velocity of a body, with the same limit."""
Strengths = Annotated[
    tuple[Strength3, ...], Strict(False), BeforeValidator(_listed("a list of points [x, y, z]"))
]
"""One or more forces or torques."""
Positive3 = Annotated[
    tuple[Positive, Positive, Positive],
    Strict(False),
    BeforeValidator(_listed("3 numbers [x, y, z] > 0", 3)),
]
"""Three numbers > 0."""
UnitVector3 = Annotated[
    Vector3, AfterValidator(partial(_normalised, what="a direction: 3 numbers, not all zero"))
]
"""A direction; any length but zero is accepted and normalised."""
Numbers = Annotated[
    tuple[Finite, ...], Strict(False), BeforeValidator(_listed("a list of numbers"))
]
"""One or more finite numbers."""
Points = Annotated[
    tuple[Vector3, ...], Strict(False), BeforeValidator(_listed("a list of points [x, y, z]"))
]
"""One or more points, each 3 finite numbers."""


def _radians(angle: float) -> float:
    if abs(angle) > WHOLE_TURN:
        raise refuse(
            "an angle in radians, at most 6.2832 (a whole turn) in size; "
            f"use {angle:g} deg for degrees"
        )
    return angle


_WITH_UNIT = re.compile(r"\s*([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)\s*(deg|rad)\s*")


def radians_of(angle: Any) -> Any:
    """Radians of a text like "5 deg" or "0.1 rad"; other values unchanged."""
    if not isinstance(angle, str):
        return angle
    match = _WITH_UNIT.fullmatch(angle)
    try:
        number = float(match[1]) if match else math.nan
    except ValueError:
        number = math.nan
    if match is None or not math.isfinite(number):
        raise refuse("a number in radians, or a text like 5 deg")
    return math.radians(number) if match[2] == "deg" else number


Angle = Annotated[Finite, BeforeValidator(radians_of)]
"""An angle in radians; also read from "5 deg"."""


class AxisAngle(Spec):
    """A rotation by `angle` [rad] about `axis` (normalised); the angle also as "5 deg"."""

    axis: UnitVector3
    angle: Annotated[Angle, AfterValidator(_radians)]

    def quaternion(self) -> tuple[float, float, float, float]:
        """[x, y, z, w] = [axis sin(angle/2), cos(angle/2)]."""
        half = 0.5 * self.angle
        x, y, z = self.axis
        sine = math.sin(half)
        return (x * sine, y * sine, z * sine, math.cos(half))


EULER = {"rpy", "euler", "roll", "pitch", "yaw"}
"""Keys of an orientation by angles in other programs."""

QUATERNION = {"x", "y", "z", "w"}
"""Keys of a quaternion in other programs."""


def _from_axis_angle(value: Any) -> Any:
    keys = set(value) if isinstance(value, Mapping) else set()
    angles = bool(keys & EULER)
    if isinstance(value, Mapping) and not angles and not keys >= QUATERNION:
        return AxisAngle.model_validate(value).quaternion()
    allowed = "a quaternion [x, y, z, w] or {axis: [x, y, z], angle: rad}"
    if angles or (isinstance(value, (list, tuple)) and len(value) == 3):
        allowed += "; from roll, pitch, yaw: scipy's Rotation.from_euler('xyz', rpy).as_quat()"
    return _listed(allowed, 4)(value)


UnitQuaternion = Annotated[
    tuple[Finite, Finite, Finite, Finite],
    Strict(False),
    AfterValidator(partial(_normalised, what="a quaternion [x, y, z, w], not all zero")),
    BeforeValidator(_from_axis_angle),
]
"""Rotation [x, y, z, w], normalised; also read from {axis: [x, y, z], angle: rad}."""


Vec3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Symmetric = tuple[float, float, float, float, float, float]


class Inertial(NamedTuple):
    """Mass, inertia and centre of mass of one rigid body."""

    mass: float
    """mass [kg]."""
    inertia: Symmetric
    """inertia about the centre of mass C, body axes (xx, yy, zz, xy, xz, yz) [kg m^2]."""
    r_OC: Vec3
    """vector from the body origin O to C, body axes [m]."""


class BodyState(NamedTuple):
    """State of one body."""

    p_WC: Vec3
    """centre of mass, world [m]."""
    q_WB: Quaternion
    """unit quaternion [x, y, z, w], body to world."""
    v_WC: Vec3
    """velocity of the centre of mass, world [m/s]."""
    w_WB_B: Vec3
    """angular velocity, body frame [rad/s]."""


WORLD = BodyState((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
"""State of the world, the parent of a body without one."""


class Part(NamedTuple):
    """One row of a constraint and the reactions that include its wrench."""

    row: NamedTuple
    outputs: tuple[str, ...] = ("",)
    """suffixes of these reactions: "" is the constraint's total, "A" and "B" its bearings."""


class Place(Protocol):
    """Data of the scene that a spec uses to compile its rows."""

    def body_names(self) -> tuple[str, ...]:
        """All bodies of the scene."""
        ...

    def inertial(self, body: str) -> Inertial:
        """Mass, inertia and centre of mass of a body."""
        ...

    def state(self, body: str | None) -> BodyState:
        """Initial state of a body; WORLD for None."""
        ...

    def shape(self, body: str) -> Any:
        """The shape model of a body, or None."""
        ...

    def from_com(self, body: str | None, point: Vec3) -> Vec3:
        """Vector from C to a point given in body coordinates (from O); unchanged for the world."""
        ...

    def partner_point(
        self, parent: str | None, point: Vec3 | None, body: str | None, point_B: Vec3
    ) -> Vec3:
        """The parent's point, from its C; if `point` is None, the initial position of the body's
        point_B."""
        ...

    def partner_axis(
        self, parent: str | None, axis: Vec3 | None, body: str | None, axis_B: Vec3
    ) -> Vec3:
        """The parent's direction; if `axis` is None, the initial direction of the body's axis_B."""
        ...


class ConstraintKind(Protocol):
    """Interface of every constraint of the catalogue (its base is catalogue.spec.Spec)."""

    type: Any
    body: Any

    def parts(self, place: Place) -> list[Part]:
        """Its rows, each with the reactions that include its wrench."""
        ...

    def reaction_suffixes(self, place: Place) -> tuple[str, ...]:
        """Suffixes of its reactions: "" is the total NAME, "A" is NAME/A."""
        ...

    def contact_suffixes(self, place: Place) -> tuple[str, ...]:
        """Suffixes of its contact points, as its reactions; none for a joint."""
        ...


class EffectKind(Protocol):
    """Interface of every effect of the catalogue (its base is catalogue.spec.Spec)."""

    type: Any
    commandable: ClassVar[bool]

    def rows(self, place: Place) -> list[tuple[NamedTuple, str, str | None]]:
        """(row, body, parent) of each of its wrenches."""
        ...

    def breakpoints(self) -> tuple[float, ...]:
        """Instants at which its law is not smooth [s]; no step crosses them."""
        ...


class Changing(NamedTuple):
    """Quantities of a row, or a system, that change between steps, as inputs of a traced law."""

    count: int
    values: Callable[[Any, float, bool], tuple[float, ...]]
    """(row, t, True for steps from t on or False for the instant t alone) -> the inputs."""
    symbolic: Callable[[Any, tuple], Any]
    """(row, its inputs as symbols) -> the row that is traced in its place."""
    next: Callable[[Any, BodyState, BodyState], tuple] | None = None
    """(row, states of the body and its parent at the end of a step) -> the inputs of the next step,
    for a row with memory; None: they change from outside only."""


CHANGING: dict[type, Changing] = {}
"""Changing inputs by row or system class; all other numbers are constants of a law."""


class Placed(NamedTuple):
    """A row and the bodies on which it acts; -1 stands for the world."""

    row: tuple
    body: int
    parent: int


CENTRAL: set[type] = set()
"""Row classes whose force acts at C and does not depend on the orientation or angular velocity."""


@dispatch
def wrench(row, t, body, B, A):
    """Force at C in world axes [N] and torque about C in body axes [N m] on the body B."""


@dispatch
def potential(row, t, body, B, A):
    """Potential energy [J] of a conservative effect."""
