# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Drawing of a statics scene: bodies, supports, loads, and reactions as arrows.

A scene in a coordinate plane is drawn in that plane; any other one in an orthographic view from
above, from between +x and -y, with the axes in the corner.
"""

from __future__ import annotations

import itertools
import re
from pathlib import Path
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from rb_sim.base.palette import REACTION, TENSION, TEXT, VERMILLION
from rb_sim.catalogue.spec import BodyState
from rb_sim.equilibrium.equilibrium import Element, Equilibrium, tangents
from rb_sim.equilibrium.statics_of_scene import Load, active_loads, at_rest, at_zero_velocity
from rb_sim.equilibrium.statics_tables import StaticsResult
from rb_sim.scene import shapes
from rb_sim.scene.extent import drawn_solid
from rb_sim.scene.place import InitialPlace
from rb_sim.scene.schema import Body, Scene

# Surfaces of shapes, and projection to the picture.


Array = NDArray[np.float64]

STEPS = 48
"""Number of points on a circle."""


def surface_points(body: Body) -> Array:
    """Points whose convex hull is the shape, world [m], (n, 3); (0, 3) for a body without shape."""
    shape = body.shape
    if shape is None:
        return np.zeros((0, 3))
    local = np.array(shape.center_B) + _local_points(shape)
    return np.array(body.position) + Rotation.from_quat(body.orientation).apply(local)


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
            rod = drawn_solid(shape)
            return _tube(0.5 * rod.radius, rod.length, shape.axis_B)
        case shapes.Cylinder():
            return _tube(shape.radius, shape.length, shape.axis_B)
    return np.zeros((0, 3))


def _ball() -> Array:
    latitude = np.linspace(-0.5 * np.pi, 0.5 * np.pi, STEPS // 2 + 1)[:, None]
    longitude = np.linspace(0.0, 2.0 * np.pi, STEPS, endpoint=False)
    x, y = np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude)
    return np.stack([x, y, np.sin(latitude) + 0.0 * x], axis=-1).reshape(-1, 3)


def _ring(axis: tuple[float, float, float]) -> Array:
    """Points on the unit circle perpendicular to the axis."""
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
    """Projection matrix (2, 3) and names of the picture's axes; None for the oblique view."""
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


class Drawn(NamedTuple):
    """Contents of the picture except the result."""

    title: str
    bodies: dict[str, Body]
    states: dict[str, BodyState]
    loads: list[Load]
    system: Equilibrium

    def centre(self, name: str) -> Array:
        """Centre of mass, world [m], (3,)."""
        return np.array(self.states[name].p_WC)


def drawn_of(scene: Scene) -> Drawn:
    """The contents for a scene, without loads that are zero at rest."""
    place = InitialPlace(scene)
    states = {name: at_zero_velocity(place.state(name)) for name in scene.bodies}
    loads = [
        load for load in active_loads(scene, place, states) if load.force.any() or load.torque.any()
    ]
    title = scene.description or scene.name
    return Drawn(title, dict(scene.bodies), states, loads, at_rest(scene))


BODY = "#d9c39a"
LONGEST = 0.30
"""Length of the longest arrow, relative to the scene's size."""
SHORTEST = 0.06
"""Length of the shortest arrow, relative to the scene's size."""


def draw(scene: Scene, result: StaticsResult) -> Figure:
    """The picture as a matplotlib figure."""
    canvas = _Canvas(scene, result)
    canvas.bodies()
    canvas.supports()
    canvas.loads()
    canvas.reactions()
    return canvas.finish()


def save_picture(scene: Scene, result: StaticsResult, path: Path) -> None:
    """Write the picture to a file, whose extension gives the format."""
    draw(scene, result).savefig(path, dpi=140)


def _greek(text: str) -> str:
    """The text with Greek letters and degrees, and no line break within a formula."""
    for name, letter in (("mu", "μ"), ("alpha", "α"), ("phi", "φ"), ("theta", "θ")):
        text = re.sub(rf"\b{name}\b", letter, text)
    text = re.sub(r"(\d) deg\b", r"\1°", text)
    return re.sub(r"(?<=[\dμ]) (?=μ)|(?<=\btan) | (?=[-+=<>] )|(?<= [-+=<>]) ", "\u00a0", text)


class _Canvas:
    """A picture under construction: view, scale, and marks so far."""

    def __init__(self, scene: Scene, result: StaticsResult) -> None:
        self.drawn_scene, self.result = drawn_of(scene), result
        self.system = self.drawn_scene.system
        self.points = {name: surface_points(body) for name, body in self.drawn_scene.bodies.items()}
        everything = [points for points in self.points.values() if len(points)]
        for element in self.system.elements:
            everything.append(np.array([element.anchor_W, element.parent_anchor_W]))
        everything += [self.drawn_scene.centre(name)[None] for name in self.drawn_scene.bodies]
        cloud = np.concatenate(everything)
        self.view, self.labels = projection(cloud, self._vectors())
        flat = cloud @ self.view.T
        self.size = float(np.max(np.ptp(flat, axis=0))) or 1.0
        self.figure = Figure(figsize=(7.5, 6.6), layout="constrained")
        self.axes = self.figure.add_subplot()
        self.drawn = [flat]
        self.texts: list[Any] = []

    def _vectors(self) -> Array:
        """Forces to be shown, world axes, (n, 3)."""
        forces = [reaction.force for reaction in self.result.reactions.values()]
        forces += [element.force_W[:, 0] for element in self.system.elements]
        forces += [load.force for load in self.drawn_scene.loads]
        return np.array([f for f in forces if f.any()]).reshape(-1, 3)

    def flat(self, point: Array) -> Array:
        """Position of a world point in the picture, (2,)."""
        return self.view @ point

    def bodies(self) -> None:
        """Draw the shapes, and a leg from each support outside the shape to its nearest point."""
        for name in self.drawn_scene.bodies:
            ends = [(e.anchor_W, e) for e in self.system.elements if e.body == name]
            ends += [(e.parent_anchor_W, e) for e in self.system.elements if e.parent == name]
            surface = self.points[name]
            if len(surface):
                self._filled(surface @ self.view.T)
            core = surface if len(surface) else self.drawn_scene.centre(name)[None]
            for end, element in ends:
                leg = core[np.argmin(np.linalg.norm(core - end, axis=1))] - end
                if element.kind == "contact" and len(surface):  # a leg along the normal
                    leg = element.force_W[:, 0] * float(leg @ element.force_W[:, 0])
                if np.linalg.norm(leg) > 0.05 * self.size or not len(surface):
                    self._line(end, end + leg, color="#8a6d3b", linewidth=4, zorder=1)

    def _filled(self, flat: Array) -> None:
        try:
            outline = flat[ConvexHull(flat).vertices]
        except QhullError:  # seen edge-on
            along = flat @ np.linalg.svd(flat - flat.mean(axis=0))[2][0]
            outline = flat[[np.argmin(along), np.argmax(along)]]
        patch = Polygon(outline, closed=True, facecolor=BODY, edgecolor="#8a6d3b", zorder=2)
        self.axes.add_patch(patch)

    def supports(self) -> None:
        """Draw strings and rods as lines, contacts as hatched ground, hinges as circles."""
        giving = {finding.name for finding in self.result.findings}
        for element in self.system.elements:
            colour = VERMILLION if element.name in giving else "#222222"
            anchor, far = self.flat(element.anchor_W), self.flat(element.parent_anchor_W)
            if colour == VERMILLION and not self.result.reactions:
                behind = -0.07 * self.size * (self.view @ element.force_W[:, 0])
                self._text(anchor + behind, element.name, VERMILLION, behind)
            if element.kind in ("string", "rod"):
                width = 1.3 if element.kind == "string" else 3.0
                self._line(element.anchor_W, element.parent_anchor_W, color=colour, linewidth=width)
                if element.parent is None:
                    self.axes.plot(*far, marker="s", color=colour, markersize=5, zorder=4)
            elif element.kind == "contact":
                self._ground(element, colour)
            else:
                fill_colour = "white" if element.kind == "hinge" else colour
                self.axes.plot(
                    *anchor, marker="o", color=colour, markerfacecolor=fill_colour, zorder=5
                )

    def _ground(self, element: Element, colour: str) -> None:
        """Draw a patch of the ground; edge-on a line with hatching on the far side."""
        anchor, normal = self.flat(element.anchor_W), self.view @ element.force_W[:, 0]
        half = 0.07 * self.size
        if self.labels is None:
            first, second = tangents(element.force_W[:, 0])
            corners = [first + second, first - second, -first - second, second - first]
            square = anchor + half * np.array(corners) @ self.view.T
            style = {"facecolor": "#e8e8e8", "edgecolor": colour, "hatch": "///", "alpha": 0.6}
            self.axes.add_patch(Polygon(square, closed=True, zorder=2.5, **style))
            self.drawn.append(square)
            return
        if np.linalg.norm(normal) < 0.2:  # seen along the normal
            self.axes.plot(*anchor, marker="o", markersize=9, fillstyle="none", color=colour)
            return
        normal = normal / np.linalg.norm(normal)
        across = np.array([-normal[1], normal[0]])
        ends = np.array([anchor - half * across, anchor + half * across])
        self.axes.plot(*ends.T, color=colour, linewidth=1.8, zorder=1)
        for share in np.linspace(-0.9, 0.9, 6):
            foot = anchor + share * half * across
            tip = foot - 0.3 * half * (normal + across)
            self.axes.plot(*np.array([foot, tip]).T, color=colour, linewidth=0.8, zorder=1)

    def _line(self, start: Array, end: Array, zorder: float = 3, **style: Any) -> None:
        ends = np.array([self.flat(start), self.flat(end)])
        self.axes.plot(*ends.T, solid_capstyle="round", zorder=zorder, **style)

    def loads(self) -> None:
        """Draw weights as arrows from the centre of mass, other forces as arrows to their point."""
        for name, _, point, force, torque, pushes in self.drawn_scene.loads:
            size = float(np.linalg.norm(force))
            text = f"{name}\n{size:.4g} N" if size > 0.0 else name
            if torque.any():
                text += f"\nK = ({', '.join(f'{v:.4g}' for v in torque)}) N m"
            if size > 0.0:
                start, tip = self._arrow(point, force, TEXT, pushes=pushes)
                end, along = (start, start - tip) if pushes else (tip, tip - start)
                self._text(end, text, TEXT, along)
            elif torque.any():
                self._text(self.flat(point), text, TEXT)

    def reactions(self) -> None:
        """Draw reactions as red arrows, tensions as blue ones, with values and ranges."""
        strongest = self._strongest()
        for name, reaction in self.result.reactions.items():
            span = self.result.ranges[name]
            size = float(np.linalg.norm(reaction.force))
            text = f"{name}\n{size if size > 1e-12 * strongest else 0.0:.4g} N"
            if reaction.along is not None and span.along is not None and not span.determinate:
                low, high = span.along
                top = "unbounded" if np.isinf(high) else f"{high:.4g}"
                letter = "T" if reaction.kind == "string" else "N"
                text += f"\n{letter} from {low:.4g} to {top}"
            colour = TENSION if reaction.kind in ("string", "rod") else REACTION
            start, along = self.flat(reaction.anchor), np.zeros(2)
            if size > 1e-9 * strongest:
                start, tip = self._arrow(reaction.anchor, reaction.force, colour)
                along = tip - start
            if reaction.kind in ("string", "rod"):
                middle = 0.4 * start + 0.6 * self.flat(reaction.parent_anchor)
                self._text(middle, text, colour, np.array([0.0, -1.0]))
            elif reaction.direction is not None:
                behind = self.view @ reaction.direction
                away = 0.03 if self.labels is not None else 0.07
                self._text(start - away * self.size * behind, text, colour, -behind)
            else:
                self._text(start + along, text, colour, along)

    def _strongest(self) -> float:
        sizes = [np.linalg.norm(reaction.force) for reaction in self.result.reactions.values()]
        sizes += [np.linalg.norm(load.force) for load in self.drawn_scene.loads]
        return float(max(sizes, default=0.0)) or 1.0

    def _arrow(
        self, point: Array, force: Array, colour: str, pushes: bool = False
    ) -> tuple[Array, Array]:
        """Draw a force from the point, or towards it (`pushes`); returns tail and tip, (2,)."""
        share = max(LONGEST * float(np.linalg.norm(force)) / self._strongest(), SHORTEST)
        step = share * self.size * (self.view @ (force / np.linalg.norm(force)))
        start = self.flat(point) - (step if pushes else 0.0)
        tip = start + step
        self.axes.annotate(
            "",
            xy=tuple(tip),
            xytext=tuple(start),
            arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2, "shrinkA": 0, "shrinkB": 0},
            zorder=6,
        )
        self.drawn.append(np.array([start, tip]))
        return start, tip

    def _text(self, at: Array, text: str, colour: str, away: Array | None = None) -> None:
        """Draw a label at a point of the picture, offset in direction `away`."""
        away = np.zeros(2) if away is None else away / (float(np.linalg.norm(away)) or 1.0)
        at = at + 0.025 * self.size * away
        self.axes.text(
            float(at[0]),
            float(at[1]),
            text,
            color=colour,
            fontsize=9,
            ha="left" if away[0] > 0.4 else "right" if away[0] < -0.4 else "center",
            va="bottom" if away[1] > 0.4 else "top" if away[1] < -0.4 else "center",
            zorder=7,
            bbox={"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 1.0},
        )
        self.drawn.append(np.array([at + 0.12 * self.size * away]))

    def finish(self) -> Figure:
        """Set frame, titles and axes; returns the figure."""
        cloud = np.concatenate(self.drawn)
        low, high = cloud.min(axis=0), cloud.max(axis=0)
        margin = 0.10 * float(np.max(high - low))
        self.axes.set_xlim(low[0] - margin, high[0] + margin)
        self.axes.set_ylim(low[1] - margin, high[1] + margin)
        self.axes.set_aspect("equal")
        self.axes.set_title(fill(_greek(self.drawn_scene.title), 74), fontsize=11)
        self.figure.supxlabel(fill(_greek(self.result.explanation), 92), fontsize=9.5)
        if self.labels is not None:
            self.axes.set_xlabel(f"{self.labels[0]} [m]")
            self.axes.set_ylabel(f"{self.labels[1]} [m]")
            self.axes.grid(alpha=0.25)
            self.axes.spines[:].set_visible(False)  # labels may cross a frame
        else:
            self.axes.set_axis_off()
            self._triad()
        return self.figure

    def _triad(self) -> None:
        """Draw the world axes in the lower left corner."""
        inset = self.axes.inset_axes((0.0, 0.0, 0.14, 0.14))
        inset.set_axis_off()
        inset.set_xlim(-1.3, 1.3)
        inset.set_ylim(-1.3, 1.3)
        inset.set_aspect("equal")
        for column, label in zip(self.view.T, "xyz", strict=True):
            inset.annotate("", xy=column, xytext=(0, 0), arrowprops={"arrowstyle": "->"})
            inset.text(
                1.25 * column[0], 1.25 * column[1], label, fontsize=9, ha="center", va="center"
            )
