"""Scenes with contacts, compiled: joints first, then every point of contact."""

from __future__ import annotations

from itertools import groupby
from math import isfinite
from typing import Any

import numpy as np

from rb_sim.catalogue.constraints.rows import COUNT, ROW_WIDTH
from rb_sim.catalogue.types import Placed
from rb_sim.contact.geometry.rims import RimOnPlane
from rb_sim.contact.geometry.rims_on_cylinders import RimOnCylinder
from rb_sim.contact.scene.contact import Contact
from rb_sim.contact.scene.sides import Sides, sides_of
from rb_sim.contact.scene.surfaces import BodySurface
from rb_sim.contact.scene.touching import ContactLaw, Touching, contact_lines
from rb_sim.contact.start import check_contacts
from rb_sim.contact.system import lines as _registers_its_kernels  # noqa: F401
from rb_sim.contact.system.bodies import (
    AMONG_LINES,
    AMONG_POSITIONS,
    DEPENDENT,
    LINE_WIDTH,
    STOPPED,
    ContactBodies,
)
from rb_sim.contact.system.touch import (
    BILATERAL,
    COMPLIANT,
    DRAGS,
    KINETIC,
    LEAN_BEFORE,
    RESTITUTION,
    RIM,
    ROLLING_ARM,
    SENSE,
    SIDE,
    SPINNING_ARM,
    STATIC,
    TOUCH_WIDTH,
)
from rb_sim.engine.manifold import dependent_lines
from rb_sim.engine.samples import SampleLayout
from rb_sim.engine.systems.multibody import body_table
from rb_sim.errors import SceneError
from rb_sim.maths.vectors import norm
from rb_sim.scene.compiled import BoxPair, Compiled
from rb_sim.scene.dependent import undetermined
from rb_sim.scene.initial import check_maximal
from rb_sim.scene.place import InitialPlace
from rb_sim.scene.scales import scene_scales
from rb_sim.scene.schema import Scene


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
    joints, contacts, laws, labels = [], [], [], []
    boxes: dict[str, BoxPair] = {}
    sides: dict[str, Sides] = {}
    owned = []
    for name, spec in scene.constraints.items():
        if not isinstance(spec, Touching):
            for part in spec.parts(place):  # type: ignore[attr-defined]
                joints.append(placed_part(spec, part, index))
                owned.append((name, part))
    for name, spec, part, label in grouped_contacts(scene, place):
        if name not in boxes and (sizes := box_sizes(spec, place)) is not None:
            boxes[name] = BoxPair(len(contacts), sizes)
        if name not in sides and (found := sides_of(name, spec, part, index, place)) is not None:
            sides[name] = found
        contacts.append(placed_part(spec, part, index))
        laws.append(spec.law())
        owned.append((name, part))
        labels.append(label)
    layout = layout._replace(contacts=tuple(labels))
    counts = [COUNT[type(c.row)] for c in joints] + [contact_lines(c.row) for c in contacts]
    length, speed = contact_scales(
        place, scene, [part for _, part in owned[: len(joints)]], contacts
    )
    n, parts = sum(counts), len(owned)
    lines = np.zeros((n, LINE_WIDTH), np.int64)
    for column, values in enumerate(
        ([c.body for c in (*joints, *contacts)], [c.parent for c in (*joints, *contacts)])
    ):
        lines[:, column] = np.repeat(np.array(values, np.int64), counts)
    bodies = [place.inertial(name) for name in scene.bodies]
    system = ContactBodies(
        bodies=body_table(bodies),
        lines=lines,
        rows=np.zeros((n, ROW_WIDTH)),
        square=np.zeros((2, n, n)),
        vectors=np.zeros((3, n)),
        first_row=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        members=members_of(outputs, owned, scene, index),
        anchors=np.zeros((parts, 3)),
        length=length,
        speed=speed,
        effects=tuple(placed),
        constraints=tuple(joints),
        contacts=groups_of(contacts),
        touch=touch_table(laws, contacts),
        pushes=np.zeros((n, 12)),
        mass=float(sum(body.mass for body in bodies)),
        still=STOPPED * speed,
    )
    y = np.concatenate(
        [np.concatenate([np.array(f) for f in place.start(name)]) for name in scene.bodies]
        + [[0.0]]
    )
    names = [name for name, _ in owned]
    alone = without_contacts(system, len(joints))
    rank, _ = check_maximal(scene, alone, y, names, place.time)
    redundant = rank < system.first_row[len(joints)]
    indeterminate = undetermined(alone, layout, place.time, y) if redundant else ()
    if redundant:
        left_out = dependent_lines(alone, y)  # type: ignore[arg-type]  # its tables are the same
        system.lines[list(left_out.lines), DEPENDENT] += AMONG_LINES
        system.lines[list(left_out.positions), DEPENDENT] += AMONG_POSITIONS
    check_contacts(scene, system, y, names[len(joints) :], laws, place.time)
    return Compiled(
        system,
        y,
        layout,
        commands,
        breakpoints,
        indeterminate,
        n,
        6 * len(bodies) - rank,
        tuple(laws),
        tuple(boxes.values()),
        tuple(sides.values()),
        scene.simulation.impacts == "one_by_one",
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


def box_sizes(spec: Touching, place: InitialPlace) -> list[float] | None:
    """Centre and half edges of both boxes of a contact of a box with a box; None of others."""
    if not isinstance(spec, Contact) or not isinstance(spec.surface, BodySurface):
        return None
    if spec.points is not None:
        return None
    sizes: list[float] = []
    for name in (spec.body, spec.parent):
        shape = place.shape(name)  # type: ignore[arg-type]
        if shape is None or shape.type != "box":
            return None
        sizes += [*place.from_com(name, shape.center_B), *(0.5 * edge for edge in shape.size)]
    return sizes


def kind_of(row: Any) -> str:
    """What decides the compiled code of a point of contact."""
    classes = (row.pair, getattr(row.pair, "surface", None), row.friction, row.resistance)
    names = [type(field).__name__ for field in (*classes, row.carrier)]
    return " ".join([*names, str(len(row.spring))])


def grouped_contacts(scene: Scene, place: InitialPlace) -> list[tuple[str, Touching, Any, str]]:
    """(constraint, spec, part, name of the point), those of one kind one after the other."""
    found = []
    for name, spec in scene.constraints.items():
        if isinstance(spec, Touching):
            parts = spec.parts(place)
            for i, part in enumerate(parts):
                found.append((name, spec, part, name if len(parts) == 1 else f"{name}/{i + 1}"))
    kinds = list(dict.fromkeys(kind_of(part.row) for _, _, part, _ in found))
    return sorted(found, key=lambda item: kinds.index(kind_of(item[2].row)))


def groups_of(contacts: list[Placed]) -> tuple[tuple[Placed, ...], ...]:
    """Neighbours of one kind together."""
    return tuple(tuple(group) for _, group in groupby(contacts, key=lambda c: kind_of(c.row)))


def rims_of_points(contacts: list[Placed]) -> list[float]:
    """For each contact the first that is a point of the same rim on a plane or a cylinder; -1 for
    others."""
    rims: dict[Any, float] = {}
    found = []
    for c, placed in enumerate(contacts):
        pair: Any = placed.row.pair  # type: ignore[attr-defined]
        if isinstance(pair, RimOnPlane):
            rim = (placed.body, placed.parent, pair.centre_C, pair.r_A, pair.n_A)
        elif isinstance(pair, RimOnCylinder):
            rim = (placed.body, placed.parent, *pair[:-1])
        else:
            rim = None
        if rim is not None:
            found.append(rims.setdefault(rim, float(c)))
        else:
            found.append(-1.0)
    return found


def touch_table(laws: list[ContactLaw], contacts: list[Placed]) -> np.ndarray:
    """The table of contacts at the start: all open."""
    touch = np.zeros((len(laws), TOUCH_WIDTH))
    touch[:, RIM] = rims_of_points(contacts)
    for c, law in enumerate(laws):
        touch[c, [STATIC, ROLLING_ARM, SPINNING_ARM]] = (
            law.static,
            law.rolling_arm,
            law.spinning_arm,
        )
        touch[c, [RESTITUTION, KINETIC, DRAGS]] = law.restitution, law.kinetic, law.drags
        touch[c, [BILATERAL, COMPLIANT, SIDE]] = law.bilateral, law.compliant, 1.0
        touch[c, [SENSE, LEAN_BEFORE + 6]] = 1.0
    return touch


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
        several = isinstance(spec, Touching) and len(parts) > 1
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
    if not isfinite(length + speed):
        what = "lengths, speeds or spins are so large that their squares overflow"
        raise SceneError(what, key="bodies", file=scene.file)
    return length, speed
