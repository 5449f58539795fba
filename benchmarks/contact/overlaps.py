# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Overlap of two convex bodies, from their poses alone: written apart from the program's geometry.

Of a ball and a body: the distance of the ball's centre.  Of others the least width, over all
directions, by which they would have to move apart (the separating axis).  That width is a convex
function of the directions d that have one component in common, and so found near the best of a
first look around by one golden section inside another, to some 1e-11 of a depth that is none and a
hundredth of one that is.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.contact.shapes import reach

FIRST, ROUNDS, SIDE, FINER = 400, 6, 7, 0.5
"""Directions looked at first all around; grids about the best, directions along a side of one, and
the width of the next over its own."""
WIDTH = 0.2
"""Half the width of the first grid [rad]."""
FARTHEST = 2.0
"""Tangent of the largest angle about the best direction so far, in which the sections look: a rod
just beside an edge is parted from it by a sliver of directions that no grid has seen."""
GOLDEN, SECTIONS, MOST = 0.5 * (5.0**0.5 - 1.0), 58, 40
"""Of the golden sections: ratio, rounds, and instants that are looked at so closely."""

Pose = tuple[Any, Any]
"""Position of the origin (n, 3) [m], and orientation (n, 4), [x, y, z, w]."""


def overlap(shape: dict[str, Any], pose: Pose, other: dict[str, Any], place: Pose) -> Any:
    """Width by which the two overlap at each instant [m], (n,); where they are clearly apart, or
    overlap less than at the MOST worst instants, a bound of it from above or minus infinity."""
    if other["type"] == "sphere" and shape["type"] != "ellipsoid":
        x = Rotation.from_quat(pose[1]).inv().apply(np.asarray(place[0]) - np.asarray(pose[0]))
        return other["radius"] - distance(shape, x)
    pair = Widths(shape, pose, other, place)
    least, best = pair.looked_around()
    out = np.where(least < 0.0, least, -np.inf)
    worst = np.argsort(-least)[:MOST]
    rows = worst[least[worst] >= 0.0]
    if len(rows):
        out[rows] = pair.least_near(rows, best[rows])
    return out


def distance(shape: dict[str, Any], x: Any) -> Any:
    """Of points in body axes (n, 3) from a box, a rod, a disk, a cylinder or a ball; inside of it
    minus the depth below the nearest of its surfaces [m]."""
    if shape["type"] == "sphere":
        return np.linalg.norm(x, axis=1) - shape["radius"]
    if shape["type"] == "box":
        out = np.abs(x) - 0.5 * np.array(shape["size"])
    else:
        e = np.array(shape["axis_B"])
        along = x @ e
        across = np.linalg.norm(x - along[:, None] * e, axis=1) - shape.get("radius", 0.0)
        out = np.stack([across, np.abs(along) - 0.5 * shape.get("length", 0.0)], axis=1)
    return np.linalg.norm(np.maximum(out, 0.0), axis=1) + np.minimum(out.max(axis=1), 0.0)


class Widths:
    """Of the overlap of two bodies along directions."""

    def __init__(self, shape: Any, pose: Pose, other: Any, place: Pose) -> None:
        self.shape, self.other = shape, other
        self.far = np.asarray(pose[0]) - np.asarray(place[0])
        self.turn = Rotation.from_quat(pose[1]).as_matrix()
        self.turn_other = Rotation.from_quat(place[1]).as_matrix()

    def along(self, rows: Any, d: Any) -> Any:
        """Width along unit vectors d (m, k, 3), from the other body to this one, (m, k)."""
        m, k, _ = d.shape
        own = reach(self.shape, -np.matmul(d, self.turn[rows]).reshape(-1, 3)).reshape(m, k)
        others = reach(self.other, np.matmul(d, self.turn_other[rows]).reshape(-1, 3))
        return own + others.reshape(m, k) - np.matmul(d, self.far[rows][:, :, None])[:, :, 0]

    def looked_around(self) -> tuple[Any, Any]:
        """(least width, its direction) on grids; the first with which they are apart will do."""
        everywhere = directions(FIRST)
        rows = np.arange(len(self.far))
        found = self.along(rows, np.broadcast_to(everywhere, (len(rows), *everywhere.shape)))
        least, best = found.min(axis=1), everywhere[found.argmin(axis=1)]
        grid = np.linspace(-WIDTH, WIDTH, SIDE)
        for _ in range(ROUNDS):
            rows = np.flatnonzero(least >= 0.0)
            first, second = across(best[rows])
            a, b = (x.reshape(-1, 1) for x in np.meshgrid(grid, grid))
            around = best[rows][:, None] + a * first[:, None] + b * second[:, None]
            around /= np.linalg.norm(around, axis=2, keepdims=True)
            found = self.along(rows, around)
            at = found.argmin(axis=1)
            least[rows] = found[np.arange(len(rows)), at]
            best[rows] = around[np.arange(len(rows)), at]
            grid = FINER * grid
        return least, best

    def least_near(self, rows: Any, d: Any) -> Any:
        """Least width along d + a first + b second, (len(rows),)."""
        first, second = across(d)

        def at(a: Any, b: Any) -> Any:
            x = d + a[:, None] * first + b[:, None] * second
            size = np.linalg.norm(x, axis=1)
            # homogeneous: times its size it is convex in a and b
            return self.along(rows, (x / size[:, None])[:, None])[:, 0] * size

        return golden(lambda a: golden(lambda b: at(a, b), len(rows)), len(rows))


def golden(function: Any, n: int) -> Any:
    """Least of n convex functions of one variable each, over -FARTHEST to FARTHEST."""
    low, high = np.full(n, -FARTHEST), np.full(n, FARTHEST)
    a, b = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_a, at_b = function(a), function(b)
    least = np.minimum(at_a, at_b)
    for _ in range(SECTIONS):
        left = at_a < at_b
        low, high = np.where(left, low, a), np.where(left, b, high)
        new = np.where(left, high - GOLDEN * (high - low), low + GOLDEN * (high - low))
        found = function(new)
        least = np.minimum(least, found)
        a, b = np.where(left, new, b), np.where(left, a, new)
        at_a, at_b = np.where(left, found, at_b), np.where(left, at_a, found)
    return least


def directions(n: int) -> Any:
    """n unit vectors all around, along a spiral, and the six axes."""
    i = np.arange(n) + 0.5
    z, angle = 1.0 - 2.0 * i / n, np.pi * (1.0 + 5.0**0.5) * i
    r = np.sqrt(1.0 - z * z)
    spiral = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)
    return np.concatenate([spiral, np.eye(3), -np.eye(3)])


def across(d: Any) -> tuple[Any, Any]:
    """Two unit vectors across each of d, (m, 3)."""
    first = np.cross(d, np.eye(3)[np.abs(d).argmin(axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(d, first)
