# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Forces and torques of a scene's effects, from its samples alone; apart from the program."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

Array = Any
Load = tuple[str, Array, Array]
"""A body, the force on it and the torque about its centre of mass; world axes, (n, 3) each."""


def turn_of(trajectory: Any, name: str | None) -> Rotation:
    """From a body's axes, or those of the world, to the world's, at each sample."""
    if name is None:
        return Rotation.identity(len(trajectory.t))
    return Rotation.from_quat(trajectory.orientation[name])


def spin_of(trajectory: Any, name: str | None) -> Array:
    """Angular velocity in world axes."""
    if name is None:
        return np.zeros((len(trajectory.t), 3))
    return turn_of(trajectory, name).apply(trajectory.angular_velocity[name])


def point_of(mapping: Any, trajectory: Any, name: str | None, point: Any) -> Array:
    """A point of a body, named from its origin, or of the world."""
    if name is None:
        return np.tile(np.array(point, dtype=float), (len(trajectory.t), 1))
    com = np.array(mapping["bodies"][name].get("center_of_mass", [0.0, 0.0, 0.0]))
    return trajectory.position[name] + turn_of(trajectory, name).apply(np.array(point) - com)


def velocity_of(trajectory: Any, name: str | None, at: Array) -> Array:
    """Of the body's material point that is there."""
    if name is None:
        return np.zeros_like(at)
    far = at - trajectory.position[name]
    return trajectory.linear_velocity[name] + np.cross(spin_of(trajectory, name), far)


def at_point(trajectory: Any, name: str, force: Array, at: Array, torque: Any = 0.0) -> Load:
    return name, force, torque + np.cross(at - trajectory.position[name], force)


def pair(trajectory: Any, spring: Any, force: Array, at: Array, torque: Any = 0.0) -> list[Load]:
    """A wrench on the body of an effect, and its opposite on the parent."""
    out = [at_point(trajectory, spring["body"], force, at, torque)]
    if spring.get("parent"):
        out.append(at_point(trajectory, spring["parent"], -force, at, -torque))
    return out


def spring(mapping: Any, trajectory: Any, own: Any) -> list[Load]:
    """-k (l - l0) u and -c (u . d') u, or -k d - c v between material points at the same place."""
    body, parent = own["body"], own.get("parent")
    b = point_of(mapping, trajectory, body, own.get("point_B", [0.0] * 3))
    a = point_of(mapping, trajectory, parent, own.get("point_A", [0.0] * 3))
    k, c, rest = (own.get(key, 0.0) for key in ("stiffness", "damping", "rest_length"))
    d = b - a
    if rest == 0.0:
        slip = velocity_of(trajectory, body, b) - velocity_of(trajectory, parent, b)
        return pair(trajectory, own, -k * d - c * slip, b)
    length = np.maximum(np.linalg.norm(d, axis=1, keepdims=True), 1e-12)
    u = d / length
    rate = velocity_of(trajectory, body, b) - velocity_of(trajectory, parent, a)
    along = np.sum(rate * u, axis=1, keepdims=True)
    return pair(trajectory, own, -(k * (length - rest) + c * along) * u, b)


def torsion(mapping: Any, trajectory: Any, own: Any) -> list[Load]:
    """-k theta grad theta of the twist from the first sample on, and -c of the spin about the
    axis."""
    body, parent = own["body"], own.get("parent")
    B, A = turn_of(trajectory, body), turn_of(trajectory, parent)
    axis, turned = np.array(own["axis_B"]), A.inv() * B
    q = (turned[0].inv() * turned).as_quat()
    v, w = q[:, :3], q[:, 3]
    s = v @ axis
    theta = (2.0 * np.arctan2(s, w) + np.pi) % (2.0 * np.pi) - np.pi
    slope = w[:, None] ** 2 * axis + w[:, None] * np.cross(axis, v) + s[:, None] * v
    slope /= (w * w + s * s)[:, None]
    torque = B.apply(-own.get("stiffness", 0.0) * theta[:, None] * slope)
    about = B.apply(axis)
    spin = np.sum((spin_of(trajectory, body) - spin_of(trajectory, parent)) * about, axis=1)
    torque -= own.get("damping", 0.0) * spin[:, None] * about
    return pair(trajectory, own, np.zeros_like(torque), trajectory.position[body], torque)


def swinging(mapping: Any, trajectory: Any, own: Any) -> list[Load]:
    """A constant force at the origin and torque, and sin(w t) times others; world axes."""
    s = np.sin(own.get("angular_frequency", 0.0) * trajectory.t)[:, None]
    at = point_of(mapping, trajectory, own["body"], [0.0] * 3)
    force, torque = (
        np.array(own.get(what, [0.0] * 3)) + s * np.array(own.get(f"sine_{what}", [0.0] * 3))
        for what in ("force", "torque")
    )
    return [at_point(trajectory, own["body"], force, at, torque)]


def commanded(mapping: Any, trajectory: Any, own: Any) -> list[Load]:
    """As recorded; one body is commanded."""
    at = point_of(mapping, trajectory, own["body"], [0.0] * 3)
    command = trajectory.block.command[:, 0]
    return [at_point(trajectory, own["body"], command[:, :3], at, command[:, 3:])]


KINDS = {
    "spring": spring, "torsion_spring": torsion, "wrench": swinging, "commanded_wrench": commanded
}  # fmt: skip


def loads(mapping: Any, trajectory: Any, name: str) -> tuple[Array, Array]:
    """(force, torque about the centre of mass) of gravity and all effects on a body."""
    weight = (
        np.array(mapping["effects"]["weight"]["acceleration"]) * mapping["bodies"][name]["mass"]
    )
    force = np.tile(weight, (len(trajectory.t), 1))
    torque = np.zeros_like(force)
    for own in mapping["effects"].values():
        if own["type"] in KINDS:
            for who, f, m in KINDS[own["type"]](mapping, trajectory, own):
                if who == name:
                    force, torque = force + f, torque + m
    return force, torque


def power(mapping: Any, trajectory: Any) -> Array:
    """Of the effects that have no potential, and of what drives a velocity [W], (n,)."""
    out = np.zeros(len(trajectory.t))
    for own in mapping["effects"].values():
        if own["type"] in KINDS:
            lossy = own | {"stiffness": 0.0}
            for who, f, m in KINDS[own["type"]](mapping, trajectory, lossy):
                out += np.sum(f * trajectory.linear_velocity[who], axis=1)
                out += np.sum(m * spin_of(trajectory, who), axis=1)
    for name, row in mapping["constraints"].items():
        if row["type"] == "velocity":
            push = trajectory.reaction[name]
            at = velocity_of(trajectory, row["body"], push.anchor)
            out += np.sum(push.force * at, axis=1)
            out += np.sum(push.torque * spin_of(trajectory, row["body"]), axis=1)
    return out
