"""The equilibrium of every body as one linear system in the reactions (LL 38.1).

    matrix @ x + load = 0,    x admissible

Six rows per body: sum of forces (world axes) and sum of torques about the body's pole (world axes).
A support contributes columns: the wrench it puts on its body per unit of each of its unknowns, and
the opposite force at its other end on the parent. Unknowns are tensions and forces [N] and the
torques of hinges with an axis and of welds [N m].
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Law = Literal["two-way", "one-way"]


class Bound(NamedTuple):
    """|x[tails]| <= coefficient N, N the push x[0], or `push` where that is given."""

    gives: Literal["slips", "rolls", "spins"]
    """what happens beyond it."""
    coefficient: float
    """of friction, or the arm of a resistance to turning [m]."""
    tails: tuple[int, ...]
    """one or two unknowns of the element."""
    push: float | None = None
    """[N], of a support that gives way: its depth says how hard it pushes."""


@dataclass(frozen=True)
class Element:
    """One support placed in the world, m unknowns."""

    name: str
    kind: str
    body: str
    parent: str | None
    anchor_W: Array
    """where it acts on the body, world [m], (3,)."""
    parent_anchor_W: Array
    """where it acts on the parent; differs from anchor_W for strings and rods, (3,)."""
    force_W: Array
    """force on the body per unknown, (3, m)."""
    torque_W: Array
    """torque on the body about anchor_W per unknown, (3, m)."""
    law: Law
    """two-way: any x; one-way: x[0] >= 0; its bounds hold besides."""
    friction: float = 0.0
    bounds: tuple[Bound, ...] = ()
    given_W: Array = field(default_factory=lambda: np.zeros(3))
    """force on the body whatever the unknowns are, (3,)."""
    normal_W: Array | None = None
    """of a contact without unknowns along it, (3,)."""

    @property
    def size(self) -> int:
        """m."""
        return self.force_W.shape[1]

    @property
    def rubs(self) -> bool:
        """Whether it is a contact with friction."""
        return self.direction is not None and self.friction > 0.0

    @property
    def direction(self) -> Array | None:
        """Unit vector of the first unknown: a contact's normal, a string's or rod's line; (3,)."""
        if self.normal_W is not None:
            return self.normal_W
        return self.force_W[:, 0] if self.kind in ("contact", "string", "rod") else None


def tangents(normal: Array) -> tuple[Array, Array]:
    """Two unit vectors across a unit normal, right-handed with it."""
    away = np.zeros(3)
    away[np.argmin(np.abs(normal))] = 1.0
    first = np.cross(normal, away)
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)


@dataclass(frozen=True)
class Equilibrium:
    """The linear system and where its rows and columns come from. n bodies, u unknowns."""

    bodies: tuple[str, ...]
    elements: tuple[Element, ...]
    columns: tuple[slice, ...]
    """columns of each element."""
    poles: Array
    """point about which a body's torques are summed, world [m], (n, 3)."""
    matrix: Array
    """(6 n, u): three force rows, then three torque rows, body after body."""
    load: Array
    """active wrench on each body, force [N] and torque about its pole [N m], (6 n,)."""
    active: Array
    """the same of the loads alone, without what elements exert whatever their unknowns, (n, 6)."""
    is_torque: Array
    """unknowns that are torques, bool (u,)."""
    lever: float
    """largest distance of a point of application from its body's pole [m]; 1 if all are zero."""
    reach: float
    """largest distance of a point of application from the world origin [m]."""
    centres: Array
    """of mass, world [m], (n, 3)."""
    apart: tuple[str, ...] = ()
    """contacts whose surfaces do not touch: they hold nothing."""

    def load_about_centres(self) -> Array:
        """The active loads with their torques about the centres of mass, (n, 6) [N, N m]."""
        total = self.active.copy()
        total[:, 3:] += np.cross(self.poles - self.centres, total[:, :3])
        return total


def poles_of(bodies: tuple[str, ...], points: dict[str, list[Array]]) -> Array:
    """The mean of the points of application on each body, world [m], (n, 3)."""
    return np.array([np.mean(points[name], axis=0) for name in bodies]).reshape(-1, 3)


def put_together(
    bodies: tuple[str, ...],
    elements: tuple[Element, ...],
    points: dict[str, list[Array]],
    loads: Array,
    centres: Array,
    apart: tuple[str, ...] = (),
) -> Equilibrium:
    """The system of elements and loads.

    points: where something acts on each body, world [m]; their mean is its pole.
    loads: active wrench on each body about its pole, (n, 6) [N, N m].
    """
    poles = poles_of(bodies, points)
    ends = np.cumsum([0, *(element.size for element in elements)])
    columns = tuple(slice(int(a), int(b)) for a, b in zip(ends[:-1], ends[1:], strict=True))
    matrix = np.zeros((6 * len(bodies), int(ends[-1])))
    is_torque = np.zeros(int(ends[-1]), dtype=bool)
    active, loads = loads, loads.copy()
    for element, column in zip(elements, columns, strict=True):
        is_torque[column] = ~element.force_W.any(axis=0)
        add_end(matrix, loads, column, element, bodies, poles)
    levers = [
        float(np.linalg.norm(point - pole))
        for name, pole in zip(bodies, poles, strict=True)
        for point in points[name]
    ]
    lever = max(levers, default=0.0)
    reach = max((float(np.linalg.norm(p)) for at in points.values() for p in at), default=0.0)
    return Equilibrium(
        bodies=bodies,
        elements=elements,
        columns=columns,
        poles=poles,
        matrix=matrix,
        load=loads.ravel(),
        active=active,
        is_torque=is_torque,
        lever=lever if lever > 0.0 else 1.0,
        reach=reach,
        centres=centres,
        apart=apart,
    )


def add_end(
    matrix: Array,
    loads: Array,
    column: slice,
    element: Element,
    bodies: tuple[str, ...],
    poles: Array,
) -> None:
    """Add the element's wrench on its body and the opposite one on its parent."""
    for name, anchor, sign in (
        (element.body, element.anchor_W, 1.0),
        (element.parent, element.parent_anchor_W, -1.0),
    ):
        if name is not None:
            row = bodies.index(name)
            lever = anchor - poles[row]
            turning = element.torque_W + np.cross(lever, element.force_W, axisb=0, axisc=0)
            matrix[6 * row : 6 * row + 3, column] += sign * element.force_W
            matrix[6 * row + 3 : 6 * row + 6, column] += sign * turning
            loads[row, :3] += sign * element.given_W
            loads[row, 3:] += sign * np.cross(lever, element.given_W)
