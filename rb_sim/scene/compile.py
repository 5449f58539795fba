# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Compile a scene: the system that kernels integrate, its initial coordinates and sample layout."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from pydantic_core import PydanticCustomError

from rb_sim.base.errors import SceneError
from rb_sim.catalogue.constraints.rows import COUNT
from rb_sim.catalogue.spec import Placed
from rb_sim.mechanics import methods
from rb_sim.mechanics.compiled import Compiled
from rb_sim.mechanics.laws import traceable
from rb_sim.mechanics.samples import SampleLayout
from rb_sim.mechanics.systems.free import with_spins
from rb_sim.mechanics.systems.multibody import multibody
from rb_sim.scene.initial import check_maximal, check_reduced, undetermined
from rb_sim.scene.place import (
    InitialPlace,
    along_parents,
    along_parents_if_close,
    scene_scales,
    start_scales,
)
from rb_sim.scene.reduced import principal_axes, projected_alone, reduce_scene
from rb_sim.scene.schema import Scene, SimulationOptions


def compile_method(options: SimulationOptions, duration: float) -> Any:
    """The method named by the options; `auto` must have been replaced by a method before."""
    return methods.build(
        options.method, step=options.step, tolerance=options.tolerance, largest_step=duration
    )


def compile_scene(
    scene: Scene, *, coordinates: str = "auto", place: InitialPlace | None = None
) -> Compiled:
    """Compile the scene; coordinates "auto" prefers reduced ones, "maximal" forces maximal ones.

    place: initial place with another start of the motion (maximal coordinates only); None: the
    scene's own.

    Raises SceneError if the initial state violates a constraint and `project_initial` is false, or
    if a constraint, an effect or the method cannot be used in this scene.
    """
    compiled = compile_motion(scene, coordinates, place)
    if absolute := absolute_tolerances(scene, compiled):
        compiled = replace(compiled, absolute=absolute)
    name = scene.simulation.method
    method = methods.METHODS.get(name)  # None for auto
    if method is not None and not method.suits(compiled.system):
        raise SceneError(
            f"got {name!r}; must be dopri853 or auto here, since {name} takes only {method.domain}",
            key="simulation.method",
            file=scene.file,
        )
    return compiled


def absolute_tolerances(scene: Scene, compiled: Compiled) -> tuple[float | None, ...]:
    """Absolute tolerance of each body, () if none is given. Raises SceneError in a scene with
    contacts."""
    given = tuple(body.absolute_tolerance for body in scene.bodies.values())
    if not any(given):
        return ()
    for name, value in zip(scene.bodies, given, strict=True):
        if value is not None and compiled.layout.contacts:
            key = f"bodies.{name}.absolute_tolerance"
            text = f"got {value:g}; must be omitted in a scene with contacts"
            raise SceneError(text, key=key, file=scene.file)
    return given


def compile_motion(scene: Scene, coordinates: str, place: InitialPlace | None = None) -> Compiled:
    """As compile_scene, without checks of the method."""
    place = place or InitialPlace(scene)
    placed, commands, breakpoints = compile_effects(scene, place)
    rows = tuple(effect.row for effect in placed)
    joints = list(scene.constraints.values())
    for name, spec in scene.constraints.items():
        named(scene, f"constraints.{name}", lambda spec=spec: spec.parts(place))
    outputs = reaction_names(scene, place)
    layout = SampleLayout(
        tuple(scene.bodies),
        tuple(name for name, _, _ in outputs),
        tuple(scene.constraints[base].body for _, base, _ in outputs),
        tuple(commands),
        contact_names(scene, place),
    )
    if layout.contacts:
        from rb_sim.scene.compile_contacts import compile_contacts

        return compile_contacts(scene, place, placed, commands, breakpoints, layout, outputs)
    reduced = reduce_scene(place, joints, rows) if coordinates == "auto" else None
    if reduced is None:
        return compile_maximal(scene, place, placed, commands, breakpoints, layout, outputs)
    check_reduced(scene, place, reduced)
    indeterminate = tuple(layout.reactions) if reduced.indeterminate else ()
    parts = [part for spec in joints for part in spec.parts(place)]
    row_count = sum(COUNT[type(part.row)] for part in parts)
    freedom = 6 - row_count + (1 if reduced.indeterminate else 0)
    return Compiled(
        reduced.system, reduced.y, layout, commands, breakpoints, indeterminate, row_count, freedom
    )


def named(scene: Scene, key: str, action: Any) -> Any:
    """Run a spec's compile step; its errors become a SceneError at `key`."""
    try:
        return action()
    except (PydanticCustomError, ValueError) as error:
        text = error.message() if isinstance(error, PydanticCustomError) else str(error)
        raise SceneError(text, key=key, file=scene.file) from None


def compile_effects(
    scene: Scene, place: InitialPlace
) -> tuple[list[Placed], dict[str, tuple[int, ...]], tuple[float, ...]]:
    """(effects as placed rows, command rows of each body, breakpoints [s])."""
    index = {name: i for i, name in enumerate(scene.bodies)}
    placed: list[Placed] = []
    commands: dict[str, tuple[int, ...]] = {}
    breakpoints: set[float] = set()
    for name, spec in scene.effects.items():
        rows = named(scene, f"effects.{name}", lambda spec=spec: spec.rows(place))
        for row, body, parent in rows:
            if spec.commandable:
                if body in commands:
                    raise SceneError(
                        f"got a second commanded_wrench on {body}; a body takes one command",
                        key=f"effects.{name}",
                        file=scene.file,
                    )
                commands[body] = (len(placed),)
            placed.append(Placed(row, index[body], -1 if parent is None else index[parent]))
        breakpoints.update(spec.breakpoints())
    return placed, commands, tuple(sorted(breakpoints))


def contact_names(scene: Scene, place: InitialPlace) -> tuple[str, ...]:
    """Names of all contact points: NAME, or NAME/1, NAME/2 ... for a contact with several
    points."""
    return tuple(
        f"{name}/{suffix}" if suffix else name
        for name, spec in scene.constraints.items()
        for suffix in spec.contact_suffixes(place)
    )


def reaction_names(scene: Scene, place: InitialPlace) -> list[tuple[str, str, str]]:
    """(reaction, constraint, suffix) in the order of the samples."""
    return [
        (f"{name}/{suffix}" if suffix else name, name, suffix)
        for name, spec in scene.constraints.items()
        for suffix in spec.reaction_suffixes(place)
    ]


def compile_maximal(
    scene: Scene,
    place: InitialPlace,
    placed: list[Placed],
    commands: dict[str, tuple[int, ...]],
    breakpoints: tuple[float, ...],
    layout: SampleLayout,
    outputs: list[tuple[str, str, str]],
) -> Compiled:
    """The scene in maximal coordinates."""
    index = {name: i for i, name in enumerate(scene.bodies)}
    parts, owners, constraints = [], [], []
    for name, spec in scene.constraints.items():
        parent = getattr(spec, "parent", None)
        for part in spec.parts(place):
            parts.append(part)
            owners.append(name)
            at = -1 if parent is None else index[parent]
            constraints.append(Placed(part.row, index[spec.body], at))
    owned = list(zip(owners, parts, strict=True))
    groups = []
    for _, base, suffix in outputs:
        members = [i for i, (of, part) in enumerate(owned) if of == base and suffix in part.outputs]
        groups.append((members, members[0]))
    length, speed = scene_scales(place, parts)
    bodies = [place.inertial(name) for name in scene.bodies]
    held = along_parents_if_close(constraints)
    system = multibody(bodies, tuple(placed), held, groups, length, speed)
    y = initial_coordinates(scene, place)
    scales = start_scales(place, owned)
    rank, rows = check_maximal(scene, system, y, owners, place.time, scales)
    indeterminate: tuple[str, ...] = ()
    if rank < rows:
        system = along_parents(system)
        indeterminate = undetermined(system, layout, place.time, y)
    if traceable(system):
        system = with_spins(system, bodies, principal_axes, y)
    return Compiled(
        system, y, layout, commands, breakpoints, indeterminate, rows, 6 * len(bodies) - rank
    )


def initial_coordinates(scene: Scene, place: InitialPlace) -> np.ndarray:
    """Initial maximal coordinates; with project_initial, bodies with a single joint are moved onto
    it."""
    starts = {name: place.start(name) for name in scene.bodies}
    if scene.simulation.project_initial:
        starts |= projected_alone(place, list(scene.constraints.values()))
    return np.concatenate(
        [np.concatenate([np.array(field) for field in start]) for start in starts.values()]
    )
