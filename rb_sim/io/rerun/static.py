# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Constant parts of a recording: shapes, surfaces, colours, widths and names of curves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from rb_sim.base.palette import BLACK, COMMAND, CYCLE, REACTION, VELOCITY, rgb
from rb_sim.io.contact_power import contacts_of
from rb_sim.io.extent import drawn_cylinder, inertia_box, reach_of
from rb_sim.io.rerun.arrow_scales import drawn_reactions
from rb_sim.numerics.rotations import from_z, rotate

if TYPE_CHECKING:
    from rb_sim.io.panels import Panel
    from rb_sim.io.rerun.arrow_scales import Scales
    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene


# Rerun archetypes of bodies, in body axes from the body origin.


def shape_archetype(shape: Any, color: tuple[int, int, int, int]) -> Any:
    """The solid in a colour; spheres and ellipsoids with lines that make rotation visible."""
    common: dict[str, Any] = {"centers": [shape.center_B], "colors": [color], "fill_mode": "solid"}
    match shape.type:
        case "sphere":
            half = [[shape.radius] * 3]
            return rr.Ellipsoids3D(half_sizes=half, **common)
        case "ellipsoid":
            return rr.Ellipsoids3D(half_sizes=[shape.semi_axes], **common)
        case "box":
            return rr.Boxes3D(half_sizes=[0.5 * np.array(shape.size)], **common)
        case _:
            length, radius = drawn_cylinder(shape)
            turn = [from_z(np.array(shape.axis_B))]
            return rr.Cylinders3D(lengths=[length], radii=[radius], quaternions=turn, **common)


def stand_in(body: Any, color: tuple[int, int, int, int]) -> Any:
    """Edges of the box with the mass and inertia of a body without shape."""
    half, axes = inertia_box(body)
    return rr.Boxes3D(
        centers=[body.center_of_mass],
        half_sizes=[half],
        quaternions=[Rotation.from_matrix(axes).as_quat()],
        colors=[color],
        fill_mode="majorwireframe",
    )


SUPPORT = (125, 130, 142)
JOINT = (225, 225, 230)
"""Colour of pivots, bearings and rails, which are drawn in front of bodies and grids."""
PIVOT, BEARING, AXLE = 0.07, (0.07, 0.3), 1.0
"""In arrow lengths: radius of a pivot; radius and length of a bearing; half length of its axis."""
THIN_LINE, WIDE_LINE = 0.8, 2.5
"""Line radii of a grid, and of an axis or a rail [pixels]."""


def spacing(size: float) -> float:
    """Grid spacing: the power of ten that divides the scene into about ten cells."""
    return float(10.0 ** np.round(np.log10(size / 10.0)))


def lines(strips: Any, color: tuple[int, int, int], width: float) -> Any:
    """Line strips with a radius in pixels."""
    radius: Any = rr.Radius.ui_points(width)
    return rr.LineStrips3D(strips, colors=[color], radii=[radius])


def grid(point: Any, normal: Any, near: Any, size: float) -> Any:
    """A plane as grid lines, transparent: about `size` [m] around the point nearest to `near`."""
    along = [_turned(from_z(normal), axis) for axis in np.eye(3)[:2]]
    field = spacing(size)
    half = field * np.ceil(0.5 * size / field)
    foot = point + sum(
        field * np.round(np.dot(near - point, axis) / field) * axis for axis in along
    )
    ticks = np.arange(-half, half + 0.5 * field, field)
    strips = [
        [foot + tick * one - half * other, foot + tick * one + half * other]
        for one, other in (along, along[::-1])
        for tick in ticks
    ]
    return lines(strips, SUPPORT, THIN_LINE)


def pivot(point_B: Any, length: float) -> Any:
    """The fixed point of a body."""
    return rr.Ellipsoids3D(
        centers=[point_B], half_sizes=[[PIVOT * length] * 3], colors=[JOINT], fill_mode="solid"
    )


def bearing(point_B: Any, axis_B: Any, length: float) -> tuple[Any, Any]:
    """The bearing of a body, and its axis."""
    point, axis = np.array(point_B, float), np.array(axis_B, float)
    radius, long = BEARING
    solid = rr.Cylinders3D(
        centers=[point], lengths=[long * length], radii=[radius * length],
        quaternions=[from_z(axis)], colors=[JOINT], fill_mode="solid",
    )  # fmt: skip
    reach = AXLE * length * axis
    return solid, lines([[point - reach, point + reach]], JOINT, THIN_LINE)


def rail(guide: Any, start: Any, near: Any, size: float, origin: Any) -> Any:
    """Guide curve of a point.

    start: position of that point in the first sample, relative to the local origin; near, size,
    origin: as in `support_archetype`."""
    match guide.type:
        case "line":
            direction = np.array(guide.direction)
            point = start if guide.point is None else np.array(guide.point) - origin
            foot = point + np.dot(near - point, direction) * direction
            points = [foot - 0.5 * size * direction, foot + 0.5 * size * direction]
        case "circle":
            turn = from_z(np.array(guide.normal))
            angles = np.linspace(0.0, 2.0 * np.pi, ROUND)
            flat = guide.radius * np.c_[np.cos(angles), np.sin(angles), 0.0 * angles]
            points = np.array(guide.center) - origin + [_turned(turn, each) for each in flat]
        case _:
            points = guide.points_along(ROUND) - origin
    return lines([points], JOINT, WIDE_LINE)


ROUND = 181
"""Points of a curved rail."""


def _turned(quaternion: Any, vector: Any) -> Any:
    return rotate(np.asarray(quaternion, float), np.asarray(vector, float))


def support_archetype(surface: Any, near: Any, size: float, origin: Any) -> Any | None:
    """The surface of a contact; None if it is a body's own shape, which is drawn anyway.

    Infinite surfaces are drawn up to `size` [m] around the point nearest to `near`, which is
    relative to the local origin [m] of the view.
    """
    match surface.type:
        case "plane":
            point, normal = np.array(surface.point) - origin, np.array(surface.normal)
            return grid(point, normal, near, size)
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
                quaternions=[from_z(axis)],
                colors=[SUPPORT],
                fill_mode="solid" if surface.side == "outside" else "majorwireframe",
            )
        case _:
            return None


AXIS = 1.4
"""Length of body axes, relative to the reach of the shape, so that they extend beyond a sphere."""

TRAIL = (150, 160, 175)
BODIES = tuple(map(rgb, CYCLE))
LIGHT = (240, 240, 240)
"""Replacement for black on the dark background."""

ARROW = 2.5
"""Radius of an arrow [pixels], independent of the scale of its length."""

MARKER = 5.0
"""Radius [pixels] of the centre of mass, which shows bodies too small to see."""


class Static:
    """Logs the constant parts once, at the start. scales: of arrows and camera."""

    def __init__(
        self,
        recording: Any,
        scene: Scene,
        layout: SampleLayout,
        scales: Scales,
        first: SampleBlock,
    ) -> None:
        """first: samples; the first one gives the start of rails."""
        self._recording, self._scene, self._layout = recording, scene, layout
        self._scales = scales
        self._orientation = dict(zip(layout.bodies, first.orientation[0], strict=True))
        self._position = dict(zip(layout.bodies, first.position[0], strict=True))
        self._drawn = drawn_reactions(layout)

    def _log(self, entity: str, archetype: Any) -> None:
        self._recording.log(entity_path(entity), archetype, static=True)

    def log(self, panels: list[Panel]) -> None:
        """Log all constant parts, including names and colours of the panels' curves."""
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
        for name in self._layout.contacts:
            size: Any = rr.Radius.ui_points(7.0)
            self._log(f"world/contact/{name}", rr.Points3D.from_fields(radii=[size]))
        for name in self._layout.commanded:
            self._log_arrow(f"world/command/{name}", COMMAND)
        for k, name in enumerate(self._layout.reactions):
            if k in self._drawn:
                self._log_arrow(f"world/reaction/{name}", REACTION)
        self.log_supports(self._scales.center, self._scales.size)
        for c, name in enumerate(self._layout.contacts):
            style = rr.SeriesLines(
                names=[name],
                colors=[BODIES[c % len(BODIES)]],
                interpolation_mode="StepAfter",
                aggregation_policy="Max",
            )
            self._log(f"plots/contacts/{name}", style)
        for panel in panels:
            more = {"interpolation_mode": "StepBefore"} if panel.held else {}
            self._log(f"plots/{panel.entity}", _lines(panel, **more))

    def log_supports(self, center: Array, size: float) -> None:
        """Log the supports: surfaces of contacts and planes, in the world or on a parent, and the
        pivots and bearings on each body.

        center, size [m]: range of the 3D view, relative to the local origin. A plane on a body with
        a shape is not drawn, since it is part of the shape.
        """
        length = self._scales.length
        specs: dict[str, Any] = dict(self._scene.constraints)
        for name, spec in specs.items():
            entity = f"world/{spec.body}/support/{name}"
            match spec.type:
                case "fixed_point":
                    self._log(entity, pivot(spec.point_B, length))
                case "fixed_axis":
                    solid, axis = bearing(spec.point_B, spec.axis_B, length)
                    self._log(entity, solid)
                    self._log(f"{entity}/axis", axis)
                case "translation" if spec.guide is not None:
                    start = self._start_of(spec.body, spec.point_B)
                    drawn = rail(spec.guide, start, center, size, self._scales.origin)
                    self._log(f"world/support/{name}", drawn)
                case "rolling" | "plane" if spec.parent is None:
                    self._log(f"world/support/{name}", self._plane(spec, center, size))
        for name, spec in contacts_of(self._scene).items():
            on = None if spec.parent is None else self._scene.bodies[spec.parent].shape
            if spec.surface.type == "plane" and on is not None:
                continue
            frame = "world" if spec.parent is None else f"world/{spec.parent}"
            near, origin = np.zeros(3), np.zeros(3)
            if spec.parent is None:
                near, origin = center, self._scales.origin
            surface = support_archetype(spec.surface, near, size, origin)
            if surface is not None:
                self._log(f"{frame}/support/{name}", surface)

    def _start_of(self, body: str, point_B: Any) -> Array:
        """Position of a body's point at the first sample, relative to the local origin [m]."""
        arm = np.array(point_B) - self._scene.bodies[body].center_of_mass
        return self._position[body] + _turned(self._orientation[body], arm) - self._scales.origin

    def _plane(self, spec: Any, center: Array, size: float) -> Any:
        if spec.point_A is None:
            point = self._start_of(spec.body, spec.point_B)
        else:
            point = np.array(spec.point_A) - self._scales.origin
        return grid(point, np.array(spec.normal_A), center, size)

    def _log_arrow(self, entity: str, color: str) -> None:
        radius: Any = rr.Radius.ui_points(ARROW)
        self._log(f"{entity}/arrow", rr.Arrows3D.from_fields(colors=[rgb(color)], radii=[radius]))


def entity_path(entity: str) -> str:
    """The path with special characters such as spaces escaped for Rerun."""
    return "/".join(map(rr.escape_entity_path_part, entity.split("/")))


def has_plane(scene: Scene) -> bool:
    """Whether a plane of the world is drawn, which replaces the view's own grid."""
    specs: list[Any] = list(scene.constraints.values())
    if any(spec.type in ("rolling", "plane") and spec.parent is None for spec in specs):
        return True
    surfaces = (spec for spec in contacts_of(scene).values() if spec.parent is None)
    return any(spec.surface.type == "plane" for spec in surfaces)


def _lines(panel: Panel, **more: Any) -> Any:
    colors = [LIGHT if color == BLACK else rgb(color) for color in panel.colors]
    widths = [1.5] * len(colors)
    return rr.SeriesLines(names=list(panel.labels), colors=colors, widths=widths, **more)
