"""Contacts and strings of an ordinary scene, at rest: what each point may push and rub."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rb_sim.catalogue.types import BodyState
from rb_sim.contact.compile import box_sizes
from rb_sim.contact.geometry.boxes import box_points
from rb_sim.contact.geometry.pairs import touching
from rb_sim.contact.scene.touching import ContactLaw, Touching
from rb_sim.maths.vectors import add, rotate
from rb_sim.scene.place import InitialPlace
from rb_sim.statics.element import Bound, Element
from rb_sim.statics.supports import tangents

Array = NDArray[np.float64]

TOUCHES = 1e-9
"""Gap, relative to the scene's length, at which surfaces touch: poses in files are rounded."""


class Standing(NamedTuple):
    """One contact of a scene at its initial pose."""

    place: InitialPlace
    name: str
    spec: Touching
    B: BodyState
    A: BodyState
    """of the parent, or of the world."""
    length: float
    """of the scene [m]."""


class Found(NamedTuple):
    """Its points."""

    closed: list[Element]
    apart: list[str]


class Point(NamedTuple):
    """A point of contact in the world."""

    at: Array
    normal: Array
    """into the body."""
    gap: float


def touching_elements(standing: Standing) -> Found:
    """An element for each point that touches; the names of those that do not.

    Raises ValueError for a bilateral contact with Coulomb friction: N may pull there.
    """
    law = standing.spec.law()
    bounded = 0.0 < law.static < math.inf or law.rolling_arm > 0.0 or law.spinning_arm > 0.0
    if law.bilateral and bounded:
        raise ValueError(
            "statics takes a bilateral contact smooth or rough, not with friction that N bounds"
        )
    points = list(points_of(standing))
    near = TOUCHES * standing.length
    closed, apart = [], []
    for i, point in enumerate(points):
        name = standing.name if len(points) == 1 else f"{standing.name}/{i + 1}"
        if point.gap > (0.0 if law.compliant else near) and not law.bilateral:
            apart.append(name)
        else:
            closed.append(element_of(name, standing, law, point))
    return Found(closed, apart)


def points_of(standing: Standing) -> Iterator[Point]:
    """Where it touches, or would; of a box on a box the corners of what both faces share."""
    spec, B, A = standing.spec, standing.B, standing.A
    boxes = box_sizes(spec, standing.place)
    if boxes is not None:
        yield from points_of_boxes(boxes, B, A)
        return
    for part in spec.parts(standing.place):
        found = touching(part.row.pair, B, A)  # type: ignore[attr-defined]
        yield Point(np.array(found.point, float), np.array(found.normal, float), float(found.gap))


def points_of_boxes(sizes: list[float], B: BodyState, A: BodyState) -> Iterator[Point]:
    """sizes: centre from C and half edges of the body's box, then of the parent's [m]."""
    half_B, half_A = tuple(sizes[3:6]), tuple(sizes[9:])
    centre_B = add(B.p_WC, rotate(B.q_WB, tuple(sizes[:3])))
    centre_A = add(A.p_WC, rotate(A.q_WB, tuple(sizes[6:9])))
    points, normal = box_points(A.q_WB, centre_A, half_A, B.q_WB, centre_B, half_B, math.inf)
    for x, y, z, gap in points:
        yield Point(np.array([x, y, z]), normal, float(gap))


def element_of(name: str, standing: Standing, law: ContactLaw, point: Point) -> Element:
    """What one point that touches may exert."""
    spec, normal = standing.spec, point.normal
    depth = max(-point.gap, 0.0)
    push = law.spring[0] * depth if law.compliant else None
    rubs = law.static > 0.0
    forces = [] if law.compliant else [normal]
    forces += [*tangents(normal)] if rubs else []
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
        bounds=bounds_of(law, push),
        given_W=np.zeros(3) if push is None else push * normal,
        normal_W=None if push is None else normal,
    )


def bounds_of(law: ContactLaw, push: float | None) -> tuple[Bound, ...]:
    """What its normal force bounds; unknowns: N (where it is one), two tangents, the torques."""
    found: list[Bound] = []
    k = 0 if law.compliant else 1
    if law.static > 0.0:
        if law.static < math.inf:
            found.append(Bound("slips", law.static, (k, k + 1), push))
        k += 2
    if law.rolling_arm > 0.0:
        found.append(Bound("rolls", law.rolling_arm, (k, k + 1), push))
        k += 2
    if law.spinning_arm > 0.0:
        found.append(Bound("spins", law.spinning_arm, (k,), push))
    return tuple(found)
