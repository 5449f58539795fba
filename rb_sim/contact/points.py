"""The points of contact of a scene, those of one kind side by side, and the table of them."""

from __future__ import annotations

from itertools import groupby
from typing import Any

import numpy as np

from rb_sim.catalogue.types import Placed
from rb_sim.contact.geometry.points_on_solids import PointOnSolid
from rb_sim.contact.geometry.rims import RimOnPlane
from rb_sim.contact.geometry.rims_on_cylinders import RimOnCylinder
from rb_sim.contact.scene.touching import ContactLaw, Touching
from rb_sim.contact.system.touch import (
    BILATERAL,
    COMPLIANT,
    DRAGS,
    KINETIC,
    LEAN_BEFORE,
    PER_SLIP,
    RESTITUTION,
    RIM,
    ROLLING_ARM,
    ROUNDED,
    SENSE,
    SIDE,
    SPINNING_ARM,
    STATIC,
    TOUCH_WIDTH,
)
from rb_sim.scene.place import InitialPlace
from rb_sim.scene.schema import Scene


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
    """For each contact the first that is a point of the same rim on a plane or a cylinder, or
    itself where a face holds it; -1 for others."""
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
        touch[c, [PER_SLIP, ROUNDED]] = law.per_slip, law.rounded
        touch[c, [BILATERAL, COMPLIANT, SIDE]] = law.bilateral, law.compliant, 1.0
        touch[c, [SENSE, LEAN_BEFORE + 6]] = 1.0
    return touch
