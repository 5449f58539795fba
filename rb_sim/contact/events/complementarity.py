"""Complementarity problems with friction: w = A x + b, each line of x and w bound by its item.

Unilateral: 0 <= x _|_ w >= 0.  Friction: |x_t| <= bound x_n, and x_t = -bound x_n w_t/|w_t| where
w_t is not zero (Coulomb's law; on accelerations, velocities or impulses alike).  Solved as the
equations of Alart and Curnier (1991) by Newton's method with least-squares steps, so that lines
that depend on each other do no harm; sweeps of projected Gauss-Seidel find another start if needed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rb_sim.contact.events.decompositions import least_squares, require_finite
from rb_sim.engine.samples import Array

OF = "the laws of contact"
SOLVED = 1e-12
"""Residual, relative to the size of x, at which a solution counts."""
ROUNDING = 1e-14
"""Of b, relative to the terms that it is the sum of: lines that depend on each other contradict
each other by that much."""
CONTRADICTION = 1e-10
"""Residual, as `SOLVED`, that counts where none is smaller: points that touch to within that of the
scene's length, as those at the ends of a rod that lies, contradict each other by as much."""
NEWTON_STEPS = 60
SWEEPS = 400
SOFTER, PROXIMAL_STEPS = 1e-3, 60
"""Part of a line's own stiffness that a proximal step adds, and the most such steps."""


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
        self.A, self.b, self.normals, self.bounded = A, b, normals, bounded
        n = len(b)
        taken = {item.line for item in normals} | {k for item in bounded for k in item.lines}
        self.equalities = np.array([k for k in range(n) if k not in taken], dtype=int)
        diagonal = np.abs(np.diag(A))
        scale = diagonal.max() if n and diagonal.max() > 0.0 else 1.0
        self.step = 1.0 / np.where(diagonal > 1e-12 * scale, diagonal, scale)
        sizes = np.abs(b) if terms is None else terms
        self.blur = ROUNDING * float(np.abs(self.step * sizes).max(initial=0.0))
        """Residual that is but the rounding of b."""

    def solve(self) -> Solution | None:
        """A solution, or None where Newton's iteration finds none from any of its starts.

        Raises SimulationError where A or b are not finite.
        """
        n = len(self.b)
        if n == 0:
            return Solution(np.zeros(0), np.zeros(0))
        require_finite(OF, self.A, self.b)
        best, least = None, math.inf
        for start in (lambda: np.zeros(n), self._all_holding, self._swept):
            x, excess = self._newton(np.array(start(), dtype=float))
            if excess < least:
                best, least = x, excess
            if least <= SOLVED:
                break
        if not least <= CONTRADICTION and self._pushes_are_given():
            best, least = self._approached(self._swept())
        if best is None or not least <= CONTRADICTION:
            return None
        return Solution(best, self.A @ best + self.b)

    def _all_holding(self) -> Array:
        return least_squares(self.A, -self.b, OF)

    def _pushes_are_given(self) -> bool:
        """True if every bound follows from a force that nothing else changes: then friction is the
        least of a convex function within the bounds, and has a solution always."""
        given = [item.line for item in self.normals]
        alone = np.abs(self.A[given]).sum(axis=1) == np.abs(np.diag(self.A)[given])
        return bool(alone.all()) and all(item.bilateral for item in self.normals)

    def _approached(self, x: Array) -> tuple[Array, float]:
        """As `_newton`, by proximal steps (Rockafellar 1976): each is the problem with what grips a
        little less than rigidly around the x before, whose only solution Newton's method finds."""
        best, least = x, math.inf
        weight = np.diag(SOFTER / self.step)
        for _ in range(PROXIMAL_STEPS):
            softer = Problem(self.A + weight, self.b - weight @ x, self.normals, self.bounded)
            x = softer._newton(x)[0]
            trial, excess = self._newton(x)
            if excess < least:
                best, least = trial, excess
            if least <= SOLVED:
                break
        return best, least

    def _swept(self) -> Array:
        """Projected Gauss-Seidel from zero."""
        x = np.zeros(len(self.b))
        for _ in range(SWEEPS):
            for k in self.equalities:
                x[k] -= self.step[k] * (self.A[k] @ x + self.b[k])
            for item in self.normals:
                k = item.line
                x[k] -= self.step[k] * (self.A[k] @ x + self.b[k])
                if not item.bilateral:
                    x[k] = max(x[k], item.least)
            for item in self.bounded:
                k = list(item.lines)
                z = x[k] - self.step[k].min() * (self.A[k] @ x + self.b[k])
                size, most = float(np.linalg.norm(z)), self._most(item, x)
                x[k] = z if size <= most else z * (most / size)
        return x

    def _most(self, item: Bounded, x: Array) -> float:
        """Bound of the item at x."""
        normal = next(i for i in self.normals if i.line == item.normal)
        push = abs(x[item.normal]) if normal.bilateral else max(0.0, x[item.normal])
        if math.isinf(item.bound):
            return math.inf if push > 0.0 or normal.bilateral else 0.0
        return item.bound * push

    def _equations(self, x: Array) -> tuple[Array, Array]:
        """Residual and its generalised Jacobian."""
        n = len(x)
        w = self.A @ x + self.b
        F, J = np.empty(n), np.zeros((n, n))
        for k in self.equalities:
            F[k], J[k] = self.step[k] * w[k], self.step[k] * self.A[k]
        pushing = {}
        for item in self.normals:
            k = item.line
            holds = item.bilateral or x[k] - item.least - self.step[k] * w[k] > 0.0
            pushing[k] = (item, holds)
            if holds:
                F[k], J[k] = self.step[k] * w[k], self.step[k] * self.A[k]
            else:
                F[k], J[k, k] = x[k] - item.least, 1.0
        for item in self.bounded:
            self._bounded_equations(item, x, w, pushing[item.normal], F, J)
        return F, J

    def _bounded_equations(
        self, item: Bounded, x: Array, w: Array, pushing: tuple[Normal, bool], F: Array, J: Array
    ) -> None:
        k = list(item.lines)
        step = self.step[k].min()
        normal, holds = pushing
        z = x[k] - step * w[k]
        size = float(np.linalg.norm(z))
        if math.isinf(item.bound):
            most = math.inf if holds or normal.least > 0.0 else 0.0
        else:
            most = self._most(item, x)
        if size <= most:
            F[k], J[k] = step * w[k], step * self.A[k]
            return
        F[k] = x[k] - (most / size) * z
        identity = np.eye(len(x))[k]
        unit = z / size
        turned = identity - step * self.A[k]
        J[k] = identity - (most / size) * (turned - np.outer(unit, unit @ turned))
        if most > 0.0:
            J[k, item.normal] -= item.bound * math.copysign(1.0, x[item.normal]) * unit

    def _newton(self, x: Array) -> tuple[Array, float]:
        """(x, its residual relative to the sizes of x) by Newton's iteration, each step halved
        while it does not reduce the residual."""
        F, J = self._equations(x)
        error = float(np.linalg.norm(F))
        for _ in range(NEWTON_STEPS):
            if not math.isfinite(error) or self._relative(error, x) <= SOLVED:
                break
            dx = least_squares(J, -F, OF)
            share = 1.0
            for _ in range(6):
                trial = x + share * dx
                trial_F, trial_J = self._equations(trial)
                trial_error = float(np.linalg.norm(trial_F))
                if trial_error < error:
                    break
                share *= 0.5
            x, F, J, error = trial, trial_F, trial_J, trial_error
        return x, self._relative(error, x)

    def _relative(self, error: float, x: Array) -> float:
        """Residual beyond the rounding of b, relative to the size of x."""
        return max(0.0, error - self.blur) / (1e-3 * self._natural() + float(np.linalg.norm(x)))

    def _natural(self) -> float:
        """Size of x where every line alone would hold."""
        return float(np.abs(self.step * self.b).max()) + 1e-300
