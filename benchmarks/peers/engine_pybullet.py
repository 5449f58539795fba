# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bullet: multibody joints, point-to-point for the top (its joint is far worse), contact."""

from __future__ import annotations

import tempfile
import weakref

import numpy as np
import pybullet

from benchmarks.peers.engine import Run, Way, steps
from benchmarks.peers.scenes import Array, Scene, rotation

PACKAGE = "pybullet"
KIND = "engine"

_HALF_THICKNESS = 1e-4
"""Of the cylinder that stands for the thin disk [m]."""


def ways(scene: Scene) -> list[Way]:
    """Bullet's one integrator, semi-implicit Euler, over its step."""
    kind = "contact" if scene.name.startswith("rolling") else "joint"
    if scene.name == "heavy_top":
        kind = "point-to-point"
    return [Way(f"semi-implicit/{kind}", steps(scene, 0.02, 2e-5))]


def build(scene: Scene, method: str, knob: float) -> Run:
    """A world of its own with the step `knob` [s]."""
    return _Bullet(scene, knob)


class _Bullet(Run):
    def __init__(self, scene: Scene, step: float) -> None:
        self._scene, self._step = scene, step
        self._client = pybullet.connect(pybullet.DIRECT)
        weakref.finalize(self, pybullet.disconnect, self._client)

    def start(self) -> None:
        scene, here = self._scene, {"physicsClientId": self._client}
        pybullet.resetSimulation(**here)
        pybullet.setTimeStep(self._step, **here)
        pybullet.setPhysicsEngineParameter(numSolverIterations=200, **here)
        pybullet.setGravity(*scene.gravity, **here)
        self._hinge = scene.name == "pendulum"
        self._body = self._make_hinge(here) if self._hinge else self._make_body(here)
        link = 0 if self._hinge else -1
        pybullet.changeDynamics(
            self._body,
            link,
            linearDamping=0,
            angularDamping=0,
            jointDamping=0,
            maxJointVelocity=1e4,
            lateralFriction=1.0,
            restitution=0,
            **here,
        )
        if not self._hinge:  # on a link this would lock the joint, silently
            pybullet.changeDynamics(
                self._body,
                link,
                mass=scene.mass,
                localInertiaDiagonal=scene.inertia.tolist(),
                **here,
            )
            turn = rotation(scene.quaternion)
            velocity = scene.velocity + turn @ np.cross(scene.spin, scene.center)
            pybullet.resetBaseVelocity(
                self._body, velocity.tolist(), (turn @ scene.spin).tolist(), **here
            )
        self._loaded = bool(np.any(scene.force) or np.any(scene.torque))
        self._done = 0

    def _make_body(self, here: dict) -> int:
        scene, radius = self._scene, self._scene.size[0]
        position, shape = scene.position, -1
        if scene.name.startswith("rolling"):
            floor = pybullet.createCollisionShape(pybullet.GEOM_PLANE, **here)
            plane = pybullet.createMultiBody(0, floor, **here)
            pybullet.changeDynamics(plane, -1, lateralFriction=1.0, restitution=0, **here)
            shape = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=radius, **here)
        if scene.name == "rolling_disk":
            shape = pybullet.createCollisionShape(
                pybullet.GEOM_CYLINDER, radius=radius, height=2 * _HALF_THICKNESS, **here
            )
            cosine = rotation(scene.quaternion)[2, 2]
            position = position + np.array([0.0, 0.0, _HALF_THICKNESS * cosine])
        held = scene.name == "heavy_top"
        body = pybullet.createMultiBody(
            scene.mass,
            shape,
            basePosition=position.tolist(),
            baseOrientation=scene.quaternion.tolist(),
            **here,
        )
        if held:
            joint = pybullet.createConstraint(
                body,
                -1,
                -1,
                -1,
                pybullet.JOINT_POINT2POINT,
                [0, 0, 0],
                (-scene.center).tolist(),
                scene.origin.tolist(),
                **here,
            )
            pybullet.changeConstraint(joint, maxForce=1e9, **here)
        return body

    def _make_hinge(self, here: dict) -> int:
        scene = self._scene
        with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
            file.write(_hinge_description(scene))
            file.flush()
            body = pybullet.loadURDF(
                file.name,
                basePosition=scene.origin.tolist(),
                useFixedBase=True,
                flags=pybullet.URDF_USE_INERTIA_FROM_FILE,
                **here,
            )
        angle = 2.0 * np.arctan2(scene.quaternion[1], scene.quaternion[3])
        pybullet.resetJointState(body, 0, angle, 0.0, **here)
        pybullet.setJointMotorControl2(body, 0, pybullet.VELOCITY_CONTROL, force=0, **here)
        return body

    def advance(self, t: float) -> None:
        count, client = round(t / self._step), self._client
        force, torque = self._scene.force.tolist(), self._scene.torque.tolist()
        for _ in range(count - self._done):
            if self._loaded:
                self._apply(force, torque)
            pybullet.stepSimulation(physicsClientId=client)
        self._done = count

    def _apply(self, force: list[float], torque: list[float]) -> None:
        body, world, client = self._body, pybullet.WORLD_FRAME, self._client
        at = pybullet.getBasePositionAndOrientation(body, physicsClientId=client)[0]
        pybullet.applyExternalForce(body, -1, force, at, world, physicsClientId=client)
        pybullet.applyExternalTorque(body, -1, torque, world, physicsClientId=client)

    def pose(self) -> tuple[Array, Array]:
        here = {"physicsClientId": self._client}
        if self._hinge:
            angle = pybullet.getJointState(self._body, 0, **here)[0]
            quaternion = np.array([0.0, np.sin(0.5 * angle), 0.0, np.cos(0.5 * angle)])
            return rotation(quaternion) @ self._scene.center, quaternion
        position, quaternion = pybullet.getBasePositionAndOrientation(self._body, **here)
        return np.array(position), np.array(quaternion)


def _hinge_description(scene: Scene) -> str:
    """URDF of the pendulum: a fixed base and a link that turns about y."""
    center, (ixx, iyy, izz) = " ".join(map(repr, scene.center.tolist())), scene.inertia.tolist()
    return f"""
    <robot name="pendulum">
      <link name="base"/>
      <link name="rod">
        <inertial>
          <origin xyz="{center}"/>
          <mass value="{scene.mass!r}"/>
          <inertia ixx="{ixx!r}" iyy="{iyy!r}" izz="{izz!r}" ixy="0" ixz="0" iyz="0"/>
        </inertial>
      </link>
      <joint name="hinge" type="continuous">
        <parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
        <dynamics damping="0" friction="0"/>
      </joint>
    </robot>"""
