"""Bodies whose sides may sink into a support that they touch with corners or ends alone."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rb_sim.catalogue.types import Place
from rb_sim.contact.geometry.pairs import BallOnCylinder, BallOnSolid
from rb_sim.contact.geometry.solids import Box, Cylinder
from rb_sim.contact.scene.surfaces import SOLIDS


class Sides(NamedTuple):
    """Edges of one body that may cross a support without a corner in it, and the reverse."""

    name: str
    """of the constraint."""
    body: int
    parent: int
    """-1: the world."""
    edges: np.ndarray
    """ends in body coordinates from C, shape (k, 2, 3)."""
    support: NamedTuple
    """Box, Cylinder or BallOnCylinder, in the parent's coordinates from C."""
    motion: NamedTuple
    """of a support in the world."""
    own: NamedTuple | None
    """the body's box, which corners and rims of the support may enter; None of a rod."""


def edges_of_box(box: Box) -> np.ndarray:
    """Shape (12, 2, 3)."""
    signs = np.array(list(np.ndindex(2, 2, 2))) * 2.0 - 1.0
    corners = np.array(box.centre) + signs * np.array(box.half)
    pairs = [
        (i, j) for i in range(8) for j in range(i) if np.sum(signs[i] != signs[j]) == 1
    ]  # neighbours differ in one sign
    return np.array([[corners[i], corners[j]] for i, j in pairs])


def support_of_pair(pair: Any) -> NamedTuple | None:
    """The support of a corner or an end where sides may sink in; None of others."""
    if isinstance(pair, BallOnSolid) and isinstance(pair.surface, Box | Cylinder):
        return pair.surface
    return pair if isinstance(pair, BallOnCylinder) and pair.side > 0.0 else None


def sides_of(name: str, spec: Any, part: Any, index: dict[str, int], place: Place) -> Any:
    """The Sides of a contact of a box or a rod, None of others; part: its first point."""
    support = support_of_pair(part.row.pair)
    if support is None or spec.points is not None:
        return None
    shape: Any = place.shape(spec.body)
    if shape.type not in ("box", "rod"):
        return None
    solid: Any = SOLIDS[shape.type](place.from_com(spec.body, shape.center_B), shape)
    own, end = None, solid.end if shape.type == "rod" else None
    if end is None:
        own, edges = solid, edges_of_box(solid)
    else:
        edges = np.array([[end, np.array(end) + solid.length * np.array(solid.axis)]])
    parent = -1 if spec.parent is None else index[spec.parent]
    return Sides(name, index[spec.body], parent, edges, support, part.row.carrier, own)
