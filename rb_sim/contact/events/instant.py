"""The contacts of a system at one instant: what impacts and the choice of modes look at."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rb_sim.contact.events.decompositions import pseudo_inverse
from rb_sim.contact.events.dense import (
    LINES,
    Call,
    Interpreted,
    Lines,
    inverse_mass,
    room_for_lines,
    set_velocities,
    velocities,
)
from rb_sim.contact.geometry.rims_on_cylinders import ABSENT
from rb_sim.contact.scene.touching import ContactLaw
from rb_sim.contact.system.bodies import HELD, ContactBodies
from rb_sim.contact.system.touch import GAP, NORMAL, SENSE, SLIP, TURN
from rb_sim.engine.samples import Array
from rb_sim.engine.systems.many_bodies import WIDTH
from rb_sim.maths.vectors import perpendicular

TOUCHING = 1e-10
"""Gap, relative to the scene's length, at which surfaces touch."""
STILL = 1e-10
"""Speed, relative to the scene's, that is none: of approach, of slip, of turning."""


class Instant:
    """The contacts of a system at (t, y); y and the table of contacts are changed in place.

    Raises SimulationError where no modes or impulses satisfy the laws.
    """

    def __init__(
        self,
        system: ContactBodies,
        laws: Sequence[ContactLaw],
        call: Call,
        t: float,
        y: Array,
        inverse: Array | None = None,
        forms: dict[Any, Any] | None = None,
    ) -> None:
        """inverse: M^-1, where it is known already; forms: what instants of these laws share."""
        self.system, self.laws, self.t, self.y = system, laws, t, y
        self.call = call
        self.compiled = not isinstance(call, Interpreted)
        self.inverse_mass = inverse_mass(system) if inverse is None else inverse
        self.forms: dict[Any, Any] = {} if forms is None else forms
        """What follows from the laws alone, by what it is asked for."""
        self.still = STILL * system.speed
        """Speed that is none [m/s]."""
        self.first: list[int] = system.first_row[system.joints :].tolist()
        """First line of each contact; all before that of contact 0 are the joints'."""
        self.lines: Lines = room_for_lines(system)
        self.refresh()

    def refresh(self) -> None:
        """Write the lines again, after y or the modes have changed."""
        self.call(LINES, self.t, self.y, self.lines)
        self._touching: list[int] | None = None

    def rigid(self, c: int) -> bool:
        return not self.laws[c].compliant

    def touching(self) -> list[int]:
        """Rigid contacts whose surfaces touch."""
        if self._touching is None:
            touch, near = self.system.touch, TOUCHING * self.system.length
            columns = zip(self.laws, touch[:, SENSE].tolist(), touch[:, GAP].tolist(), strict=True)
            self._touching = [
                c
                for c, (law, sense, gap) in enumerate(columns)
                if not law.compliant and sense != ABSENT and (gap <= near or law.bilateral)
            ]
        return self._touching

    def slip_speed(self, c: int) -> float:
        return math.hypot(*self.system.touch[c, SLIP : SLIP + 3].tolist())

    def turning(self, c: int) -> tuple[float, float]:
        """Relative angular speed across and along the normal [rad/s]."""
        turn, n = self.system.touch[c, TURN : TURN + 3], self.system.touch[c, NORMAL : NORMAL + 3]
        about = float(turn @ n)
        return float(np.linalg.norm(turn - about * n)), about

    def apply(self, x: Array) -> None:
        """Add the impulses x to the velocities, and their work to that of the contacts."""
        u = velocities(self.system, self.y)
        p = self.lines.J.T @ x
        du = self.inverse_mass @ p
        set_velocities(self.system, self.y, u + du)
        self.y[WIDTH * self.system.bodies.shape[0]] += float(p @ (u + 0.5 * du))
        self.refresh()

    def taken_by_joints(self, rows: Array) -> Array:
        """Minus the impulses on the joints' lines per unit of impulse along each of `rows`, (joint
        lines, rows)."""
        held = self.lines.J[: self.first[0]]
        if not len(held):
            return np.zeros((0, len(rows)))
        A = held @ self.inverse_mass @ held.T
        of = f"the impulses on the joints at t = {self.t:.9g} s"
        return pseudo_inverse(A, of) @ held @ self.inverse_mass @ rows.T

    def pivot_of(self, rows: Array, pushes: Array) -> Array:
        """Velocities along `rows` per unit of impulse along each of `pushes`, joints holding."""
        held = self.lines.J[: self.first[0]]
        return rows @ self.inverse_mass @ (pushes.T - held.T @ self.taken_by_joints(pushes))

    def effective_pivot(self, c: int) -> float:
        """n . M^-1 (n + T/N) over n . M^-1 n, joints holding, for the slip that contact c has."""
        speed, law = self.slip_speed(c), self.laws[c]
        if speed <= self.still or not 0.0 < law.kinetic < math.inf:
            return 1.0
        k = self.first[c]
        J = self.lines.J
        n = self.system.touch[c, NORMAL : NORMAL + 3]
        t1, t2 = frame(n)
        d = self.system.touch[c, SLIP : SLIP + 3] / speed
        push = J[k] - law.kinetic * (float(d @ t1) * J[k + 1] + float(d @ t2) * J[k + 2])
        alone = float(J[k] @ self.inverse_mass @ J[k])
        ideal, effective = self.pivot_of(J[[k]], np.array([J[k], push]))[0]
        return float(effective / ideal) if ideal > HELD * alone else 1.0


def frame(n: Array) -> tuple[Array, Array]:
    """The tangents that the kernels use."""
    t1, t2 = perpendicular(tuple(float(x) for x in n))
    return np.array(t1), np.array(t2)
