"""How far a body reaches."""

from __future__ import annotations

from typing import Any

import numpy as np

THIN_DISK = 0.03
"""Thickness to draw a disk with, in radii."""

THIN_ROD = 0.03
"""Radius to draw a rod with that gives none, in lengths."""


def drawn_cylinder(shape: Any) -> tuple[float, float]:
    """Length and radius [m] with which a disk, a cylinder or a rod is drawn."""
    if shape.type == "disk":
        return THIN_DISK * shape.radius, shape.radius
    return shape.length, THIN_ROD * shape.length if shape.radius is None else shape.radius


def reach(shape: Any | None) -> float:
    """Distance from the shape's centre to its farthest point [m]; 0 for no shape."""
    if shape is None:
        return 0.0
    match shape.type:
        case "sphere" | "disk":
            return float(shape.radius)
        case "cylinder" | "rod":
            return float(np.hypot(shape.radius or 0.0, 0.5 * shape.length))
        case "box":
            return 0.5 * float(np.linalg.norm(shape.size))
        case _:
            return float(max(shape.semi_axes))


def inertia_box(body: Any) -> tuple[np.ndarray, np.ndarray]:
    """Half edges (3,) [m] of the box of uniform density with the body's mass and inertia, and its
    axes, the columns of a rotation matrix (3, 3), body axes: what stands for a body of no shape."""
    moments, axes = np.linalg.eigh(np.asarray(body.inertia, dtype=float))
    squares = 6.0 * (0.5 * moments.sum() - moments) / body.mass * 2.0
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] = -axes[:, 0]
    return 0.5 * np.sqrt(np.maximum(squares, 0.0)), axes


def reach_of(body: Any) -> float:
    """As `reach`, of what is drawn for a body [m]."""
    if body.shape is not None:
        return reach(body.shape)
    return float(np.linalg.norm(inertia_box(body)[0]))


def half_box(shape: Any | None) -> np.ndarray:
    """Half sizes of the box around the shape, body axes (3,) [m]; zero for no shape."""
    if shape is None:
        return np.zeros(3)
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
