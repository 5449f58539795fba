"""Where the points of a scene lie in its picture: the surfaces of shapes and the projection."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from rb_sim.scene import shapes
from rb_sim.statics.model import StaticBody

Array = NDArray[np.float64]

STEPS = 48
"""points around a circle."""


def surface_points(body: StaticBody) -> Array:
    """Points whose convex hull is the shape, world [m], (n, 3); (0, 3) for a body without shape."""
    shape = body.shape
    if shape is None:
        return np.zeros((0, 3))
    local = np.array(shape.center_B) + _local_points(shape)
    return np.array(body.position) + local @ body.rotation().T


def _local_points(shape: shapes.Shape) -> Array:
    match shape:
        case shapes.Box():
            half = 0.5 * np.array(shape.size)
            return np.array(list(itertools.product((-1.0, 1.0), repeat=3))) * half
        case shapes.Sphere():
            return shape.radius * _ball()
        case shapes.Ellipsoid():
            return np.array(shape.semi_axes) * _ball()
        case shapes.Disk():
            return shape.radius * _ring(shape.axis_B)
        case shapes.Rod():
            return _tube(0.5 * shape.draw_radius, shape.length, shape.axis_B)
        case shapes.Cylinder():
            return _tube(shape.radius, shape.length, shape.axis_B)
    return np.zeros((0, 3))


def _ball() -> Array:
    latitude = np.linspace(-0.5 * np.pi, 0.5 * np.pi, STEPS // 2 + 1)[:, None]
    longitude = np.linspace(0.0, 2.0 * np.pi, STEPS, endpoint=False)
    x, y = np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude)
    return np.stack([x, y, np.sin(latitude) + 0.0 * x], axis=-1).reshape(-1, 3)


def _ring(axis: tuple[float, float, float]) -> Array:
    """Unit circle across the axis."""
    n = np.array(axis)
    first = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
    first /= np.linalg.norm(first)
    angle = np.linspace(0.0, 2.0 * np.pi, STEPS, endpoint=False)[:, None]
    return np.cos(angle) * first + np.sin(angle) * np.cross(n, first)


def _tube(radius: float, length: float, axis: tuple[float, float, float]) -> Array:
    along = 0.5 * length * np.array(axis)
    ring = radius * _ring(axis)
    return np.concatenate([ring - along, ring + along])


def projection(cloud: Array, vectors: Array) -> tuple[Array, tuple[str, str] | None]:
    """Projection (2, 3) and names of the picture's axes; None for the oblique view."""
    spread = np.ptp(cloud, axis=0)
    largest = float(spread.max()) or 1.0
    strongest = float(np.abs(vectors).max(initial=0.0)) or 1.0
    sizes = np.abs(vectors).max(axis=0, initial=0.0) / strongest
    for across, first, second in ((1, 0, 2), (0, 1, 2), (2, 0, 1)):
        if spread[across] <= 0.05 * largest and sizes[across] <= 1e-9:
            view = np.zeros((2, 3))
            view[0, first] = view[1, second] = 1.0
            return view, ("xyz"[first], "xyz"[second])
    azimuth, elevation = np.radians(-58.0), np.radians(22.0)
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    up = np.array(
        [
            -np.sin(elevation) * np.cos(azimuth),
            -np.sin(elevation) * np.sin(azimuth),
            np.cos(elevation),
        ]
    )
    return np.array([right, up]), None
