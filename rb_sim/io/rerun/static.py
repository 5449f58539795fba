# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What does not change in a recording: shapes, surfaces, colours, widths and names of curves."""

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


# Shapes of bodies as Rerun draws them, in body axes from the body origin.


def shape_archetype(shape: Any, color: tuple[int, int, int, int]) -> Any:
    """The solid in a colour; a ball and an ellipsoid with lines that show how they turn."""
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
    """The edges of the box with the mass and inertia of a body of no shape."""
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
"""Of pivots, bearings and rails, which stand before bodies and grids."""
PIVOT, BEARING, AXLE = 0.07, (0.07, 0.3), 1.0
"""In lengths of the arrows: radius of a pivot; radius and length of a bearing; half the line that
shows its axis."""
THIN_LINE, WIDE_LINE = 0.8, 2.5
"""Radii of the lines of a grid, and of an axis or a rail, in pixels."""


def spacing(size: float) -> float:
    """Power of ten that divides the scene into some ten fields."""
    return float(10.0 ** np.round(np.log10(size / 10.0)))


def lines(strips: Any, color: tuple[int, int, int], width: float) -> Any:
    """Strips of a width in pixels."""
    radius: Any = rr.Radius.ui_points(width)
    return rr.LineStrips3D(strips, colors=[color], radii=[radius])


def grid(point: Any, normal: Any, near: Any, size: float) -> Any:
    """A plane as lines, which hide nothing: about `size` [m] around the point nearest to `near`."""
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
    """The point about which a body turns."""
    return rr.Ellipsoids3D(
        centers=[point_B], half_sizes=[[PIVOT * length] * 3], colors=[JOINT], fill_mode="solid"
    )


def bearing(point_B: Any, axis_B: Any, length: float) -> tuple[Any, Any]:
    """The bearing about which a body turns, and its axis."""
    point, axis = np.array(point_B, float), np.array(axis_B, float)
    radius, long = BEARING
    solid = rr.Cylinders3D(
        centers=[point], lengths=[long * length], radii=[radius * length],
        quaternions=[from_z(axis)], colors=[JOINT], fill_mode="solid",
    )  # fmt: skip
    reach = AXLE * length * axis
    return solid, lines([[point - reach, point + reach]], JOINT, THIN_LINE)


def rail(guide: Any, start: Any, near: Any, size: float, origin: Any) -> Any:
    """The curve along which a point goes. start: where that point is at the start, from the local
    origin; near, size, origin: as of `support_archetype`."""
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
    """A contact's surface; None for a body's own shape, which is drawn anyway.

    An endless one is drawn as far as `size` [m] around the point of it nearest to `near`, which is
    counted from the local origin [m] of the view, as what is drawn.
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
"""Length of the body axes in reaches of the shape, so that they stick out of a ball."""

TRAIL = (150, 160, 175)
BODIES = tuple(map(rgb, CYCLE))
LIGHT = (240, 240, 240)
"""What is black elsewhere, where the ground is white."""

ARROW = 2.5
"""Radius of an arrow in pixels: its length has a scale of its own, which its width has not."""

MARKER = 5.0
"""Radius in pixels of the point at a body's centre of mass, which is seen of a body that is smaller
than it: a box that flies for half a kilometre."""


class Static:
    """Logs it once, at the start of a recording. scales: of the arrows and of the camera."""

    def __init__(
        self,
        recording: Any,
        scene: Scene,
        layout: SampleLayout,
        scales: Scales,
        first: SampleBlock,
    ) -> None:
        """first: samples, of which the first one tells where rails begin."""
        self._recording, self._scene, self._layout = recording, scene, layout
        self._scales = scales
        self._orientation = dict(zip(layout.bodies, first.orientation[0], strict=True))
        self._position = dict(zip(layout.bodies, first.position[0], strict=True))
        self._drawn = drawn_reactions(layout)

    def _log(self, entity: str, archetype: Any) -> None:
        self._recording.log(entity_path(entity), archetype, static=True)

    def log(self, panels: list[Panel]) -> None:
        """Send all of it; of the panels the names and colours of their curves."""
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
        """What holds the bodies: surfaces of contacts and planes, in the world or on a parent, and
        on each body the pivots and bearings about which it turns.

        center, size [m]: what the 3D view shows, from the local origin. A plane on a body that has
        a shape is not drawn: the shape shows it.
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
        """Where a point of a body is at the start, from the local origin [m]."""
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
    """The path with what Rerun does not take as it is, a space for one, escaped."""
    return "/".join(map(rr.escape_entity_path_part, entity.split("/")))


def has_plane(scene: Scene) -> bool:
    """Whether a plane of the world is drawn, beside which the view's own grid would confuse."""
    specs: list[Any] = list(scene.constraints.values())
    if any(spec.type in ("rolling", "plane") and spec.parent is None for spec in specs):
        return True
    surfaces = (spec for spec in contacts_of(scene).values() if spec.parent is None)
    return any(spec.surface.type == "plane" for spec in surfaces)


def _lines(panel: Panel, **more: Any) -> Any:
    colors = [LIGHT if color == BLACK else rgb(color) for color in panel.colors]
    widths = [1.5] * len(colors)
    return rr.SeriesLines(names=list(panel.labels), colors=colors, widths=widths, **more)
