# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""MuJoCo: joints in their own coordinates, springs as tendons; RK4 and the implicit default."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from benchmarks.hard_cases.described import Described, Link
from rb_sim.catalogue.constraints.joints import FixedPoint
from rb_sim.mechanics.samples import Array

METHODS = ("RK4", "implicitfast")

mujoco.set_mju_user_warning(lambda message: None)


def run(scene: Described, method: str, step: float, count: int, every: int) -> Array:
    """(count, links, 13): of each sample, `every` steps apart, position and velocity of the centre
    of mass in the world, attitude xyzw and spin in body axes, in the order of a sample."""
    model = mujoco.MjModel.from_xml_string(_model(scene, method, step))
    data = mujoco.MjData(model)
    _start(scene, model, data)
    rows = np.zeros((count, len(scene.links), 13))
    for i in range(count):
        if i:
            mujoco.mj_step(model, data, nstep=every)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        for k, link in enumerate(scene.links):
            body, twist = data.body(link.name), np.zeros(6)
            kind = mujoco.mjtObj.mjOBJ_BODY
            mujoco.mj_objectVelocity(model, data, kind, body.id, twist, 0)
            spin = body.xmat.reshape(3, 3).T @ twist[:3]
            rows[i, k] = np.concatenate([body.xipos, np.roll(body.xquat, -1), twist[3:], spin])
    return rows


def _text(values: Any) -> str:
    return " ".join(f"{v:.17g}" for v in values)


def _model(scene: Described, method: str, step: float) -> str:
    sites = "".join(
        f'<site name="anchor{n}" pos="{_text(spring.point_A)}"/>'
        for n, (_, spring) in enumerate(scene.springs)
    )
    tendons = "".join(
        f'<spatial stiffness="{spring.stiffness:.17g}" damping="{spring.damping:.17g}" '
        f'springlength="{spring.rest_length:.17g}"><site site="anchor{n}"/>'
        f'<site site="end{n}"/></spatial>'
        for n, (_, spring) in enumerate(scene.springs)
    )
    bodies = "".join(_body(scene, k) for k, link in enumerate(scene.links) if link.parent < 0)
    return (
        f'<mujoco><option timestep="{step:.17g}" gravity="{_text(scene.gravity)}" '
        f'integrator="{method}" tolerance="1e-14"><flag autoreset="disable" contact="disable"/>'
        f"</option><worldbody>{sites}{bodies}</worldbody><tendon>{tendons}</tendon></mujoco>"
    )


def _body(scene: Described, k: int) -> str:
    link = scene.links[k]
    origin, turn = link.origin, link.turn
    if link.parent >= 0:
        parent = scene.links[link.parent]
        origin, turn = parent.turn.T @ (origin - parent.origin), parent.turn.T @ turn
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, turn.ravel())
    inertia = link.body.inertia
    six = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    ends = "".join(
        f'<site name="end{n}" pos="{_text(spring.point_B)}"/>'
        for n, (at, spring) in enumerate(scene.springs)
        if at == k
    )
    inner = "".join(_body(scene, j) for j, other in enumerate(scene.links) if other.parent == k)
    return (
        f'<body name="{link.name}" pos="{_text(origin)}" quat="{_text(quaternion)}">'
        f'{_joint(link)}<inertial pos="{_text(link.center)}" mass="{link.body.mass:.17g}" '
        f'fullinertia="{_text(six)}"/>{ends}{inner}</body>'
    )


def _joint(link: Link) -> str:
    if link.joint is None:
        return "<freejoint/>"
    at = f'pos="{_text(link.joint.point_B)}"'
    if isinstance(link.joint, FixedPoint):
        return f'<joint type="ball" {at}/>'
    return f'<joint type="hinge" axis="{_text(link.joint.axis_B)}" {at}/>'


def _start(scene: Described, model: Any, data: Any) -> None:
    mujoco.mj_resetData(model, data)
    for link in scene.links:
        spin = np.array(link.body.angular_velocity)
        if link.parent >= 0:
            parent = scene.links[link.parent]
            spin = spin - link.turn.T @ parent.turn @ np.array(parent.body.angular_velocity)
        first = model.jnt_dofadr[model.body_jntadr[data.body(link.name).id]]
        if link.joint is None:
            velocity = np.concatenate([link.body.linear_velocity, spin])
        elif isinstance(link.joint, FixedPoint):
            velocity = spin
        else:
            velocity = [spin @ np.array(link.joint.axis_B)]
        data.qvel[first : first + len(velocity)] = velocity
    for at, force in scene.forces:
        data.xfrc_applied[data.body(scene.links[at].name).id, :3] = force
