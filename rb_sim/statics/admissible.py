"""All reactions that balance the loads, as an affine set cut by cones.

Scaled unknowns: forces by the largest load, torques by it times the lever (see `Equilibrium`). With
x = x0 + Z y, Z an orthonormal basis of the states of self-stress (null space of the matrix), every
question about the reactions is a small cone program in y. The margin of an x is the largest s such
that x stays admissible after s has been taken off every tension and normal force: >= 0 says
admissible, and how far from slack, lift-off or slip.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rb_sim.statics.cone_program import Cones, Objective, Optimum, linear, minimise
from rb_sim.statics.equilibrium import Element, Equilibrium

Array = NDArray[np.float64]

RANK_SLACK = 1e-12
"""singular values below this share of the largest count as zero."""
ROUND_OFF = 1e-13
"""imbalance, relative to the largest load, that counts as none."""


LOWEST_FRICTION = 1e-3
"""coefficient of friction below which a contact's margin is measured in friction force."""
FAR = 10.0
"""size of a self-stress, over the largest load, that counts as far out."""


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
    rank = int(np.sum(sigma > max(RANK_SLACK, noise) * sigma.max(initial=0.0)))

    def solve(rhs: Array) -> Array:
        return vt[:rank].T @ ((u[:, :rank].T @ rhs) / sigma[:rank])

    x = solve(-load)
    for _ in range(2):  # iterative refinement: the balance closes to round-off
        x = x - solve(matrix @ x + load)
    motions = u[:, rank:]
    return Reduced(
        force=force,
        unit=force * columns,
        row_unit=force * rows,
        particular=x,
        self_stress=vt[rank:].T,
        motions=motions,
        uncarried=motions @ (motions.T @ load),
        round_off=max(ROUND_OFF, noise),
    )


def _share(element: Element) -> float:
    """Friction force per unit of margin: the coefficient, or LOWEST_FRICTION if that is more.

    So the margin of a rubbing contact is the normal force that it can spare; at coefficients so low
    that this would drown in rounding, it is a friction force of fixed size.
    """
    return max(element.friction, LOWEST_FRICTION)


class AdmissibleSet:
    """{x = x0 + Z y : pulls only, pushes only, within friction}, optionally relaxed.

    relax: scaled force by which every tension and normal force is let off (0: not at all).
    """

    def __init__(self, system: Equilibrium, reduced: Reduced, relax: float = 0.0) -> None:
        self.reduced = reduced
        self.one_way: list[int] = []
        self.cones: list[tuple[Element, slice]] = []
        self.owners: list[str] = []
        for element, column in zip(system.elements, system.columns, strict=True):
            if element.law == "one-way":
                self.one_way.append(column.start)
                self.owners.append(element.name)
        for element, column in zip(system.elements, system.columns, strict=True):
            if element.law == "friction":
                self.cones.append((element, column))
                self.owners.append(element.name)
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
        for row, (element, column) in enumerate(self.cones):
            scale = np.array([element.friction, 1.0, 1.0]) / _share(element)
            soc_h[row] = scale * x[column]
            soc_G[row] = scale[:, None] * z[column]
        soc_h[:, 0] += self.relax
        return Cones(x[self.one_way] + self.relax, z[self.one_way], soc_h, soc_G)

    def slack(self, x: Array) -> Array:
        """How far each one-way or friction support is from giving, scaled force, as `owners`."""
        plain = x[self.one_way]
        round_ = [
            (e.friction * x[c.start] - np.hypot(x[c.start + 1], x[c.start + 2])) / _share(e)
            for e, c in self.cones
        ]
        return np.concatenate([plain, np.array(round_)])

    def at(self, y: Array) -> Array:
        """x of a y."""
        return self.reduced.particular + self.reduced.self_stress @ y

    def widest(self) -> Array:
        """The y of largest margin (capped at one unit of force)."""
        start = np.zeros(self.freedom)
        if not self.owners or self.freedom == 0:
            return start
        lin_h, lin_G, soc_h, soc_G = self.program
        head = np.zeros((len(soc_h), 3, 1))
        head[:, 0] = -1.0
        cap = np.zeros((1, self.freedom + 1))
        cap[0, -1] = -1.0
        cones = Cones(
            np.append(lin_h, 1.0),
            np.vstack([np.hstack([lin_G, -np.ones((len(lin_h), 1))]), cap]),
            soc_h,
            np.concatenate([soc_G, head], axis=2),
        )
        down = np.zeros(self.freedom + 1)
        down[-1] = -1.0
        worst = min(float(self.program.slack(start).min()), 0.0) - 1.0
        best = self._minimise(linear(down), cones, np.append(start, worst))
        return best.y[:-1]

    def near_middle(self, widest: Array) -> Array:
        """A strictly admissible y of moderate size: the shortest with half the largest margin.

        Jammed scenes have admissible states of any size, and `widest` may be far out; programs are
        solved more sharply from nearby.
        """
        if np.linalg.norm(widest) <= FAR:
            return widest
        lin_h, lin_G, soc_h, soc_G = self.program
        half = 0.5 * float(self.program.slack(widest).min(initial=2.0))
        soc_h = soc_h.copy()
        soc_h[:, 0] -= half
        short = Objective(np.eye(self.freedom), np.zeros(self.freedom))
        return self._minimise(short, Cones(lin_h - half, lin_G, soc_h, soc_G), widest).y

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
        self.gap = max(self.gap, best.gap)
        return best

    def fixed(self, row: Array) -> bool:
        """Whether row . x is the same for all solutions of the balance."""
        slope = row @ self.reduced.self_stress
        return bool(np.linalg.norm(slope) <= 1e-11 * np.linalg.norm(row))
