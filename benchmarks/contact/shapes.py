# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Depth of a body below a plane, from its pose alone: written apart from the program's geometry."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation


def depth_below(shape: dict[str, Any], position: Any, quaternion: Any, normal: Any) -> Any:
    """How deep the lowest point of the shape is below the plane through 0 with this normal [m].

    position: (n, 3) of the body's origin; quaternion: (n, 4), [x, y, z, w]; negative above.
    """
    down = -Rotation.from_quat(quaternion).inv().apply(np.asarray(normal))
    return reach(shape, down) - position @ np.asarray(normal)


def reach(shape: dict[str, Any], d: np.ndarray) -> np.ndarray:
    """Largest d . x over the shape, d unit vectors in body axes, (n, 3)."""
    kind = shape["type"]
    if kind == "sphere":
        return np.full(len(d), shape["radius"])
    if kind == "ellipsoid":
        return np.linalg.norm(d * np.array(shape["semi_axes"]), axis=1)
    if kind == "box":
        return np.abs(d) @ (0.5 * np.array(shape["size"]))
    along = d @ np.array(shape["axis_B"])
    if kind == "rod":
        return 0.5 * shape["length"] * np.abs(along)
    across = np.linalg.norm(d - along[:, None] * np.array(shape["axis_B"]), axis=1)
    return shape["radius"] * across + 0.5 * shape.get("length", 0.0) * np.abs(along)


def size_of(shape: dict[str, Any]) -> float:
    """Largest extent from the origin [m]."""
    if shape["type"] == "box":
        return float(np.linalg.norm(shape["size"])) / 2.0
    longest = max([shape.get("radius", 0.0), *shape.get("semi_axes", [])])
    return float(np.hypot(longest, 0.5 * shape.get("length", 0.0)))


RIM_POINTS, SHRINKS = 240, 4
"""Points looked at on a rim at first, and times that the arc about the farthest is parted again."""


def depth_in_round(
    shape: dict[str, Any], position: Any, quaternion: Any, surface: dict[str, Any]
) -> Any:
    """How far the shape reaches out of the hollow sphere or cylinder that it is in [m], (n,).

    The farthest point of a convex body is a corner, lies on a rim, or is that of an ellipsoid.
    """
    turn = Rotation.from_quat(quaternion)
    if "axis" in surface:
        middle, e = np.array(surface["point"]), np.array(surface["axis"])
        across = np.eye(3) - np.outer(e, e)
    else:
        middle, across = np.array(surface["center"]), np.eye(3)

    def distance(points: Any) -> Any:
        """Of points of the body, (n, 3) or (3,), at each instant, (n,)."""
        return np.linalg.norm((turn.apply(points) + position - middle) @ across, axis=1)

    kind, n = shape["type"], len(position)
    if kind == "sphere":
        return distance(np.zeros(3)) + shape["radius"] - surface["radius"]
    if kind == "ellipsoid":
        return farthest_of_ellipsoid(shape, distance, n) - surface["radius"]
    if kind == "box":
        half = 0.5 * np.array(shape["size"])
        corners = [half * signs for signs in np.ndindex(2, 2, 2)]
        found = [distance(2.0 * corner - half) for corner in corners]
    elif kind == "rod":
        end = 0.5 * shape["length"] * np.array(shape["axis_B"])
        found = [distance(end), distance(-end)]
    else:
        half = 0.5 * shape.get("length", 0.0)
        found = [farthest_of_rim(shape, h, distance, n) for h in {half, -half}]
    return np.max(found, axis=0) - surface["radius"]


def farthest_of_rim(shape: dict[str, Any], height: float, distance: Any, n: int) -> Any:
    """Largest distance of the rim's points, (n,); its axis is z."""
    assert shape["axis_B"] == [0.0, 0.0, 1.0]
    middle, width = np.zeros(n), 2.0 * np.pi
    for _ in range(SHRINKS):
        angles = [middle + width * (i / RIM_POINTS - 0.5) for i in range(RIM_POINTS + 1)]
        found = np.array(
            [
                distance(
                    np.stack(
                        [
                            shape["radius"] * np.cos(a),
                            shape["radius"] * np.sin(a),
                            np.full(n, height),
                        ],
                        axis=1,
                    )
                )
                for a in angles
            ]
        )
        middle = np.array(angles)[found.argmax(axis=0), np.arange(n)]
        width *= 4.0 / RIM_POINTS
    return found.max(axis=0)


def farthest_of_ellipsoid(shape: dict[str, Any], distance: Any, n: int) -> Any:
    """Largest distance of its points (a cos h cos l, b cos h sin l, c sin h), (n,)."""
    axes = np.array(shape["semi_axes"])

    def at(h: Any, length: Any) -> Any:
        unit = [np.cos(h) * np.cos(length), np.cos(h) * np.sin(length), np.sin(h)]
        return distance(axes * np.stack(unit, axis=1))

    high, long, wide = np.zeros(n), np.zeros(n), np.pi
    for points in [25] + [7] * 14:
        steps = np.linspace(-wide, wide, points)
        found = np.array([at(high + a, long + b) for a in 0.5 * steps for b in steps])
        best = found.argmax(axis=0)
        high, long = high + 0.5 * steps[best // points], long + steps[best % points]
        wide = 2.0 * (steps[1] - steps[0])
    return found.max(axis=0)


def depth_outside(
    shape: dict[str, Any], position: Any, quaternion: Any, surface: dict[str, Any]
) -> Any:
    """How deep the shape is in the full endless cylinder that it is outside of [m], (n,): the least
    width, over all directions across the axis, by which the two do not part."""
    turn, n = Rotation.from_quat(quaternion), len(position)
    e, far = np.array(surface["axis"]), position - np.array(surface["point"])
    across = np.linalg.svd(e[None, :])[2][1:]

    def overlap(angle: Any) -> Any:
        d = np.cos(angle)[:, None] * across[0] + np.sin(angle)[:, None] * across[1]
        body = reach(shape, turn.inv().apply(-d)) - np.sum(far * d, axis=1)
        return body + surface["radius"]

    return least_of_angles(overlap, n)


def least_of_angles(function: Any, n: int) -> Any:
    """Least value over all angles of a function with one least valley, (n,)."""
    middle, width = np.zeros(n), 2.0 * np.pi
    for _ in range(2 * SHRINKS):
        angles = [middle + width * (i / RIM_POINTS - 0.5) for i in range(RIM_POINTS + 1)]
        found = np.array([function(a) for a in angles])
        middle = np.array(angles)[found.argmin(axis=0), np.arange(n)]
        width *= 4.0 / RIM_POINTS
    return found.min(axis=0)
