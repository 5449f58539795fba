# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Spring-damper between a point of the body and a point of its parent or the world.

With a rest length the force acts along the line through the points. Without one the law is
isotropic, as for a bushing, and regular where the points coincide. There v is the velocity of the
body's point relative to the parent's material point at the same place, and the force acts on both
bodies at this place: damping dissipates energy however the parent rotates.
"""

from __future__ import annotations

from typing import ClassVar, Literal, NamedTuple

from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.catalogue.spec import Name, NonNegative, Place, Spec, Vec3, Vector3, potential, wrench
from rb_sim.numerics.vectors import ZERO, add, cross, dot, norm, rotate, scale, sub, unrotate


class Spring(Spec):
    """Spring-damper between point_B of the body and point_A of the parent."""

    type: Literal["spring"]
    body: Name
    parent: Name | None = None
    point_B: Vector3 = ZERO
    """end of the spring on the body, from its origin, body axes [m]."""
    point_A: Vector3 = ZERO
    """end of the spring on the parent, from its origin, or in the world [m]."""
    stiffness: NonNegative = 0.0
    """stiffness k [N/m]."""
    damping: NonNegative = 0.0
    """damping c [N s/m]."""
    rest_length: NonNegative = 0.0
    """unstretched length l0 [m]."""

    EQUATION: ClassVar[str] = r"""
    $$
    \ell_0 > 0: \quad
    \mathbf F = -k\,(\ell - \ell_0)\,\mathbf u - c\,(\mathbf u\cdot\dot{\mathbf d})\,\mathbf u ,
    \qquad U = \tfrac12 k\,(\ell - \ell_0)^2
    $$

    $$
    \ell_0 = 0: \quad \mathbf F = -k\,\mathbf d - c\,\mathbf v , \qquad
    U = \tfrac12 k\,\mathbf d\cdot\mathbf d
    $$

    $\mathbf d = \mathbf p_B - \mathbf p_A = \ell\,\mathbf u$ leads from `point_A` to `point_B`,
    $\ell_0$ is `rest_length`. The force acts on the body at `point_B`, the opposite one on the
    parent.
    """

    def rows(self, place: Place) -> list[tuple[NamedTuple, str, str | None]]:
        """A row for the stiffness and one for the damping, each omitted if zero.

        Raises ValueError if the ends coincide at the start and the rest length is not zero.
        """
        r_B = place.from_com(self.body, self.point_B)
        r_A = place.from_com(self.parent, self.point_A)
        rows: list[NamedTuple] = []
        if self.rest_length == 0.0:
            if self.stiffness:
                rows.append(BushingRow(r_B, r_A, self.stiffness))
            if self.damping:
                rows.append(BushingDamperRow(r_B, r_A, self.damping))
        else:
            along = SpringRow(r_B, r_A, self.stiffness, self.rest_length)
            length = norm(separation(along, place.state(self.body), place.state(self.parent)))
            if not length > COMPUTED_ROUNDING * self.rest_length:
                raise ValueError(
                    "its ends coincide at the start, so that its force has no direction; move them "
                    "apart or use rest_length 0"
                )
            if self.stiffness:
                rows.append(along)
            if self.damping:
                rows.append(DamperRow(r_B, r_A, self.damping))
        return [(row, self.body, self.parent) for row in rows]


class SpringRow(NamedTuple):
    """Spring with a rest length between two points."""

    r_B: Vec3
    r_A: Vec3
    stiffness: float
    rest_length: float


class DamperRow(NamedTuple):
    """Damper along the line between two points."""

    r_B: Vec3
    r_A: Vec3
    damping: float


class BushingRow(NamedTuple):
    """Isotropic spring without rest length between two points."""

    r_B: Vec3
    r_A: Vec3
    stiffness: float


class BushingDamperRow(NamedTuple):
    """Isotropic damper between two points."""

    r_B: Vec3
    r_A: Vec3
    damping: float


def separation(row, B, A):
    """Vector from the parent's point to the body's point, world axes [m]."""
    return sub(
        add(B.p_WC, rotate(B.q_WB, row.r_B)),
        add(A.p_WC, rotate(A.q_WB, row.r_A)),
    )


def at_point(row, B, f):
    """The wrench of a force f (world) that acts at r_B."""
    return f, cross(row.r_B, unrotate(B.q_WB, f))


@wrench.register(SpringRow)
def spring(row, t, body, B, A):
    """-k (l - l0) along the line from the parent's point to the body's point."""
    d = separation(row, B, A)
    length = norm(d)
    return at_point(row, B, scale(-row.stiffness * (length - row.rest_length) / length, d))


@potential.register(SpringRow)
def spring_potential(row, t, body, B, A):
    """k (l - l0)^2 / 2."""
    stretch = norm(separation(row, B, A)) - row.rest_length
    return 0.5 * row.stiffness * stretch * stretch


@wrench.register(DamperRow)
def damper(row, t, body, B, A):
    """-c (u . d') u, with d the separation and u = d/|d|: acts on the rate of the length only."""
    d = separation(row, B, A)
    own = add(B.v_WC, rotate(B.q_WB, cross(B.w_WB_B, row.r_B)))
    rate = dot(d, sub(own, add(A.v_WC, rotate(A.q_WB, cross(A.w_WB_B, row.r_A)))))
    return at_point(row, B, scale(-row.damping * rate / dot(d, d), d))


@wrench.register(BushingRow)
def bushing(row, t, body, B, A):
    """-k d with d the separation."""
    return at_point(row, B, scale(-row.stiffness, separation(row, B, A)))


@potential.register(BushingRow)
def bushing_potential(row, t, body, B, A):
    """k |d|^2 / 2."""
    d = separation(row, B, A)
    return 0.5 * row.stiffness * dot(d, d)


@wrench.register(BushingDamperRow)
def bushing_damper(row, t, body, B, A):
    """-c v, with v the velocity of the body's point relative to the parent's material point at the
    same place."""
    arm = sub(add(B.p_WC, rotate(B.q_WB, row.r_B)), A.p_WC)
    own = add(B.v_WC, rotate(B.q_WB, cross(B.w_WB_B, row.r_B)))
    v = sub(own, add(A.v_WC, cross(rotate(A.q_WB, A.w_WB_B), arm)))
    return at_point(row, B, scale(-row.damping, v))
