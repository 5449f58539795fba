# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Torsion spring about an axis of the body.

The angle is the twist about the axis in the rotation from the parent's to the body's frame, plus
full turns: the value closest to that at the end of the previous step is taken. Its gradient is the
axis itself as long as the body only turns about it; otherwise the full gradient keeps the law
conservative.
"""

from __future__ import annotations

import math
from typing import ClassVar, Literal, NamedTuple

from rb_sim.catalogue.spec import (
    CHANGING,
    Angle,
    Changing,
    Name,
    NonNegative,
    Place,
    Quaternion,
    Spec,
    UnitVector3,
    Vec3,
    potential,
    wrench,
)
from rb_sim.numerics.vectors import (
    ZERO,
    add,
    atan2,
    conjugate,
    cross,
    dot,
    quaternion_product,
    rotate,
    scale,
    sub,
    unrotate,
    where,
)


class TorsionSpring(Spec):
    """Torsion spring-damper about axis_B; angles are measured from the initial pose."""

    type: Literal["torsion_spring"]
    body: Name
    parent: Name | None = None
    axis_B: UnitVector3
    """axis of the spring, body axes."""
    stiffness: NonNegative = 0.0
    """stiffness k [N m/rad]."""
    damping: NonNegative = 0.0
    """damping c of the relative angular velocity about the axis [N m s/rad]."""
    rest_angle: Angle = 0.0
    """angle theta0 of zero torque, from the initial pose [rad]."""

    EQUATION: ClassVar[str] = r"""
    $$
    \mathbf K = -k\,(\theta - \theta_0)\,\nabla\theta
    - c\,\big((\boldsymbol\omega_B - \boldsymbol\omega_A)\cdot\mathbf a\big)\,\mathbf a , \qquad
    U = \tfrac12 k\,(\theta - \theta_0)^2
    $$

    $$
    \theta = 2\,\mathrm{atan2}(\mathbf v\cdot\mathbf a,\, w) , \qquad
    \nabla\theta = \frac{w^2\,\mathbf a + w\,\mathbf a\times\mathbf v
    + (\mathbf v\cdot\mathbf a)\,\mathbf v}{w^2 + (\mathbf v\cdot\mathbf a)^2}
    $$

    The quaternion $(\mathbf v, w)$ turns the parent's frame into the body's, counted from the
    initial pose; $\mathbf a$ is the axis. The torque acts on the body, the opposite one on the
    parent.
    """

    def rows(self, place: Place) -> list[tuple[NamedTuple, str, str | None]]:
        """A row for the stiffness and one for the damping, each omitted if zero."""
        rows: list[NamedTuple] = []
        if self.stiffness:
            reference = quaternion_product(
                conjugate(place.state(self.body).q_WB), place.state(self.parent).q_WB
            )
            rows.append(TorsionSpringRow(self.axis_B, self.stiffness, self.rest_angle, reference))
        if self.damping:
            rows.append(TorsionDamperRow(self.axis_B, self.damping))
        return [(row, self.body, self.parent) for row in rows]


class TorsionSpringRow(NamedTuple):
    """Torsion spring about an axis of the body."""

    axis_B: Vec3
    stiffness: float
    rest_angle: float
    q_BA: Quaternion
    """initial rotation from the parent's to the body's axes."""
    angle: float = 0.0
    """angle at the end of the previous step, whole turns included [rad]."""
    turns: float = 0.0
    """whole turns in `angle` [rad]."""


class TorsionDamperRow(NamedTuple):
    """Torsion damper about an axis of the body."""

    axis_B: Vec3
    damping: float


def twist(row, B, A):
    """(twist angle including whole turns [rad], these turns [rad], gradient of the angle, body
    axes)."""
    q = quaternion_product(row.q_BA, quaternion_product(conjugate(A.q_WB), B.q_WB))
    v = (q[0], q[1], q[2])
    w = q[3]
    s = dot(v, row.axis_B)
    angle = 2.0 * atan2(s, w)
    angle = where(angle <= -math.pi, angle + 2.0 * math.pi, angle)
    angle = where(angle > math.pi, angle - 2.0 * math.pi, angle)
    over = angle + row.turns - row.angle
    turns = where(over > math.pi, row.turns - 2.0 * math.pi, row.turns)
    turns = where(over < -math.pi, row.turns + 2.0 * math.pi, turns)
    gradient = scale(
        1.0 / (w * w + s * s),
        add(scale(w * w, row.axis_B), add(scale(w, cross(row.axis_B, v)), scale(s, v))),
    )
    return angle + turns, turns, gradient


def _next(row, B, A):
    """Angle and whole turns at the end of a step [rad]."""
    angle, turns, _ = twist(row, B, A)
    return angle, turns


CHANGING[TorsionSpringRow] = Changing(
    2,
    lambda row, t, onwards: (row.angle, row.turns),
    lambda row, inputs: row._replace(angle=inputs[0], turns=inputs[1]),
    _next,
)


@wrench.register(TorsionSpringRow)
def torsion_spring(row, t, body, B, A):
    """The torque -k (theta - theta0) grad theta, body axes; no force."""
    angle, _, gradient = twist(row, B, A)
    return ZERO, scale(-row.stiffness * (angle - row.rest_angle), gradient)


@potential.register(TorsionSpringRow)
def torsion_potential(row, t, body, B, A):
    """k (theta - theta0)^2 / 2."""
    angle, *_ = twist(row, B, A)
    return 0.5 * row.stiffness * (angle - row.rest_angle) ** 2


@wrench.register(TorsionDamperRow)
def torsion_damper(row, t, body, B, A):
    """The torque -c ((w_B - w_A) . axis_B) axis_B, body axes; no force."""
    spin = sub(B.w_WB_B, unrotate(B.q_WB, rotate(A.q_WB, A.w_WB_B)))
    return ZERO, scale(-row.damping * dot(row.axis_B, spin), row.axis_B)
