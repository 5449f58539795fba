# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Power of the contacts, from samples; `power` without it is smooth at changes of contact.

    P = sum F . (v_B - v_A)(anchor) + T . (w_B - w_A)

over the contacts' totals (F, T about the anchor, BY the contact ON body B; A is the parent, or the
world at rest). `contact_work` is its exact integral, including the work of impacts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.numerics.rotations import cross, rotate

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene


def contacts_of(scene: Scene) -> dict[str, Any]:
    """Unilateral constraints of the scene: contacts and strings."""
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
        force, torque = block.reaction_force[:, k], block.reaction_torque[:, k]
        if not force.any() and not torque.any():  # open throughout
            continue
        for body, sign in ((spec.body, 1.0), (spec.parent, -1.0)):
            if body is not None:
                i = layout.bodies.index(body)
                spin = rotate(block.orientation[:, i], block.angular_velocity[:, i])
                arm = block.anchor[:, k] - block.position[:, i]
                speed = block.linear_velocity[:, i] + cross(spin, arm)
                total += sign * np.sum(force * speed + torque * spin, axis=1)
    return total


def smooth_power(block: SampleBlock, scene: Scene, layout: SampleLayout) -> Array:
    """Power of joints and non-conservative effects [W], shape (n,)."""
    return block.power - contact_power(block, scene, layout) if layout.contacts else block.power
