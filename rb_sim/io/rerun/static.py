"""What does not change in a recording: shapes, surfaces, colours, widths and names of curves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from rb_sim.io.contact_power import contacts_of
from rb_sim.io.extent import THIN_DISK, THIN_ROD, inertia_box, reach_of
from rb_sim.io.rerun.arrow_scales import drawn_reactions

if TYPE_CHECKING:
    from rb_sim.io.rerun.arrow_scales import Scales
    from rb_sim.mechanics.samples import SampleLayout
    from rb_sim.scene.schema import Scene


# Shapes of bodies as Rerun draws them, in body axes from the body origin.


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


AXIS = 1.4
"""Length of the body axes in reaches of the shape, so that they stick out of a ball."""

VELOCITY = (64, 190, 110)
REACTION = (255, 165, 40)
COMMAND = (235, 80, 160)
TRAIL = (150, 160, 175)
BODIES = ((96, 150, 225), (215, 140, 90), (130, 185, 110), (175, 130, 200), (200, 185, 100))
AXES = ((230, 80, 80), (90, 190, 90), (90, 130, 240), (190, 190, 190))
"""Of x, y, z and the scalar part w."""

ARROW = 2.5
"""Radius of an arrow in pixels: its length has a scale of its own, which its width has not."""

MARKER = 5.0
"""Radius in pixels of the point at a body's centre of mass, which is seen of a body that is smaller
than it: a box that flies for half a kilometre."""


class Static:
    """Logs it once, at the start of a recording. scales: of the arrows and of the camera."""

    def __init__(self, recording: Any, scene: Scene, layout: SampleLayout, scales: Scales) -> None:
        self._recording, self._scene, self._layout = recording, scene, layout
        self._scales = scales
        self._drawn = drawn_reactions(layout)

    def _log(self, entity: str, archetype: Any) -> None:
        self._recording.log(entity_path(entity), archetype, static=True)

    def log(self) -> None:
        """Send all of it."""
        self._log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        for i, name in enumerate(self._layout.bodies):
            body = self._scene.bodies[name]
            color = (*BODIES[i % len(BODIES)], 255)
            if body.shape is not None:
                self._log(f"world/{name}/shape", shape_archetype(body.shape, color))
            else:
                self._log(f"world/{name}/inertia", stand_in(body, color))
            marker = rr.Points3D(
                [body.center_of_mass],
                radii=rr.Radius.ui_points(MARKER),
                colors=[BODIES[i % len(BODIES)]],
            )
            self._log(f"world/{name}/marker", marker)
            axis = AXIS * reach_of(body) or 0.5 * self._scales.length
            self._log(f"world/{name}", rr.TransformAxes3D(axis_length=axis))
            width: Any = rr.Radius.ui_points(1.5)
            style = rr.LineStrips3D.from_fields(colors=[TRAIL], radii=[width])
            self._log(f"world/trail/{name}", style)
            self._log_arrow(f"world/velocity/{name}", VELOCITY)
            self._log_plot(f"plots/{name}/position", "xyz")
            self._log_plot(f"plots/{name}/orientation", "xyzw")
            self._log_plot(f"plots/{name}/velocity", "xyz")
            self._log_plot(f"plots/{name}/angular_velocity", "xyz")
        for name in self._layout.contacts:
            size: Any = rr.Radius.ui_points(7.0)
            self._log(f"world/contact/{name}", rr.Points3D.from_fields(radii=[size]))
        for name in self._layout.commanded:
            self._log_arrow(f"world/command/{name}", COMMAND)
        for k, name in enumerate(self._layout.reactions):
            if k in self._drawn:
                self._log_arrow(f"world/reaction/{name}", REACTION)
            self._log_plot(f"plots/reactions/{name}/force", "xyz")
            self._log_plot(f"plots/reactions/{name}/torque", "xyz")
        self._log_supports()
        for c, name in enumerate(self._layout.contacts):
            style = rr.SeriesLines(
                names=[name],
                colors=[BODIES[c % len(BODIES)]],
                interpolation_mode="StepAfter",
                aggregation_policy="Max",
            )
            self._log(f"plots/contacts/{name}", style)
        names = ["kinetic", "potential", "total"]
        self._log("plots/energy", _lines(names, [AXES[0], AXES[2], (240, 240, 240)]))
        self._log("plots/residual", _lines(["residual"], [AXES[3]]))

    def _log_supports(self) -> None:
        """The surface of each contact, in the world or on its parent.

        A plane on a body that has a shape is not drawn: the shape shows it, and a plane around it
        would hide what is below, the body's own arrows too.
        """
        for name, spec in contacts_of(self._scene).items():
            on = None if spec.parent is None else self._scene.bodies[spec.parent].shape
            if spec.surface.type == "plane" and on is not None:
                continue
            frame = "world" if spec.parent is None else f"world/{spec.parent}"
            near, origin = np.zeros(3), np.zeros(3)
            if spec.parent is None:
                near, origin = self._scales.center, self._scales.origin
            surface = support_archetype(spec.surface, near, self._scales.size, origin)
            if surface is not None:
                self._log(f"{frame}/support/{name}", surface)

    def _log_arrow(self, entity: str, color: tuple[int, int, int]) -> None:
        radius: Any = rr.Radius.ui_points(ARROW)
        self._log(f"{entity}/arrow", rr.Arrows3D.from_fields(colors=[color], radii=[radius]))

    def _log_plot(self, entity: str, names: str) -> None:
        self._log(entity, _lines(list(names), AXES[: len(names)]))


def entity_path(entity: str) -> str:
    """The path with what Rerun does not take as it is, a space for one, escaped."""
    return "/".join(map(rr.escape_entity_path_part, entity.split("/")))


def _lines(names: list[str], colors: Any) -> Any:
    return rr.SeriesLines(names=names, colors=list(colors), widths=[1.5] * len(names))
