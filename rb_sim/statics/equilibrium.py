# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The equilibrium of every body as one linear system in the reactions (LL 38.1).

    matrix @ x + load = 0,    x admissible

Six rows per body: sum of forces (world axes) and sum of torques about the body's pole (world axes).
A support contributes columns: the wrench it puts on its body per unit of each of its unknowns, and
the opposite force at its other end on the parent. Unknowns are tensions and forces [N] and the
torques of hinges with an axis and of welds [N m].
"""

from __future__ import annotations

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
    """|x[tails]| <= coefficient N, N the push x[0], or `push` where that is given."""

    motion: Literal["slips", "rolls", "spins"]
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


# All reactions that balance the loads, as an affine set cut by cones.
#
# Scaled unknowns: forces by the largest load, torques by it times the lever (see `Equilibrium`).
# With x = x0 + Z y, Z an orthonormal basis of the states of self-stress (null space of the matrix),
# every question about the reactions is a small cone program in y. The margin of an x is the largest
# s such that x stays admissible after s has been taken off every tension and normal force: >= 0
# says admissible, and how far from slack, lift-off or slip.


LOWEST_FRICTION = 1e-3
"""coefficient of friction below which a contact's margin is measured in friction force."""


class Reduced(NamedTuple):
    """The scaled system after elimination of the balance equations.

    u unknowns, r rows, k = u - rank.
    """

    force: float
    """unit of force [N]: the largest load (force, or torque over lever); 1 without loads."""
    unit: Array
    """SI value of one scaled unknown, (u,)."""
    row_unit: Array
    """SI value of one scaled row, (r,)."""
    particular: Array
    """x0: the shortest scaled solution in the least-squares sense, (u,)."""
    self_stress: Array
    """Z, (u, k)."""
    motions: Array
    """orthonormal virtual motions that no support resists (scaled rows), (r, r - rank)."""
    uncarried: Array
    """part of the scaled load along those motions: what no reaction can balance, (r,)."""
    round_off: float
    """imbalance (scaled) that rounding explains."""


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
    for _ in range(2):  # iterative refinement: the balance closes to round-off
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
    """|x[tails]| <= coefficient x[head] + constant, scaled."""

    element: Element
    bound: Bound
    coefficient: float
    constant: float
    head: int | None
    tails: list[int]


def cones_of(system: Equilibrium, force: float) -> list[Cone]:
    """The bounds of all elements, scaled: arms are over the lever where torques are."""
    found = []
    for element, column in zip(system.elements, system.columns, strict=True):
        for bound in element.bounds:
            tails = [column.start + k for k in bound.tails]
            unit = system.lever if system.is_torque[tails[0]] else 1.0
            coefficient, head, constant = bound.coefficient / unit, column.start, 0.0
            if bound.push is not None:
                head, constant = None, coefficient * bound.push / force
            found.append(Cone(element, bound, coefficient, constant, head, tails))
    return found


def _share(cone: Cone) -> float:
    """Friction force per unit of margin: the coefficient, or LOWEST_FRICTION if that is more.

    So the margin of a rubbing contact is the normal force that it can spare; at coefficients so low
    that this would drown in rounding, it is a friction force of fixed size.
    """
    return max(cone.coefficient, LOWEST_FRICTION)


class AdmissibleSet:
    """{x = x0 + Z y : pulls only, pushes only, within friction}, optionally relaxed.

    relax: scaled force by which every tension and normal force is let off (0: not at all).
    """

    def __init__(self, system: Equilibrium, reduced: Reduced, relax: float = 0.0) -> None:
        self.reduced = reduced
        self.one_way: list[int] = []
        self.owners: list[tuple[str, Bound | None]] = []
        """element of each inequality, and which of its bounds it is."""
        for element, column in zip(system.elements, system.columns, strict=True):
            if element.law == "one-way" and not element.bounds:  # a bound says it, too
                self.one_way.append(column.start)
                self.owners.append((element.name, None))
        self.cones = cones_of(system, reduced.force)
        self.owners += [(cone.element.name, cone.bound) for cone in self.cones]
        self.relax = relax
        self.gap = 0.0
        """largest bound of the error of an optimum so far, scaled force."""
        self._found: dict[tuple[float, ...], Optimum] = {}

    @property
    def freedom(self) -> int:
        """k: dimension of the states of self-stress."""
        return self.reduced.self_stress.shape[1]

    @cached_property
    def program(self) -> Cones:
        """The cones on y; heads and tails are measured as normal forces (see `_share`)."""
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
        """How far each one-way or friction support is from giving, scaled force, as `owners`."""
        plain = x[self.one_way]
        round_ = []
        for cone in self.cones:
            push = 0.0 if cone.head is None else cone.coefficient * x[cone.head]
            across = float(np.linalg.norm(x[cone.tails]))
            round_.append((cone.constant + push - across) / _share(cone))
        return np.concatenate([plain, np.array(round_)])

    def at(self, y: Array) -> Array:
        """x of a y."""
        return self.reduced.particular + self.reduced.self_stress @ y

    def widest(self) -> Array:
        """The y of largest margin (capped at one unit of force)."""
        return self._noted(widest(self.program))

    def near_middle(self, y: Array) -> Array:
        """A strictly admissible y of moderate size, from which programs are solved more sharply."""
        return self._noted(moderate(self.program, y))

    def shortest(self, inside: Array) -> Array:
        """x of least Euclidean norm in SI units (N and N m); `inside`: a strictly admissible y."""
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
        """Minimum of row . x over the set; -inf when unbounded."""
        slope = row @ self.reduced.self_stress
        slope = slope / np.linalg.norm(slope)
        key = tuple(np.round(slope, 12) + 0.0)  # the two ends of a support ask the same
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
