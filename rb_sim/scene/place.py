# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The initial situation of a scene, as specs ask for it, and the scene's scales.

A local error is held to tolerance * max(1, |y_i|), which for a motion over a nanometre is the
whole of it. Where everything that a scene names is SMALL in SI, its tolerance is made smaller by
that much; else nothing changes.
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
    """Three Python floats."""
    x, y, z = map(float, values)
    return x, y, z


def quaternion(values: Any) -> Quaternion:
    """Four Python floats."""
    x, y, z, w = map(float, values)
    return x, y, z, w


def symmetric(values: Any) -> Symmetric:
    """Six Python floats."""
    xx, yy, zz, xy, xz, yz = map(float, values)
    return xx, yy, zz, xy, xz, yz


def inertial_of(body: Body) -> Inertial:
    """Constants of one body as kernels take them."""
    i = np.asarray(body.inertia)
    six = symmetric((i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]))
    return Inertial(float(body.mass), six, vector(body.center_of_mass))


def initial_state(body: Body) -> BodyState:
    """State of the centre of mass from that of the body origin."""
    q, w, r = (
        quaternion(body.orientation),
        vector(body.angular_velocity),
        vector(body.center_of_mass),
    )
    p = add(vector(body.position), rotate(q, r))
    v = add(vector(body.linear_velocity), rotate(q, cross(w, r)))
    return BodyState(p, q, v, w)


class InitialPlace:
    """Implements `Place` for a scene.

    starts: states of centres of mass from which the motion starts at `time` [s] instead of the
    scene's; what the scene takes from its initial pose is still taken from there.
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
        """The scene's own initial state of a body; None: the world."""
        return WORLD if body is None else self.states[body]

    def start(self, body: str) -> BodyState:
        """From which the motion starts."""
        return self._starts.get(body) or self.states[body]

    def shape(self, body: str) -> Any:
        """The shape of a body, or None."""
        return self.scene.bodies[body].shape

    def from_com(self, body: str | None, point: Vec3) -> Vec3:
        """A point of the body, given from its origin, from its centre of mass [m]; None: world."""
        return vector(point) if body is None else sub(vector(point), self.inertials[body].r_OC)

    def partner_point(
        self, parent: str | None, point: Vec3 | None, body: str | None, point_B: Vec3
    ) -> Vec3:
        """The parent's point of a joint [m]: as given, or where point_B lies at the start."""
        if point is not None:
            return self.from_com(parent, point)
        B, A = self.state(body), self.state(parent)
        world = add(B.p_WC, rotate(B.q_WB, self.from_com(body, point_B)))
        return unrotate(A.q_WB, sub(world, A.p_WC))

    def partner_axis(
        self, parent: str | None, axis: Vec3 | None, body: str | None, axis_B: Vec3
    ) -> Vec3:
        """The parent's axis of a joint: as given, or as axis_B lies at the start."""
        if axis is not None:
            return vector(axis)
        return unrotate(self.state(parent).q_WB, rotate(self.state(body).q_WB, vector(axis_B)))


# Points held between bodies, with rows along the world's axes or along the parent's.
#
# On the manifold of the constraints both ask for the same.  Off it, in the stages of a step, rows
# along the world's axes ask for other accelerations than rows that turn with the parent, and a
# body that has one of each close to each other is tilted by their difference over their distance.


CLOSE = 0.1
"""Of its arms: a point held between two bodies that is closer to what else holds a point of the
same two has its rows along the parent's axes, a fifth more operations. The square of their
distance is in an error of the motion, at a tenth a twentieth of what rk4 errs by."""

TURNING = (SlotRow, PlaneRow, DistanceRow)
"""Rows that hold a point of a body as seen from its parent."""


def along_parents(system: Any) -> Any:
    """The same system, all points held between two bodies with rows along the parent's axes.

    For scenes with rows that depend on each other.  Those that are left out are chosen at the
    start; along the world's axes the choice is a bad one as soon as a loop of bodies has turned as
    a whole: the row along x cannot be left out once the direction that is held twice is normal to
    x.  Seen from the bodies that direction stays where it is.
    """
    return system._replace(constraints=tuple(_seated(c) for c in system.constraints))


def along_parents_if_close(constraints: Sequence[Placed]) -> tuple[Placed, ...]:
    """The constraints, points with rows along the parent's axes where other rows on the same two
    bodies are CLOSE."""
    of_pair: dict[tuple[int, int], list[Any]] = defaultdict(list)
    for c in constraints:
        of_pair[c.body, c.parent].append(c.row)
    close = {pair for pair, rows in of_pair.items() if pair[1] >= 0 and _close(rows)}
    return tuple(_seated(c) if (c.body, c.parent) in close else c for c in constraints)


def _close(rows: Sequence[Any]) -> bool:
    """Whether one of the points is close to what turns with the parent."""
    points = [row for row in rows if isinstance(row, PointRow)]
    others = [row.r_B for row in rows if isinstance(row, TURNING)]
    return any(
        math.dist(point.r_B, r_B) < CLOSE * max(math.hypot(*point.r_B), math.hypot(*point.r_A))
        for point in points
        for r_B in others
    )


def _seated(c: Placed) -> Placed:
    """A point between two bodies with rows along the parent's axes; all else as it is."""
    return c._replace(row=SeatRow(*c.row)) if isinstance(c.row, PointRow) and c.parent >= 0 else c


LENGTHS = ("point", "length", "radius", "distance", "size", "anchor")
"""Parts of the names of parameters that are lengths [m]."""

SMALL = 1e-3
"""[m] or [m/s]."""

LEAST = 1e-20
"""Of the factor: below, a scene is taken to say nothing about its size."""


def scaled_tolerance(scene: Scene, tolerance: float) -> float:
    """The tolerance for coordinates in SI that is `tolerance` relative to the scene's own size."""
    small = size_of(scene)
    if not LEAST <= small < SMALL:
        return tolerance
    scaled = tolerance * small
    return scaled if not turns(scene) else max(scaled, min(tolerance, SMALLEST_TOLERANCE))


def at_its_size(scene: Scene) -> Scene:
    """The scene with its tolerance, if it has one, as coordinates in SI need it."""
    options = scene.simulation
    if options.tolerance is None:
        return scene
    scaled = scaled_tolerance(scene, options.tolerance)
    if scaled == options.tolerance:
        return scene
    update = {"simulation": options.model_copy(update={"tolerance": scaled})}
    return scene.model_copy(update=update)


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
    """Distances that the scene names: of bodies and centres of mass, of points, of joints."""
    for body in scene.bodies.values():
        yield math.hypot(*body.position)
        yield math.hypot(*body.center_of_mass)
    specs: list[Any] = [*scene.constraints.values(), *scene.effects.values()]
    for spec in specs:
        for name in length_fields(type(spec)):
            yield from sizes(getattr(spec, name))


@cache
def length_fields(kind: Any) -> tuple[str, ...]:
    """The parameters of a kind of constraint or effect that are lengths."""
    return tuple(name for name in kind.model_fields if any(part in name for part in LENGTHS))


def sizes(value: Any) -> Iterator[float]:
    """The numbers and the lengths of the vectors in a parameter."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        yield abs(float(value))
    elif isinstance(value, tuple | list):
        if value and all(isinstance(entry, int | float) for entry in value):
            yield math.hypot(*value)
        else:
            for entry in value:
                yield from sizes(entry)


def turns(scene: Scene) -> bool:
    """Whether a body may turn: it spins, is held by anything, or something may twist it."""
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
        if b.mass > 0.0  # of a body at rest it may be left out
    ]
    length = max([norm(p) for p in points] + gyration, default=0.0)
    speeds = [norm(s.v_WC) + length * norm(s.w_WB_B) for s in (place.state(name) for name in names)]
    return float(length), float(max([*speeds, (9.81 * length) ** 0.5]))


def start_scales(place: InitialPlace, owned: list[tuple[str, Any]]) -> tuple[float, float]:
    """As `scene_scales`, for what a start may be off by: joints count by where they are.

    How far apart bearings are, a metre if left out, says nothing about the size of the bodies.
    owned: the parts of constraints with the name of theirs, the first of each says where it is.
    """
    first: dict[str, Any] = {}
    for name, part in owned:
        first.setdefault(name, part)
    return scene_scales(place, list(first.values()))
