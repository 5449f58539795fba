# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Contacts: their spec in a scene file and the equations of one contact point.

Contacts and strings carry a normal force of one sign while they are closed, and open when that
force would change sign (LL 38). A support in the world may have a prescribed motion.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field, PlainValidator, model_validator

from rb_sim.catalogue import friction
from rb_sim.catalogue.geometry import pairs as carriers
from rb_sim.catalogue.geometry.corners_and_rims import held_by_faces
from rb_sim.catalogue.geometry.pairs import BallOnCylinder, BallOnSolid
from rb_sim.catalogue.geometry.solids import Box, Cylinder
from rb_sim.catalogue.spec import (
    Finite,
    Name,
    NonNegative,
    Part,
    Place,
    Points,
    Positive,
    Spec,
    UnitVector3,
    Vector3,
    refuse,
    refuse_at,
    spec_of_type,
)
from rb_sim.catalogue.surfaces import (
    SOLIDS,
    SURFACES,
    BodySurface,
    CylinderSurface,
    PlaneSurface,
    SphereSurface,
    pairs_of,
)
from rb_sim.numerics.vectors import ZERO, scale

# Bodies whose edges may penetrate a support that is tested at their corners or ends only.


class Sides(NamedTuple):
    """Edges of one body that may cross a support between its corners, and the reverse."""

    name: str
    """name of the constraint."""
    body: int
    parent: int
    """index of the parent; -1: the world."""
    edges: np.ndarray
    """ends of each edge and diagonal, body coordinates from C, shape (k, 2, 3) [m]."""
    support: NamedTuple
    """Box, Cylinder or BallOnCylinder, in the parent's coordinates from C."""
    motion: NamedTuple
    """prescribed motion of a support in the world."""
    own: NamedTuple | None
    """the body's box, which corners and rims of the support may enter; None for a rod."""


def edges_of_box(box: Box) -> np.ndarray:
    """The 12 edges of a box and its 4 diagonals, shape (16, 2, 3) [m].

    The diagonals enter what the corners and edges only slide along: an equal box below.
    """
    signs = np.array(list(np.ndindex(2, 2, 2))) * 2.0 - 1.0
    corners = np.array(box.centre) + signs * np.array(box.half)
    pairs = [
        (i, j) for i in range(8) for j in range(i) if np.sum(signs[i] != signs[j]) != 2
    ]  # corners of an edge differ in one sign, those of a diagonal in three
    return np.array([[corners[i], corners[j]] for i, j in pairs])


def support_of_pair(pair: Any) -> NamedTuple | None:
    """Support that edges may penetrate, for the pair of a corner or an end; None for other
    pairs."""
    if isinstance(pair, BallOnSolid) and isinstance(pair.surface, Box | Cylinder):
        return pair.surface
    return pair if isinstance(pair, BallOnCylinder) and pair.side > 0.0 else None


def sides_of(name: str, spec: Any, part: Any, index: dict[str, int], place: Place) -> Any:
    """The Sides of a contact of a box or a rod, else None; part: the first point of the contact."""
    support = support_of_pair(part.row.pair)
    if support is None or spec.points is not None:
        return None
    shape: Any = place.shape(spec.body)
    if shape.type not in ("box", "rod"):
        return None
    solid: Any = SOLIDS[shape.type](place.from_com(spec.body, shape.center_B), shape)
    own, end = None, solid.end if shape.type == "rod" else None
    if end is None:
        own, edges = solid, edges_of_box(solid)
    else:
        edges = np.array([[end, np.array(end) + solid.length * np.array(solid.axis)]])
    parent = -1 if spec.parent is None else index[spec.parent]
    return Sides(name, index[spec.body], parent, edges, support, part.row.carrier, own)


class Compliance(Spec):
    """Compliant support: N = stiffness depth + damping (rate of depth), never negative."""

    stiffness: Positive
    """stiffness [N/m]."""
    damping: NonNegative = 0.0
    """damping [N s/m]."""

    @property
    def spring(self) -> tuple[float, float]:
        """(stiffness [N/m], damping [N s/m])."""
        return float(self.stiffness), float(self.damping)


class ContactRow(NamedTuple):
    """One contact point: the types of its fields select its equations."""

    pair: tuple
    friction: tuple
    resistance: tuple
    carrier: tuple
    spring: tuple
    """(stiffness, damping) of a compliant support, or () for a rigid one."""


def contact_rows(row: ContactRow) -> int:
    """Number of rows of a contact point: 3 (normal, two tangents), or 6 with rolling resistance."""
    return 3 if isinstance(row.resistance, friction.NoResistance) else 6


class ContactLaw(NamedTuple):
    """Constants of a contact point that impacts and mode changes use (kernels do not)."""

    restitution: float
    bilateral: bool
    compliant: bool
    static: float
    """coefficient that limits the traction in sticking; inf if it never slips, 0 if it cannot
    stick."""
    kinetic: float
    """|T| / N at the onset of slip, for a law that can stick; inf if it never slips."""
    rolling_arm: float
    spinning_arm: float
    spring: tuple[float, float] = (0.0, 0.0)
    """stiffness [N/m] and damping [N s/m] of a compliant support."""
    closes: str = "closes"
    """name of the event at which the normal force begins."""
    opens: str = "opens"
    """name of the event at which the normal force ends."""
    drags: bool = False
    """whether the traction stays finite as the normal force vanishes."""


class Touching(Spec):
    """A constraint whose points may be open or closed: a contact or a string."""

    body: Name
    parent: Name | None = None

    @abstractmethod
    def law(self) -> ContactLaw:
        """Constants for impacts and mode changes, the same for each of its points."""

    @abstractmethod
    def parts(self, place: Place) -> list[Part]:
        """One ContactRow for each point."""

    def contact_suffixes(self, place: Place) -> tuple[str, ...]:
        """Names of its points, "1", "2" ...; ("",) if it has one point."""
        n = len(self.parts(place))
        return ("",) if n == 1 else tuple(str(i + 1) for i in range(n))

    def reaction_suffixes(self, place: Place) -> tuple[str, ...]:
        """Suffix "" for the total; with several points also the name of each."""
        points = self.contact_suffixes(place)
        return points if len(points) == 1 else ("", *points)


MOST_POINTS = 64
"""Largest number of points of one contact: their equations are solved together."""


class SmoothLaw(Spec):
    """Frictionless contact."""

    type: Literal["smooth"] = "smooth"

    def law(self) -> friction.Friction:
        """The frictionless law."""
        return friction.Smooth()


class CoulombLaw(Spec):
    """|T| <= static N in sticking, |T| = kinetic N against the slip in slipping."""

    type: Literal["coulomb"] = "coulomb"
    static: NonNegative
    """coefficient of friction in sticking or rolling."""
    kinetic: NonNegative | None = None
    """coefficient of friction in slipping; default: static."""

    @model_validator(mode="after")
    def _ordered(self) -> CoulombLaw:
        if self.kinetic is not None and self.kinetic > self.static:
            allowed = refuse(f"at most static ({self.static:g})")
            raise refuse_at((("kinetic",), self.kinetic, allowed))
        return self

    def law(self) -> friction.Friction:
        """Coulomb's law; `kinetic` defaults to `static`; a frictionless law if static is 0."""
        kinetic = self.static if self.kinetic is None else self.kinetic
        return friction.Coulomb(self.static, kinetic) if self.static > 0.0 else friction.Smooth()


class ViscousLaw(Spec):
    """T = -c s, or with `per_normal` T = -c N s; s is the slip velocity."""

    type: Literal["viscous"] = "viscous"
    coefficient: NonNegative
    """c [N s/m], or [s/m] with per_normal."""
    per_normal: bool = False
    """whether the friction force is proportional to the normal force N."""

    def law(self) -> friction.Friction:
        """The viscous law, with the force proportional to N if `per_normal` is set."""
        kind = friction.ViscousPerNormal if self.per_normal else friction.Viscous
        return kind(self.coefficient)


class RegularisedLaw(Spec):
    """T = -mu N s / sqrt(s^2 + v^2): creeps slowly under loads for which Coulomb's law sticks."""

    type: Literal["regularised"] = "regularised"
    coefficient: NonNegative
    """mu, coefficient of friction at large slip."""
    speed: Positive
    """v, slip speed at which friction reaches 0.7 mu N [m/s]."""

    def law(self) -> friction.Friction:
        """The regularised law."""
        return friction.Regularised(self.coefficient, self.speed)


class RoughLaw(Spec):
    """Perfectly rough contact: it rolls and never slips."""

    type: Literal["rough"] = "rough"

    def law(self) -> friction.Friction:
        """The law of a perfectly rough contact."""
        return friction.Rough()


LAWS: dict[str, type[Spec]] = {
    "smooth": SmoothLaw,
    "coulomb": CoulombLaw,
    "viscous": ViscousLaw,
    "regularised": RegularisedLaw,
    "rough": RoughLaw,
}


class TurntableMotion(Spec):
    """Support that turns at a constant `rate` [rad/s] about `axis` through `point`."""

    type: Literal["turntable"] = "turntable"
    rate: Finite
    """angular velocity about the axis [rad/s]."""
    axis: UnitVector3 = (0.0, 0.0, 1.0)
    """direction of the axis, world."""
    point: Vector3 = ZERO
    """a point of the axis, world [m]."""

    def carrier(self) -> NamedTuple:
        """The prescribed motion of the support, compiled."""
        return carriers.Turntable(self.point, scale(self.rate, self.axis))


class ShakenMotion(Spec):
    """Support displaced by amplitude direction sin(2 pi frequency t + phase)."""

    type: Literal["shaken"] = "shaken"
    direction: UnitVector3
    """direction of the motion, world."""
    amplitude: Positive
    """amplitude [m]."""
    frequency: Positive
    """frequency [Hz]."""
    phase: Finite = 0.0
    """phase at t = 0 [rad]."""

    def carrier(self) -> NamedTuple:
        """The prescribed motion of the support, compiled (with the angular frequency [rad/s])."""
        amplitude = scale(self.amplitude, self.direction)
        return carriers.Shaken(amplitude, 2.0 * math.pi * self.frequency, self.phase)


MOTIONS: dict[str, type[Spec]] = {"turntable": TurntableMotion, "shaken": ShakenMotion}


def _group(value: Any) -> Any:
    """Validator: "all", or a list of at least two different names of bodies."""
    if value in (None, "all"):
        return value
    names = tuple(value) if isinstance(value, (list, tuple)) else ()
    if len(names) < 2 or len(set(map(str, names))) < len(names):
        raise refuse("all, or a list of at least two different bodies")
    if not all(isinstance(name, str) for name in names):
        raise refuse("all, or a list of names of bodies")
    return names


class Contact(Touching):
    """Contact of the body's shape (or its `points`) with a support.

    Outputs: NAME, the total wrench, about the contact point (about C if there are several points);
    with several points also NAME/1, NAME/2 ..., each about its own point. A contact `between`
    bodies has NAME_BODY for each body, about C: the total wrench of the other bodies on it.
    """

    type: Literal["contact"]
    body: Name
    """the body in contact; all: each body of the scene, with a contact NAME_BODY of its own.
    Omitted if `between` is given."""
    parent: Name | None = None
    between: Annotated[Literal["all"] | tuple[str, ...] | None, PlainValidator(_group)] = None
    """instead of `body` and `parent`: bodies in contact with each other, [NAME, ...], or all that
    have a shape; without pairs that another constraint joins. Requires method time_stepping."""
    surface: Annotated[
        PlaneSurface | SphereSurface | CylinderSurface | BodySurface,
        PlainValidator(lambda value: spec_of_type(SURFACES, value)),
    ] = PlaneSurface()
    """the support, in the parent's coordinates (from its origin) or in the world; for the parent's
    own shape: {type: shape}."""
    points: Points | None = None
    """contact points that replace the shape, from the body origin [m]."""
    lies_flat: bool | None = None
    """whether an end of a disk or a cylinder may lie on a plane, supported at six points of its
    rim; default: true for a cylinder, false for a disk."""
    friction: Annotated[
        SmoothLaw | CoulombLaw | ViscousLaw | RegularisedLaw | RoughLaw,
        PlainValidator(lambda value: spec_of_type(LAWS, value)),
    ] = SmoothLaw()
    """friction law: the tangential force."""
    restitution: Annotated[NonNegative, Field(le=1.0)] = 0.0
    """coefficient of restitution e: rebound speed over approach speed in an impact."""
    rolling_resistance: NonNegative = 0.0
    """arm of the rolling resistance [m]: the torque against rolling is at most arm N."""
    spinning_resistance: NonNegative = 0.0
    """arm of the spinning resistance [m]: the torque about the normal is at most arm N."""
    mode: Literal["unilateral", "bilateral"] = "unilateral"
    """unilateral: only pushes and may open; bilateral: also pulls and stays closed."""
    motion: (
        Annotated[
            TurntableMotion | ShakenMotion,
            PlainValidator(lambda value: spec_of_type(MOTIONS, value)),
        ]
        | None
    ) = None
    """prescribed motion of a support in the world; default: at rest."""
    compliance: Compliance | None = None
    """stiffness and damping of the support; default: rigid."""

    EQUATION: ClassVar[str] = r"""
    $$
    g \ge 0 , \quad N \ge 0 , \quad N g = 0 , \qquad
    \text{impact: } \dot g^{+} = -e\,\dot g^{-} , \qquad
    \text{compliant: } N = \max\left(0,\; k\,\delta + c\,\dot\delta\right)
    $$

    $g$ is the gap, $\delta$ the penetration. A bilateral contact has $g = 0$ and $N$ of either
    sign. The normal force, the friction force (laws below) and the torques of
    `rolling_resistance` and `spinning_resistance`, at most the arm times $N$, act on the body at
    the contact point.
    """

    @model_validator(mode="after")
    def _consistent(self) -> Contact:
        if self.between is not None:
            self._check_between()
        if self.motion is not None and self.parent is not None:
            allowed = refuse("omitted if the support belongs to a parent body")
            raise refuse_at((("motion",), self.motion.type, allowed))
        if isinstance(self.surface, BodySurface) and self.parent is None:
            allowed = refuse("plane, sphere or cylinder without a parent")
            raise refuse_at((("surface", "type"), "shape", allowed))
        if self.points is not None and len(self.points) > MOST_POINTS:
            allowed = refuse(f"at most {MOST_POINTS} points")
            raise refuse_at((("points",), len(self.points), allowed))
        if not friction.is_whole(law := self.friction.law()):
            allowed = refuse(
                "a law whose class has `static` and a function under traction.register"
            )
            raise refuse_at((("friction",), type(law).__name__, allowed))
        if self.compliance is not None and self.mode == "bilateral":
            allowed = refuse("unilateral for a compliant support")
            raise refuse_at((("mode",), self.mode, allowed))
        if self.lies_flat and not self.opens_rigidly:
            allowed = refuse("false for a bilateral or compliant contact")
            raise refuse_at((("lies_flat",), True, allowed))
        return self

    def _check_between(self) -> None:
        """Refuse keys that belong to a contact of one pair only."""
        own = Contact.model_fields
        for key in ("parent", "surface", "points", "lies_flat", "motion", "mode"):
            if (value := getattr(self, key)) != own[key].default:
                value = getattr(value, "type", value)
                raise refuse_at(((key,), value, refuse("omitted if between is given")))

    def of_pair(self, body: str, parent: str) -> Contact:
        """The contact of one pair of bodies of a contact `between` bodies."""
        pair = {"body": body, "parent": parent, "between": None, "surface": BodySurface()}
        return self.model_copy(update=pair)

    def contact_suffixes(self, place: Place) -> tuple[str, ...]:
        """Names of its points; for a contact `between` bodies only the total."""
        return ("",) if self.between is not None else super().contact_suffixes(place)

    @property
    def opens_rigidly(self) -> bool:
        """True if the contact can open and its support is rigid: it has impacts."""
        return self.mode == "unilateral" and self.compliance is None

    def law(self) -> ContactLaw:
        """Constants for impacts and mode changes, the same for each of its points."""
        law, soft = self.friction.law(), self.compliance
        return ContactLaw(
            self.restitution,
            self.mode == "bilateral",
            self.compliance is not None,
            law.static,
            friction.at_begin_of_slip(law),
            self.rolling_resistance,
            self.spinning_resistance,
            (0.0, 0.0) if soft is None else soft.spring,
            drags=friction.drags(law),
        )

    def parts(self, place: Place) -> list[Part]:
        """One ContactRow for each point that may touch; none if `between` is given."""
        if self.between is not None:
            return []  # pairs are found as they come close (scene/pairs_of_bodies)
        touching = pairs_of(
            place,
            self.body,
            self.parent,
            self.surface,
            self.points,
            self.lies_flat,
            self.opens_rigidly,
            self.mode == "bilateral",
        )
        if self.compliance is None:
            touching = held_by_faces(touching)
        law = self.friction.law()
        resistance = friction.NoResistance()
        if self.rolling_resistance > 0.0 or self.spinning_resistance > 0.0:
            resistance = friction.Resistance(self.rolling_resistance, self.spinning_resistance)
        carrier = carriers.Resting() if self.motion is None else self.motion.carrier()
        spring = () if self.compliance is None else self.compliance.spring
        rows = [ContactRow(pair, law, resistance, carrier, spring) for pair in touching]
        return [
            Part(row, ("", str(i + 1)) if len(rows) > 1 else ("",)) for i, row in enumerate(rows)
        ]
