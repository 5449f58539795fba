# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""DART: reduced joints, semi-implicit Euler, stepped from Python; no rolling scenes here."""

from __future__ import annotations

import dartpy
import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.peers.engine import Run, Way, steps
from benchmarks.peers.scenes import Array, Scene, rotation

PACKAGE = "dartpy"
KIND = "engine"


def ways(scene: Scene) -> list[Way]:
    """DART's integrator over its step."""
    if scene.name.startswith("rolling"):
        return []
    return [Way("semi-implicit", steps(scene, 0.02, 2e-5))]


def build(scene: Scene, method: str, knob: float) -> Run:
    """A world with the step `knob` [s]."""
    return _Dart(scene, knob)


class _Dart(Run):
    def __init__(self, scene: Scene, step: float) -> None:
        self._scene, self._step = scene, step

    def start(self) -> None:
        scene = self._scene
        skeleton = dartpy.dynamics.Skeleton("skeleton")
        if scene.name == "pendulum":
            joint, self._body = skeleton.createRevoluteJointAndBodyNodePair()
            joint.setAxis([0.0, 1.0, 0.0])
            angle = 2.0 * np.arctan2(scene.quaternion[1], scene.quaternion[3])
            joint.setPositions([angle])
        elif scene.name == "heavy_top":
            joint, self._body = skeleton.createBallJointAndBodyNodePair()
            joint.setPositions(np.zeros(3))
            joint.setVelocities(scene.spin)
        else:
            joint, self._body = skeleton.createFreeJointAndBodyNodePair()
            own = rotation(scene.quaternion).T @ scene.velocity
            joint.setVelocities(np.concatenate([scene.spin, own]))
        inertia = dartpy.dynamics.Inertia()
        inertia.setMass(scene.mass)
        inertia.setLocalCOM(scene.center)
        inertia.setMoment(np.diag(scene.inertia))
        self._body.setInertia(inertia)
        self._world = dartpy.simulation.World()
        self._world.setTimeStep(self._step)
        self._world.setGravity(scene.gravity)
        self._world.addSkeleton(skeleton)
        self._done = 0

    def advance(self, t: float) -> None:
        count = round(t / self._step)
        for _ in range(count - self._done):
            self._world.step()
        self._done = count

    def pose(self) -> tuple[Array, Array]:
        place = np.array(self._body.getWorldTransform().matrix())
        turn = place[:3, :3]
        position = place[:3, 3] + turn @ self._scene.center
        return position, Rotation.from_matrix(turn).as_quat()
