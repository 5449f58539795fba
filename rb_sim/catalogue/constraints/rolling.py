# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Rolling without slip on a perfectly rough plane (LL 38.3): the contact point is at rest.

The surface is that of the body's shape: sphere, thin disk (its rim), ellipsoid or cylinder. A
cylinder touches along a line, so two more constraint equations keep its axis parallel to the plane.
The plane belongs to the world or to a parent body. The equation of the height is holonomic, the
two tangential ones are not.
"""

from __future__ import annotations

from typing import ClassVar, Literal, NamedTuple

from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.catalogue.constraints.rows import COUNT, ParallelRow, anchor, fill, put
from rb_sim.catalogue.geometry.smooth_surfaces import (
    EllipsoidSurface,
    RimSurface,
    SphereSurface,
    support,
    support_rate,
)
from rb_sim.catalogue.spec import Name, Part, Place, Spec, UnitVector3, Vec3, Vector3, refuse
from rb_sim.numerics.vectors import (
    ZERO,
    add,
    cross,
    dot,
    norm,
    perpendicular,
    rotate,
    scale,
    sub,
    unrotate,
)


class Rolling(Spec):
    """The body's shape rolls on the plane through point_A with normal_A (towards the body)."""

    type: Literal["rolling"]
    body: Name
    parent: Name | None = None
    normal_A: UnitVector3 = (0.0, 0.0, 1.0)
    """normal to the plane, towards the body; axes of the parent or the world."""
    point_A: Vector3 = ZERO
    """a point of the plane, on the parent from its origin, or in the world [m]."""

    EQUATION: ClassVar[str] = r"""
    $$
    \mathbf n_A\cdot(\mathbf p_P - \mathbf p_A) = 0 , \qquad
    \mathbf V + \boldsymbol\omega\times\mathbf r_{CP} = \mathbf V_A
    $$

    P is the contact point, $\mathbf V_A$ the velocity of the plane's material point there (zero in
    the world). The reaction is a force at P; on a cylinder also the torque that keeps its line on
    the plane.
    """

    def surface(self, place: Place) -> NamedTuple:
        """The compiled surface of the body's shape; an error of the scene if that shape cannot
        roll."""
        shape = place.shape(self.body)
        if shape is None or shape.type not in ("sphere", "disk", "cylinder", "ellipsoid"):
            found = "none" if shape is None else shape.type
            raise refuse(
                f"on a body with a shape that rolls: sphere, disk, cylinder or ellipsoid; "
                f"{self.body} has {found}"
            )
        centre = place.from_com(self.body, shape.center_B)
        if shape.type == "sphere":
            return SphereSurface(centre, shape.radius)
        if shape.type == "ellipsoid":
            return EllipsoidSurface(centre, shape.semi_axes)
        return RimSurface(centre, shape.radius, shape.axis_B)

    def has_line_contact(self, place: Place) -> bool:
        """True for a cylinder: it touches along a line, so its axis stays parallel to the plane."""
        return place.shape(self.body).type == "cylinder"

    def _refuse_flat(self, place: Place, axis_B: Vec3) -> None:
        """Raise ValueError if the rim is parallel to the plane at the start: it has no lowest point
        then."""
        q_WA = place.state(self.parent).q_WB
        axis = rotate(place.state(self.body).q_WB, axis_B)
        if norm(cross(axis, rotate(q_WA, self.normal_A))) < COMPUTED_ROUNDING:
            raise ValueError(
                f"the rim of {self.body} starts flat on the plane, without a lowest point; "
                "must start tilted"
            )

    def parts(self, place: Place) -> list[Part]:
        """A RollingRow; for a cylinder, which touches along a line, also a ParallelRow.

        Raises: an error of the scene if a rim lies flat on the plane at the start.
        """
        surface = self.surface(place)
        if isinstance(surface, RimSurface):
            self._refuse_flat(place, surface.axis_B)
        r_A = place.from_com(self.parent, self.point_A)
        t1, t2 = perpendicular(self.normal_A)
        parts = [Part(RollingRow(surface, r_A, self.normal_A, t1, t2))]
        if isinstance(surface, RimSurface) and self.has_line_contact(place):
            axis_A = place.partner_axis(self.parent, None, self.body, surface.axis_B)
            level_A = levelled(axis_A, self.normal_A)
            parts.append(Part(ParallelRow(surface.axis_B, *perpendicular(level_A))))
        return parts


def levelled(axis: Vec3, normal: Vec3) -> Vec3:
    """Projection of a line's axis onto the plane with this normal, as a unit vector."""
    along = sub(axis, scale(dot(axis, normal), normal))
    return scale(1.0 / norm(along), along)


class RollingRow(NamedTuple):
    """Rolling without slip: the surface touches the parent's plane at a point at rest: 3 rows."""

    surface: tuple
    r_A: Vec3
    n_A: Vec3
    t1_A: Vec3
    t2_A: Vec3


COUNT[RollingRow] = 3


@fill.register(RollingRow)
def fill_rolling(row, t, B, A, G, k):
    """3 rows at the contact point: its velocity along the normal and two tangents is zero.

    Only the normal row is holonomic; its error is the height of the contact point over the plane
    [m].
    """
    n = rotate(A.q_WB, row.n_A)
    spin_B, spin_A = rotate(B.q_WB, B.w_WB_B), rotate(A.q_WB, A.w_WB_B)
    gamma = unrotate(B.q_WB, n)
    gamma_dot = cross(gamma, sub(B.w_WB_B, unrotate(B.q_WB, spin_A)))
    r_CP = support(row.surface, gamma)
    r, r_dot = rotate(B.q_WB, r_CP), rotate(B.q_WB, support_rate(row.surface, gamma, gamma_dot))
    r_dot = add(r_dot, cross(spin_B, r))
    sigma = sub(add(B.p_WC, r), A.p_WC)
    sigma_dot = sub(add(B.v_WC, r_dot), A.v_WC)
    drift = sub(cross(spin_B, r_dot), cross(spin_A, sigma_dot))
    slip = sub(add(B.v_WC, cross(spin_B, r)), add(A.v_WC, cross(spin_A, sigma)))
    height = dot(n, sub(sigma, rotate(A.q_WB, row.r_A)))
    axes = (row.n_A, row.t1_A, row.t2_A)
    for i in range(3):
        d = rotate(A.q_WB, axes[i])
        bias = dot(d, drift) + dot(cross(spin_A, d), slip)
        turn_B = cross(r_CP, unrotate(B.q_WB, d))
        turn_A = unrotate(A.q_WB, cross(d, sigma))
        first = 1.0 if i == 0 else 0.0
        put(G, k + i, d, turn_B, turn_A, bias, first * height, 0.0, first)


@anchor.register(RollingRow)
def rolling_anchor(row, B, A):
    """The contact point, world [m]."""
    gamma = unrotate(B.q_WB, rotate(A.q_WB, row.n_A))
    return add(B.p_WC, rotate(B.q_WB, support(row.surface, gamma)))
