# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Equilibrium of all bodies as one linear system in the reactions (LL 38.1).

    matrix @ x + load = 0,    x admissible

Six rows per body: sum of forces and sum of torques about the body's pole, world axes. A support
contributes columns: the wrench on its body per unit of each of its unknowns, and the opposite force
at its other end on the parent. Unknowns are tensions and forces [N], and torques of hinges with an
axis and of welds [N m].
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.numerics.cone_program import (
    Cones,
    Objective,
    Optimum,
    linear,
    minimise,
    moderate,
    widest,
)
from rb_sim.numerics.rank import LEAST_SINGULAR, split

Array = NDArray[np.float64]
Law = Literal["two-way", "one-way"]


class Bound(NamedTuple):
    """x[tails]| <= coefficient N, with N = x[0], or `normal_force` if that is given."""

    motion: Literal["slips", "rolls", "spins"]
    """motion if the bound is exceeded."""
    coefficient: float
    """of friction, or the arm of a rolling or spinning resistance [m]."""
    tails: tuple[int, ...]
    """one or two unknowns of the element."""
    normal_force: float | None = None
    """normal force [N] of a compliant support, given by its penetration depth."""


@dataclass(frozen=True)
class Element:
    """One support at its position in the world, with m unknowns."""

    name: str
    kind: str
    body: str
    parent: str | None
    anchor_W: Array
    """point of application on the body, world [m], (3,)."""
    parent_anchor_W: Array
    """point of application on the parent; differs from anchor_W for strings and rods, (3,)."""
    force_W: Array
    """force on the body per unknown, (3, m)."""
    torque_W: Array
    """torque on the body about anchor_W per unknown, (3, m)."""
    law: Law
    """two-way: any x; one-way: x[0] >= 0; `bounds` apply in addition."""
    friction: float = 0.0
    bounds: tuple[Bound, ...] = ()
    given_W: Array = field(default_factory=lambda: np.zeros(3))
    """force on the body independent of the unknowns, (3,)."""
    normal_W: Array | None = None
    """normal of a contact whose normal force is not an unknown, (3,)."""

    @property
    def size(self) -> int:
        """Number of unknowns m."""
        return self.force_W.shape[1]

    @property
    def has_friction(self) -> bool:
        """Whether it is a contact with friction."""
        return self.direction is not None and self.friction > 0.0

    @property
    def direction(self) -> Array | None:
        """Unit vector of the first unknown: a contact's normal, a string's or rod's line; (3,)."""
        if self.normal_W is not None:
            return self.normal_W
        return self.force_W[:, 0] if self.kind in ("contact", "string", "rod") else None


def tangents(normal: Array) -> tuple[Array, Array]:
    """Two unit vectors perpendicular to a unit normal, right-handed with it."""
    away = np.zeros(3)
    away[np.argmin(np.abs(normal))] = 1.0
    first = np.cross(normal, away)
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)


@dataclass(frozen=True)
class Equilibrium:
    """The linear system, and the origin of its rows and columns. n bodies, u unknowns."""

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
    """wrench of the loads alone, without `given_W` of the elements, (n, 6)."""
    is_torque: Array
    """mask of the unknowns that are torques, (u,)."""
    lever: float
    """largest distance of a point of application from its body's pole [m]; 1 if all are zero."""
    reach: float
    """largest distance of a point of application from the world origin [m]."""
    centres: Array
    """centres of mass, world [m], (n, 3)."""
    apart: tuple[str, ...] = ()
    """contacts whose surfaces do not touch, which carry no load."""

    def load_about_centres(self) -> Array:
        """Active loads with torques about the centres of mass, (n, 6) [N, N m]."""
        total = self.active.copy()
        total[:, 3:] += np.cross(self.poles - self.centres, total[:, :3])
        return total


def points_of_application(
    bodies: tuple[str, ...],
    centres: Array,
    elements: Iterable[Element],
    pushed: Iterable[tuple[str, Array]] = (),
) -> dict[str, list[Array]]:
    """Points at which elements and loads act on each body, its centre first, world [m].

    centres: of mass, world [m], (n, 3). pushed: body and point of each force that acts at a point.
    """
    points = {body: [centre] for body, centre in zip(bodies, centres, strict=True)}
    for body, point in pushed:
        points[body].append(point)
    for element in elements:
        points[element.body].append(element.anchor_W)
        if element.parent is not None:
            points[element.parent].append(element.parent_anchor_W)
    return points


def poles_of(bodies: tuple[str, ...], points: dict[str, list[Array]]) -> Array:
    """Mean of the points of application on each body, world [m], (n, 3)."""
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

    points: points of application on each body, world [m]; their mean is its pole. loads: active
    wrench on each body about its pole, (n, 6) [N, N m].
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
    """Add the element's wrench on its body, and the opposite one on its parent."""
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


# Reactions that balance the loads: an affine set intersected with cones.
#
# Scaled unknowns: forces relative to the largest load, torques to it times the lever (see
# `Equilibrium`). With x = x0 + Z y, Z an orthonormal basis of the states of self-stress (null space
# of the matrix), every question about the reactions is a small cone program in y. The margin of x
# is the largest s that can be subtracted from every tension and normal force such that x remains
# admissible: x is admissible if it is >= 0, and it measures the distance from slack, lift-off or
# slip.


LOWEST_FRICTION = 1e-3
"""Coefficient of friction below which a contact's margin is measured as friction force."""


class Reduced(NamedTuple):
    """The scaled system without the balance equations: u unknowns, r rows, k = u - rank."""

    force: float
    """unit of force [N]: the largest load (force, or torque over lever); 1 without loads."""
    unit: Array
    """SI value of one scaled unknown, (u,)."""
    row_unit: Array
    """SI value of one scaled row, (r,)."""
    particular: Array
    """x0: minimum-norm scaled least-squares solution, (u,)."""
    self_stress: Array
    """Z, (u, k)."""
    motions: Array
    """orthonormal virtual motions that no support resists (scaled rows), (r, r - rank)."""
    uncarried: Array
    """component of the scaled load along those motions, which no reaction can balance, (r,)."""
    round_off: float
    """scaled imbalance due to rounding."""


def eliminate(system: Equilibrium) -> Reduced:
    """Scale the system and eliminate the balance equations by a singular value decomposition."""
    rows = np.tile(np.repeat([1.0, system.lever], 3), len(system.bodies))
    force = float(np.abs(system.load / rows).max(initial=0.0)) or 1.0
    columns = np.where(system.is_torque, system.lever, 1.0)
    matrix = system.matrix / rows[:, None] * columns
    load = system.load / rows / force
    u, sigma, vt = np.linalg.svd(matrix, full_matrices=True)
    noise = 8.0 * float(np.finfo(float).eps) * (1.0 + system.reach / system.lever)
    found = split(u, sigma, vt, max(LEAST_SINGULAR, noise))
    x = found.least(-load)
    for _ in range(2):  # iterative refinement of the balance to rounding
        x = x - found.least(matrix @ x + load)
    motions = u[:, found.rank :]
    return Reduced(
        force=force,
        unit=force * columns,
        row_unit=force * rows,
        particular=x,
        self_stress=found.null,
        motions=motions,
        uncarried=motions @ (motions.T @ load),
        round_off=max(COMPUTED_ROUNDING, noise),
    )


class Cone(NamedTuple):
    """x[tails]| <= coefficient x[head] + constant, scaled."""

    element: Element
    bound: Bound
    coefficient: float
    constant: float
    head: int | None
    tails: list[int]


def cones_of(system: Equilibrium, force: float) -> list[Cone]:
    """Bounds of all elements, scaled; arms relative to the lever if the tails are torques."""
    found = []
    for element, column in zip(system.elements, system.columns, strict=True):
        for bound in element.bounds:
            tails = [column.start + k for k in bound.tails]
            unit = system.lever if system.is_torque[tails[0]] else 1.0
            coefficient, head, constant = bound.coefficient / unit, column.start, 0.0
            if bound.normal_force is not None:
                head, constant = None, coefficient * bound.normal_force / force
            found.append(Cone(element, bound, coefficient, constant, head, tails))
    return found


def _share(cone: Cone) -> float:
    """Friction force per unit of margin: the coefficient, but at least LOWEST_FRICTION.

    So the margin of a frictional contact is its spare normal force; for very low coefficients,
    where that would be lost in rounding, it is a friction force of fixed scale.
    """
    return max(cone.coefficient, LOWEST_FRICTION)


class AdmissibleSet:
    """{x = x0 + Z y : tensions and normal forces >= 0, within friction}, optionally relaxed.

    relax: scaled force by which every tension and normal force may violate its bound (0: none).
    """

    def __init__(self, system: Equilibrium, reduced: Reduced, relax: float = 0.0) -> None:
        self.reduced = reduced
        self.one_way: list[int] = []
        self.owners: list[tuple[str, Bound | None]] = []
        """element of each inequality, and its bound (None: the one-way condition)."""
        for element, column in zip(system.elements, system.columns, strict=True):
            if element.law == "one-way" and not element.bounds:  # implied by a bound
                self.one_way.append(column.start)
                self.owners.append((element.name, None))
        self.cones = cones_of(system, reduced.force)
        self.owners += [(cone.element.name, cone.bound) for cone in self.cones]
        self.relax = relax
        self.gap = 0.0
        """largest error bound of an optimum so far, scaled force."""
        self._found: dict[tuple[float, ...], Optimum] = {}

    @property
    def freedom(self) -> int:
        """k: dimension of the space of states of self-stress."""
        return self.reduced.self_stress.shape[1]

    @cached_property
    def program(self) -> Cones:
        """The cones in y; heads and tails are scaled to normal forces (see `_share`)."""
        x, z = self.reduced.particular, self.reduced.self_stress
        soc_h = np.zeros((len(self.cones), 3))
        soc_G = np.zeros((len(self.cones), 3, self.freedom))
        for row, cone in enumerate(self.cones):
            share = _share(cone)
            soc_h[row, 0] = cone.constant / share
            if cone.head is not None:
                soc_h[row, 0] += cone.coefficient / share * x[cone.head]
                soc_G[row, 0] = cone.coefficient / share * z[cone.head]
            last = 1 + len(cone.tails)
            soc_h[row, 1:last] = x[cone.tails] / share
            soc_G[row, 1:last] = z[cone.tails] / share
        soc_h[:, 0] += self.relax
        return Cones(x[self.one_way] + self.relax, z[self.one_way], soc_h, soc_G)

    def slack(self, x: Array) -> Array:
        """Distance of each support in `owners` from its bound, scaled force."""
        plain = x[self.one_way]
        round_ = []
        for cone in self.cones:
            normal_force = 0.0 if cone.head is None else cone.coefficient * x[cone.head]
            across = float(np.linalg.norm(x[cone.tails]))
            round_.append((cone.constant + normal_force - across) / _share(cone))
        return np.concatenate([plain, np.array(round_)])

    def at(self, y: Array) -> Array:
        """x for a given y."""
        return self.reduced.particular + self.reduced.self_stress @ y

    def widest(self) -> Array:
        """The y with the largest margin (at most one unit of force)."""
        return self._noted(widest(self.program))

    def near_middle(self, y: Array) -> Array:
        """A strictly admissible y of moderate size, as a better start of cone programs."""
        return self._noted(moderate(self.program, y))

    def shortest(self, inside: Array) -> Array:
        """The x of minimum norm in SI units (N and N m). inside: a strictly admissible y."""
        if self.freedom == 0:
            return self.reduced.particular
        weight = self.reduced.unit / self.reduced.force
        stress = weight[:, None] * self.reduced.self_stress
        offset = weight * self.reduced.particular
        free = np.asarray(np.linalg.lstsq(stress, -offset, rcond=None)[0], dtype=float)
        if self.program.slack(free).min(initial=0.0) >= -1e-14:
            return self.at(free)
        size = max(1.0, float(np.abs(stress).max()))
        objective = Objective(stress / size, stress.T @ offset / size**2)
        return self.at(self._minimise(objective, self.program, inside).y)

    def least(self, row: Array, inside: Array) -> float:
        """Minimum of row . x over the set; -inf if unbounded. inside: a strictly admissible y."""
        slope = row @ self.reduced.self_stress
        slope = slope / np.linalg.norm(slope)
        key = tuple(np.round(slope, 12) + 0.0)  # shared by the two ends of a support
        if key not in self._found:
            self._found[key] = self._minimise(linear(slope), self.program, inside)
        best = self._found[key]
        return float(row @ self.at(best.y)) if best.bounded else -np.inf

    def _minimise(self, objective: Objective, cones: Cones, start: Array) -> Optimum:
        best = minimise(objective, cones, start)
        self._noted(best)
        return best

    def _noted(self, best: Optimum) -> Array:
        self.gap = max(self.gap, best.gap)
        return best.y

    def fixed(self, row: Array) -> bool:
        """Whether row . x is the same for all solutions of the balance."""
        slope = row @ self.reduced.self_stress
        return bool(np.linalg.norm(slope) <= 1e-11 * np.linalg.norm(row))
