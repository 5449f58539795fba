# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What the engines are told of a scene: links with one joint each, gravity, springs, forces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rb_sim.base.errors import RbSimError
from rb_sim.catalogue.constraints.joints import FixedPoint
from rb_sim.catalogue.constraints.simple import FixedAxis
from rb_sim.catalogue.effects.gravity import Gravity
from rb_sim.catalogue.effects.spring import Spring
from rb_sim.catalogue.effects.wrench import Wrench
from rb_sim.mechanics.samples import Array
from rb_sim.scene.schema import Body, Scene


class CannotExpressError(RbSimError):
    """The engine has no counterpart of something in the scene, or no figure of the case."""


@dataclass(frozen=True)
class Link:
    """A body and the joint that holds it."""

    name: str
    body: Body
    parent: int
    """number of the link that its joint is on; -1: the world."""
    joint: Any
    """FixedPoint, FixedAxis, or None where it is free."""

    @property
    def turn(self) -> Array:
        """Body axes in the world at the start, (3, 3)."""
        from scipy.spatial.transform import Rotation

        return Rotation.from_quat(np.array(self.body.orientation)).as_matrix()

    @property
    def origin(self) -> Array:
        """Where the body's origin starts [m]."""
        return np.array(self.body.position)

    @property
    def center(self) -> Array:
        """Centre of mass from the origin, body axes [m]."""
        return np.array(self.body.center_of_mass)


@dataclass(frozen=True)
class Described:
    """The scene in these terms."""

    links: tuple[Link, ...]
    gravity: Array
    springs: tuple[tuple[int, Spring], ...]
    """(link, spring to the world)."""
    forces: tuple[tuple[int, Array], ...]
    """(link, constant force at its centre of mass, world axes [N])."""


def described(scene: Scene) -> Described:
    """Raises CannotExpressError, which names what has no counterpart."""
    number = {name: i for i, name in enumerate(scene.bodies)}
    joints: dict[str, Any] = {}
    for name, spec in scene.constraints.items():
        kind = spec.type  # type: ignore[attr-defined]
        if not isinstance(spec, FixedPoint | FixedAxis) or spec.body in joints:
            raise CannotExpressError(f"constraint {name} ({kind})")
        joints[spec.body] = spec
    links = []
    for i, (name, body) in enumerate(scene.bodies.items()):
        joint = joints.get(name)
        parent = -1 if joint is None or joint.parent is None else number[joint.parent]
        if parent >= i:
            raise CannotExpressError(f"{name} hangs on a body that is listed later")
        links.append(Link(name, body, parent, joint))
    gravity, springs, forces = np.zeros(3), [], []
    for name, effect in scene.effects.items():
        if isinstance(effect, Gravity) and effect.bodies is None:
            gravity = gravity + np.array(effect.acceleration)
        elif isinstance(effect, Spring) and effect.parent is None and not any(effect.point_B):
            springs.append((number[effect.body], effect))
        elif isinstance(effect, Wrench) and is_plain(effect, scene.bodies[effect.body]):
            forces.append((number[effect.body], np.array(effect.force)))
        else:
            raise CannotExpressError(f"effect {name} ({effect.type})")  # type: ignore[attr-defined]
    return Described(tuple(links), gravity, tuple(springs), tuple(forces))


def is_plain(effect: Wrench, body: Body) -> bool:
    """A constant force in world axes at the centre of mass."""
    others = (*effect.torque, *effect.sine_force, *effect.sine_torque)
    at_center = tuple(effect.point_B) == tuple(body.center_of_mass)
    return effect.frame == "world" and at_center and not any(others)
