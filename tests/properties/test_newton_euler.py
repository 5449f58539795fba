# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Newton's and Euler's equations hold for every body with the reactions that are reported.

m dV/dt = F + sum R and d(R I w)/dt = K + sum (M + (p - C) x R), the rates by differences of samples
that lie close together; F, K from the laws of the catalogue; a reaction acts on the body, its
opposite on the parent at the same point (LL 38.6).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rb_sim.scene.listing import find_scene, list_scenes
from rb_sim.scene.yaml_reader import parse
from tests.one_body_scenes import JOINTS, Mapping

SPACING = 2e-4
"""[s] of the samples: what the fourth-order differences leave out stays below CLOSE."""
CLOSE = 1e-6
"""Of the largest term."""
INSTANTS = (0.002, 0.05)
"""[s] at which the equations are looked at."""


def samples(mapping: Mapping, t: float) -> tuple[Any, Any, Any]:
    """(five samples about t, scene, layout)."""
    from rb_sim import Simulation, load_scene

    options = {"method": "dopri853", "tolerance": 1e-12, "step": None}
    mapping = mapping | {"simulation": mapping["simulation"] | options}
    simulation = Simulation(load_scene(mapping))
    with np.errstate(all="ignore"):  # attempts that are far too long overflow, and are refused
        simulation.advance(t - 2.0 * SPACING)
        simulation.take_events()
        block = simulation.run(4.0 * SPACING, 1.0 / SPACING, checks=False).block
    return block, simulation.scene, simulation.layout


def middle_rate(values: np.ndarray) -> np.ndarray:
    """Derivative at the third of five values SPACING apart."""
    return (8.0 * (values[3] - values[1]) - (values[4] - values[0])) / (12.0 * SPACING)


def defects(mapping: Mapping, t: float) -> list[float]:
    """For every body the part of force or torque that is missing; empty where a contact changes."""
    from rb_sim.scene.compile import compile_scene

    block, scene, layout = samples(mapping, t)
    if any(np.ptp(block.contact_state, axis=0)) or block.events:
        return []
    system = compile_scene(scene, coordinates="maximal").system
    moved = {name: wrench_of_motion(block, system, i) for i, name in enumerate(layout.bodies)}
    acting = dict(zip(layout.bodies, active(block, system, t), strict=True))
    for i, name in enumerate(layout.reactions):
        if "/" not in name:
            spec: Any = scene.constraints[name]
            for body, sign in ((spec.body, 1.0), (getattr(spec, "parent", None), -1.0)):
                if body is not None:
                    acting[body] += sign * about(block, i, layout.bodies.index(body))
    return [
        float(np.abs(moved[name] - acting[name]).max() / (1.0 + np.abs(moved[name]).max()))
        for name in layout.bodies
    ]


def wrench_of_motion(block: Any, system: Any, i: int) -> np.ndarray:
    """[m dV/dt, d(R I w)/dt] of body i at the middle sample."""
    xx, yy, zz, xy, xz, yz = system.bodies[i, 1:7]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    spin = block.angular_velocity[:, i] @ inertia
    turning = Rotation.from_quat(block.orientation[:, i]).apply(spin)
    force = system.bodies[i, 0] * middle_rate(block.linear_velocity[:, i])
    return np.concatenate([force, middle_rate(turning)])


def active(block: Any, system: Any, t: float) -> list[np.ndarray]:
    """[F, K about C], world axes, of the effects on each body."""
    from rb_sim.catalogue.spec import WORLD, BodyState, wrench
    from rb_sim.mechanics.systems.many_bodies import inertial_of

    def state(i: int) -> Any:
        if i < 0:
            return WORLD
        parts = (block.position, block.orientation, block.linear_velocity, block.angular_velocity)
        return BodyState(*(tuple(part[2, i].tolist()) for part in parts))

    total = [np.zeros(6) for _ in range(block.position.shape[1])]
    for placed in system.effects:
        B, A = state(placed.body), state(placed.parent)
        f, k = wrench(placed.row, t, inertial_of(system, placed.body), B, A)
        k = Rotation.from_quat(B.q_WB).apply(k)
        total[placed.body] += np.concatenate([f, k])
        if placed.parent >= 0:
            back = k + np.cross(np.array(B.p_WC) - A.p_WC, f)
            total[placed.parent] -= np.concatenate([f, back])
    return total


def about(block: Any, reaction: int, body: int) -> np.ndarray:
    """[force, torque about the body's C] of a reaction at the middle sample."""
    force, arm = (
        block.reaction_force[2, reaction],
        block.anchor[2, reaction] - block.position[2, body],
    )
    return np.concatenate([force, block.reaction_torque[2, reaction] + np.cross(arm, force)])


def check(mapping: Mapping) -> None:
    seen = [defects(mapping, t) for t in INSTANTS]
    assert any(seen)
    assert max(max(found) for found in seen if found) <= CLOSE


@pytest.mark.parametrize("name", sorted(JOINTS))
def test_one_body(name: str) -> None:
    check(JOINTS[name])


@pytest.mark.parametrize("name", [listed.name for listed in list_scenes()])
def test_shipped_scene(name: str) -> None:
    path = find_scene(name)
    check(parse(path.read_text(), path.name))
