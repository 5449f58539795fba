# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Shapes of uniform density: geometry of a body and its inertia tensor.

Each shape gives `unit_inertia`: the tensor about its own centre in body axes, per unit of mass
[m^2]. For a body of revolution about the unit vector n it is  t (1 - n n) + a n n  with the axial
moment a and the transverse moment t. Formulas: Landau & Lifshitz, Mechanics, section 32, problem 2.
"""

from __future__ import annotations

import math
import sys
from functools import lru_cache
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, PlainValidator, Strict

from rb_sim.base.rounding import WRITTEN_ROUNDING
from rb_sim.catalogue.spec import (
    Positive,
    Positive3,
    Spec,
    UnitVector3,
    Vector3,
    refuse,
    spec_of_type,
)

# The inertia tensor as a scene gives it: three moments or a matrix, physically admissible.


Rows3 = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]


def _is_triple(value: Any) -> bool:
    return isinstance(value, (list, tuple)) and len(value) == 3


def from_principal_moments(value: Any) -> Any:
    """[Ixx, Iyy, Izz] -> the diagonal 3x3; three rows of three pass unchanged; all else is
    refused."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if _is_triple(value):
        if all(_is_triple(row) for row in value):
            return value
        if not any(isinstance(entry, (list, tuple)) for entry in value):
            a, b, c = value
            return ((a, 0.0, 0.0), (0.0, b, 0.0), (0.0, 0.0, c))
    raise refuse("3 principal moments [Ixx, Iyy, Izz] or 3 rows of 3 numbers")


@lru_cache(maxsize=256)  # the same in most runs of a sweep
def inertia_of_some_body(rows: Rows3) -> Rows3:
    """Refuse an inadmissible inertia tensor; symmetrise one that is symmetric up to rounding.

    Some mass distribution has the tensor I if and only if its principal moments are positive and
    none exceeds the sum of the two others (equality: a plane body).
    """
    tensor = np.array(rows)
    scale = float(np.abs(tensor).max())
    if scale < math.sqrt(sys.float_info.min):  # products of moments underflow
        raise refuse("an inertia with three principal moments > 0")
    tensor /= scale
    if float(np.abs(tensor - tensor.T).max()) > WRITTEN_ROUNDING:
        raise refuse("a symmetric inertia tensor")
    small, middle, large = (float(v) for v in np.linalg.eigvalsh(0.5 * (tensor + tensor.T)))
    if small <= 0.0:
        raise refuse(f"an inertia with three principal moments > 0, but one is {small * scale:.6g}")
    if large > (small + middle) * (1.0 + WRITTEN_ROUNDING):
        raise refuse(
            "an inertia that some body can have: no principal moment above the sum of the others, "
            f"but {large * scale:.6g} > {small * scale:.6g} + {middle * scale:.6g}"
        )
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rows
    xy, yz, zx = (0.5 * xy + 0.5 * yx, 0.5 * yz + 0.5 * zy, 0.5 * zx + 0.5 * xz)
    return ((xx, xy, zx), (xy, yy, yz), (zx, yz, zz))


SymmetricInertia = Annotated[
    tuple[Vector3, Vector3, Vector3],
    Strict(False),
    AfterValidator(inertia_of_some_body),
    BeforeValidator(from_principal_moments),
]
"""Inertia tensor [kg m^2]: 3 principal moments on the body axes, or 3x3; kept as 3 rows."""


Z_AXIS = (0.0, 0.0, 1.0)

THIN_ROD = 1e-3
"""Default radius of a rod, as a fraction of its length.

It affects the axial moment only, which must not be zero: a rod could not spin about its axis.
"""


class Shape(Spec):
    """Base of the shapes."""

    type: str
    center_B: Vector3 = (0.0, 0.0, 0.0)
    """centre of the shape, from the body origin, body axes [m]."""

    @property
    def unit_inertia(self) -> np.ndarray:
        """Inertia tensor per unit mass about the shape's centre, body axes, (3, 3) [m^2]."""
        raise NotImplementedError

    @property
    def reach(self) -> float:
        """Distance from the centre to the farthest point [m]."""
        raise NotImplementedError


def _revolution(axial: float, transverse: float, axis: tuple[float, float, float]) -> np.ndarray:
    """t (1 - n n) + a n n, (3, 3)."""
    along = np.outer(axis, axis)
    return transverse * (np.eye(3) - along) + axial * along


def _diagonal(x2: float, y2: float, z2: float) -> np.ndarray:
    """Tensor of a body with mean squares x2, y2, z2 of its coordinates and zero mean products."""
    return np.diag([y2 + z2, z2 + x2, x2 + y2])


class Sphere(Shape):
    """Solid ball: moment 2/5 a^2 per unit mass about every axis."""

    type: Literal["sphere"] = "sphere"
    radius: Positive = Field(description="radius [m]")

    @property
    def unit_inertia(self) -> np.ndarray:
        """2/5 a^2 about every axis."""
        return 0.4 * self.radius**2 * np.eye(3)

    @property
    def reach(self) -> float:
        """The radius."""
        return self.radius


class Disk(Shape):
    """Disk without thickness: moment a^2/2 per unit mass about its axis, a^2/4 about a diameter."""

    type: Literal["disk"] = "disk"
    radius: Positive = Field(description="radius [m]")
    axis_B: UnitVector3 = Z_AXIS
    """axis of the shape, body axes."""

    @property
    def unit_inertia(self) -> np.ndarray:
        """a^2/2 about the axis, a^2/4 about a diameter."""
        square = self.radius**2
        return _revolution(0.5 * square, 0.25 * square, self.axis_B)

    @property
    def reach(self) -> float:
        """The radius."""
        return self.radius


class Cylinder(Shape):
    """Solid cylinder: per unit mass a^2/2 about its axis, a^2/4 + h^2/12 about a diameter."""

    type: Literal["cylinder"] = "cylinder"
    radius: Positive = Field(description="radius [m]")
    length: Positive = Field(description="length [m]")
    axis_B: UnitVector3 = Z_AXIS
    """axis of the shape, body axes."""

    @property
    def unit_inertia(self) -> np.ndarray:
        """a^2/2 about the axis, a^2/4 + h^2/12 about a diameter."""
        square = self.radius**2
        return _revolution(0.5 * square, 0.25 * square + self.length**2 / 12.0, self.axis_B)

    @property
    def reach(self) -> float:
        """Distance from the centre to the edge of an end."""
        return float(np.hypot(self.radius, 0.5 * self.length))


class Box(Shape):
    """Solid box: moment (y^2 + z^2)/12 per unit mass about x, and so on."""

    type: Literal["box"] = "box"
    size: Positive3 = Field(description="edges along x, y, z [m]")

    @property
    def unit_inertia(self) -> np.ndarray:
        """(y^2 + z^2)/12 about x, and so on."""
        x, y, z = self.size
        return _diagonal(x * x / 12.0, y * y / 12.0, z * z / 12.0)

    @property
    def reach(self) -> float:
        """Half the diagonal."""
        return 0.5 * float(np.linalg.norm(self.size))


class Rod(Shape):
    """Thin rod: l^2/12 per unit mass about a normal to it; with `radius` a solid cylinder."""

    type: Literal["rod"] = "rod"
    length: Positive = Field(description="length [m]")
    radius: Positive | None = None
    """radius [m]; default: 0.001 of the length, for the inertia about the axis only."""
    axis_B: UnitVector3 = Z_AXIS
    """axis of the shape, body axes."""

    @property
    def unit_inertia(self) -> np.ndarray:
        """l^2/12 about a normal to the axis; about the axis that of a cylinder, by default of
        radius THIN_ROD l."""
        thin = self.length**2 / 12.0
        if self.radius is None:
            return _revolution(0.5 * (THIN_ROD * self.length) ** 2, thin, self.axis_B)
        square = self.radius**2
        return _revolution(0.5 * square, 0.25 * square + thin, self.axis_B)

    @property
    def reach(self) -> float:
        """Distance from the centre to the edge of an end."""
        return float(np.hypot(self.radius or 0.0, 0.5 * self.length))


class Ellipsoid(Shape):
    """Solid ellipsoid: moment (b^2 + c^2)/5 per unit mass about x, and so on."""

    type: Literal["ellipsoid"] = "ellipsoid"
    semi_axes: Positive3 = Field(description="semi-axes along x, y, z [m]")

    @property
    def unit_inertia(self) -> np.ndarray:
        """(b^2 + c^2)/5 about x, and so on."""
        a, b, c = self.semi_axes
        return _diagonal(a * a / 5.0, b * b / 5.0, c * c / 5.0)

    @property
    def reach(self) -> float:
        """The longest semi-axis."""
        return max(self.semi_axes)


SHAPES: dict[str, type[Spec]] = {
    "sphere": Sphere,
    "disk": Disk,
    "cylinder": Cylinder,
    "box": Box,
    "rod": Rod,
    "ellipsoid": Ellipsoid,
}

AnyShape = Annotated[
    Sphere | Disk | Cylinder | Box | Rod | Ellipsoid,
    PlainValidator(lambda value: spec_of_type(SHAPES, value)),
]
"""A shape, read from {type: ..., its dimensions}."""
