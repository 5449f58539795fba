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

from typing import Any

import numpy as np

THIN_DISK = 0.03
"""Drawn thickness of a disk, relative to its radius."""

THIN_ROD = 0.02
"""Drawn radius of a rod without one, relative to its length."""


def drawn_cylinder(shape: Any) -> tuple[float, float]:
    """Length and radius [m] with which a disk, a cylinder or a rod is drawn."""
    if shape.type == "disk":
        return THIN_DISK * shape.radius, shape.radius
    return shape.length, THIN_ROD * shape.length if shape.radius is None else shape.radius


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
    """Half edges of the bounding box of the shape, body axes (3,) [m]."""
    match shape.type:
        case "sphere":
            return np.full(3, float(shape.radius))
        case "box":
            return 0.5 * np.array(shape.size, dtype=float)
        case "ellipsoid":
            return np.array(shape.semi_axes, dtype=float)
        case _:
            axis = np.abs(np.array(shape.axis_B, dtype=float))
            across = np.sqrt(np.maximum(0.0, 1.0 - axis**2))
            length = float(getattr(shape, "length", 0.0))
            return 0.5 * length * axis + float(shape.radius or 0.0) * across
