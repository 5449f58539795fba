# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Drag of a medium: linear and quadratic drag at the centre of mass; angular damping."""

from __future__ import annotations

from typing import ClassVar, Literal, NamedTuple

from rb_sim.catalogue.spec import CENTRAL, Name, NonNegative, Place, Spec, Vec3, Vector3, wrench
from rb_sim.numerics.vectors import ZERO, norm, rotate, scale, sub, unrotate


class LinearDrag(Spec):
    """Drag proportional to the speed relative to a medium, at the centre of mass."""

    type: Literal["linear_drag"]
    body: Name
    coefficient: NonNegative
    """coefficient c [N s/m]."""
    medium_velocity: Vector3 = ZERO
    """velocity of the medium, world [m/s]."""

    EQUATION: ClassVar[str] = r"""
    $$
    \mathbf F = -c\,(\mathbf V - \mathbf V_{\mathrm{medium}})
    $$

    The force acts at C.
    """

    def rows(self, place: Place) -> list[tuple[NamedTuple, str, str | None]]:
        """One LinearDragRow on the body."""
        return [(LinearDragRow(self.coefficient, self.medium_velocity), self.body, None)]


class LinearDragRow(NamedTuple):
    """Drag proportional to the speed relative to the medium."""

    coefficient: float
    medium_W: Vec3


CENTRAL.add(LinearDragRow)


@wrench.register(LinearDragRow)
def linear_drag(row, t, body, B, A):
    """-c (V - V_medium) at the centre of mass; no torque."""
    return scale(-row.coefficient, sub(B.v_WC, row.medium_W)), ZERO


class QuadraticDrag(Spec):
    """Drag proportional to the square of the speed relative to a medium, at the centre of mass."""

    type: Literal["quadratic_drag"]
    body: Name
    coefficient: NonNegative
    """c = (1/2) density area drag-coefficient [kg/m]."""
    medium_velocity: Vector3 = ZERO
    """velocity of the medium, world [m/s]."""

    EQUATION: ClassVar[str] = r"""
    $$
    \mathbf F = -c\,|\mathbf V - \mathbf V_{\mathrm{medium}}|\,
    (\mathbf V - \mathbf V_{\mathrm{medium}})
    $$

    The force acts at C.
    """

    def rows(self, place: Place) -> list[tuple[NamedTuple, str, str | None]]:
        """One QuadraticDragRow on the body."""
        return [(QuadraticDragRow(self.coefficient, self.medium_velocity), self.body, None)]


class QuadraticDragRow(NamedTuple):
    """Drag proportional to the square of the speed relative to the medium."""

    coefficient: float
    medium_W: Vec3


CENTRAL.add(QuadraticDragRow)


@wrench.register(QuadraticDragRow)
def quadratic_drag(row, t, body, B, A):
    """-c |V - V_medium| (V - V_medium) at the centre of mass; no torque."""
    u = sub(B.v_WC, row.medium_W)
    return scale(-row.coefficient * norm(u), u), ZERO


class AngularDamping(Spec):
    """Viscous torque against rotation relative to the parent or the world."""

    type: Literal["angular_damping"]
    body: Name
    parent: Name | None = None
    coefficient: NonNegative
    """coefficient c [N m s/rad]."""

    EQUATION: ClassVar[str] = r"""
    $$
    \mathbf K = -c\,(\boldsymbol\omega_B - \boldsymbol\omega_A)
    $$

    The torque acts on the body, the opposite one on the parent; the world has
    $\boldsymbol\omega_A = 0$.
    """

    def rows(self, place: Place) -> list[tuple[NamedTuple, str, str | None]]:
        """One AngularDampingRow between the body and its parent."""
        return [(AngularDampingRow(self.coefficient), self.body, self.parent)]


class AngularDampingRow(NamedTuple):
    """Torque proportional to the relative angular velocity."""

    coefficient: float


@wrench.register(AngularDampingRow)
def angular_damping(row, t, body, B, A):
    """The torque -c (w_B - w_A), body axes; no force."""
    parent_spin_B = unrotate(B.q_WB, rotate(A.q_WB, A.w_WB_B))
    return ZERO, scale(-row.coefficient, sub(B.w_WB_B, parent_spin_B))
