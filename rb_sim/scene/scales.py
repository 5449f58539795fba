# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""How large a scene is: the lengths and speeds against which a tolerance is to mean something.

A local error is held to tolerance * max(1, |y_i|), which for a motion over a nanometre is the
whole of it.  Where everything that a scene names is SMALL in SI, its tolerance is made smaller by
that much; else nothing changes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from typing import Any

from rb_sim.numerics.vectors import norm
from rb_sim.scene.place import InitialPlace
from rb_sim.scene.schema import SMALLEST_TOLERANCE, Scene

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
