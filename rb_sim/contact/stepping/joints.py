"""The joints of a scene under time stepping: their lines, and the way back to their manifold.

Both are laws compiled for the scene, as those of scenes without contacts.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

import numpy as np

from rb_sim.catalogue.constraints.rows import ROW_WIDTH
from rb_sim.contact.system.bodies import AMONG_LINES, AMONG_POSITIONS, DEPENDENT
from rb_sim.engine.independent import Dependent
from rb_sim.engine.laws import Compiled
from rb_sim.engine.multibody_laws import MultiBodyLaws
from rb_sim.engine.samples import Array
from rb_sim.engine.systems.many_bodies import LINE_COLUMNS, MULTIPLIERS, MultiBody
from rb_sim.engine.systems.multipliers import write_rows
from rb_sim.graph.machine import evaluate_rows
from rb_sim.loops.manifold import LOST, correct_positions, position_error, return_to_positions


class Joints:
    """The lines of the constraints of a system that are no contacts.

    system: these alone, as MultiBody, with tables of its own.
    """

    def __init__(self, system: Any) -> None:
        count = int(system.first_row[len(system.constraints)])
        self.system = joint_system(system, count)
        flags = system.lines[:count, DEPENDENT]
        left_out = (
            frozenset(np.flatnonzero(flags & among).tolist())
            for among in (AMONG_LINES, AMONG_POSITIONS)
        )
        self.laws = MultiBodyLaws(self.system, 0, bool(flags.any()), (), Dependent(*left_out))
        self._inputs = np.array([*self.laws.inputs.values(self.system, 0.0), 0.0])

    @cached_property
    def _written(self) -> Compiled:
        """The law of the lines."""

        def kernel(system: MultiBody, t: Any, y: list[Any]) -> list[Any]:
            write_rows(system, t, y)
            return list(system.rows.ravel())

        return self.laws.traced(kernel)

    def rows(self, t: float, y: Array) -> Array:
        """The lines at (t, y), shape (n, ROW_WIDTH)."""
        n = self.system.lines.shape[0]
        return self.value(self._written, t, y, n * ROW_WIDTH).reshape(n, ROW_WIDTH)

    @cached_property
    def _hastened(self) -> Compiled:
        """The law of admissible velocities: y, then the impulse of each line that gives them."""

        def kernel(system: MultiBody, t: Any, y: list[Any]) -> list[Any]:
            return [*self.laws.hastened(system, t, y), *system.vectors[MULTIPLIERS]]

        return self.laws.traced(kernel)

    def settle(self, t: float, y: Array) -> Array:
        """y with unit quaternions and on the manifold, in place: position first, then velocity.

        Returns the impulse of each line that brings the velocities there [N s].  A state from which
        the manifold is out of reach (the step was absurd) becomes NaN.
        """
        laws, length = self.laws, self.system.length
        at = y[: laws.n]
        at[:] = self.value(laws.settle, t, y, laws.n)
        if not return_to_positions(self, t, at, length, 0.0)[0] <= LOST * length:
            at[0] = math.nan
        found = self.value(self._hastened, t, y, laws.n + len(self.system.lines))
        at[:] = found[: laws.n]
        return found[laws.n :]

    def value(self, law: Any, t: float, y: Array, count: int) -> Array:
        """What the law gives at (t, y), so many numbers."""
        out = np.zeros((1, count))
        state = np.ascontiguousarray(y[None, : self.laws.n])
        evaluate_rows(law, np.array([t]), state, self._inputs, out)
        return out[0]


@position_error.register(Joints)
def error_of_joints(way: Joints, t: float, y: Array) -> tuple[float, None]:
    return float(way.value(way.laws.gap, t, y, 1)[0]), None


@correct_positions.register(Joints)
def correct_joints(way: Joints, t: float, y: Array, lines: None) -> None:
    y[:] = way.value(way.laws.position, t, y, way.laws.n)


def joint_system(system: Any, rows: int) -> MultiBody:
    """The system of the joints alone, with room of its own."""
    joints = len(system.constraints)
    return MultiBody(
        bodies=system.bodies.copy(),
        lines=system.lines[:rows, :LINE_COLUMNS].copy(),
        rows=np.zeros((rows, system.rows.shape[1])),
        square=np.zeros((2, rows, rows)),
        vectors=np.zeros((2, rows)),
        first_row=system.first_row[: joints + 1].copy(),
        members=system.members[:, : 1 + joints].copy(),
        anchors=np.zeros((joints, 3)),
        length=system.length,
        speed=system.speed,
        effects=(),
        constraints=system.constraints,
    )
