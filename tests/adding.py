# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What somebody adds to the catalogue, as CONTRIBUTING says: a file each, and one line."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Literal, NamedTuple

import numpy as np

from rb_sim.base.errors import Finding
from rb_sim.catalogue.constraints.rows import VelocityRow
from rb_sim.catalogue.friction import straight_on, traction
from rb_sim.catalogue.geometry.pairs import ContactPoint, carried_point, touching
from rb_sim.catalogue.spec import (
    Finite,
    Name,
    NonNegative,
    Part,
    Place,
    Positive,
    Spec,
    Vec3,
    wrench,
)
from rb_sim.numerics.vectors import ZERO, add, dot, norm, scale, sub

# An effect: a force that grows with time.


class Ramp(Spec):
    """F = rate t along x, at the centre of mass."""

    type: Literal["ramp"]
    body: Name
    rate: Finite
    """[N/s]."""

    def rows(self, place: Place) -> list[tuple[NamedTuple, str, str | None]]:
        return [(RampRow(self.rate), self.body, None)]


class RampRow(NamedTuple):
    rate: float


@wrench.register(RampRow)
def ramp(row, t, body, B, A):
    return (row.rate * t, 0.0, 0.0), ZERO


# A constraint: the centre of mass moves along x at a given speed.


class Conveyor(Spec):
    """v_x of the centre of mass is `speed`."""

    type: Literal["conveyor"]
    body: Name
    speed: Finite
    """[m/s]."""

    def parts(self, place: Place) -> list[Part]:
        return [Part(VelocityRow(ZERO, (1.0, 0.0, 0.0), ZERO, self.speed, False))]


# Laws of friction: one without a corner, one that can stick and weakens with the slip.


class Oil(NamedTuple):
    """T = -c N |s| s."""

    coefficient: float
    """[s^2/m^2]."""
    static: float = 0.0


@traction.register(Oil)
def oil_traction(law, s, ahead, least, compliant):
    return scale(-law.coefficient * norm(s), s), ZERO


class OilLaw(Spec):
    type: Literal["oil"] = "oil"
    coefficient: NonNegative

    def law(self) -> Any:
        return Oil(self.coefficient)


class Weakening(NamedTuple):
    """|T| <= static N at rest; T = -(slow + (static - slow) / (1 + s^2/v^2)) N s/|s| in motion."""

    static: float
    slow: float
    speed: float
    """[m/s]."""


@traction.register(Weakening)
def weakening_traction(law, s, ahead, least, compliant):
    ratio = dot(s, s) / (law.speed * law.speed)
    coefficient = law.slow + (law.static - law.slow) / (1.0 + ratio)
    return scale(-coefficient, straight_on(s, ahead, least)), ZERO


class WeakeningLaw(Spec):
    type: Literal["weakening"] = "weakening"
    static: Positive
    slow: Positive
    speed: Positive

    def law(self) -> Any:
        return Weakening(self.static, self.slow, self.speed)


class Sideways(NamedTuple):
    """T = c N (z x s): across the slip, which no step of impulses can take."""

    coefficient: float
    static: float = 0.0


@traction.register(Sideways)
def sideways_traction(law, s, ahead, least, compliant):
    return scale(law.coefficient, (-s[1], s[0], 0.0)), ZERO


class SidewaysLaw(Spec):
    type: Literal["sideways"] = "sideways"
    coefficient: NonNegative

    def law(self) -> Any:
        return Sideways(self.coefficient)


class Nothing(NamedTuple):
    """A law whose traction was forgotten."""

    static: float = 0.0


class NothingLaw(Spec):
    type: Literal["nothing"] = "nothing"

    def law(self) -> Any:
        return Nothing()


# A pair: a point inside a cone that stands on its tip.


class PointInCone(NamedTuple):
    """r_B of the body in the cone about the parent's z axis, its tip at the parent's centre."""

    r_B: Vec3
    cos: float
    sin: float
    """of the angle between axis and surface."""


@touching.register(PointInCone)
def point_in_cone(pair, B, A):
    p, v = carried_point(B, pair.r_B)
    tip, tip_rate = carried_point(A, ZERO)
    off, off_rate = sub(p, tip), sub(v, tip_rate)
    across, across_rate = (off[0], off[1], 0.0), (off_rate[0], off_rate[1], 0.0)
    radius = norm(across)
    out = scale(1.0 / radius, across)
    turn = scale(1.0 / radius, sub(across_rate, scale(dot(out, across_rate), out)))
    normal = add(scale(-pair.cos, out), (0.0, 0.0, pair.sin))
    return ContactPoint(dot(normal, off), normal, scale(-pair.cos, turn), p, v)


class Cone(Spec):
    """The inside of a cone about z through the origin."""

    type: Literal["cone"] = "cone"
    half_angle: Positive
    """between axis and surface [rad]."""

    def pairs(self, place: Place, body: str, parent: str | None, points: Any) -> list[NamedTuple]:
        cos, sin = math.cos(self.half_angle), math.sin(self.half_angle)
        return [PointInCone(place.from_com(body, p), cos, sin) for p in points or [ZERO]]


# A sink: the number of samples, and the last of them.


class Last:
    """Counts samples and keeps the last position of each body."""

    def __init__(self) -> None:
        self.samples = 0
        self.position: dict[str, list[float]] = {}

    def open(self, scene: Any, layout: Any) -> None:
        self.bodies = layout.bodies

    def write(self, block: Any) -> None:
        self.samples += len(block)
        last = block.position[-1].tolist()
        self.position = dict(zip(self.bodies, last, strict=True))

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Nothing is kept open."""


# A check: whether a body is farther from its start than a leash is long.

LEASH = 0.505
"""[m]."""


def leash(run: Any) -> Any:
    """The first sample in which the first body is farther from its start than LEASH."""
    start: list[Any] = []

    def look(seen: Any) -> Iterator[Finding]:
        position = seen.block.position[:, 0]
        start.extend(position[:1] if not start else ())
        distance = np.linalg.norm(position - start[0], axis=1)
        for i in np.flatnonzero(distance > LEASH)[:1]:
            t, name = float(seen.block.t[i]), run.layout.bodies[0]
            what, advice = "distance from the start [m]", "a shorter duration"
            yield Finding("leash", t, float(distance[i]), LEASH, what, name, advice)

    return look
