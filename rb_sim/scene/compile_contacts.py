# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Compile scenes with contacts: joints first, then every contact point."""

from __future__ import annotations

from itertools import groupby
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from rb_sim.base.errors import SceneError
from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.catalogue.constraints.rows import COUNT, ROW_WIDTH
from rb_sim.catalogue.contact import ContactLaw, Sides, Touching, contact_rows, sides_of
from rb_sim.catalogue.geometry.corners_and_rims import (
    ABSENT,
    PointOnSolid,
    RimOnCylinder,
    RimOnPlane,
)
from rb_sim.catalogue.spec import Placed
from rb_sim.mechanics.compiled import BoxPair, Compiled
from rb_sim.mechanics.contact import constraint_tables as _registers_its_kernels  # noqa: F401
from rb_sim.mechanics.contact.constraint_tables import write_contact
from rb_sim.mechanics.contact.contact_bodies import (
    AMONG_POSITIONS,
    AMONG_ROWS,
    CHANGING,
    CLOSED,
    CONTACT_TABLE_WIDTH,
    DEPENDENT,
    GAP,
    LEAN_BEFORE,
    LEAN_SIGN,
    MOST_RANK,
    NORMAL,
    NORMAL_SIGN,
    POINT,
    RIM,
    ROW_TABLE_WIDTH,
    SLIP,
    SPEED_TOLERANCE,
    ContactBodies,
    write_parameters,
)
from rb_sim.mechanics.contact.motion_kernels import bring_positions, bring_to_manifold
from rb_sim.mechanics.initial_projection import changing_in, dependent_rows
from rb_sim.mechanics.samples import SampleLayout
from rb_sim.mechanics.systems.many_bodies import ANGLE, angles
from rb_sim.mechanics.systems.multibody import body_table, write_rows
from rb_sim.numerics.kernels import python_of
from rb_sim.numerics.vectors import norm
from rb_sim.scene.initial import MISFIT, check_maximal, in_scene, refuse_initial, undetermined
from rb_sim.scene.pairs_of_bodies import Between, box_sizes
from rb_sim.scene.place import (
    InitialPlace,
    along_parents,
    along_parents_if_close,
    scene_scales,
    start_scales,
)
from rb_sim.scene.schema import Scene

# The contact points of a scene, grouped by kind, and their table.


def kind_of(row: Any) -> str:
    """Key of the compiled code of a contact point: the classes of its geometry and laws."""
    classes = (row.pair, getattr(row.pair, "surface", None), row.friction, row.resistance)
    names = [type(field).__name__ for field in (*classes, row.carrier)]
    return " ".join([*names, str(len(row.spring))])


def grouped_contacts(scene: Scene, place: InitialPlace) -> list[tuple[str, Touching, Any, str]]:
    """(constraint, spec, part, name of the point) of each contact point, grouped by kind."""
    found = []
    for name, spec in scene.constraints.items():
        if isinstance(spec, Touching):
            parts = spec.parts(place)
            for i, part in enumerate(parts):
                found.append((name, spec, part, name if len(parts) == 1 else f"{name}/{i + 1}"))
    kinds = list(dict.fromkeys(kind_of(part.row) for _, _, part, _ in found))
    return sorted(found, key=lambda item: kinds.index(kind_of(item[2].row)))


def groups_of(contacts: list[Placed]) -> tuple[tuple[Placed, ...], ...]:
    """Consecutive contact points of one kind as groups."""
    return tuple(tuple(group) for _, group in groupby(contacts, key=lambda c: kind_of(c.row)))


def rims_of_points(contacts: list[Placed]) -> list[float]:
    """Index of the rim of each contact: the first contact on the same rim of a plane or cylinder.

    For a point held by a face it is its own index; -1 for all others.
    """
    rims: dict[Any, float] = {}
    found = []
    for c, placed in enumerate(contacts):
        pair: Any = placed.row.pair  # type: ignore[attr-defined]
        if isinstance(pair, RimOnPlane):
            rim = (placed.body, placed.parent, pair.centre_C, pair.r_A, pair.n_A)
        elif isinstance(pair, RimOnCylinder):
            rim = (placed.body, placed.parent, *pair[:-1])
        elif isinstance(pair, PointOnSolid):
            rim = c
        else:
            rim = None
        if rim is not None:
            found.append(rims.setdefault(rim, float(c)))
        else:
            found.append(-1.0)
    return found


def contact_table_columns(laws: list[ContactLaw], contacts: list[Placed]) -> np.ndarray:
    """The table of contacts at the start: all are open."""
    table = np.zeros((len(laws), CONTACT_TABLE_WIDTH))
    table[:, RIM] = rims_of_points(contacts)
    for c, law in enumerate(laws):
        write_parameters(table[c], law)
        table[c, [NORMAL_SIGN, LEAN_SIGN, LEAN_BEFORE + 6]] = 1.0
    return table


# Check of the initial state against the contact laws: overlaps are moved apart if the scene asks
# for a projection, else refused.


def check_contacts(
    scene: Scene,
    system: ContactBodies,
    y: np.ndarray,
    names: list[str],
    laws: list[ContactLaw],
    t: float,
) -> None:
    """Refuse a start with overlapping bodies or with slip at a perfectly rough contact.

    With `project_initial` overlapping bodies are moved apart instead; y changes in place.
    """
    try:
        with np.errstate(all="ignore"):
            write_rows(system, t, y)
        require_nearest_points(system.contact_table)
    except ZeroDivisionError:
        refuse_middle(scene, system, y, names, t)
        raise
    if scene.simulation.project_initial:
        if not move_apart(system, y, laws, t):
            raise SceneError(
                "contacts contradict each other or the constraints: every state near the initial "
                f"one has an overlap ({names[int(overlaps(system, laws).argmin())]})",
                key="constraints",
                file=scene.file,
            )
        return
    for c in np.argsort(system.contact_table[:, GAP], kind="stable").tolist():  # deepest first
        name = names[c]
        gap = system.contact_table[c, GAP] / system.length
        if not laws[c].compliant and (gap < -MISFIT or (laws[c].bilateral and gap > MISFIT)):
            amount = abs(float(system.contact_table[c, GAP]))
            spec: Any = scene.constraints[name.split("/")[0]]
            string = spec.type == "string"
            what = "stretch" if string else "overlap" if gap < 0.0 else "gap"
            move = system.contact_table[c, GAP] * system.contact_table[c, NORMAL : NORMAL + 3]
            place = in_scene("position", np.array(scene.bodies[spec.body].position) - move)
            problem = f"{what} of {amount:.2g} m at the start"
            refuse_initial(scene, name, problem, f"use {place} for {spec.body}")
        slip = float(np.linalg.norm(system.contact_table[c, SLIP : SLIP + 3])) / system.speed
        if laws[c].static == np.inf and abs(gap) <= MISFIT < slip:
            amount = f"{slip * system.speed:.2g} m/s"
            problem = f"the contact point of this rough contact slips at {amount} at the start"
            refuse_initial(scene, name, problem)


def require_nearest_points(table: np.ndarray) -> None:
    """Raise ZeroDivisionError if the geometry of a contact is not finite: compiled code gives that
    where Python divides by zero."""
    if not np.isfinite(table[:, GAP : POINT + 3]).all():
        raise ZeroDivisionError


def refuse_middle(
    scene: Scene, system: ContactBodies, y: np.ndarray, names: list[str], t: float
) -> None:
    """Raise SceneError if no point of a body that is not round is the nearest to a hollow support:
    its centre of mass is at the centre, or a rim touches all round."""
    for c, placed in enumerate(one for group in system.contacts for one in group):
        try:
            with np.errstate(all="ignore"):
                write_contact(placed, t, system, y, c)
            require_nearest_points(system.contact_table[c : c + 1])
        except ZeroDivisionError:
            name = names[c].split("/")[0]
            body = scene.constraints[name].body
            raise SceneError(
                f"no point of {body} is nearest to the round surface: its center of mass is at the "
                f"centre, or its rim lies all round; change bodies.{body}.position, or tilt the "
                "body, by 0.1 rad say",
                key=f"constraints.{name}",
                file=scene.file,
            ) from None


def move_apart(system: ContactBodies, y: np.ndarray, laws: list[ContactLaw], t: float) -> bool:
    """Move overlapping bodies apart until they touch; y changes in place. False if impossible.

    The displacement is the least one in the mass metric that keeps the joints. The deepest contact
    is held at gap zero, then also the deepest of the others, until none overlaps; velocities at the
    contacts stay unchanged.
    """
    held: list[int] = []
    for _ in range(len(laws) + 1):
        gaps = overlaps(system, laws)
        c = int(gaps.argmin()) if len(gaps) else 0
        if not len(gaps) or gaps[c] >= -COMPUTED_ROUNDING * system.length:
            break
        if c in held:
            return bool(gaps[c] >= -MISFIT * system.length)
        held.append(c)
        system.contact_table[held, CLOSED] = 1.0
        python_of(bring_positions)(system, t, y)
        system.contact_table[held, CLOSED] = 0.0
        write_rows(system, t, y)
    if held:  # project velocities onto the joints in the new positions
        python_of(bring_to_manifold)(system, t, y)
        write_rows(system, t, y)
    return bool(np.isfinite(y).all())


def overlaps(system: ContactBodies, laws: list[ContactLaw]) -> np.ndarray:
    """Gap of each rigid contact that exists [m], 0 for all others, (contacts,)."""
    compliant = np.array([law.compliant for law in laws], dtype=bool)
    counts = ~compliant & (system.contact_table[:, LEAN_SIGN] != ABSENT)
    return np.where(counts, system.contact_table[:, GAP], 0.0)


def compile_contacts(
    scene: Scene,
    place: InitialPlace,
    placed: list[Placed],
    commands: dict[str, tuple[int, ...]],
    breakpoints: tuple[float, ...],
    layout: SampleLayout,
    outputs: list[tuple[str, str, str]],
) -> Compiled:
    """The scene in maximal coordinates with contacts; the last entry of y is the work of the
    contacts.

    Raises SceneError if bodies overlap, or a perfectly rough contact slips, at the start.
    """
    index = {name: i for i, name in enumerate(scene.bodies)}
    parts = parts_of(scene, place, index)
    system = system_of(scene, place, parts, placed, members_of(outputs, parts.owned, scene, index))
    between = Between(scene, place)
    labels = [name for members in between.groups.values() for name in members.values()]
    layout = layout._replace(contacts=(*parts.labels, *labels))
    y = start_of(scene, place)
    names, joints = [name for name, _ in parts.owned], len(parts.joints)
    alone = without_contacts(system, joints)
    scales, indeterminate = start_scales(place, parts.owned[:joints]), ()
    rank, _ = check_maximal(scene, alone, y, names, place.time, scales)
    if rank < system.first_row[joints]:
        indeterminate = undetermined(alone, layout, place.time, y)
        system = without_dependent(system, alone, y)
    check_contacts(scene, system, y, names[joints:], parts.laws, place.time)
    return Compiled(
        system,
        y,
        layout,
        commands,
        breakpoints,
        indeterminate,
        len(system.row_table),
        6 * len(scene.bodies) - rank,
        tuple(parts.laws),
        tuple(parts.boxes.values()),
        tuple(parts.sides.values()),
        scene.simulation.impacts == "one_by_one",
        between if between.groups else None,
    )


def start_of(scene: Scene, place: InitialPlace) -> np.ndarray:
    """The initial coordinates; the last one, the work of the contacts [J], is zero."""
    fields = [np.array(field) for name in scene.bodies for field in place.start(name)]
    return np.concatenate([*fields, [0.0]])


def without_dependent(system: ContactBodies, alone: ContactBodies, y: np.ndarray) -> ContactBodies:
    """The system with the dependent rows of joints marked; alone: the system without its
    contacts."""
    found = dependent_rows(along_parents(alone), y)
    system.row_table[changing_in(along_parents(alone), found), DEPENDENT] += CHANGING
    system.row_table[list(found.rows), DEPENDENT] += AMONG_ROWS
    system.row_table[list(found.positions), DEPENDENT] += AMONG_POSITIONS
    return along_parents(system)


class Parts(NamedTuple):
    """Constraint parts of a scene: joints first, then contact points, in every list."""

    joints: list[Placed]
    contacts: list[Placed]
    owned: list[tuple[str, Any]]
    """(constraint, part) of every joint and contact point."""
    laws: list[ContactLaw]
    labels: list[str]
    """laws and names of the contact points."""
    boxes: dict[str, BoxPair]
    sides: dict[str, Sides]
    """by constraint: box-box pairs, and contacts whose edges may penetrate between the points."""


def parts_of(scene: Scene, place: InitialPlace, index: dict[str, int]) -> Parts:
    """The joints and contact points of a scene; index: of each body by name."""
    parts = Parts([], [], [], [], [], {}, {})
    for name, spec in scene.constraints.items():
        if not isinstance(spec, Touching):
            for part in spec.parts(place):  # type: ignore[attr-defined]
                parts.joints.append(placed_part(spec, part, index))
                parts.owned.append((name, part))
    parts.joints[:] = along_parents_if_close(parts.joints)
    for name, spec, part, label in grouped_contacts(scene, place):
        if name not in parts.boxes and (sizes := box_sizes(spec, place)) is not None:
            parts.boxes[name] = BoxPair(len(parts.contacts), sizes)
        if name not in parts.sides and (found := sides_of(name, spec, part, index, place)):
            parts.sides[name] = found
        parts.contacts.append(placed_part(spec, part, index))
        parts.laws.append(spec.law())
        parts.owned.append((name, part))
        parts.labels.append(label)
    return parts


def system_of(
    scene: Scene, place: InitialPlace, parts: Parts, placed: list[Placed], members: np.ndarray
) -> ContactBodies:
    """The tables of the system with all contacts open; placed: rows of the effects."""
    joints, contacts = parts.joints, parts.contacts
    rows: list[Any] = [c.row for c in contacts]
    counts = [COUNT[type(c.row)] for c in joints] + [contact_rows(row) for row in rows]
    length, speed = contact_scales(
        place, scene, [part for _, part in parts.owned[: len(joints)]], contacts
    )
    n = sum(counts)
    row_table = np.zeros((n, ROW_TABLE_WIDTH), np.int64)
    ends = np.array([(c.body, c.parent) for c in (*joints, *contacts)], np.int64).reshape(-1, 2)
    row_table[:1, MOST_RANK] = n
    row_table[:, :2] = np.repeat(ends, counts, axis=0)
    of_joints = angles([c.row for c in joints])
    row_table[: len(of_joints), ANGLE] = of_joints
    bodies = [place.inertial(name) for name in scene.bodies]
    return ContactBodies(
        bodies=body_table(bodies),
        row_table=row_table,
        rows=np.zeros((n, ROW_WIDTH)),
        delassus=np.zeros((2, n, n)),
        vectors=np.zeros((3, n)),
        first_row=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        members=members,
        anchors=np.zeros((len(parts.owned), 3)),
        length=length,
        speed=speed,
        effects=tuple(placed),
        constraints=tuple(joints),
        contacts=groups_of(contacts),
        contact_table=contact_table_columns(parts.laws, contacts),
        force_rows=np.zeros((n, 12)),
        mass=float(sum(body.mass for body in bodies)),
        velocity_tolerance=SPEED_TOLERANCE * speed,
        creep=0.0,
    )


def without_contacts(system: ContactBodies, joints: int) -> ContactBodies:
    """The system with its joints only: all contacts are open before the start."""
    n = int(system.first_row[joints])
    return system._replace(
        contacts=(),
        row_table=system.row_table[:n].copy(),
        rows=system.rows[:n].copy(),
        delassus=np.zeros((2, n, n)),
        vectors=np.zeros((3, n)),
        first_row=system.first_row[: joints + 1].copy(),
        anchors=system.anchors[:joints].copy(),
        contact_table=system.contact_table[:0].copy(),
        force_rows=system.force_rows[:n].copy(),
    )


def placed_part(spec: Any, part: Any, index: dict[str, int]) -> Placed:
    """A part of a constraint with the indices of its body and parent; -1: the world."""
    parent = getattr(spec, "parent", None)
    return Placed(part.row, index[spec.body], -1 if parent is None else index[parent])


def members_of(
    outputs: list[tuple[str, str, str]],
    owned: list[tuple[str, Any]],
    scene: Scene,
    index: dict[str, int],
) -> np.ndarray:
    """Table of the parts in each reaction, after the part (or -1 - body) that gives its reference
    point.

    A total over several points is taken about C.
    """
    members = np.zeros((len(outputs), 1 + len(owned)), np.int64)
    for o, (_, base, suffix) in enumerate(outputs):
        parts = [
            i for i, (name, part) in enumerate(owned) if name == base and suffix in part.outputs
        ]
        spec = scene.constraints[base]
        several = isinstance(spec, Touching) and len(parts) != 1  # `between` has no parts
        members[o, 0] = -1 - index[spec.body] if several else parts[0]  # type: ignore[attr-defined]
        members[o, [1 + part for part in parts]] = 1
    return members


def contact_scales(
    place: InitialPlace, scene: Scene, joint_parts: list[Any], contacts: list[Placed]
) -> tuple[float, float]:
    """Characteristic length [m] and speed [m/s], from joints, shapes and supports."""
    length, _ = scene_scales(place, joint_parts)
    sizes = [length]
    for body in scene.bodies.values():
        if body.shape is not None:
            sizes.append(float(body.shape.reach))
    for contact in contacts:
        pair: Any = contact.row.pair  # type: ignore[attr-defined]
        sizes += [float(getattr(pair, name, 0.0)) for name in ("radius", "curved")]
        sizes += [norm(pair.r_B)] if hasattr(pair, "r_B") else []
        sizes += [float(getattr(getattr(pair, "surface", None), "reach", 0.0))]
    length = max(sizes)
    states = [place.state(name) for name in scene.bodies]
    speeds = [norm(s.v_WC) + length * norm(s.w_WB_B) for s in states]
    speed = max([*speeds, (9.81 * length) ** 0.5])
    if not isfinite(length * length + speed * speed):
        what = "lengths, speeds or spins are too large: their squares overflow"
        raise SceneError(what, key="bodies", file=scene.file)
    return length, speed
