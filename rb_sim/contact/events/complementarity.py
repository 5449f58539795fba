"""Complementarity problems with friction: w = A x + b, each line of x and w bound by its item.

Unilateral: 0 <= x _|_ w >= 0.  Friction: |x_t| <= bound x_n, and x_t = -bound x_n w_t/|w_t| where
w_t is not zero (Coulomb's law; on accelerations, velocities or impulses alike).  Solved by Newton's
iteration on the equations of Alart and Curnier (see active_set).
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass

import numpy as np

from rb_sim.contact.events import active_set
from rb_sim.contact.events.active_set import BOUND_WIDTH, HOLDS, PUSH, PUSHES, RUBS, room_of
from rb_sim.contact.events.decompositions import require_finite
from rb_sim.engine.samples import Array
from rb_sim.maths.jit import python_of

OF = "the laws of contact"
SOLVED = 1e-12
"""Residual, relative to the size of x, at which a solution counts."""
STARTS = 3
"""Of Newton's iteration: zero, where all lines hold, and what sweeps give."""
SOFTER, PROXIMAL_STEPS = 1e-3, 60
"""Part of a line's own stiffness that a proximal step adds, and the most such steps."""
CONTRADICTION = 1e-10
"""Residual, as `SOLVED`, that counts where none is smaller: points that touch to within that of the
scene's length, as those at the ends of a rod that lies, contradict each other by as much."""


@dataclass(frozen=True)
class Normal:
    """One normal line: pushes only, with x >= least; or holds both ways if `bilateral`."""

    line: int
    bilateral: bool = False
    least: float = 0.0


@dataclass(frozen=True)
class Bounded:
    """Lines whose |x| is at most bound |x_normal|; bound inf: they hold where the normal pushes."""

    lines: tuple[int, ...]
    normal: int
    bound: float


@dataclass(frozen=True)
class Solution:
    """x and w = A x + b."""

    x: Array
    w: Array


class Problem:
    """min-free form of the problem; lines in no item are equalities w = 0.

    A: (n, n), b: (n,); terms: sizes of what b has been summed from, (n,), b itself if left out.
    """

    def __init__(
        self,
        A: Array,
        b: Array,
        normals: list[Normal],
        bounded: list[Bounded],
        terms: Array | None = None,
    ) -> None:
        self.A, self.b = np.ascontiguousarray(A), b
        self.terms = b if terms is None else terms
        self.normals = normals
        n, m = len(b), len(bounded)
        self.rules, self.least = np.full(n, HOLDS), np.zeros(n)
        self.bounds, self.limits = np.full((m, BOUND_WIDTH), -1), np.empty(m)
        for i, item in enumerate(bounded):
            self.bounds[i, : len(item.lines)] = item.lines
            self.bounds[i, PUSH], self.limits[i] = item.normal, item.bound
            for k in item.lines:
                self.rules[k] = RUBS
        for item in normals:
            self.rules[item.line] = HOLDS if item.bilateral else PUSHES
            self.least[item.line] = item.least

    def solve(self, compiled: bool = True) -> Solution | None:
        """A solution, or None where Newton's iteration finds none from any of its starts.

        Raises SimulationError where A or b are not finite.
        """
        x = np.zeros(len(self.b))
        if len(x):
            require_finite(OF, self.A, self.b)
            residual = self._from(x, STARTS, compiled)
            if not residual <= CONTRADICTION:
                residual = self._approach(x, compiled)
            if not residual <= CONTRADICTION:
                return None
        return Solution(x, self.A @ x + self.b)

    def _from(self, x: Array, starts: int, compiled: bool) -> float:
        """Into x the solution from so many starts, the first of which is x; gives its residual."""
        run = active_set.solve if compiled else python_of(active_set.solve)
        return float(
            run(
                self.A, self.b, self.terms, self.rules, self.least, self.bounds.reshape(-1),
                self.limits, x, np.empty(room_of(len(x))), starts, SOLVED,
            )
        )  # fmt: skip

    def _approach(self, x: Array, compiled: bool) -> float:
        """As `_from`, by proximal steps from where sweeps come to (Rockafellar 1976): each is the
        problem with what grips a little less than rigidly around the x before, whose solution
        Newton's method finds.

        Where friction follows from forces that nothing else changes it is the least of a convex
        function, and they always end; where pushes change with it, mostly."""
        at, step, least = np.zeros(len(x)), np.empty(len(x)), math.inf
        sweep = active_set.swept if compiled else python_of(active_set.swept)
        items = self.rules, self.least, self.bounds.reshape(-1), self.limits
        sweep(self.A, self.b, *items, at, step)
        for _ in range(PROXIMAL_STEPS):
            weight = SOFTER / step
            softer = copy(self)
            softer.A, softer.b = self.A + np.diag(weight), self.b - weight * at
            softer.terms = softer.b
            softer._from(at, 1, compiled)
            trial = at.copy()
            residual = self._from(trial, 1, compiled)
            if residual < least:
                least, x[:] = residual, trial
            if least <= SOLVED:
                break
        return least
