# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Equilibrium of an ordinary scene in its initial pose, at rest (LL 38.1).

Constraints contribute the same equations, with the same signs, as in motion; effects contribute
their loads on bodies at rest; contacts act within their friction laws if the surfaces touch.
Initial velocities, driven rates, motion of supports and commands are taken as zero.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rb_sim.base.errors import SceneError
from rb_sim.base.rounding import SUM_ROUNDING, WRITTEN_ROUNDING
from rb_sim.catalogue.constraints.rows import (
    ANGLES,
    COUNT,
    ERROR,
    HOLONOMIC,
    ROW_WIDTH,
    anchor,
    fill,
)
from rb_sim.catalogue.contact import ContactLaw, Touching
from rb_sim.catalogue.effects.wrench import Wrench
from rb_sim.catalogue.geometry.pairs import touching
from rb_sim.catalogue.geometry.solids import box_points
from rb_sim.catalogue.spec import WORLD, BodyState, Placed, wrench
from rb_sim.equilibrium.equilibrium import (
    Bound,
    Element,
    Equilibrium,
    points_of_application,
    poles_of,
    put_together,
    tangents,
)
from rb_sim.numerics.vectors import ZERO, add, rotate, sub
from rb_sim.scene.compile import named
from rb_sim.scene.compile_contacts import contact_scales
from rb_sim.scene.initial import MISFIT, refuse_initial
from rb_sim.scene.pairs_of_bodies import box_sizes
from rb_sim.scene.place import InitialPlace
from rb_sim.scene.schema import Scene

# Contacts and strings at rest: admissible normal and friction forces at each point.


Array = NDArray[np.float64]


class Standing(NamedTuple):
    """One constraint of a scene in its initial pose."""

    place: InitialPlace
    name: str
    spec: Any
    B: BodyState
    A: BodyState
    """state of the parent, or of the world."""
    length: float
    """characteristic length of the scene [m]."""


class Found(NamedTuple):
    """Elements of the closed contact points, and names of the open ones."""

    closed: list[Element]
    apart: list[str]


class Point(NamedTuple):
    """A contact point in the world."""

    at: Array
    normal: Array
    """unit normal, into the body."""
    gap: float


def touching_elements(standing: Standing) -> Found:
    """An element for each closed contact point; names of the open ones.

    Raises ValueError for a bilateral contact with Coulomb friction, whose normal force may pull.
    """
    law = standing.spec.law()
    bounded = 0.0 < law.static < math.inf or law.rolling_arm > 0.0 or law.spinning_arm > 0.0
    if law.bilateral and bounded:
        raise ValueError(
            "statics takes a bilateral contact smooth or rough, not with friction that N bounds"
        )
    points = list(points_of(standing))
    near = WRITTEN_ROUNDING * standing.length
    closed, apart = [], []
    for i, point in enumerate(points):
        name = standing.name if len(points) == 1 else f"{standing.name}/{i + 1}"
        if point.gap > (0.0 if law.compliant else near) and not law.bilateral:
            apart.append(name)
        else:
            closed.append(element_of(name, standing, law, point))
    return Found(closed, apart)


def points_of(standing: Standing) -> Iterator[Point]:
    """Contact points, also open ones; for two boxes the corners of the common face area."""
    spec, B, A = standing.spec, standing.B, standing.A
    boxes = box_sizes(spec, standing.place)
    if boxes is not None:
        yield from points_of_boxes(boxes, B, A)
        return
    for part in spec.parts(standing.place):
        found = touching(part.row.pair, B, A)  # type: ignore[attr-defined]
        yield Point(np.array(found.point, float), np.array(found.normal, float), float(found.gap))


def points_of_boxes(sizes: list[float], B: BodyState, A: BodyState) -> Iterator[Point]:
    """Contact points of two boxes. sizes: centre from C and half edges of the body's box, then of
    the parent's [m]."""
    half_B, half_A = tuple(sizes[3:6]), tuple(sizes[9:])
    centre_B = add(B.p_WC, rotate(B.q_WB, tuple(sizes[:3])))
    centre_A = add(A.p_WC, rotate(A.q_WB, tuple(sizes[6:9])))
    points, normal = box_points(A.q_WB, centre_A, half_A, B.q_WB, centre_B, half_B, math.inf)
    for x, y, z, gap in points:
        yield Point(np.array([x, y, z]), normal, float(gap))


def element_of(name: str, standing: Standing, law: ContactLaw, point: Point) -> Element:
    """The element of one closed contact point."""
    spec, normal = standing.spec, point.normal
    depth = max(-point.gap, 0.0)
    normal_force = law.spring[0] * depth if law.compliant else None
    has_friction = law.static > 0.0
    forces = [] if law.compliant else [normal]
    forces += [*tangents(normal)] if has_friction else []
    turns = [*tangents(normal)] if law.rolling_arm > 0.0 else []
    turns += [normal] if law.spinning_arm > 0.0 else []
    none = np.zeros((3, 1))
    columns = [np.c_[f, none] for f in forces] + [np.c_[none, t] for t in turns]
    both = np.array(columns).reshape(-1, 3, 2)
    kind = spec.type  # type: ignore[attr-defined]
    return Element(
        name=name,
        kind=kind,
        body=spec.body,
        parent=spec.parent,
        anchor_W=point.at,
        parent_anchor_W=point.at,
        force_W=both[:, :, 0].T,
        torque_W=both[:, :, 1].T,
        law="two-way" if law.bilateral or law.compliant else "one-way",
        friction=law.static,
        bounds=bounds_of(law, normal_force),
        given_W=np.zeros(3) if normal_force is None else normal_force * normal,
        normal_W=None if normal_force is None else normal,
    )


def bounds_of(law: ContactLaw, normal_force: float | None) -> tuple[Bound, ...]:
    """Bounds by the normal force. Unknowns: N (if unknown), two tangential forces, torques."""
    found: list[Bound] = []
    k = 0 if law.compliant else 1
    if law.static > 0.0:
        if law.static < math.inf:
            found.append(Bound("slips", law.static, (k, k + 1), normal_force))
        k += 2
    if law.rolling_arm > 0.0:
        found.append(Bound("rolls", law.rolling_arm, (k, k + 1), normal_force))
        k += 2
    if law.spinning_arm > 0.0:
        found.append(Bound("spins", law.spinning_arm, (k,), normal_force))
    return tuple(found)


KINDS = {"distance": "rod"}
"""Kinds of supports by constraint type. The unknown of a rod is its tension, positive in tension,
whereas the constraint row pushes the body away from the other end."""

LINES = ("string", "rod", "distance")
"""Constraints that act along a line between two points."""


def at_rest(scene: Scene) -> Equilibrium:
    """Equilibrium system of the scene's bodies in their initial pose.

    Raises SceneError if the pose violates a constraint, and for a bilateral contact with Coulomb
    friction.
    """
    place = InitialPlace(scene)
    states = {name: at_zero_velocity(place.state(name)) for name in scene.bodies}
    scale = length_of(scene, place)
    elements: list[Element] = []
    apart: list[str] = []
    constraints: dict[str, Any] = dict(scene.constraints)
    for name, spec in constraints.items():
        kind = spec.type
        if getattr(spec, "between", None) is not None:
            raise SceneError(
                f"got {spec.between!r}; must be omitted for statics, which needs each pair that "
                "touches as a contact with body and parent",
                key=f"constraints.{name}.between",
                file=scene.file,
            )
        B, A = states[spec.body], states.get(spec.parent, WORLD) if has_parent(spec) else WORLD
        if isinstance(spec, Touching):
            standing = Standing(place, name, spec, B, A, scale)
            found = named(scene, f"constraints.{name}", lambda s=standing: touching_elements(s))
            apart += found.apart
            made = found.closed
        else:
            made = list(joint_elements(name, spec, place, B, A))
        if not scene.simulation.project_initial:
            check_pose(scene, Standing(place, name, spec, B, A, scale))
        if kind in LINES:
            far = far_end(spec, place, A)
            made = [replace(element, parent_anchor_W=far) for element in made]
        elements += made
    loads = list(active_loads(scene, place, states))
    bodies = tuple(scene.bodies)
    centres = np.array([states[name].p_WC for name in bodies])
    pushed = [(load.body, load.point) for load in loads if load.pushes]
    points = points_of_application(bodies, centres, elements, pushed)
    poles, wrenches = poles_of(bodies, points), np.zeros((len(bodies), 6))
    for load in loads:
        row = bodies.index(load.body)
        wrenches[row, :3] += load.force
        wrenches[row, 3:] += load.torque + np.cross(load.point - poles[row], load.force)
    return put_together(bodies, tuple(elements), points, wrenches, centres, tuple(apart))


def length_of(scene: Scene, place: InitialPlace) -> float:
    """Characteristic length of the scene [m]."""
    parts: dict[bool, list[Any]] = {True: [], False: []}
    for name, spec in scene.constraints.items():
        found = named(scene, f"constraints.{name}", lambda spec=spec: spec.parts(place))
        parts[isinstance(spec, Touching)] += found
    contacts = [Placed(part.row, 0, -1) for part in parts[True]]
    return contact_scales(place, scene, parts[False], contacts)[0] or 1.0


def check_pose(scene: Scene, standing: Standing) -> None:
    """Raise SceneError if the pose violates a joint, or rigid bodies overlap."""
    spec, place, scale = standing.spec, standing.place, standing.length
    worst, amount = 0.0, ""
    if not isinstance(spec, Touching):
        for part in spec.parts(place):
            lines = lines_of(part.row, standing.B, standing.A)
            off = float(np.abs(lines[:, ERROR] * lines[:, HOLONOMIC]).max())
            turned = type(part.row) in ANGLES
            share = off if turned else off / scale
            if share > worst:
                worst, amount = share, f"{off:.2g} {'rad' if turned else 'm'}"
    elif not (law := spec.law()).compliant:
        for point in points_of(standing):
            off = abs(point.gap) if law.bilateral else -point.gap
            if off / scale > worst:
                worst, amount = off / scale, f"{off:.2g} m"
    if worst > MISFIT:
        refuse_initial(scene, standing.name, f"the initial position violates it by {amount}")


def far_end(spec: Any, place: InitialPlace, A: BodyState) -> Array:
    """Attachment point of a string or rod on its parent, world [m], (3,)."""
    return np.array(add(A.p_WC, rotate(A.q_WB, place.from_com(spec.parent, spec.point_A))))


def has_parent(spec: Any) -> bool:
    """Whether the constraint has a parent body (else the world)."""
    return getattr(spec, "parent", None) is not None


def at_zero_velocity(state: BodyState) -> BodyState:
    """The same pose with zero velocities."""
    return state._replace(v_WC=(0.0, 0.0, 0.0), w_WB_B=(0.0, 0.0, 0.0))


def joint_elements(
    name: str, spec: Any, place: InitialPlace, B: BodyState, A: BodyState, *, whole: bool = False
) -> Iterator[Element]:
    """An element for each reaction of a joint except totals; whole: one element for the total."""
    groups: dict[str, list[Any]] = {}
    for part in spec.parts(place):
        groups.setdefault("" if whole else part.outputs[-1], []).append(part.row)
    parent = spec.parent if has_parent(spec) else None
    for suffix, rows in groups.items():
        point = np.array(anchor(rows[0], B, A), float)
        lines = np.vstack([lines_of(row, B, A)[:, :12] for row in rows])
        force = lines[:, :3]
        about_centre = np.array([rotate(B.q_WB, tuple(line)) for line in lines[:, 3:6]])
        torque = about_centre - np.cross(point - np.array(B.p_WC), force)
        torque[np.abs(torque) <= SUM_ROUNDING * np.abs(about_centre).max(initial=0.0)] = 0.0
        kind = KINDS.get(str(spec.type), str(spec.type))
        if kind == "rod":
            force, torque = -force, -torque
        yield Element(
            name=f"{name}/{suffix}" if suffix else name,
            kind=kind,
            body=spec.body,
            parent=parent,
            anchor_W=point,
            parent_anchor_W=point,
            force_W=force.T,
            torque_W=torque.T,
            law="two-way",
        )


def lines_of(row: Any, B: BodyState, A: BodyState) -> Array:
    """Jacobian and further columns of one part of a constraint, (equations, ROW_WIDTH)."""
    G = np.zeros((COUNT[type(row)], ROW_WIDTH))
    fill(row, 0.0, B, A, G, 0)
    return G


class Load(NamedTuple):
    """Wrench of an effect on a body at rest."""

    name: str
    """name of the effect."""
    body: str
    point: Array
    """point of application of the force, world [m], (3,)."""
    force: Array
    """world axes [N], (3,)."""
    torque: Array
    """about the point, world axes [N m], (3,)."""
    pushes: bool
    """whether it is a force at a point, drawn towards it; else drawn away, like a weight."""


def active_loads(scene: Scene, place: InitialPlace, states: dict[str, BodyState]) -> Iterator[Load]:
    """Loads of the effects on their bodies and, opposite, on the parents."""
    effects: dict[str, Any] = dict(scene.effects)
    for name, spec in effects.items():
        if spec.commandable:
            continue
        for row, body, parent in named(scene, f"effects.{name}", lambda s=spec: s.rows(place)):
            B, A = states[body], WORLD if parent is None else states[parent]
            force_W, torque_B = wrench(row, 0.0, place.inertial(body), B, A)
            force, about_C = np.array(force_W, float), np.array(rotate(B.q_WB, torque_B), float)
            arm = ZERO  # point of application relative to C
            if hasattr(spec, "point_B"):
                arm = rotate(B.q_WB, place.from_com(body, spec.point_B))
            moved = np.cross(arm, force)
            torque = about_C - moved
            torque[np.abs(torque) <= SUM_ROUNDING * np.abs(moved).max()] = 0.0
            point = np.array(add(B.p_WC, arm))
            pushes = isinstance(spec, Wrench)
            yield Load(name, body, point, force, torque, pushes)
            if parent is not None:
                turned = about_C + np.cross(sub(B.p_WC, A.p_WC), force)
                yield Load(name, parent, np.array(A.p_WC), -force, -turned, pushes)
