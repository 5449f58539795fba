# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""MuJoCo: reduced joints, or contact with a plane; a block of steps per call of mj_step."""

from __future__ import annotations

import mujoco
import numpy as np

from benchmarks.peers.engine import Run, Way, steps
from benchmarks.peers.scenes import Array, Scene, rotation

PACKAGE = "mujoco"
KIND = "engine"

_HALF_THICKNESS = 1e-4
"""Of the cylinder that stands for the thin disk [m]."""

_CONTACT = {
    "contact": 'solref="0.02 1" solimp="0.9 0.95 0.001 0.5 2"',
    "stiff": 'solref="{stiff:.17g} 1" solimp="0.9999 0.9999 0.001 0.5 2"',
}

mujoco.set_mju_user_warning(lambda _message: None)


def ways(scene: Scene) -> list[Way]:
    """Integrators over steps; on a plane also the default and a stiff contact."""
    if scene.name.startswith("rolling"):
        ladder = steps(scene, 0.02)
        kinds = ("Euler/contact", "RK4/contact", "RK4/stiff", "implicitfast/stiff")
        return [Way(kind, ladder) for kind in kinds]
    return [Way(kind, steps(scene)) for kind in ("Euler", "implicitfast", "implicit", "RK4")]


def build(scene: Scene, method: str, knob: float) -> Run:
    """The model with integrator and contact of `method`, step `knob` [s]."""
    return _MuJoCo(scene, method, knob)


def _numbers(values: Array) -> str:
    return " ".join(f"{v:.17g}" for v in values)


def _model(scene: Scene, method: str, step: float) -> str:
    integrator, _, contact = method.partition("/")
    joint, geom, plane, quaternion = "<freejoint/>", "", "", np.roll(scene.quaternion, 1)
    position = scene.origin
    if scene.name == "heavy_top":
        joint = '<joint type="ball"/>'
    elif scene.name == "pendulum":
        joint, quaternion = '<joint type="hinge" axis="0 1 0"/>', np.array([1.0, 0.0, 0.0, 0.0])
    elif contact:
        radius = scene.size[0]
        form = f'type="sphere" size="{radius}"'
        if scene.name == "rolling_disk":
            form = f'type="cylinder" size="{radius} {_HALF_THICKNESS}"'
            cosine = rotation(scene.quaternion)[2, 2]
            position = position + np.array([0.0, 0.0, _HALF_THICKNESS * cosine])
        material = _CONTACT[contact].format(stiff=2.0 * step)
        friction = f'condim="3" friction="1 0 0" {material}'
        geom = f"<geom {form} {friction}/>"
        plane = f'<geom type="plane" size="0 0 1" {friction}/>'
    return f"""
    <mujoco>
      <option timestep="{step:.17g}" gravity="{_numbers(scene.gravity)}" integrator="{integrator}"
              cone="elliptic" impratio="{100 if contact == "stiff" else 1}" tolerance="1e-14">
        <flag autoreset="disable"/>
      </option>
      <worldbody>{plane}
        <body pos="{_numbers(position)}" quat="{_numbers(quaternion)}">
          {joint}{geom}
          <inertial pos="{_numbers(scene.center)}" mass="{scene.mass:.17g}"
                    diaginertia="{_numbers(scene.inertia)}"/>
        </body>
      </worldbody>
    </mujoco>"""


class _MuJoCo(Run):
    def __init__(self, scene: Scene, method: str, step: float) -> None:
        self._scene, self._step = scene, step
        self._model = mujoco.MjModel.from_xml_string(_model(scene, method, step))
        self._data = mujoco.MjData(self._model)

    def start(self) -> None:
        scene, data = self._scene, self._data
        mujoco.mj_resetData(self._model, data)
        if self._model.nv == 6:
            data.qvel[:] = np.concatenate([scene.velocity, scene.spin])
        elif self._model.nv == 3:
            data.qvel[:] = scene.spin
        else:
            data.qpos[0] = 2.0 * np.arctan2(scene.quaternion[1], scene.quaternion[3])
        data.xfrc_applied[1] = np.concatenate([scene.force, scene.torque])
        self._done = 0

    def advance(self, t: float) -> None:
        count = round(t / self._step)
        mujoco.mj_step(self._model, self._data, nstep=count - self._done)
        self._done = count

    def pose(self) -> tuple[Array, Array]:
        q = self._data.qpos
        if len(q) == 1:
            quaternion = np.array([0.0, np.sin(0.5 * q[0]), 0.0, np.cos(0.5 * q[0])])
        else:
            quaternion = np.roll(q[-4:], -1)
        origin = q[:3].copy() if len(q) == 7 else self._scene.origin
        return origin + rotation(quaternion) @ self._scene.center, quaternion
