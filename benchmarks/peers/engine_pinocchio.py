# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Pinocchio: forward dynamics (ABA) stepped from Python; no contact, so no rolling scenes."""

from __future__ import annotations

import numpy as np
import pinocchio

from benchmarks.peers.engine import Run, Way, steps
from benchmarks.peers.scenes import Array, Scene, rotation

PACKAGE = "pin"
KIND = "engine"


def ways(scene: Scene) -> list[Way]:
    """Semi-implicit Euler, and the textbook RK4 with stages in the tangent space."""
    if scene.name.startswith("rolling"):
        return []
    return [Way("semi-implicit", steps(scene)), Way("RK4", steps(scene))]


def build(scene: Scene, method: str, knob: float) -> Run:
    """The model of one joint, step `knob` [s]."""
    return _Pinocchio(scene, method, knob)


class _Pinocchio(Run):
    def __init__(self, scene: Scene, method: str, step: float) -> None:
        self._scene, self._rk4, self._step = scene, method == "RK4", step
        joints = {"heavy_top": pinocchio.JointModelSpherical, "pendulum": pinocchio.JointModelRY}
        joint = joints.get(scene.name, pinocchio.JointModelFreeFlyer)()
        self._model = pinocchio.Model()
        self._model.gravity.linear = scene.gravity
        number = self._model.addJoint(0, joint, pinocchio.SE3.Identity(), "joint")
        body = pinocchio.Inertia(scene.mass, scene.center, np.diag(scene.inertia))
        self._model.appendBodyToJoint(number, body, pinocchio.SE3.Identity())
        self._data = self._model.createData()

    def start(self) -> None:
        scene, self._done = self._scene, 0
        if self._model.nv == 1:
            self._q = np.array([2.0 * np.arctan2(scene.quaternion[1], scene.quaternion[3])])
            self._v = np.zeros(1)
        elif self._model.nv == 3:
            self._q, self._v = scene.quaternion.copy(), scene.spin.copy()
        else:
            self._q = np.concatenate([scene.origin, scene.quaternion])
            own = rotation(scene.quaternion).T @ scene.velocity
            self._v = np.concatenate([own, scene.spin])

    def advance(self, t: float) -> None:
        count = round(t / self._step)
        step = self._runge_kutta if self._rk4 else self._semi_implicit
        for _ in range(count - self._done):
            step()
        self._done = count

    def _semi_implicit(self) -> None:
        model, data, h = self._model, self._data, self._step
        self._v = self._v + h * pinocchio.aba(model, data, self._q, self._v, np.zeros(model.nv))
        self._q = pinocchio.integrate(model, self._q, h * self._v)

    def _runge_kutta(self) -> None:
        model, data, h, q, v = self._model, self._data, self._step, self._q, self._v
        zero, move = np.zeros(model.nv), pinocchio.integrate
        a1 = pinocchio.aba(model, data, q, v, zero).copy()
        v2 = v + 0.5 * h * a1
        a2 = pinocchio.aba(model, data, move(model, q, 0.5 * h * v), v2, zero).copy()
        v3 = v + 0.5 * h * a2
        a3 = pinocchio.aba(model, data, move(model, q, 0.5 * h * v2), v3, zero).copy()
        v4 = v + h * a3
        a4 = pinocchio.aba(model, data, move(model, q, h * v3), v4, zero).copy()
        self._q = move(model, q, h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4))
        self._v = v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)

    def pose(self) -> tuple[Array, Array]:
        pinocchio.forwardKinematics(self._model, self._data, self._q)
        place = self._data.oMi[1]
        quaternion = pinocchio.Quaternion(place.rotation).coeffs()
        return place.act(self._scene.center), np.array(quaternion)
