# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Normals of supports, from poses alone: apart from the geometry of the program."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.contact.loads import point_of


def normal_of(contact: Any, mapping: Any, trajectory: Any, at: Any) -> Any:
    """From the support to the body, at each sample; at: the points of contact, shape (n, 3)."""
    surface, parent = contact.get("surface", {"type": "plane"}), contact.get("parent")

    def turned(direction: Any) -> Any:
        n = np.tile(np.array(direction, float), (len(at), 1))
        return Rotation.from_quat(trajectory.orientation[parent]).apply(n) if parent else n

    def placed(point: Any) -> Any:
        return point_of(mapping, trajectory, parent, point)

    if surface["type"] == "plane":
        return turned(surface.get("normal", [0.0, 0.0, 1.0]))
    if surface["type"] == "shape":
        return off_shape(contact, mapping, trajectory, at)
    if surface["type"] == "sphere":
        away, side = at - placed(surface["center"]), surface.get("side", "outside")
    else:
        away, side = at - placed(surface["point"]), surface.get("side", "inside")
        axis = turned(np.array(surface["axis"]) / np.linalg.norm(surface["axis"]))
        away = away - np.sum(away * axis, axis=1)[:, None] * axis
    return (-1.0 if side == "inside" else 1.0) * unit(away)


def off_shape(contact: Any, mapping: Any, trajectory: Any, at: Any) -> Any:
    """The same of the parent's own shape: away from its nearest point for balls, which are above
    it, else off the face on which the point lies."""
    parent, body = contact["parent"], mapping["bodies"][contact["body"]]
    shape = mapping["bodies"][parent]["shape"]
    middle = point_of(mapping, trajectory, parent, shape.get("center_B", [0.0, 0.0, 0.0]))
    if shape["type"] == "sphere":
        return unit(at - middle)
    turn = Rotation.from_quat(trajectory.orientation[parent])
    if shape["type"] == "cylinder":
        axis = np.array(shape["axis_B"]) / np.linalg.norm(shape["axis_B"])
        half = np.array([shape["radius"], 0.5 * shape["length"]])
    own = body.get("shape", {})
    ball = own.get("type") == "sphere" and "points" not in contact
    centre = own.get("center_B", [0.0, 0.0, 0.0])
    to = point_of(mapping, trajectory, contact["body"], centre) if ball else at
    x = turn.inv().apply(to - middle)
    if shape["type"] == "box":
        ways, sizes, half = np.eye(3)[None] * np.sign(x)[:, :, None], abs(x), shape["size"]
        half = 0.5 * np.array(half)
    else:
        along = x @ axis
        across = x - along[:, None] * axis
        ways = np.stack([unit(across), np.sign(along)[:, None] * axis], axis=1)
        sizes = np.stack([np.linalg.norm(across, axis=1), abs(along)], axis=1)
    beyond = sizes - half
    outside = np.sum(np.maximum(beyond, 0.0)[:, :, None] * ways, axis=1)
    face = ways[np.arange(len(x)), beyond.argmax(axis=1)]
    return turn.apply(unit(outside) if ball else face)


def unit(v: Any) -> Any:
    """Of length 1."""
    return v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-300)
