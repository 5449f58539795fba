# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Exudyn: explicit Lie-group Runge-Kutta for free bodies, implicit index 2 with joints."""

from __future__ import annotations

from typing import Any

import exudyn
import numpy as np
from exudyn import utilities as exu
from scipy.spatial.transform import Rotation

from benchmarks.hard_cases.described import CannotExpressError, Described, Link
from rb_sim.catalogue.constraints.joints import FixedPoint
from rb_sim.mechanics.samples import Array

METHODS = ("RK67", "TrapezoidalIndex2")

KINDS = exudyn.OutputVariableType
COLUMNS = (KINDS.Position, KINDS.RotationMatrix, KINDS.Velocity, KINDS.AngularVelocityLocal)


def run(scene: Described, method: str, step: float, count: int, every: int) -> Array:
    """As on_mujoco.run."""
    explicit = method == "RK67"
    if explicit and any(link.joint is not None for link in scene.links):
        raise CannotExpressError("joints under an explicit method")
    container = exudyn.SystemContainer()
    system = container.AddSystem()
    ground = system.CreateGround()
    bodies: list[int] = []
    for link in scene.links:
        bodies.append(_body(system, scene, link, explicit))
        _join(system, link, [ground, *bodies][link.parent + 1], bodies[-1])
    for at, spring in scene.springs:
        system.CreateSpringDamper(
            itemNumbers=[ground, bodies[at]],
            localPosition0=list(spring.point_A),
            localPosition1=list(spring.point_B),
            referenceLength=spring.rest_length,
            stiffness=spring.stiffness,
            damping=spring.damping,
        )
    for at, force in scene.forces:
        center = scene.links[at].center
        system.CreateForce(bodyNumber=bodies[at], loadVector=force, localPosition=center)
    sensors = [
        [
            system.AddSensor(
                exu.SensorBody(
                    bodyNumber=body,
                    localPosition=link.center,
                    outputVariableType=kind,
                    storeInternal=True,
                    writeToFile=False,
                )
            )
            for kind in COLUMNS
        ]
        for link, body in zip(scene.links, bodies, strict=True)
    ]
    system.Assemble()
    _solve(system, method, step, count, every)
    return np.stack([_rows(system, each, count) for each in sensors], axis=1)


def _body(system: Any, scene: Described, link: Link, explicit: bool) -> int:
    arm, mass = link.center, link.body.mass
    about_origin = link.body.inertia + mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    node = exudyn.NodeType
    return system.CreateRigidBody(
        referencePosition=link.origin,
        referenceRotationMatrix=link.turn,
        initialVelocity=np.array(link.body.linear_velocity),
        initialAngularVelocity=link.turn @ np.array(link.body.angular_velocity),
        inertia=exu.RigidBodyInertia(mass, about_origin, com=arm),
        gravity=scene.gravity,
        nodeType=node.RotationRotationVector if explicit else node.RotationEulerParameters,
    )


def _join(system: Any, link: Link, parent: int, body: int) -> None:
    if link.joint is None:
        return
    place = link.origin + link.turn @ np.array(link.joint.point_B)
    if isinstance(link.joint, FixedPoint):
        system.CreateSphericalJoint(itemNumbers=[parent, body], position=place)
        return
    axis = link.turn @ np.array(link.joint.axis_B)
    system.CreateRevoluteJoint(itemNumbers=[parent, body], position=place, axis=axis)


def _solve(system: Any, method: str, step: float, count: int, every: int) -> None:
    settings = exudyn.SimulationSettings()
    time = settings.timeIntegration
    time.endTime, time.verboseMode = (count - 1) * every * step, 0
    time.numberOfSteps = (count - 1) * every
    time.automaticStepSize = time.adaptiveStep = False
    time.explicitIntegration.useLieGroupIntegration = True
    time.explicitIntegration.computeEndOfStepAccelerations = False
    settings.solutionSettings.writeSolutionToFile = False
    settings.solutionSettings.sensorsWritePeriod = every * step
    settings.show.computationTime = settings.show.statistics = False
    kind = getattr(exudyn.DynamicSolverType, method)
    system.SolveDynamic(settings, solverType=kind)


def _rows(system: Any, sensors: list[int], count: int) -> Array:
    """The samples of one body; NaN from where the solver gave up."""
    data = [system.GetSensorStoredData(sensor) for sensor in sensors]
    place, turn, velocity, spin = (values[:count, 1:] for values in data)
    quaternion = Rotation.from_matrix(turn.reshape(-1, 3, 3)).as_quat()
    rows = np.full((count, 13), np.nan)
    rows[: len(place)] = np.concatenate([place, quaternion, velocity, spin], axis=1)
    return rows
