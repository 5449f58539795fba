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
from rb_sim.io.drawn_supports import Sight, Supports, solid_of
from rb_sim.io.rerun.arrow_scales import drawn_reactions
from rb_sim.io.sink import samples_at
from rb_sim.numerics.rotations import from_z, norms, rotate
from rb_sim.scene.extent import reach_of

if TYPE_CHECKING:
    from rb_sim.io.panels import Panel
    from rb_sim.io.rerun.arrow_scales import Scales
    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene


# Rerun archetypes of solids and of supports, in the axes of their entity.


SUPPORT = (125, 130, 142)
JOINT = (225, 225, 230)
"""Colour of pivots, axes and links, which are drawn in front of bodies and grids."""
THIN_LINE, WIDE_LINE = 0.8, 1.5
"""Line radii of a grid, an axis or a string, and of a rail or a rod [pixels]."""
DOT = 4.0
"""Radius of a joint [pixels]."""
ROUND = 24
"""Corners of a cone."""


def solid_archetype(solid: dict[str, Any], shift: Array, color: tuple[int, ...]) -> Any:
    """A solid of `drawn_supports`, moved by `shift` (3,) [m]; a ghost as its edges."""
    center = np.array(solid["center"]) + shift
    mode = "majorwireframe" if solid.get("ghost") else "solid"
    common: dict[str, Any] = {"centers": [center], "colors": [color], "fill_mode": mode}
    match solid["kind"]:
        case "ball":
            return rr.Ellipsoids3D(half_sizes=[[solid["radius"]] * 3], **common)
        case "ellipsoid":
            return rr.Ellipsoids3D(half_sizes=[solid["half"]], **common)
        case "box":
            axes = np.array(solid.get("axes", np.eye(3))).T
            turn = [Rotation.from_matrix(axes).as_quat()]
            return rr.Boxes3D(half_sizes=[solid["half"]], quaternions=turn, **common)
    turn, radius, length = from_z(np.array(solid["axis"])), solid["radius"], solid["length"]
    if solid["kind"] == "cylinder":
        return rr.Cylinders3D(lengths=[length], radii=[radius], quaternions=[turn], **common)
    return _cone(center, turn, radius, length, color)


def _cone(center: Array, turn: Array, radius: float, length: float, color: Any) -> Any:
    """A cone with its tip along the axis; each face has its own corners and normal."""
    angles = np.linspace(0.0, 2.0 * np.pi, ROUND + 1)
    rim = np.c_[radius * np.cos(angles), radius * np.sin(angles), 0.0 * angles - 0.5 * length]
    tip = np.tile([0.0, 0.0, 0.5 * length], (ROUND, 1))
    corners = np.stack([rim[:-1], rim[1:], tip], axis=1).reshape(-1, 3)
    normals = corners * [length, length, 0.0] + [0.0, 0.0, radius**2]
    normals[2::3] = 0.5 * (normals[::3] + normals[1::3])
    return rr.Mesh3D(
        vertex_positions=center + _turned(turn, corners),
        triangle_indices=np.arange(3 * ROUND).reshape(-1, 3),
        vertex_normals=_turned(turn, normals / norms(normals)[:, None]),
        albedo_factor=color,
    )


def lines(strips: Any, color: tuple[int, int, int], width: float) -> Any:
    """Line strips with a radius in pixels."""
    radius: Any = rr.Radius.ui_points(width)
    return rr.LineStrips3D(strips, colors=[color], radii=[radius])


def grid(plane: dict[str, Any], shift: Array) -> Any:
    """A plane as a round field of grid lines, which hides nothing."""
    point, one = np.array(plane["point"]) + shift, np.array(plane["along"])
    other = np.cross(plane["normal"], one)
    size, step = plane["size"], plane["step"]
    ticks = step * np.arange(-np.round(size / step), np.round(size / step) + 1.0)
    halves = np.sqrt(np.maximum(0.0, size**2 - ticks**2))
    strips = [
        [point + tick * first - half * second, point + tick * first + half * second]
        for first, second in ((one, other), (other, one))
        for tick, half in zip(ticks, halves, strict=True)
    ]
    return lines(strips, GRID if plane["thing"] else FAINT, THIN_LINE)


GRID, FAINT = (100, 105, 116), (58, 62, 70)
"""Colours of a plane, and of a ground that the scene does not have."""


def support_archetype(kind: str, item: dict[str, Any], shift: Array) -> Any:
    """A drawing of `Supports`, moved by `shift` (3,) [m]; of a link its style only."""
    match kind:
        case "solids":
            return solid_archetype(item, shift, SUPPORT)
        case "planes":
            return grid(item, shift)
        case "lines":
            style = (JOINT, THIN_LINE) if item.get("dash") else (SUPPORT, WIDE_LINE)
            return lines([np.array(item["points"]) + shift], *style)
        case "joints":
            dot: Any = rr.Radius.ui_points(DOT)
            return rr.Points3D([np.array(item["point"]) + shift], radii=dot, colors=[JOINT])
    width: Any = rr.Radius.ui_points(WIDE_LINE if item["kind"] == "rod" else THIN_LINE)
    return rr.LineStrips3D.from_fields(colors=[JOINT], radii=[width])


def _turned(quaternion: Any, vector: Any) -> Any:
    return rotate(np.asarray(quaternion, float), np.asarray(vector, float))


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
    """Logs the constant parts at the start, and the supports once more when the view is known.

    scales: of arrows and camera. first: samples relative to the local origin; the first one gives
    the positions of joints.
    """

    def __init__(
        self,
        recording: Any,
        scene: Scene,
        layout: SampleLayout,
        scales: Scales,
        first: SampleBlock,
    ) -> None:
        self._recording, self._scene, self._layout = recording, scene, layout
        self._scales, self._first = scales, samples_at(first, [0])
        self._drawn = drawn_reactions(layout)
        self._supports: dict[str, Any] = {}
        """archetype of each entity of a support."""
        self.links: dict[str, dict[str, Any]] = {}
        """entities of rods, springs and strings, whose ends move."""

    def _log(self, entity: str, archetype: Any) -> None:
        self._recording.log(entity_path(entity), archetype, static=True)

    def log(self, panels: list[Panel]) -> None:
        """Log all constant parts, including names and colours of the panels' curves."""
        self._log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        for i, name in enumerate(self._layout.bodies):
            body = self._scene.bodies[name]
            color = (*BODIES[i % len(BODIES)], 255)
            part = "inertia" if body.shape is None else "shape"
            drawn = solid_archetype(solid_of(body), np.array(body.center_of_mass), color)
            self._log(f"world/{name}/{part}", drawn)
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

    def log_supports(self, view: Sight) -> None:
        """Log the supports, each under the world or the body that carries it.

        A ball that is larger than the view becomes lines: what is no longer drawn is cleared."""
        before, self._supports, self.links = self._supports, {}, {}
        items = Supports(self._scene, self._layout, self._first, view, self._scales.origin).items
        for name, kind, item in items:
            body = self._layout.bodies[item["on"]] if item.get("on", -1) >= 0 else None
            center = np.zeros(3) if body is None else self._scene.bodies[body].center_of_mass
            frame = "world" if body is None else f"world/{body}"
            entity = f"{frame}/support/{name}/{kind}"
            entity = f"{entity}/{sum(each.startswith(entity) for each in self._supports)}"
            if kind == "links":
                self.links[entity] = item
            self._supports[entity] = support_archetype(kind, item, np.array(center))
            self._log(entity, self._supports[entity])
        self._recording.flush()  # a recording keeps no order within a batch
        for entity in before.keys() - self._supports.keys():
            self._log(entity, type(before[entity]).from_fields(clear_unset=True))

    def _log_arrow(self, entity: str, color: str) -> None:
        radius: Any = rr.Radius.ui_points(ARROW)
        self._log(f"{entity}/arrow", rr.Arrows3D.from_fields(colors=[rgb(color)], radii=[radius]))


def entity_path(entity: str) -> str:
    """The path with special characters such as spaces escaped for Rerun."""
    return "/".join(map(rr.escape_entity_path_part, entity.split("/")))


def _lines(panel: Panel, **more: Any) -> Any:
    colors = [LIGHT if color == BLACK else rgb(color) for color in panel.colors]
    widths = [1.5] * len(colors)
    return rr.SeriesLines(names=list(panel.labels), colors=colors, widths=widths, **more)
