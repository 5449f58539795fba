# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""States set from outside during a run: validation, and a check against the constraints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.base.errors import RbSimError, SceneError
from rb_sim.catalogue.spec import STRONGEST, BodyState
from rb_sim.mechanics.compiled import Compiled
from rb_sim.mechanics.samples import centers_of_mass, origins
from rb_sim.numerics.vectors import add, cross, rotate
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.place import InitialPlace, vector

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene

Placement = Mapping[str, Sequence[float]]
"""position, orientation, linear_velocity, angular_velocity of a body, with the keys of a scene."""

FIELDS = {
    "position": slice(0, 3),
    "orientation": slice(3, 7),
    "linear_velocity": slice(7, 10),
    "angular_velocity": slice(10, 13),
}
"""Slice of each quantity among the 13 numbers of Input.state."""
UNIT = 1e-3
"""Largest deviation of a quaternion's length from 1; it is normalised."""


def placement(state: Sequence[float]) -> Placement:
    """The 13 numbers of a state as a mapping by name."""
    return {name: state[part] for name, part in FIELDS.items()}


def present_states(
    scene: Scene, layout: SampleLayout, block: SampleBlock
) -> dict[str, np.ndarray[Any, Any]]:
    """The 13 numbers of every body at the last sample."""
    motion = origins(block, centers_of_mass(scene.bodies, layout.bodies))
    columns = (motion.position, block.orientation, motion.linear_velocity, block.angular_velocity)
    rows = np.concatenate([column[-1] for column in columns], axis=1)
    return dict(zip(layout.bodies, rows, strict=True))


def read_placement(body: str, given: Placement, present: Array) -> Array:
    """The 13 numbers of a body: given values, current ones for missing keys. Raises RbSimError."""
    state = present.copy()
    if not isinstance(given, Mapping):
        raise RbSimError(f"{body}: got {given!r:.80}; must be a mapping of {', '.join(FIELDS)}")
    for name, values in given.items():
        if name not in FIELDS:
            raise RbSimError(f"{body}: got {name!r}; must be one of {', '.join(FIELDS)}")
        vector = np.asarray(values, dtype=float)
        shape = state[FIELDS[name]].shape
        if vector.shape != shape or not (np.abs(vector) <= STRONGEST).all():  # also for NaN
            raise RbSimError(
                f"{body}.{name}: got {values!r}; must be {shape[0]} finite numbers, none beyond "
                f"{STRONGEST:g}"
            )
        if name == "orientation":
            length = float(np.linalg.norm(vector))
            if abs(length - 1.0) > UNIT:
                raise RbSimError(f"{body}.orientation: got length {length:g}; must be 1")
            vector = vector / length
        state[FIELDS[name]] = vector
    return state


def compiled_at(scene: Scene, states: Mapping[str, Array], t: float, *, project: bool) -> Compiled:
    """The scene in maximal coordinates, started from the states at t [s].

    Raises RbSimError if a state violates a constraint and is not projected.
    """
    starts = {body: _of_center(scene, body, state) for body, state in states.items()}
    try:
        return compile_scene(
            scene.with_options(project_initial=project),
            coordinates="maximal",
            place=InitialPlace(scene, starts, t),
        )
    except SceneError as error:
        words = error.message.replace("the initial ", "the given ").replace(" at the start", "")
        words = words.replace("set simulation.project_initial: true", "project it")
        raise RbSimError(f"{error.key}: {words}") from None


def _of_center(scene: Scene, body: str, state: Array) -> BodyState:
    """State of the centre of mass from that of the body origin."""
    r = vector(scene.bodies[body].center_of_mass)
    numbers: list[Any] = [tuple(map(float, state[part])) for part in FIELDS.values()]
    p, q, v, w = numbers
    return BodyState(add(p, rotate(q, r)), q, add(v, rotate(q, cross(w, r))), w)
