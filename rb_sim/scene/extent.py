# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Dimensions with which bodies are drawn, and the extent of the drawing."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rb_sim.numerics.rotations import from_z

THIN_DISK = 0.03
"""Drawn thickness of a disk, relative to its radius."""

THIN_ROD = 0.02
"""Drawn radius of a rod without one, relative to its length."""


NO_TURN = np.array([0.0, 0.0, 0.0, 1.0])


class Solid(NamedTuple):
    """The solid with which a shape is drawn, about the shape's centre."""

    kind: str
    """ball, ellipsoid, box or cylinder."""
    half: np.ndarray
    """half edges of the box around it along its own axes (3,) [m]; the last is the cylinder's."""
    turn: np.ndarray = NO_TURN
    """rotation from its own axes to body axes."""

    @property
    def radius(self) -> float:
        """Radius of a ball or a cylinder; of the ball around an ellipsoid [m]."""
        return float(self.half[0] if self.kind == "cylinder" else self.half.max())

    @property
    def length(self) -> float:
        """Length of a cylinder [m]."""
        return 2.0 * float(self.half[2])


def drawn_solid(shape: Any) -> Solid:
    """How every view draws a shape: a disk and a rod without thickness get some."""
    match shape.type:
        case "sphere":
            return Solid("ball", np.full(3, float(shape.radius)))
        case "ellipsoid":
            return Solid("ellipsoid", np.array(shape.semi_axes, dtype=float))
        case "box":
            return Solid("box", 0.5 * np.array(shape.size, dtype=float))
    length = THIN_DISK * shape.radius if shape.type == "disk" else shape.length
    radius = THIN_ROD * length if shape.radius is None else shape.radius
    half = np.array([radius, radius, 0.5 * length])
    return Solid("cylinder", half, from_z(np.array(shape.axis_B, dtype=float)))


def inertia_box(body: Any) -> tuple[np.ndarray, np.ndarray]:
    """Half edges (3,) [m] of the uniform box with the body's mass and inertia, and its axes, the
    columns of a rotation matrix (3, 3), body axes: drawn for a body without a shape."""
    moments, axes = np.linalg.eigh(np.asarray(body.inertia, dtype=float))
    squares = 6.0 * (0.5 * moments.sum() - moments) / body.mass * 2.0
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] = -axes[:, 0]
    return 0.5 * np.sqrt(np.maximum(squares, 0.0)), axes


def reach_of(body: Any) -> float:
    """Largest distance of a drawn point of a body from the centre of its drawing [m]."""
    if body.shape is not None:
        return float(body.shape.reach)
    return float(np.linalg.norm(inertia_box(body)[0]))


def half_box(shape: Any) -> np.ndarray:
    """Half edges of the bounding box of the drawn shape, body axes (3,) [m]."""
    solid = drawn_solid(shape)
    if solid.kind != "cylinder":
        return solid.half
    axis = np.abs(np.array(shape.axis_B, dtype=float))
    across = np.sqrt(np.maximum(0.0, 1.0 - axis**2))
    return 0.5 * solid.length * axis + solid.radius * across
