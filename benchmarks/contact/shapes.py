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
    across = np.sqrt(np.maximum(0.0, 1.0 - along**2))
    return shape["radius"] * across + 0.5 * shape.get("length", 0.0) * np.abs(along)


def size_of(shape: dict[str, Any]) -> float:
    """Largest extent from the origin [m]."""
    if shape["type"] == "box":
        return float(np.linalg.norm(shape["size"])) / 2.0
    longest = max([shape.get("radius", 0.0), *shape.get("semi_axes", [])])
    return float(np.hypot(longest, 0.5 * shape.get("length", 0.0)))
