"""Scenes with contacts, compiled: joints first, then every point of contact."""

from __future__ import annotations

from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from rb_sim.catalogue.constraints.rows import COUNT, ROW_WIDTH
from rb_sim.catalogue.types import Placed
from rb_sim.contact.between import Between, box_sizes
from rb_sim.contact.points import grouped_contacts, groups_of, touch_table
from rb_sim.contact.scene.sides import Sides, sides_of
from rb_sim.contact.scene.touching import ContactLaw, Touching, contact_lines
from rb_sim.contact.start import check_contacts
from rb_sim.contact.system import lines as _registers_its_kernels  # noqa: F401
from rb_sim.contact.system.bodies import (
    AMONG_LINES,
    AMONG_POSITIONS,
    CHANGING,
    DEPENDENT,
    LINE_WIDTH,
    MOST_RANK,
    STOPPED,
    ContactBodies,
)
from rb_sim.engine.manifold import changing_in, dependent_lines
from rb_sim.engine.samples import SampleLayout
from rb_sim.engine.systems.many_bodies import ANGLE, angles
from rb_sim.engine.systems.multibody import body_table
from rb_sim.errors import SceneError
from rb_sim.maths.vectors import norm
from rb_sim.scene.compiled import BoxPair, Compiled
from rb_sim.scene.dependent import undetermined
from rb_sim.scene.initial import check_maximal
from rb_sim.scene.place import InitialPlace
from rb_sim.scene.scales import scene_scales, start_scales
from rb_sim.scene.schema import Scene
from rb_sim.scene.seats import along_parents, along_parents_if_close


def compile_contacts(
    scene: Scene,
    place: InitialPlace,
    placed: list[Placed],
    commands: dict[str, tuple[int, ...]],
    breakpoints: tuple[float, ...],
    layout: SampleLayout,
    outputs: list[tuple[str, str, str]],
) -> Compiled:
    """The scene in maximal coordinates with contacts; y ends with their work.

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
        len(system.lines),
        6 * len(scene.bodies) - rank,
        tuple(parts.laws),
        tuple(parts.boxes.values()),
        tuple(parts.sides.values()),
        scene.simulation.impacts == "one_by_one",
        between if between.groups else None,
    )


def start_of(scene: Scene, place: InitialPlace) -> np.ndarray:
    """The coordinates at the start; no work is done yet."""
    fields = [np.array(field) for name in scene.bodies for field in place.start(name)]
    return np.concatenate([*fields, [0.0]])


def without_dependent(system: ContactBodies, alone: ContactBodies, y: np.ndarray) -> ContactBodies:
    """The system with those lines of joints marked that follow from others; alone: the system
    without its contacts."""
    found = dependent_lines(along_parents(alone), y)
    system.lines[changing_in(along_parents(alone), found), DEPENDENT] += CHANGING
    system.lines[list(found.lines), DEPENDENT] += AMONG_LINES
    system.lines[list(found.positions), DEPENDENT] += AMONG_POSITIONS
    return along_parents(system)


class Parts(NamedTuple):
    """What holds the bodies: joints first, then the points of contact, each list in that order."""

    joints: list[Placed]
    contacts: list[Placed]
    owned: list[tuple[str, Any]]
    """(constraint, part of it) of every joint and point."""
    laws: list[ContactLaw]
    labels: list[str]
    """laws and names of the points."""
    boxes: dict[str, BoxPair]
    sides: dict[str, Sides]
    """of the constraints that are a pair of boxes, or have sides that points may sink into."""


def parts_of(scene: Scene, place: InitialPlace, index: dict[str, int]) -> Parts:
    """The joints and contacts of a scene; index: of the bodies."""
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
    """The tables of the system, all contacts open; placed: effects."""
    joints, contacts = parts.joints, parts.contacts
    rows: list[Any] = [c.row for c in contacts]
    counts = [COUNT[type(c.row)] for c in joints] + [contact_lines(row) for row in rows]
    length, speed = contact_scales(
        place, scene, [part for _, part in parts.owned[: len(joints)]], contacts
    )
    n = sum(counts)
    lines = np.zeros((n, LINE_WIDTH), np.int64)
    ends = np.array([(c.body, c.parent) for c in (*joints, *contacts)], np.int64).reshape(-1, 2)
    lines[:1, MOST_RANK] = n
    lines[:, :2] = np.repeat(ends, counts, axis=0)
    of_joints = angles([c.row for c in joints])
    lines[: len(of_joints), ANGLE] = of_joints
    bodies = [place.inertial(name) for name in scene.bodies]
    return ContactBodies(
        bodies=body_table(bodies),
        lines=lines,
        rows=np.zeros((n, ROW_WIDTH)),
        square=np.zeros((2, n, n)),
        vectors=np.zeros((3, n)),
        first_row=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        members=members,
        anchors=np.zeros((len(parts.owned), 3)),
        length=length,
        speed=speed,
        effects=tuple(placed),
        constraints=tuple(joints),
        contacts=groups_of(contacts),
        touch=touch_table(parts.laws, contacts),
        pushes=np.zeros((n, 12)),
        mass=float(sum(body.mass for body in bodies)),
        still=STOPPED * speed,
        creep=0.0,
    )


def without_contacts(system: ContactBodies, joints: int) -> ContactBodies:
    """The system with its joints alone: before the start all contacts are open and have no say."""
    n = int(system.first_row[joints])
    return system._replace(
        contacts=(),
        lines=system.lines[:n].copy(),
        rows=system.rows[:n].copy(),
        square=np.zeros((2, n, n)),
        vectors=np.zeros((3, n)),
        first_row=system.first_row[: joints + 1].copy(),
        anchors=system.anchors[:joints].copy(),
        touch=system.touch[:0].copy(),
        pushes=system.pushes[:n].copy(),
    )


def placed_part(spec: Any, part: Any, index: dict[str, int]) -> Placed:
    parent = getattr(spec, "parent", None)
    return Placed(part.row, index[spec.body], -1 if parent is None else index[parent])


def members_of(
    outputs: list[tuple[str, str, str]],
    owned: list[tuple[str, Any]],
    scene: Scene,
    index: dict[str, int],
) -> np.ndarray:
    """Which parts count in each reaction; a total over several points is taken about C."""
    members = np.zeros((len(outputs), 1 + len(owned)), np.int64)
    for o, (_, base, suffix) in enumerate(outputs):
        parts = [
            i for i, (name, part) in enumerate(owned) if name == base and suffix in part.outputs
        ]
        spec = scene.constraints[base]
        several = isinstance(spec, Touching) and len(parts) != 1  # none: see contact.between
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
        what = "lengths, speeds or spins are so large that their squares overflow"
        raise SceneError(what, key="bodies", file=scene.file)
    return length, speed
