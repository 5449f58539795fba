# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Drake: continuous MultibodyPlant with its integrators; rolling is contact, in three ways.

Fixed-step Runge-Kutta is Drake's best on joints, and error control by `accuracy` its natural way;
both are measured. Rolling is a discrete plant with its default contact, a continuous one with
`cenic`, its integrator for contact with error control, and one with radau3 on a contact that is
stiff enough for an error of some 1e-3 (`_STIFF`); stiffer ones take hours. A fixed point is a
BallRpyJoint (there is no quaternion ball joint); its frames are chosen so that the known motion
stays clear of the joint's singularity.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import (
    AddContactMaterial,
    Cylinder,
    HalfSpace,
    ProximityProperties,
    Sphere,
)
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.math import SpatialForce, SpatialVelocity
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    CoulombFriction,
    DiscreteContactApproximation,
    ExternallyAppliedSpatialForce,
    MultibodyPlant,
)
from pydrake.multibody.tree import (
    BallRpyJoint,
    FixedOffsetFrame,
    RevoluteJoint,
    RotationalInertia,
    SpatialInertia,
)
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import DiagramBuilder

from benchmarks.peers.engine import Run, Way, steps, tolerances
from benchmarks.peers.reference import Reference
from benchmarks.peers.scenes import Array, Scene, load, rotation

PACKAGE = "drake"
KIND = "engine"

_HALF_THICKNESS = 1e-4
"""Of the cylinder that stands for the thin disk [m]."""

_LARGEST_STEP = 0.1
"""Drake's own default; with much larger ones its error control may never return [s]."""


_STIFF = {"point_stiffness": 1e6, "dissipation": 10.0}
"""[N/m], [s/m] of Hunt and Crossley: a weight of 20 N sinks by 2e-5 m."""

_STICTION = 1e-4
"""Slip [m/s] up to which the stiff contact sticks."""


def ways(scene: Scene) -> list[Way]:
    """Fixed steps and accuracies of the Runge-Kutta methods; contact for rolling."""
    if scene.name.startswith("rolling"):
        ladder = steps(scene, 0.01, 1e-4)
        contact = [
            Way("discrete/lagged", ladder),
            Way("discrete/similar", ladder),
            Way("cenic/accuracy", tolerances(1, 7)),
        ]
        if scene.name == "rolling_disk":  # radau3 stands still where the lowest point of a rim runs
            return contact
        return [*contact, Way("radau3/stiff", tolerances(2, 4))]
    ladder, accuracies = steps(scene), tolerances(1, 12)
    return [
        Way("semi_explicit_euler/fixed", ladder),
        Way("runge_kutta3/fixed", ladder),
        Way("runge_kutta5/fixed", ladder),
        Way("runge_kutta3/accuracy", accuracies),
        Way("runge_kutta5/accuracy", accuracies),
    ]


def build(scene: Scene, method: str, knob: float) -> Run:
    """The plant with the integrator of `method`, step [s] or accuracy `knob`."""
    return _Drake(scene, method, knob)


class _Drake(Run):
    def __init__(self, scene: Scene, method: str, knob: float) -> None:
        self._scene = scene
        scheme, _, control = method.partition("/")
        builder = DiagramBuilder()
        if scheme == "discrete":
            self._plant, _ = AddMultibodyPlantSceneGraph(builder, knob)
            approximation = getattr(DiscreteContactApproximation, f"k{control.title()}")
            self._plant.set_discrete_contact_approximation(approximation)
        elif scene.name.startswith("rolling"):
            self._plant, _ = AddMultibodyPlantSceneGraph(builder, 0.0)
            self._plant.set_name("plant")  # by which cenic finds it
        else:
            self._plant = builder.AddSystem(MultibodyPlant(0.0))
        self._add_body(stiff=control == "stiff")
        system = builder.Build()
        self._simulator = Simulator(system)
        self._context = self._plant.GetMyMutableContextFromRoot(
            self._simulator.get_mutable_context()
        )
        self._fix_load()
        if scheme != "discrete":
            step = knob if control == "fixed" else _LARGEST_STEP
            integrator = ResetIntegratorFromFlags(self._simulator, scheme, step)
            if control == "fixed":
                integrator.set_fixed_step_mode(True)
            else:
                integrator.set_target_accuracy(knob)

    def _add_body(self, *, stiff: bool) -> None:
        scene, plant = self._scene, self._plant
        inertia = SpatialInertia.MakeFromCentralInertia(
            scene.mass, scene.center, RotationalInertia(*scene.inertia)
        )
        self._body = plant.AddRigidBody("body", inertia)
        plant.mutable_gravity_field().set_gravity_vector(scene.gravity)
        self._joint: Any = None
        if scene.name == "pendulum":
            joint = RevoluteJoint("hinge", plant.world_frame(), self._body.body_frame(), [0, 1, 0])
            self._joint = plant.AddJoint(joint)
        elif scene.name == "heavy_top":
            self._turn = RotationMatrix(_clear_of_singularity(scene.name))
            # M's x axis along the spin axis (body y)
            self._mount = RotationMatrix(np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]))
            frames = [
                plant.AddFrame(FixedOffsetFrame(name, parent, RigidTransform(turn)))
                for name, parent, turn in (
                    ("F", plant.world_frame(), self._turn),
                    ("M", self._body.body_frame(), self._mount),
                )
            ]
            self._joint = plant.AddJoint(BallRpyJoint("tip", *frames))
        if scene.name.startswith("rolling"):
            self._add_contact(stiff=stiff)
        plant.Finalize()
        if stiff:
            plant.set_stiction_tolerance(_STICTION)

    def _add_contact(self, *, stiff: bool) -> None:
        """The body's rim on the floor."""
        plant, radius, here = self._plant, self._scene.size[0], RigidTransform()
        shape = Sphere(radius)
        if self._scene.name == "rolling_disk":
            shape = Cylinder(radius, 2 * _HALF_THICKNESS)
        material = ProximityProperties()
        kind = _STIFF if stiff else {}
        AddContactMaterial(friction=CoulombFriction(1.0, 1.0), properties=material, **kind)
        plant.RegisterCollisionGeometry(self._body, here, shape, "rim", material)
        ground = HalfSpace()
        plant.RegisterCollisionGeometry(plant.world_body(), here, ground, "floor", material)

    def _fix_load(self) -> None:
        if not np.any(self._scene.force) and not np.any(self._scene.torque):
            return
        load = ExternallyAppliedSpatialForce()
        load.body_index = self._body.index()
        load.p_BoBq_B = self._scene.center
        load.F_Bq_W = SpatialForce(self._scene.torque, self._scene.force)
        port = self._plant.get_applied_spatial_force_input_port()
        port.FixValue(self._context, Value([load]))

    def start(self) -> None:
        scene, plant, context = self._scene, self._plant, self._context
        self._simulator.get_mutable_context().SetTime(0.0)
        attitude = rotation(scene.quaternion)
        if scene.name == "pendulum":
            angle = 2.0 * np.arctan2(scene.quaternion[1], scene.quaternion[3])
            self._joint.set_angle(context, angle)
            self._joint.set_angular_rate(context, 0.0)
        elif scene.name == "heavy_top":
            turn = self._turn.inverse() @ RotationMatrix(attitude) @ self._mount
            self._joint.set_angles(context, RollPitchYaw(turn).vector())
            spin = self._turn.inverse() @ (attitude @ scene.spin)
            self._joint.set_angular_velocity(context, spin)
        else:
            position = scene.origin.copy()
            if scene.name == "rolling_disk":
                position[2] += _HALF_THICKNESS * attitude[2, 2]
            pose = RigidTransform(RotationMatrix(attitude), position)
            plant.SetFreeBodyPose(context, self._body, pose)
            velocity = SpatialVelocity(attitude @ scene.spin, scene.velocity)
            plant.SetFreeBodySpatialVelocity(context, self._body, velocity)
        self._simulator.Initialize()

    def advance(self, t: float) -> None:
        self._simulator.AdvanceTo(t)

    def pose(self) -> tuple[Array, Array]:
        pose = self._plant.EvalBodyPoseInWorld(self._context, self._body)
        position = pose.translation() + pose.rotation().matrix() @ self._scene.center
        return position, np.roll(pose.rotation().ToQuaternion().wxyz(), -1)


@functools.cache
def _clear_of_singularity(name: str) -> Array:
    """Rotation whose z axis stays farthest from the path of the body's y axis, both ways."""
    scene = load(name)
    quaternions = Reference(scene).pose(scene.times)[1]
    path = np.array([rotation(q)[:, 1] for q in quaternions])
    n = np.arange(2000) + 0.5
    height, turn = 1.0 - 2.0 * n / 2000, np.pi * (1.0 + np.sqrt(5.0)) * n
    flat = np.sqrt(1.0 - height**2)
    directions = np.column_stack([flat * np.cos(turn), flat * np.sin(turn), height])
    z = directions[np.argmin(np.max(np.abs(directions @ path.T), axis=1))]
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
