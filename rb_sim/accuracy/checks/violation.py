# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Constraints that a sample violates, and shapes that lie inside their supports."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.accuracy.checks.check import Checker, CheckInput, Run
from rb_sim.base.errors import Finding, RbSimError, SceneError
from rb_sim.base.rounding import SOLVED, SOLVED_IN_CONTACT
from rb_sim.catalogue.contact import Touching
from rb_sim.mechanics.initial_projection import Manifold, relative
from rb_sim.mechanics.systems.many_bodies import state_of
from rb_sim.scene.compile import compile_motion
from rb_sim.scene.initial import part_of
from rb_sim.scene.place import InitialPlace

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rb_sim.catalogue.spec import BodyState
    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene


CONTRADICTORY = (
    "check for constraints that contradict each other from here on, or try method dopri853"
)
STEPPED = "joints are accurate to first order only; try a smaller step or an event-driven method"


def violated_constraint(scene: Scene, layout: SampleLayout, block: SampleBlock, i: int) -> str:
    """Name of the constraint with the largest violation at sample i, by the scene in maximal
    coordinates; "" if it cannot be determined."""
    if layout.contacts or not scene.constraints:
        return ""
    try:
        system = compile_motion(scene.with_options(project_initial=True), "maximal").system
    except RbSimError:
        return ""
    y = coordinates(block, slice(i, i + 1))[0]
    with np.errstate(all="ignore"):
        violations, _ = Manifold(system).violations(float(block.t[i]), y.tolist())
    worst = relative(system, violations, system.length, system.speed).max(axis=0)
    return owner_of(scene, system, int(np.argmax(worst)))


def owner_of(scene: Scene, system: Any, row: int) -> str:
    """Name of the constraint to which a row of the system belongs."""
    place = InitialPlace(scene)
    owners = [n for n, spec in scene.constraints.items() for _ in spec.parts(place)]  # type: ignore[attr-defined]
    return owners[part_of(system, row)]


def residual(run: Run) -> Checker:
    """Checks that the residual of all samples is within its bound."""
    bound = SOLVED_IN_CONTACT if run.layout.contacts else SOLVED
    return lambda seen: residual_found(run.scene, run.layout, seen.block, bound)


def residual_found(
    scene: Scene, layout: SampleLayout, block: SampleBlock, bound: float
) -> Iterator[Finding]:
    """The first sample of the block whose residual is beyond the bound, or NaN."""
    beyond = np.flatnonzero(~(block.residual <= bound))
    if not len(beyond):
        return
    i = int(beyond[0])
    where = violated_constraint(scene, layout, block, i)
    advice = STEPPED if scene.simulation.method == "time_stepping" else CONTRADICTORY
    what = "constraint violation relative to the scene's size or speed"
    figure = float(np.nanmax(block.residual[i:]))
    yield Finding("residual", float(block.t[i]), figure, bound, what, where, advice)


def coordinates(block: SampleBlock, which: slice | list[int]) -> Array:
    """p_WC, q_WB, v_WC, w_WB_B of each body in turn at these samples, (n, 13 N)."""
    columns = block.position, block.orientation, block.linear_velocity, block.angular_velocity
    found = np.concatenate([column[which] for column in columns], axis=2)
    return found.reshape(len(found), -1)


# Shapes inside supports: a contact with listed points acts only at these, and the rest of the shape
# passes through the support, such as the upper end of a ladder of which only the foot is listed.
# Here the depth of the whole shape is computed.


DEEP = 1e-3
"""Depth, relative to the reach of the body's shape, above which it is reported."""
LOOKS = 64
"""Maximum number of instants of a block that are checked."""


def inside(run: Run) -> Checker:
    """Checks that the shape of a body with listed contact points is not inside its support."""
    bodies, contacts = run.layout.bodies, list(_whole_shapes(run.scene))

    def look(seen: CheckInput) -> Iterator[Finding]:
        if not contacts:
            return
        block = seen.block
        rows = np.unique(np.linspace(0, len(block) - 1, LOOKS).astype(int)).tolist()
        states = coordinates(block, rows).tolist()
        for t, y in zip(block.t[rows].tolist(), states, strict=True):
            for name, body, parent, parts, limit in contacts:
                B = state_of(y, bodies.index(body))
                A = state_of(y, -1 if parent is None else bodies.index(parent))
                depth = max(_depth(part.row, t, B, A) for part in parts)
                if depth > limit:
                    what = f"penetration of the shape of {body} into the contact's support [m]"
                    advice = (
                        "only the listed points make contact; list more points, or remove `points` "
                        "so that the whole shape does"
                    )
                    yield Finding("inside", t, depth, limit, what, name, advice)
                    return

    return look


def _whole_shapes(scene: Scene) -> Iterator[tuple[str, str, str | None, list[Any], float]]:
    """(contact, body, parent, contact of its whole shape, largest depth) for each contact with
    listed points of a body with a shape."""
    listed = [
        (name, spec)
        for name, spec in scene.constraints.items()
        if isinstance(spec, Touching) and getattr(spec, "points", None)
    ]
    if not listed:
        return
    place = InitialPlace(scene)
    for name, spec in listed:
        shape = scene.bodies[spec.body].shape
        if shape is None:
            continue
        try:
            parts = list(spec.model_copy(update={"points": None}).parts(place))
        except (SceneError, ValueError):
            continue  # this shape cannot touch this support
        yield name, spec.body, spec.parent, parts, DEEP * shape.reach


def _depth(row: Any, t: float, B: BodyState, A: BodyState) -> float:
    from rb_sim.catalogue.geometry.pairs import (
        carrier,  # loaded if contacts are there
        touching,
    )

    try:
        return -float(touching(row.pair, B, carrier(row.carrier, t, A)[0]).gap)
    except ZeroDivisionError:  # no unique nearest point
        return -inf
