# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Uniform gravity: F = m g at the centre of mass; U = -m g . p_WC."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, NamedTuple

from pydantic import AfterValidator, Strict

from rb_sim.catalogue.spec import (
    CENTRAL,
    Name,
    Place,
    Spec,
    Strength3,
    Vec3,
    potential,
    refuse,
    wrench,
)
from rb_sim.numerics.vectors import ZERO, dot, scale


def _some_or_all(names: tuple[str, ...] | None) -> tuple[str, ...] | None:
    if names is not None and not names:
        raise refuse("at least one body; omit bodies for all of them")
    return names


class Gravity(Spec):
    """Uniform gravity on all bodies, or on those listed."""

    type: Literal["gravity"]
    acceleration: Strength3 = (0.0, 0.0, -9.81)
    """acceleration of gravity, a vector in world axes [m/s^2]."""
    bodies: Annotated[
        Annotated[tuple[Name, ...], Strict(False)] | None, AfterValidator(_some_or_all)
    ] = None

    EQUATION: ClassVar[str] = r"""
    $$
    \mathbf F = m\,\mathbf g , \qquad U = -m\,\mathbf g\cdot\mathbf p_C
    $$

    The force acts at C.
    """

    def rows(self, place: Place) -> list[tuple[NamedTuple, str, str | None]]:
        """One GravityRow for each listed body, or for all bodies if none is listed."""
        return [
            (GravityRow(self.acceleration), name, None)
            for name in self.bodies or place.body_names()
        ]


class GravityRow(NamedTuple):
    """Uniform gravity on one body."""

    acceleration_W: Vec3


CENTRAL.add(GravityRow)


@wrench.register(GravityRow)
def gravity(row, t, body, B, A):
    """m g at the centre of mass; no torque."""
    return scale(body.mass, row.acceleration_W), ZERO


@potential.register(GravityRow)
def gravity_potential(row, t, body, B, A):
    """-m g . p_WC: zero at the world's origin."""
    return -body.mass * dot(row.acceleration_W, B.p_WC)
