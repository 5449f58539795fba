# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Initial state of a scene as specs use it, and the characteristic scales of the scene.

The local error is limited to tolerance * max(1, |y_i|); for a motion of a nanometre that would
allow an error as large as the motion. If all lengths and speeds of a scene are below SMALL in SI
units, its tolerance is reduced accordingly.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from rb_sim.catalogue.constraints.rows import DistanceRow, PlaneRow, PointRow, SeatRow, SlotRow
from rb_sim.catalogue.spec import WORLD, BodyState, Inertial, Placed, Quaternion, Symmetric, Vec3
from rb_sim.numerics.vectors import add, cross, norm, rotate, sub, unrotate
from rb_sim.scene.schema import SMALLEST_TOLERANCE, Body, Scene


def vector(values: Any) -> Vec3:
    """A vector as three Python floats."""
    x, y, z = map(float, values)
    return x, y, z


def quaternion(values: Any) -> Quaternion:
    """A quaternion as four Python floats."""
    x, y, z, w = map(float, values)
    return x, y, z, w


def symmetric(values: Any) -> Symmetric:
    """A symmetric tensor as six Python floats."""
    xx, yy, zz, xy, xz, yz = map(float, values)
    return xx, yy, zz, xy, xz, yz


def inertial_of(body: Body) -> Inertial:
    """Mass, inertia and centre of mass of a body as kernels take them."""
    i = np.asarray(body.inertia)
    six = symmetric((i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]))
    return Inertial(float(body.mass), six, vector(body.center_of_mass))


def initial_state(body: Body) -> BodyState:
    """State of the centre of mass, from the scene's state of the body origin."""
    q, w, r = (
        quaternion(body.orientation),
        vector(body.angular_velocity),
        vector(body.center_of_mass),
    )
    p = add(vector(body.position), rotate(q, r))
    v = add(vector(body.linear_velocity), rotate(q, cross(w, r)))
    return BodyState(p, q, v, w)


class InitialPlace:
    """`Place` of a scene: its initial state.

    starts: states of centres of mass at which the motion starts at `time` [s] instead of the
    scene's; data that specs derive from the initial pose still refer to the scene's own.
    """

    def __init__(
        self, scene: Scene, starts: Mapping[str, BodyState] | None = None, time: float = 0.0
    ) -> None:
        self.scene, self.time = scene, time
        self.inertials = {name: inertial_of(body) for name, body in scene.bodies.items()}
        self.states = {name: initial_state(body) for name, body in scene.bodies.items()}
        self._starts = dict(starts or {})

    def body_names(self) -> tuple[str, ...]:
        """Names of all bodies, in the order of the scene."""
        return tuple(self.scene.bodies)

    def inertial(self, body: str) -> Inertial:
        """Mass, inertia and centre of mass of a body."""
        return self.inertials[body]

    def state(self, body: str | None) -> BodyState:
        """The scene's own initial state of a body; for None that of the world."""
        return WORLD if body is None else self.states[body]

    def start(self, body: str) -> BodyState:
        """State of a body at which the motion starts."""
        return self._starts.get(body) or self.states[body]

    def shape(self, body: str) -> Any:
        """The shape of a body, or None."""
        return self.scene.bodies[body].shape

    def from_com(self, body: str | None, point: Vec3) -> Vec3:
        """Vector [m] from the centre of mass to a point given from the origin; unchanged for the
        world."""
        return vector(point) if body is None else sub(vector(point), self.inertials[body].r_OC)

    def partner_point(
        self, parent: str | None, point: Vec3 | None, body: str | None, point_B: Vec3
    ) -> Vec3:
        """The parent's joint point from its C [m]: as given, or the initial position of point_B."""
        if point is not None:
            return self.from_com(parent, point)
        B, A = self.state(body), self.state(parent)
        world = add(B.p_WC, rotate(B.q_WB, self.from_com(body, point_B)))
        return unrotate(A.q_WB, sub(world, A.p_WC))

    def partner_axis(
        self, parent: str | None, axis: Vec3 | None, body: str | None, axis_B: Vec3
    ) -> Vec3:
        """The parent's joint axis: as given, or the initial direction of axis_B."""
        if axis is not None:
            return vector(axis)
        return unrotate(self.state(parent).q_WB, rotate(self.state(body).q_WB, vector(axis_B)))


# Joint points between bodies, with rows along the world's axes or along the parent's.
#
# On the manifold both are equivalent. Off it, in the stages of a step, rows along the world's axes
# demand other accelerations than rows that turn with the parent, and a body with one of each, close
# to each other, is tilted by their difference over their distance.


CLOSE = 0.1
"""Distance of a joint point between two bodies from another constraint point of the same two, over
its arms, below which its rows are along the parent's axes (a fifth more operations). The error of
the motion contains the square of that distance: at a tenth, a twentieth of the error of rk4."""

TURNING = (SlotRow, PlaneRow, DistanceRow)
"""Row classes that constrain a point of a body in the frame of its parent."""


def along_parents(system: Any) -> Any:
    """The same system with the rows of all joint points between two bodies along the parent's axes.

    For scenes with dependent rows. The rows to omit are chosen at the start; along the world's axes
    that choice fails once a loop of bodies has turned as a whole: the row along x cannot be omitted
    when the redundant direction is normal to x. In the bodies' axes that direction stays the same.
    """
    return system._replace(constraints=tuple(_seated(c) for c in system.constraints))


def along_parents_if_close(constraints: Sequence[Placed]) -> tuple[Placed, ...]:
    """The constraints, with the rows of a joint point along the parent's axes if another row on the
    same two bodies is CLOSE."""
    of_pair: dict[tuple[int, int], list[Any]] = defaultdict(list)
    for c in constraints:
        of_pair[c.body, c.parent].append(c.row)
    close = {pair for pair, rows in of_pair.items() if pair[1] >= 0 and _close(rows)}
    return tuple(_seated(c) if (c.body, c.parent) in close else c for c in constraints)


def _close(rows: Sequence[Any]) -> bool:
    """Whether one of the joint points is close to a row that turns with the parent."""
    points = [row for row in rows if isinstance(row, PointRow)]
    others = [row.r_B for row in rows if isinstance(row, TURNING)]
    return any(
        math.dist(point.r_B, r_B) < CLOSE * max(math.hypot(*point.r_B), math.hypot(*point.r_A))
        for point in points
        for r_B in others
    )


def _seated(c: Placed) -> Placed:
    """A joint point between two bodies with rows along the parent's axes; all else unchanged."""
    return c._replace(row=SeatRow(*c.row)) if isinstance(c.row, PointRow) and c.parent >= 0 else c


LENGTHS = ("point", "length", "radius", "distance", "size", "anchor")
"""Parts of parameter names that denote lengths [m]."""

SMALL = 1e-3
"""Length [m] or speed [m/s] of a scene below which its tolerance is scaled."""

LEAST = 1e-20
"""Smallest scale factor: a scene below it has no meaningful size."""


def scaled_tolerance(scene: Scene, tolerance: float) -> float:
    """Tolerance for coordinates in SI units that equals `tolerance` relative to the scene's own
    size."""
    small = size_of(scene)
    if not LEAST <= small < SMALL:
        return tolerance
    scaled = tolerance * small
    return scaled if not turns(scene) else max(scaled, min(tolerance, SMALLEST_TOLERANCE))


def at_its_size(scene: Scene) -> Scene:
    """The scene with its tolerance, if any, scaled to coordinates in SI units."""
    tolerance = scene.simulation.tolerance
    if tolerance is None:
        return scene
    scaled = scaled_tolerance(scene, tolerance)
    return scene if scaled == tolerance else scene.with_options(tolerance=scaled)


def size_of(scene: Scene) -> float:
    """The smaller of the scene's length [m] and speed [m/s], as plain numbers; 0 if it has none."""
    duration = scene.simulation.duration
    length = max([*lengths(scene), 0.0])
    speeds = [math.hypot(*body.linear_velocity) for body in scene.bodies.values()]
    speeds += [math.hypot(*body.angular_velocity) * length for body in scene.bodies.values()]
    speed = max([*speeds, 0.0])
    for effect in scene.effects.values():
        pull = math.hypot(*getattr(effect, "acceleration", (0.0,)))
        length = max(length, 0.5 * pull * duration * duration)
        speed = max(speed, pull * duration)
    length = max(length, speed * duration)
    return min(length, max(speed, length / duration))


def lengths(scene: Scene) -> Iterator[float]:
    """All lengths in a scene [m]: positions, centres of mass, points and dimensions of joints."""
    for body in scene.bodies.values():
        yield math.hypot(*body.position)
        yield math.hypot(*body.center_of_mass)
    specs: list[Any] = [*scene.constraints.values(), *scene.effects.values()]
    for spec in specs:
        for name in length_fields(type(spec)):
            yield from sizes(getattr(spec, name))


@cache
def length_fields(kind: Any) -> tuple[str, ...]:
    """Names of the parameters of a kind of constraint or effect that are lengths."""
    return tuple(name for name in kind.model_fields if any(part in name for part in LENGTHS))


def sizes(value: Any) -> Iterator[float]:
    """Absolute values of the numbers, and lengths of the vectors, in a parameter."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        yield abs(float(value))
    elif isinstance(value, tuple | list):
        if value and all(isinstance(entry, int | float) for entry in value):
            yield math.hypot(*value)
        else:
            for entry in value:
                yield from sizes(entry)


def turns(scene: Scene) -> bool:
    """Whether a body may rotate: it spins, has a constraint, or an effect may twist it."""
    steady = {"gravity"}
    twisted = any(
        effect.type not in steady and not central(effect) for effect in scene.effects.values()
    )
    spinning = any(any(body.angular_velocity) for body in scene.bodies.values())
    return spinning or bool(scene.constraints) or twisted


def central(effect: Any) -> bool:
    """Whether the effect's force passes through the body's origin."""
    return effect.type == "spring" and not any(effect.point_B)


def scene_scales(place: InitialPlace, parts: list[Any]) -> tuple[float, float]:
    """Characteristic length [m] and speed [m/s] of the scene."""
    names = place.body_names()
    points = [
        value
        for part in parts
        for field, value in zip(part.row._fields, part.row, strict=True)
        if field.startswith("r_")
    ]
    gyration = [
        (max(b.inertia[:3]) / b.mass) ** 0.5
        for b in (place.inertial(name) for name in names)
        if b.mass > 0.0  # a body at rest may have none
    ]
    length = max([norm(p) for p in points] + gyration, default=0.0)
    speeds = [norm(s.v_WC) + length * norm(s.w_WB_B) for s in (place.state(name) for name in names)]
    return float(length), float(max([*speeds, (9.81 * length) ** 0.5]))


def start_scales(place: InitialPlace, owned: list[tuple[str, Any]]) -> tuple[float, float]:
    """As `scene_scales`, for initial violations: a constraint counts by its first part only.

    The distance of bearings, by default a metre, says nothing about the size of the bodies. owned:
    (name of the constraint, part); the first part of each locates it.
    """
    first: dict[str, Any] = {}
    for name, part in owned:
        first.setdefault(name, part)
    return scene_scales(place, list(first.values()))
