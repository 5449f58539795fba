# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Solids of the bodies and symbols of their supports, for the 3D page of a run and for Rerun.

Solids: {kind, sizes, center, axis or axes}, in body axes from the centre of mass, or in the world.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.io.rerun.arrow_scales import nice
from rb_sim.numerics.rotations import conjugate, rotate
from rb_sim.scene.extent import drawn_solid, half_box, inertia_box, reach_of

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout

CELLS = 12.0
"""Grid cells across the scene."""
ARM = 0.004
"""Radius of the arm between a body and its joint, relative to the scene's size."""
ALONG = 181
"""Points of a rail along a curve."""


def solid_of(body: Any) -> dict[str, Any]:
    """Shape of a body; without a shape the transparent box with its mass and inertia."""
    shape = body.shape
    if shape is None:
        half, axes = inertia_box(body)
        about = {"center": [0.0, 0.0, 0.0], "axes": axes.T.tolist(), "ghost": True}
        return {"kind": "box", "half": half.tolist(), **about}
    solid, about = drawn_solid(shape), {}
    about["center"] = (np.array(shape.center_B) - np.array(body.center_of_mass)).tolist()
    about["kind"] = solid.kind
    match solid.kind:
        case "ball":
            return {**about, "radius": solid.radius}
        case "cylinder":
            sizes = {"radius": solid.radius, "length": solid.length}
            return {**about, **sizes, "axis": list(shape.axis_B)}
    return {**about, "half": solid.half.tolist()}


KINDS = ("solids", "planes", "lines", "links", "joints")


class Sight(NamedTuple):
    """The part of the world that is drawn, relative to the local origin of the drawing [m]."""

    center: Array
    size: float
    low: float
    """height of the lowest centre of mass."""


class Supports:
    """Pivots, axes, rails, planes, rods and springs of a scene.

    block: samples; the first one gives the positions of joints. origin: of the drawing, in the
    world [m]. `items`: what is drawn: name of the constraint or effect, one of KINDS, and the
    drawing, relative to the body `on` (centre of mass, body axes), or with -1 to the origin.
    """

    def __init__(
        self,
        scene: Any,
        layout: SampleLayout,
        block: SampleBlock,
        view: Sight,
        origin: Array,
    ) -> None:
        self._scene, self._layout, self._block = scene, layout, block
        (self._center, self._size, self._low), self._origin = view, origin
        self.items: list[tuple[str, str, dict[str, Any]]] = []
        for name, spec in [*scene.constraints.items(), *getattr(scene, "effects", {}).items()]:
            draw = getattr(self, f"_draw_{spec.type}", None)
            if draw is not None:
                self._name = name
                draw(spec)
        if not any(plane["on"] < 0 and plane["normal"][2] > 0.5 for plane in self.of("planes")):
            self._ground()

    def of(self, kind: str) -> list[dict[str, Any]]:
        """The drawings of one of KINDS."""
        return [item for _, each, item in self.items if each == kind]

    def as_dict(self) -> dict[str, Any]:
        """Data for the page."""
        return {kind: self.of(kind) for kind in KINDS}

    def _add(self, kind: str, item: dict[str, Any]) -> None:
        """Append a drawing unless it exists already (a hundred balls may share one floor)."""
        if item not in self.of(kind):
            self.items.append((self._name, kind, item))

    # Positions: in the world at the first sample, then in the frame that they move with.

    def _world(self, body: str | None, point: Any) -> Array:
        """World position [m] at the first sample of a point of a body, or of the world."""
        if body is None:
            return np.array(point, dtype=float) - self._origin
        i = self._layout.bodies.index(body)
        arm = np.array(point, dtype=float) - np.array(self._scene.bodies[body].center_of_mass)
        return self._block.position[0, i] + rotate(self._block.orientation[0, i], arm)

    def _turned(self, body: str | None, axis: Any) -> Array:
        """World direction, at the first sample, of a direction in body axes or in the world."""
        axis = np.array(axis, dtype=float)
        if body is None:
            return axis
        return rotate(self._block.orientation[0, self._layout.bodies.index(body)], axis)

    def _in(self, body: str | None, point: Array) -> list[float]:
        """World point at the first sample, relative to a body's centre of mass, body axes."""
        if body is None:
            return point.tolist()
        i = self._layout.bodies.index(body)
        return self._direction_in(body, point - self._block.position[0, i])

    def _direction_in(self, body: str | None, axis: Array) -> list[float]:
        if body is None:
            return axis.tolist()
        q = self._block.orientation[0, self._layout.bodies.index(body)]
        return rotate(conjugate(q), axis).tolist()

    def _on(self, body: str | None) -> int:
        return -1 if body is None else self._layout.bodies.index(body)

    def _joint(self, body: str, point: Any) -> dict[str, Any]:
        return {"on": self._on(body), "point": self._in(body, self._world(body, point))}

    def _hinge(self, body: str, point: Any) -> None:
        """Add a joint, and an arm to it if it lies outside the body's shape."""
        joint = self._joint(body, point)
        self._add("joints", joint)
        shape = self._scene.bodies[body].shape
        if shape is None:
            return
        center = np.array(shape.center_B) - np.array(self._scene.bodies[body].center_of_mass)
        arm = np.array(joint["point"]) - center
        if (np.abs(arm) <= 1.05 * half_box(shape)).all():
            return
        sizes = {"radius": ARM * self._size, "length": float(np.linalg.norm(arm)), "plain": True}
        about = {"center": (center + 0.5 * arm).tolist(), "axis": (arm / sizes["length"]).tolist()}
        self._add("solids", {"kind": "cylinder", **sizes, **about, "on": self._on(body)})

    # One method for each drawn type of constraint or effect, called by name.

    def _draw_fixed_point(self, spec: Any) -> None:
        point = self._world(spec.body, spec.point_B)
        self._hinge(spec.body, spec.point_B)
        if _parent(spec) is None:  # a cone with the pivot at its tip
            length = 0.07 * self._size
            cone = {"kind": "cone", "radius": 0.45 * length, "length": length, "on": -1}
            center = (point - [0.0, 0.0, 0.5 * length]).tolist()
            self._add("solids", {**cone, "center": center, "axis": [0.0, 0.0, 1.0]})

    def _draw_fixed_axis(self, spec: Any) -> None:
        """Draw the axis as a line, with a bearing at each end if it is fixed in the world."""
        point = self._world(spec.body, spec.point_B)
        axis = self._turned(spec.body, spec.axis_B)
        half = 1.15 * max(reach_of(self._scene.bodies[spec.body]), 0.12 * self._size)
        ends = [point - half * axis, point + half * axis]
        self._line(_parent(spec), ends, dash=True)
        if _parent(spec) is None:
            sizes = {"radius": 0.018 * self._size, "length": 0.04 * self._size, "plain": True}
            for end in ends:
                about = {"center": end.tolist(), "axis": axis.tolist(), "on": -1}
                self._add("solids", {"kind": "cylinder", **sizes, **about})
        self._hinge(spec.body, spec.point_B)

    def _draw_translation(self, spec: Any) -> None:
        guide = spec.guide
        if guide is None:
            return
        start = self._world(spec.body, spec.point_B)
        if guide.type == "line":
            axis = self._turned(_parent(spec), guide.direction)
            foot = start + np.dot(self._center - start, axis) * axis
            points = [foot + s * self._size * axis for s in (-0.75, 0.75)]
        elif guide.type == "circle":
            center = self._world(_parent(spec), guide.center)
            normal = self._turned(_parent(spec), guide.normal)
            points = _circle(center, normal, start - center)
        else:
            points = [self._world(_parent(spec), p) for p in guide.points_along(ALONG)]
        self._line(_parent(spec), points)

    def _link(self, kind: str, spec: Any, ends: Any) -> None:
        from_ = self._joint(spec.body, ends.point_B)
        there = self._in(_parent(spec), self._world(_parent(spec), ends.point_A))
        to = {"on": self._on(_parent(spec)), "point": there}
        self._add("links", {"kind": kind, "from": from_, "to": to})

    def _draw_distance(self, spec: Any) -> None:
        self._link("rod", spec, spec)

    def _draw_spring(self, spec: Any) -> None:
        self._link("spring", spec, spec)

    def _draw_string(self, spec: Any) -> None:
        self._link("string", spec, spec)

    def _draw_plane(self, spec: Any) -> None:
        given = spec.point_A is not None
        point = self._world(
            *((_parent(spec), spec.point_A) if given else (spec.body, spec.point_B))
        )
        self._plane(_parent(spec), point, self._turned(_parent(spec), spec.normal_A))

    def _draw_rolling(self, spec: Any) -> None:
        point = self._world(_parent(spec), spec.point_A)
        self._plane(_parent(spec), point, self._turned(_parent(spec), spec.normal_A))

    def _draw_contact(self, spec: Any) -> None:
        surface = spec.surface
        match surface.type:
            case "plane":
                if (
                    _parent(spec) is not None
                    and self._scene.bodies[_parent(spec)].shape is not None
                ):
                    return  # the shape shows it
                point = self._world(_parent(spec), surface.point)
                normal = self._turned(_parent(spec), surface.normal)
                self._plane(_parent(spec), point, normal, getattr(spec, "motion", None))
            case "sphere":
                self._ball(_parent(spec), surface)
            case "cylinder":
                self._pipe(_parent(spec), surface)
            case "string":
                self._link("string", spec, surface)

    def _ball(self, parent: str | None, surface: Any) -> None:
        """Draw a solid ball; for a bowl, or a ball larger than the view, lines on its surface."""
        center, radius = self._world(parent, surface.center), surface.radius
        if surface.side == "outside" and radius < self._size:
            ball = {"kind": "ball", "radius": radius, "plain": True}
            about = {"center": self._in(parent, center), "on": self._on(parent)}
            self._add("solids", {**ball, **about})
            return
        pole = self._center - center
        pole = pole / (np.linalg.norm(pole) or 1.0) if pole.any() else np.eye(3)[2]
        across = _across(pole)
        wide = min(0.5 * np.pi, 0.6 * self._size / radius)
        for angle in np.linspace(0.0, wide, 6)[1:]:
            middle = center + radius * np.cos(angle) * pole
            self._line(parent, _circle(middle, pole, radius * np.sin(angle) * across))
        for start in _circle(np.zeros(3), pole, across)[:-1:6]:
            angles = np.linspace(0.0, wide, 21)
            points = [center + radius * (np.cos(a) * pole + np.sin(a) * start) for a in angles]
            self._line(parent, points)

    def _pipe(self, parent: str | None, surface: Any) -> None:
        axis = self._turned(parent, surface.axis)
        point = self._world(parent, surface.point)
        middle = point + np.dot(self._center - point, axis) * axis
        if surface.side == "outside":
            sizes = {"radius": surface.radius, "length": self._size, "plain": True}
            center, along = self._in(parent, middle), self._direction_in(parent, axis)
            about = {"center": center, "axis": along, "on": self._on(parent)}
            self._add("solids", {"kind": "cylinder", **sizes, **about})
            return
        across = surface.radius * _across(axis)
        for s in np.linspace(-0.5, 0.5, 5):
            self._line(parent, _circle(middle + s * self._size * axis, axis, across))
        for point in _circle(middle, axis, across)[:-1:6]:
            self._line(parent, [point + s * self._size * axis for s in (-0.5, 0.5)])

    def _line(self, parent: str | None, points: list[Array], **style: Any) -> None:
        line = [self._in(parent, point) for point in points]
        self._add("lines", {"on": self._on(parent), "points": line, **style})

    def _plane(self, parent: str | None, point: Array, normal: Array, motion: Any = None) -> None:
        foot = self._center - np.dot(self._center - point, normal) * normal
        plane = {
            "on": self._on(parent),
            "point": self._in(parent, foot),
            "normal": self._direction_in(parent, normal),
            "along": self._direction_in(parent, _across(normal)),
            **_grid(self._size),
            "thing": True,
        }
        if motion is not None:
            plane |= _moves(motion, self._origin)
        self._add("planes", plane)

    def _ground(self) -> None:
        """Add a faint ground plane below all bodies if the scene has none."""
        reach = min((reach_of(b) for b in self._scene.bodies.values()), default=0.0)
        cones = [solid for solid in self.of("solids") if solid["kind"] == "cone"]
        tips = [cone["center"][2] - 0.5 * cone["length"] for cone in cones]
        self._name = "ground"
        self._add("planes", ground(self._center, self._size, min([self._low - reach, *tips])))


def _parent(spec: Any) -> str | None:
    return getattr(spec, "parent", None)


def ground(center: Array, size: float, height: float) -> dict[str, Any]:
    """A horizontal reference grid that is not part of the scene."""
    across = {"normal": [0.0, 0.0, 1.0], "along": [1.0, 0.0, 0.0]}
    point = [float(center[0]), float(center[1]), height]
    return {"on": -1, "point": point, **across, **_grid(size), "thing": False}


def _grid(size: float) -> dict[str, float]:
    """Extent of a plane and spacing of its grid lines [m]."""
    step = nice(size / CELLS)
    return {"size": step * float(np.ceil(0.65 * size / step)), "step": step}


def _moves(motion: Any, origin: Array) -> dict[str, Any]:
    """Motion of the plane of a driven support."""
    if motion.type == "turntable":
        spin = motion.rate * np.array(motion.axis)
        return {"spin": spin.tolist(), "about": (np.array(motion.point) - origin).tolist()}
    amplitude = (motion.amplitude * np.array(motion.direction)).tolist()
    rate = 2.0 * np.pi * motion.frequency
    return {"shaken": {"amplitude": amplitude, "frequency": rate, "phase": motion.phase}}


def _across(axis: Array) -> Array:
    """A unit vector perpendicular to a unit vector, near x if possible."""
    other = np.eye(3)[0 if abs(axis[0]) < 0.9 else 1]
    found = other - np.dot(other, axis) * axis
    return found / np.linalg.norm(found)


def _circle(center: Array, normal: Array, arm: Array) -> list[Array]:
    """Points on a circle, closed."""
    other = np.cross(normal, arm)
    angles = np.linspace(0.0, 2.0 * np.pi, 61)
    return [center + np.cos(a) * arm + np.sin(a) * other for a in angles]
