# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Power of the contacts, from the samples: what is left of `power` is smooth where they change.

    P = sum F . (v_B - v_A)(anchor) + T . (w_B - w_A)

over the contacts' totals (F, T about the anchor, BY the contact ON body B; A the parent, or the
world at rest). `contact_work` holds the integral of it, and the work of impacts, exactly.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.numerics.kernels import for_python, interpreted, part, pointer_to, where
from rb_sim.numerics.rotations import rotate

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene


# Power of a force and a torque at a point of a body, at many instants.
#
# P = F . v + (T + r x F) . R(q) w,        r from the centre of mass to the point


FORCE, TORQUE, POINT, POSITION, ORIENTATION, VELOCITY, SPIN, TOTAL = range(8)
STRIDES, COUNT, SIGN = 8, 16, 17
"""Places in what `add_power_into` is given: where the vectors at the first instant are, and the
totals; from STRIDES on by how many numbers each goes on; how many instants; 1 or -1."""


@for_python
def add_power_into(places):
    """Add the power, times SIGN, to the totals."""
    forces, torques = pointer_to(places, FORCE), pointer_to(places, TORQUE)
    points, positions = pointer_to(places, POINT), pointer_to(places, POSITION)
    turns, velocities = pointer_to(places, ORIENTATION), pointer_to(places, VELOCITY)
    spins, totals = pointer_to(places, SPIN), pointer_to(places, TOTAL)
    for i in range(places[COUNT]):
        f, k = part(forces, i * places[STRIDES]), part(torques, i * places[STRIDES + TORQUE])
        p, x = part(points, i * places[STRIDES + POINT]), part(positions, i * places[STRIDES + 3])
        q, v = part(turns, i * places[STRIDES + 4]), part(velocities, i * places[STRIDES + 5])
        w = part(spins, i * places[STRIDES + SPIN])
        r0, r1, r2 = p[0] - x[0], p[1] - x[1], p[2] - x[2]
        m0, m1 = k[0] + r1 * f[2] - r2 * f[1], k[1] + r2 * f[0] - r0 * f[2]
        m2 = k[2] + r0 * f[1] - r1 * f[0]
        scale = 2.0 / (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        t0, t1 = scale * (q[1] * w[2] - q[2] * w[1]), scale * (q[2] * w[0] - q[0] * w[2])
        t2 = scale * (q[0] * w[1] - q[1] * w[0])
        s0 = w[0] + q[3] * t0 + q[1] * t2 - q[2] * t1
        s1 = w[1] + q[3] * t1 + q[2] * t0 - q[0] * t2
        s2 = w[2] + q[3] * t2 + q[0] * t1 - q[1] * t0
        power = f[0] * v[0] + f[1] * v[1] + f[2] * v[2] + m0 * s0 + m1 * s1 + m2 * s2
        totals[i] += places[SIGN] * power
    return 0


def add_power(vectors: tuple[Any, ...], total: Any, sign: int) -> None:
    """Add to `total` (n,) the power at a point. vectors: force, torque, point, position,
    orientation, velocity and spin, each (n, 3 or 4), the numbers of one instant side by side."""
    plain = interpreted()
    arrays = [array if fits(array) and not plain else packed(array) for array in vectors]
    arrays.append(total)
    numbers = [*(array.strides[0] // 8 for array in arrays), len(total), sign]
    places: Any = [*map(where, arrays), *numbers]
    add_power_into(places if plain else where(np.array(places)))


def fits(array: Any) -> bool:
    """Whether the loop can read it where it is."""
    return array.dtype == float and array.strides[-1] == 8 and array.strides[0] % 8 == 0


def packed(array: Any) -> Any:
    """A copy of it side by side."""
    return np.ascontiguousarray(array, float)


MANY = 1024
"""Samples of a block from which on compiled code takes them; to load it takes more than fewer."""


def contacts_of(scene: Scene) -> dict[str, Any]:
    """The scene's constraints that touch and part: contacts and strings."""
    return {
        name: spec
        for name, spec in scene.constraints.items()
        if spec.type in ("contact", "string")  # type: ignore[attr-defined]
    }


def contact_power(block: SampleBlock, scene: Scene, layout: SampleLayout) -> Array:
    """Power of all contacts on the bodies [W], shape (n,)."""
    total = np.zeros(len(block))
    for name, spec in contacts_of(scene).items():
        k = layout.reactions.index(name)
        force, torque, point = (
            block.reaction_force[:, k],
            block.reaction_torque[:, k],
            block.anchor[:, k],
        )
        if not force.any() and not torque.any():  # apart all the time
            continue
        for body, sign in ((spec.body, 1.0), (spec.parent, -1.0)):
            if body is not None:
                i = layout.bodies.index(body)
                if len(block) >= MANY:
                    of_body = block.position[:, i], block.orientation[:, i]
                    of_body += block.linear_velocity[:, i], block.angular_velocity[:, i]
                    add_power((force, torque, point, *of_body), total, int(sign))
                    continue
                spin = rotate(block.orientation[:, i], block.angular_velocity[:, i])
                speed = block.linear_velocity[:, i] + np.cross(spin, point - block.position[:, i])
                total += sign * np.sum(force * speed + torque * spin, axis=1)
    return total


def smooth_power(block: SampleBlock, scene: Scene, layout: SampleLayout) -> Array:
    """Power of the effects without potential and of the joints [W], shape (n,)."""
    return block.power - contact_power(block, scene, layout) if layout.contacts else block.power
