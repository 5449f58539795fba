# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""How deep the bodies of a heap overlap at given poses: the same measure for every engine."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

Array = np.ndarray


def deepest(mapping: dict[str, Any], positions: Array, orientations: Array) -> float:
    """The deepest overlap [m] of any two bodies, or of one with a plane of the world; 0 if none.

    positions, orientations: of all bodies in their order, shapes (N, 3) and (N, 4) [x, y, z, w].
    """
    bodies = list(mapping["bodies"].values())
    turns = Rotation.from_quat(orientations).as_matrix()
    worst = 0.0
    for point, normal in planes_of(mapping):
        for body, p, R in zip(bodies, positions, turns, strict=True):
            worst = max(worst, reach(body["shape"], R, normal) - (p - point) @ normal)
    for i, j in combinations(range(len(bodies)), 2):
        pair = bodies[i]["shape"], bodies[j]["shape"]
        worst = max(worst, overlap(*pair, turns[i], turns[j], positions[j] - positions[i]))
    return float(worst)


def planes_of(mapping: dict[str, Any]) -> list[tuple[Array, Array]]:
    """(point, normal) of the planes of the world, once each."""
    seen = {}
    for contact in mapping["constraints"].values():
        if "parent" not in contact and "between" not in contact:
            surface = contact.get("surface", {})
            point, normal = surface.get("point", [0, 0, 0]), surface.get("normal", [0, 0, 1])
            seen[(*point, *normal)] = (np.array(point, float), np.array(normal, float))
    return list(seen.values())


def reach(shape: dict[str, Any], R: Array, n: Array) -> float:
    """How far a ball or a box reaches from its centre along n, or against it."""
    if shape["type"] == "sphere":
        return float(shape["radius"])
    return float(0.5 * np.abs(R.T @ n) @ np.array(shape["size"]))


def overlap(a: dict[str, Any], b: dict[str, Any], A: Array, B: Array, d: Array) -> float:
    """Overlap [m] of two balls or two boxes whose centres are d apart, negative where they are
    apart (of boxes the least over the axes that can separate them; Gottschalk 1996)."""
    far = np.linalg.norm(d)
    if a["type"] == "sphere":
        return float(a["radius"] + b["radius"] - far)
    if far > 0.5 * (np.linalg.norm(a["size"]) + np.linalg.norm(b["size"])):
        return -1.0
    axes = [*A.T, *B.T, *(np.cross(x, y) for x in A.T for y in B.T)]
    found = np.inf
    for axis in axes:
        size = np.linalg.norm(axis)
        if size > 1e-6:
            n = axis / size
            found = min(found, reach(a, A, n) + reach(b, B, n) - abs(d @ n))
    return float(found)
