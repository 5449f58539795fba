# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Depth of a body in what it touches, from poses alone: apart from the geometry of the program."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.contact.loads import point_of, turn_of
from benchmarks.contact.overlaps import overlap
from benchmarks.contact.shapes import depth_below, depth_in_round, depth_outside

ORIGIN = [0.0, 0.0, 0.0]


def depth_of(contact: Any, mapping: Any, trajectory: Any) -> Any:
    """Depth of the body of a contact in its surface at each sample [m], (n,); negative apart."""
    surface, parent = contact.get("surface", {"type": "plane"}), contact.get("parent")
    shape, p, turn = placed(mapping, trajectory, contact["body"])
    if surface["type"] == "shape":
        other, q, place = placed(mapping, trajectory, parent)
        return overlap(shape, (p, turn.as_quat()), other, (q, place.as_quat()))
    carrier = turn_of(trajectory, parent)
    x = carrier.inv().apply(p - point_of(mapping, trajectory, parent, ORIGIN))
    x -= displacement(contact, trajectory)
    own = (carrier.inv() * turn).as_quat()
    if surface["type"] == "plane":
        beyond = x - np.array(surface.get("point", ORIGIN))
        return depth_below(shape, beyond, own, surface.get("normal", [0.0, 0.0, 1.0]))
    if surface.get("side", "inside" if surface["type"] == "cylinder" else "outside") == "inside":
        return depth_in_round(shape, x, own, surface)
    if surface["type"] == "cylinder":
        return depth_outside(shape, x, own, surface)
    at_rest = np.tile(surface["center"], (len(x), 1)), np.tile([0.0, 0.0, 0.0, 1.0], (len(x), 1))
    return overlap(shape, (x, own), surface, at_rest)


def placed(mapping: Any, trajectory: Any, name: str) -> tuple[Any, Any, Rotation]:
    """(shape, where its middle is (n, 3) [m], how it is turned) of a body."""
    shape = mapping["bodies"][name]["shape"]
    middle = point_of(mapping, trajectory, name, shape.get("center_B", ORIGIN))
    return shape, middle, turn_of(trajectory, name)


def displacement(contact: Any, trajectory: Any) -> Any:
    """Of a support that is shaken, (n, 3) [m]; one that turns stays where it is."""
    motion = contact.get("motion") or {}
    if motion.get("type") != "shaken":
        return np.zeros((len(trajectory.t), 3))
    angle = 2.0 * np.pi * motion["frequency"] * trajectory.t + motion.get("phase", 0.0)
    return motion["amplitude"] * np.sin(angle)[:, None] * np.array(motion["direction"])
