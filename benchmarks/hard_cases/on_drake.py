# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Drake: a continuous MultibodyPlant under fixed steps of its Runge-Kutta methods.

A fixed point is a BallRpyJoint, the only ball joint there is; its angles are zero at the start, and
it fails where the motion reaches their singularity.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialForce, SpatialVelocity
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import (
    BallRpyJoint,
    FixedOffsetFrame,
    LinearSpringDamper,
    RevoluteJoint,
    RotationalInertia,
    SpatialInertia,
)
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import DiagramBuilder

from benchmarks.hard_cases.described import CannotExpressError, Described, Link
from rb_sim.catalogue.constraints.joints import FixedPoint
from rb_sim.mechanics.samples import Array

METHODS = ("runge_kutta5", "runge_kutta3")


def run(scene: Described, method: str, step: float, count: int, every: int) -> Array:
    """As on_mujoco.run."""
    builder = DiagramBuilder()
    plant = builder.AddSystem(MultibodyPlant(0.0))
    bodies = [plant.AddRigidBody(link.name, _inertia(link)) for link in scene.links]
    joints = [_joint(plant, scene, k, bodies) for k in range(len(bodies))]
    plant.mutable_gravity_field().set_gravity_vector(scene.gravity)
    for at, spring in scene.springs:
        if not spring.rest_length > 0.0:
            raise CannotExpressError("a spring without rest length")
        ends = plant.world_body(), spring.point_A, bodies[at], spring.point_B
        law = spring.rest_length, spring.stiffness, spring.damping
        plant.AddForceElement(LinearSpringDamper(*ends, *law))
    plant.Finalize()
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    ResetIntegratorFromFlags(simulator, method, step).set_fixed_step_mode(True)
    _load(plant, context, scene, bodies)
    for link, body, joint in zip(scene.links, bodies, joints, strict=True):
        _start(plant, context, scene, link, body, joint)
    simulator.Initialize()
    rows = np.zeros((count, len(bodies), 13))
    for i in range(count):
        simulator.AdvanceTo(i * every * step)
        for k, (link, body) in enumerate(zip(scene.links, bodies, strict=True)):
            rows[i, k] = _row(plant, context, link, body)
    return rows


def _inertia(link: Link) -> Any:
    i = link.body.inertia
    central = RotationalInertia(i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2])
    return SpatialInertia.MakeFromCentralInertia(link.body.mass, link.center, central)


def _joint(plant: Any, scene: Described, k: int, bodies: list[Any]) -> Any:
    """The joint between two frames that coincide at the start; None for a free body."""
    link = scene.links[k]
    if link.joint is None:
        return None
    point = np.array(link.joint.point_B)
    origin, turn, on = link.origin + link.turn @ point, link.turn, plant.world_frame()
    if link.parent >= 0:
        parent = scene.links[link.parent]
        origin, turn = parent.turn.T @ (origin - parent.origin), parent.turn.T @ turn
        on = bodies[link.parent].body_frame()
    base = RigidTransform(RotationMatrix(turn), origin)
    frames = [
        plant.AddFrame(FixedOffsetFrame(f"{link.name}_{name}", frame, pose))
        for name, frame, pose in (
            ("F", on, base),
            ("M", bodies[k].body_frame(), RigidTransform(point)),
        )
    ]
    name = f"{link.name}_joint"
    if isinstance(link.joint, FixedPoint):
        return plant.AddJoint(BallRpyJoint(name, *frames))
    return plant.AddJoint(RevoluteJoint(name, *frames, np.array(link.joint.axis_B)))


def _load(plant: Any, context: Any, scene: Described, bodies: list[Any]) -> None:
    loads = []
    for at, force in scene.forces:
        load = ExternallyAppliedSpatialForce()
        load.body_index = bodies[at].index()
        load.p_BoBq_B = scene.links[at].center
        load.F_Bq_W = SpatialForce(np.zeros(3), force)
        loads.append(load)
    if loads:
        plant.get_applied_spatial_force_input_port().FixValue(context, Value(loads))


def _start(plant: Any, context: Any, scene: Described, link: Link, body: Any, joint: Any) -> None:
    spin = np.array(link.body.angular_velocity)
    if joint is None:
        pose = RigidTransform(RotationMatrix(link.turn), link.origin)
        plant.SetFreeBodyPose(context, body, pose)
        velocity = SpatialVelocity(link.turn @ spin, np.array(link.body.linear_velocity))
        plant.SetFreeBodySpatialVelocity(context, body, velocity)
        return
    if link.parent >= 0:
        parent = scene.links[link.parent]
        spin = spin - link.turn.T @ parent.turn @ np.array(parent.body.angular_velocity)
    if isinstance(link.joint, FixedPoint):
        joint.set_angular_velocity(context, spin)
    else:
        joint.set_angular_rate(context, spin @ np.array(link.joint.axis_B))


def _row(plant: Any, context: Any, link: Link, body: Any) -> Array:
    pose = plant.EvalBodyPoseInWorld(context, body)
    turn, twist = pose.rotation().matrix(), plant.EvalBodySpatialVelocityInWorld(context, body)
    arm = turn @ link.center
    spin = twist.rotational()
    velocity = twist.translational() + np.cross(spin, arm)
    quaternion = np.roll(pose.rotation().ToQuaternion().wxyz(), -1)
    return np.concatenate([pose.translation() + arm, quaternion, velocity, turn.T @ spin])
