"""Complementarity problems with friction: w = A x + b, each line of x and w bound by its item.

Unilateral: 0 <= x _|_ w >= 0.  Friction: |x_t| <= bound x_n, and x_t = -bound x_n w_t/|w_t| where
w_t is not zero (Coulomb's law; on accelerations, velocities or impulses alike).  Solved by Newton's
iteration on the equations of Alart and Curnier (see active_set).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from copy import copy
from typing import NamedTuple

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


class Normal(NamedTuple):
    """One normal line: pushes only, with x >= least; or holds both ways if `bilateral`."""

    line: int
    bilateral: bool = False
    least: float = 0.0


class Bounded(NamedTuple):
    """Lines whose |x| is at most bound |x_normal|; bound inf: they hold where the normal pushes."""

    lines: tuple[int, ...]
    normal: int
    bound: float


class Solution(NamedTuple):
    """x and w = A x + b."""

    x: Array
    w: Array


class Items(NamedTuple):
    """The items of a problem of n lines, as tables."""

    rules: Array
    """of each line, (n,)."""
    least: Array
    """least x of each line that pushes, (n,)."""
    bounds: Array
    """lines and normal of each of m bounds, see active_set; (m, BOUND_WIDTH)."""
    limits: Array
    """(m,)."""


def items_of(n: int, normals: Iterable[Normal], bounded: Sequence[Bounded]) -> Items:
    """Lines in no item are equalities w = 0."""
    items = Items(
        np.full(n, HOLDS), np.zeros(n),
        np.full((len(bounded), BOUND_WIDTH), -1), np.empty(len(bounded)),
    )  # fmt: skip
    for i, bound in enumerate(bounded):
        items.bounds[i, : len(bound.lines)] = bound.lines
        items.bounds[i, PUSH], items.limits[i] = bound.normal, bound.bound
        for k in bound.lines:
            items.rules[k] = RUBS
    for normal in normals:
        items.rules[normal.line] = HOLDS if normal.bilateral else PUSHES
        items.least[normal.line] = normal.least
    return items


class Problem:
    """min-free form of the problem.

    A: (n, n), b: (n,); terms: sizes of what b has been summed from, (n,), b itself if left out.
    """

    def __init__(self, A: Array, b: Array, items: Items, terms: Array | None = None) -> None:
        self.A, self.b, self.items = np.ascontiguousarray(A), b, items
        self.terms = b if terms is None else terms

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
        rules, least, bounds, limits = self.items
        return float(
            run(
                self.A, self.b, self.terms, rules, least, bounds.reshape(-1), limits, x,
                np.empty(room_of(len(x))), starts, SOLVED,
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
        rules, lowest, bounds, limits = self.items
        sweep(self.A, self.b, rules, lowest, bounds.reshape(-1), limits, at, step)
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
