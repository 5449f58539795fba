# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Small convex programs over half-spaces and friction cones, solved to round-off.

    minimise  1/2 |root y|^2 + c.y   over  y with  a_i(y) >= 0  and  |tail_j(y)| <= head_j(y),

where a = lin_h + lin_G y and (head, tail) = soc_h + soc_G y (second-order cones of dimension 3).

Method: the primal barrier  t (objective) - sum log a_i - sum log(head_j^2 - |tail_j|^2)  is
minimised by Newton steps for growing t (Nesterov & Nemirovskii 1994; Boyd & Vandenberghe 2004,
section 11.3), which needs a strictly feasible start but no further assumption; then the boundary
pieces that are active are read off and the optimality conditions on them are solved by Newton's
method, which takes the error from the barrier's 1e-12 to round-off. A ball |y| <= radius keeps
every problem bounded; it is widened until it no longer matters or the answer is called unbounded.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rb_sim.base.rounding import COMPUTED_ROUNDING, WRITTEN_ROUNDING

# Half-spaces and second-order cones for a vector y, and the objective.


Array = NDArray[np.float64]

MIRROR = np.array([1.0, -1.0, -1.0])
"""Diagonal of the quadratic form head^2 - |tail|^2."""


class Cones(NamedTuple):
    """The admissible set of p half-spaces and q cones for k unknowns."""

    lin_h: Array
    """constants of the half-spaces, (p,)."""
    lin_G: Array
    """coefficients of the half-spaces, (p, k)."""
    soc_h: Array
    """constants of the cones, (q, 3), [head, tail, tail]."""
    soc_G: Array
    """coefficients of the cones, (q, 3, k)."""

    @property
    def soc_rows(self) -> Array:
        """soc_G as one matrix, (3 q, k)."""
        return self.soc_G.reshape(-1, self.soc_G.shape[2])

    def at(self, y: Array) -> tuple[Array, Array]:
        """Values (p,) of the half-spaces and (q, 3) of the cones."""
        return self.lin_h + self.lin_G @ y, self.soc_h + self.soc_G @ y

    def slack(self, y: Array) -> Array:
        """a_i and head_j - |tail_j|, shape (p + q,); y is admissible if all are >= 0."""
        lin, soc = self.at(y)
        return np.concatenate([lin, soc[:, 0] - np.hypot(soc[:, 1], soc[:, 2])])

    def admits(self, y: Array) -> bool:
        """Whether y satisfies all bounds up to rounding."""
        least = -COMPUTED_ROUNDING * (1.0 + float(np.linalg.norm(y)))
        return bool(self.slack(y).min(initial=np.inf) >= least)


class Objective(NamedTuple):
    """The objective 1/2 |root y|^2 + c.y."""

    root: Array
    """root, (m, k); (0, k) for a linear objective."""
    c: Array
    """coefficients of the linear term, (k,)."""

    def slope(self, y: Array) -> Array:
        """Gradient, (k,)."""
        return self.root.T @ (self.root @ y) + self.c


def linear(c: Array) -> Objective:
    """The objective c.y."""
    return Objective(np.zeros((0, len(c))), c)


def lorentz_form(soc: Array) -> Array:
    """head^2 - |tail|^2 without cancellation, (q,)."""
    tail = np.hypot(soc[:, 1], soc[:, 2])
    return (soc[:, 0] - tail) * (soc[:, 0] + tail)


# Last digits of the solution of a cone program: Newton's method on the active boundary pieces.


class Active(NamedTuple):
    """Active boundary pieces with multipliers: planes (half-spaces, cone tips), round cones."""

    plane_h: Array
    plane_G: Array
    round_h: Array
    round_G: Array
    multipliers: Array


def read_active(cones: Cones, y: Array, weight: float) -> Active:
    """The active pieces at the end of the path, where either slack or multiplier is large."""
    threshold = 1.0 / np.sqrt(weight)
    lin, soc = cones.at(y)
    lin_force = 1.0 / (weight * lin)
    soc_force = 2.0 * MIRROR * soc / (weight * lorentz_form(soc))[:, None]
    on = lin_force > threshold
    pressed = soc_force[:, 0] > threshold
    tip = pressed & (soc[:, 0] < threshold)
    rim = pressed & ~tip
    k = len(y)
    return Active(
        np.concatenate([cones.lin_h[on], cones.soc_h[tip].ravel()]),
        np.concatenate([cones.lin_G[on], cones.soc_G[tip].reshape(-1, k)]),
        cones.soc_h[rim],
        cones.soc_G[rim],
        np.concatenate(
            [lin_force[on], soc_force[tip].ravel(), 2.0 / (weight * lorentz_form(soc[rim]))]
        ),
    )


class Optimality(NamedTuple):
    """The conditions  grad objective = sum multiplier grad g,  g = 0  on the active pieces."""

    error: Array
    """errors of the conditions, (k + p,)."""
    normals: Array
    """gradients grad g of the active pieces, (p, k)."""

    @property
    def worst(self) -> float:
        """The largest absolute error."""
        return float(np.abs(self.error).max(initial=0.0))


def optimality(objective: Objective, active: Active, point: Array, forces: Array) -> Optimality:
    """Errors of the conditions for a point (k,) and multipliers (p,)."""
    soc = active.round_h + active.round_G @ point
    curved = np.einsum("jak,ja->jk", active.round_G, MIRROR * soc)
    normals = np.concatenate([active.plane_G, curved])
    values = np.concatenate([active.plane_h + active.plane_G @ point, 0.5 * lorentz_form(soc)])
    return Optimality(
        np.concatenate([objective.slope(point) - normals.T @ forces, values]), normals
    )


def newton_step(objective: Objective, active: Active, forces: Array, now: Optimality) -> np.ndarray:
    """Newton step of the point and the multipliers, (k + p,)."""
    bent = forces[len(active.plane_h) :]
    curve = np.einsum("jak,a,jal,j->kl", active.round_G, MIRROR, active.round_G, bent)
    blank = np.zeros((len(forces), len(forces)))
    jacobian = np.block(
        [[objective.root.T @ objective.root - curve, -now.normals.T], [now.normals, blank]]
    )
    return np.linalg.lstsq(jacobian, -now.error, rcond=COMPUTED_ROUNDING)[0]


def polish(objective: Objective, cones: Cones, y: Array, weight: float) -> Array | None:
    """The optimum near y by Newton's method on the pieces that are active there.

    None if the result is not admissible or is further away than the error of the path allows:
    without strict complementarity the result of the barrier method is better.
    """
    active = read_active(cones, y, weight)
    point, forces = y, active.multipliers
    best, best_error = y, np.inf
    for _ in range(12):
        now = optimality(objective, active, point, forces)
        if now.worst >= best_error:
            break
        best, best_error = point, now.worst
        step = newton_step(objective, active, forces, now)
        point, forces = point + step[: len(y)], forces + step[len(y) :]
    near = np.linalg.norm(best - y) <= 1e-5 * (1.0 + np.linalg.norm(y))
    admissible = cones.admits(best)
    return best if near and admissible and best_error < 1e-9 else None


GROWTH = 30.0
"""Factor between consecutive weights."""
SHARPEST = GROWTH**8
"""Last weight of the objective (7e11); the duality gap is (number of barriers) / weight."""
CENTRED = 1e-2
"""Squared Newton decrement below which a point is on the central path; rounding allows no
better."""
BALLS = (1e3, 1e6, 1e8)
"""Radii of the ball, in order; a problem limited by the last one is unbounded."""
EARLY, CLEARLY = 1e4, 1e-3
"""Weight from which on, and share of the ball's force above which, the ball limits the solution:
the next ball is tried."""


class Optimum(NamedTuple):
    """Result of `minimise`."""

    y: Array
    """minimiser, (k,)."""
    bounded: bool
    """False: the objective decreases beyond every ball; y is not a solution then."""
    gap: float
    """bound of the objective's error; 0 if the optimality conditions hold up to rounding."""


FAR = 10.0
"""Norm of a y of widest margin, in units of force, above which a shorter one is sought."""


def widest(cones: Cones) -> Optimum:
    """The y of the largest margin s <= 1: y stays admissible after s is subtracted from every
    half-space and head."""
    freedom = cones.lin_G.shape[1]
    start = np.zeros(freedom)
    if freedom == 0 or len(cones.lin_h) + len(cones.soc_h) == 0:
        return Optimum(start, True, 0.0)
    head = np.zeros((len(cones.soc_h), 3, 1))
    head[:, 0] = -1.0
    cap = np.zeros((1, freedom + 1))
    cap[0, -1] = -1.0
    lifted = Cones(
        np.append(cones.lin_h, 1.0),
        np.vstack([np.hstack([cones.lin_G, -np.ones((len(cones.lin_h), 1))]), cap]),
        cones.soc_h,
        np.concatenate([cones.soc_G, head], axis=2),
    )
    down = np.zeros(freedom + 1)
    down[-1] = -1.0
    worst = min(float(cones.slack(start).min()), 0.0) - 1.0
    best = minimise(linear(down), lifted, np.append(start, worst))
    return best._replace(y=best.y[:-1])


def moderate(cones: Cones, y: Array) -> Optimum:
    """A strictly admissible y of moderate size: the shortest one with half the margin of the given
    y.

    If something jams there are admissible states of any size, and the result of `widest` may be
    very long.
    """
    if np.linalg.norm(y) <= FAR:
        return Optimum(y, True, 0.0)
    half = 0.5 * float(cones.slack(y).min(initial=2.0))
    soc_h = cones.soc_h.copy()
    soc_h[:, 0] -= half
    short = Objective(np.eye(len(y)), np.zeros(len(y)))
    return minimise(short, Cones(cones.lin_h - half, cones.lin_G, soc_h, cones.soc_G), y)


def minimise(objective: Objective, cones: Cones, start: Array) -> Optimum:
    """The minimiser; `start` must be strictly inside the cones.

    Scaling: a slope of the objective of order one and unknowns of order one to 1e6.
    """
    barriers = len(cones.lin_h) + 2 * len(cones.soc_h) + 1
    for radius in BALLS:
        reach = radius * (1.0 + float(np.linalg.norm(start)))
        y, weight, pressed = _follow(objective, cones, start, reach)
        if not pressed:
            polished = polish(objective, cones, y, weight)
            if polished is None:
                return Optimum(y, True, barriers / weight)
            return Optimum(polished, True, 0.0)
    return Optimum(start, False, 0.0)


def _follow(
    objective: Objective, cones: Cones, start: Array, reach: float
) -> tuple[Array, float, bool]:
    """Follow the central path to the weight SHARPEST, or as far as rounding allows.

    Returns (the point, its weight, whether the ball limits it).
    """
    y, weight, pressed = start, 1.0, False
    while True:
        ahead, found = _centre(objective, cones, y, weight, reach)
        if not found and weight > 1.0:
            return y, weight / GROWTH, pressed
        y = ahead
        pressure = 2.0 * float(np.linalg.norm(y)) / (weight * (reach**2 - float(y @ y)))
        pressed = pressure > max(WRITTEN_ROUNDING, 1.0 / weight)
        if weight >= SHARPEST or (weight >= EARLY and pressure > CLEARLY):
            return y, weight, pressed
        weight *= GROWTH


def _centre(
    objective: Objective, cones: Cones, y: Array, weight: float, reach: float
) -> tuple[Array, bool]:
    """Newton's method on the barrier function, with a line search on its directional slope.

    Returns (the point, whether it is the minimiser accurately enough for the gap).
    """
    descent = np.inf
    for _ in range(40):
        if cones.slack(y).min(initial=np.inf) <= 0.0:
            return y, False
        gradient = _slope(objective, cones, y, weight, reach)
        step = -_solve_normal(_root(objective, cones, y, weight, reach), gradient)
        before, descent = descent, -float(gradient @ step)
        if descent < 1e-8 or (before < CENTRED and descent > 0.25 * before):
            return y, True
        length = _longest(cones, y, step, reach)
        for _ in range(40):
            ahead = _slope(objective, cones, y + length * step, weight, reach) @ step
            if ahead <= 0.5 * descent:
                break
            length *= 0.5
        y = y + length * step
    return y, descent < CENTRED


@cache
def _triangular_solver() -> Any:
    """LAPACK's dtrtrs, loaded on first use: SciPy is slow to import, and few runs need it."""
    from scipy.linalg import get_lapack_funcs

    (trtrs,) = get_lapack_funcs(("trtrs",), dtype=np.float64)
    return trtrs


def _solve_normal(root: Array, rhs: Array) -> Array:
    """(root^T root)^-1 rhs by a QR factorisation of root, which halves the loss of digits."""
    scale = 1.0 / np.linalg.norm(root, axis=0)
    upper = np.linalg.qr(root * scale, mode="r")
    trtrs = _triangular_solver()
    half, _ = trtrs(upper, scale * rhs, trans=1)
    return scale * trtrs(upper, half)[0]


def _longest(cones: Cones, y: Array, step: Array, reach: float) -> float:
    """The longest step, up to 1, that stays strictly inside the cones and the ball."""
    length = 1.0
    for _ in range(200):
        ahead = y + length * step
        if cones.slack(ahead).min(initial=np.inf) > 0.0 and ahead @ ahead < reach**2:
            return length
        length *= 0.7
    return 0.0


def _slope(objective: Objective, cones: Cones, y: Array, weight: float, reach: float) -> Array:
    """Gradient (k,) of the barrier function."""
    lin, soc = cones.at(y)
    pull = 2.0 * MIRROR * soc / lorentz_form(soc)[:, None]
    return (
        weight * objective.slope(y)
        - cones.lin_G.T @ (1.0 / lin)
        - cones.soc_rows.T @ pull.ravel()
        + 2.0 * y / (reach**2 - y @ y)
    )


def _root(objective: Objective, cones: Cones, y: Array, weight: float, reach: float) -> Array:
    """A matrix (m, k) with root^T root the Hessian of the barrier function.

    Cone: the Hessian of -log(head^2 - |tail|^2) is (2 / form) V^2 with V = [[a, b], [b, 1 + b b /
    (1 + a)]], (a, b) = (head, -tail) / sqrt(form) (Nesterov & Todd 1997). Ball: a square likewise.
    """
    lin, soc = cones.at(y)
    form = lorentz_form(soc)
    unit = MIRROR * soc / np.sqrt(form)[:, None]
    head, tail = unit[:, 0], unit[:, 1:]
    block = np.empty((len(soc), 3, 3))
    block[:, 0, 0] = head
    block[:, 0, 1:] = block[:, 1:, 0] = tail
    block[:, 1:, 1:] = np.eye(2) + tail[:, :, None] * tail[:, None] / (1.0 + head)[:, None, None]
    round_ = np.sqrt(2.0 / form)[:, None, None] * np.matmul(block, cones.soc_G)
    ball = np.sqrt(2.0 / (reach**2 - y @ y))
    return np.vstack(
        [
            np.sqrt(weight) * objective.root,
            cones.lin_G / lin[:, None],
            round_.reshape(-1, len(y)),
            ball * np.eye(len(y)),
            ball**2 * y,
        ]
    )
