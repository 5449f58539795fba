"""Shapes of bodies as Rerun draws them, in body axes from the body origin."""

from __future__ import annotations

from typing import Any

import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from rb_sim.sinks.extent import inertia_box

THIN_DISK = 0.03
"""Thickness to draw a disk with, in radii."""

THIN_ROD = 0.03
"""Radius to draw a rod with that gives none, in lengths."""


def shape_archetype(shape: Any, color: tuple[int, int, int, int]) -> Any:
    """The solid in a colour; a ball and an ellipsoid with lines that show how they turn."""
    common = {"centers": [shape.center_B], "colors": [color], "fill_mode": "solid"}
    match shape.type:
        case "sphere":
            half = [[shape.radius] * 3]
            return rr.Ellipsoids3D(half_sizes=half, **common)
        case "ellipsoid":
            return rr.Ellipsoids3D(half_sizes=[shape.semi_axes], **common)
        case "box":
            return rr.Boxes3D(half_sizes=[0.5 * np.array(shape.size)], **common)
        case "disk":
            length, radius = THIN_DISK * shape.radius, shape.radius
        case _:
            length = shape.length
            radius = THIN_ROD * length if shape.radius is None else shape.radius
    turn = [_from_z(np.array(shape.axis_B))]
    return rr.Cylinders3D(lengths=[length], radii=[radius], quaternions=turn, **common)


def stand_in(body: Any, color: tuple[int, int, int, int]) -> Any:
    """The edges of the box with the mass and inertia of a body of no shape."""
    half, axes = inertia_box(body)
    return rr.Boxes3D(
        centers=[body.center_of_mass],
        half_sizes=[half],
        quaternions=[Rotation.from_matrix(axes).as_quat()],
        colors=[color],
        fill_mode="majorwireframe",
    )


SUPPORT = (105, 110, 120)
THIN_PLANE = 0.002
"""Thickness to draw a plane with, of the size of the scene."""

BELOW = 0.001
"""Of the size of the scene, by which a plane is drawn lower, so that neither the grid nor a face
that lies on it is in the very same plane: they would flicker."""


def support_archetype(surface: Any, near: Any, size: float, origin: Any) -> Any | None:
    """A contact's surface; None for a body's own shape, which is drawn anyway.

    An endless one is drawn as far as `size` [m] around the point of it nearest to `near`, which is
    counted from the local origin [m] of the view, as what is drawn.
    """
    match surface.type:
        case "plane":
            point, normal = np.array(surface.point) - origin, np.array(surface.normal)
            foot = near - np.dot(near - point, normal) * normal
            half = [0.5 * size, 0.5 * size, 0.5 * THIN_PLANE * size]
            return rr.Boxes3D(
                centers=[foot - (half[2] + BELOW * size) * normal],
                half_sizes=[half],
                quaternions=[_from_z(normal)],
                colors=[SUPPORT],
                fill_mode="solid",
            )
        case "sphere":
            solid = surface.side == "outside"
            return rr.Ellipsoids3D(
                centers=[np.array(surface.center) - origin],
                half_sizes=[[surface.radius] * 3],
                colors=[SUPPORT],
                fill_mode="solid" if solid else "majorwireframe",
            )
        case "cylinder":
            point, axis = np.array(surface.point) - origin, np.array(surface.axis)
            return rr.Cylinders3D(
                centers=[point + np.dot(near - point, axis) * axis],
                lengths=[size],
                radii=[surface.radius],
                quaternions=[_from_z(axis)],
                colors=[SUPPORT],
                fill_mode="solid" if surface.side == "outside" else "majorwireframe",
            )
        case _:
            return None


def _from_z(axis: Any) -> Any:
    """Quaternion [x, y, z, w] that turns z into the unit vector `axis`."""
    if axis[2] < -1.0 + 1e-12:
        return np.array([1.0, 0.0, 0.0, 0.0])
    q = np.array([-axis[1], axis[0], 0.0, 1.0 + axis[2]])
    return q / np.linalg.norm(q)
