"""Small convex programs over half-spaces and friction cones, solved to round-off.

    minimise  1/2 y.P y + c.y   over  y with  a_i(y) >= 0  and  |tail_j(y)| <= head_j(y),

where a = lin_h + lin_G y and (head, tail) = soc_h + soc_G y (second-order cones of dimension 3).

Method: the primal barrier  t (objective) - sum log a_i - sum log(head_j^2 - |tail_j|^2)  is
minimised by Newton steps for growing t (Nesterov & Nemirovskii 1994; Boyd & Vandenberghe 2004,
section 11.3), which needs a strictly feasible start but no further assumption; then the boundary
pieces that are active are read off and the optimality conditions on them are solved by Newton's
method, which takes the error from the barrier's 1e-12 to round-off. A ball |y| <= radius keeps
every problem bounded; it is widened until it no longer matters or the answer is called unbounded.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SHARPEST = 1e12
"""last weight of the objective; the duality gap is (number of barriers) / SHARPEST."""
GROWTH = 30.0
"""factor between weights."""
BALLS = (1e3, 1e6, 1e8)
"""radii of the ball, in turn; what still presses on the last one is unbounded."""
PRESSING = 1e-9
"""share of the objective's slope that the ball may carry before it counts as pressing."""
EARLY, CLEARLY = 1e4, 1e-3
"""from this weight on a share this large is the ball's for good: go on to the next ball."""
MIRROR = np.array([1.0, -1.0, -1.0])
"""the quadratic form head^2 - |tail|^2."""


class Cones(NamedTuple):
    """The admissible set. p half-spaces, q cones, k unknowns."""

    lin_h: Array
    """(p,)."""
    lin_G: Array
    """(p, k)."""
    soc_h: Array
    """(q, 3), [head, tail, tail]."""
    soc_G: Array
    """(q, 3, k)."""

    @property
    def soc_rows(self) -> Array:
        """soc_G as one matrix, (3 q, k)."""
        return self.soc_G.reshape(-1, self.soc_G.shape[2])

    def at(self, y: Array) -> tuple[Array, Array]:
        """Values (p,) of the half-spaces and (q, 3) of the cones."""
        return self.lin_h + self.lin_G @ y, self.soc_h + self.soc_G @ y

    def slack(self, y: Array) -> Array:
        """a_i and head_j - |tail_j|, shape (p + q,): all >= 0 is admissible."""
        lin, soc = self.at(y)
        return np.concatenate([lin, soc[:, 0] - np.hypot(soc[:, 1], soc[:, 2])])


class Optimum(NamedTuple):
    """Answer of `minimise`."""

    y: Array
    """(k,)."""
    bounded: bool
    """False: the objective falls beyond every ball; y is then no answer."""


class Objective(NamedTuple):
    """1/2 y.P y + c.y."""

    P: Array
    c: Array

    def slope(self, y: Array) -> Array:
        return self.P @ y + self.c


def minimise(objective: Objective, cones: Cones, start: Array) -> Optimum:
    """The minimiser; `start` must be strictly inside the cones.

    Give the objective with a slope of order one and unknowns of order one to 1e6.
    """
    for radius in BALLS:
        y = _follow(objective, cones, start, radius * (1.0 + float(np.linalg.norm(start))))
        if y is not None:
            return Optimum(_polish(objective, cones, y, SHARPEST), True)
    return Optimum(start, False)


def _follow(objective: Objective, cones: Cones, start: Array, reach: float) -> Array | None:
    """Follow the central path from `start` to the weight SHARPEST; None if the ball presses."""
    y, weight = start, 1.0
    while True:
        y = _centre(objective, cones, y, weight, reach)
        pressure = 2.0 * float(np.linalg.norm(y)) / (weight * (reach**2 - float(y @ y)))
        if pressure > (CLEARLY if weight >= EARLY else np.inf):
            return None
        if weight >= SHARPEST:
            return y if pressure <= PRESSING else None
        weight = min(weight * GROWTH, SHARPEST)


def _centre(objective: Objective, cones: Cones, y: Array, weight: float, reach: float) -> Array:
    """Newton's method on the barrier function, with a line search on its directional slope."""
    for _ in range(40):
        gradient, hessian = _barrier(objective, cones, y, weight, reach)
        scale = 1.0 / np.sqrt(np.maximum(np.diag(hessian), 1e-300))
        step = -scale * _solve(hessian * np.outer(scale, scale), scale * gradient)
        descent = -float(gradient @ step)
        if descent < 1e-8:
            return y
        length = _longest(cones, y, step, reach)
        for _ in range(40):
            ahead = _barrier_slope(objective, cones, y + length * step, weight, reach) @ step
            if ahead <= 0.5 * descent:
                break
            length *= 0.5
        else:
            return y
        y = y + length * step
    return y


def _solve(matrix: Array, rhs: Array) -> Array:
    """matrix^-1 rhs; in the least-squares sense where rounding has made the matrix singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, rhs), dtype=float)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(matrix, rhs, rcond=1e-15)[0], dtype=float)


def _longest(cones: Cones, y: Array, step: Array, reach: float) -> float:
    """The longest step up to 1 that stays strictly inside."""
    length = 1.0
    for _ in range(200):
        ahead = y + length * step
        if cones.slack(ahead).min(initial=np.inf) > 0.0 and ahead @ ahead < reach**2:
            return length
        length *= 0.7
    return 0.0


def _barrier_slope(
    objective: Objective, cones: Cones, y: Array, weight: float, reach: float
) -> Array:
    """Gradient (k,) of the barrier function."""
    lin, soc = cones.at(y)
    pull = 2.0 * MIRROR * soc / _form(soc)[:, None]
    return (
        weight * objective.slope(y)
        - cones.lin_G.T @ (1.0 / lin)
        - cones.soc_rows.T @ pull.ravel()
        + 2.0 * y / (reach**2 - y @ y)
    )


def _barrier(
    objective: Objective, cones: Cones, y: Array, weight: float, reach: float
) -> tuple[Array, Array]:
    """Gradient (k,) and Hessian (k, k) of the barrier function."""
    lin, soc = cones.at(y)
    inverse = 1.0 / _form(soc)
    rows = cones.lin_G / lin[:, None]
    pulls = np.matmul((2.0 * MIRROR * soc * inverse[:, None])[:, None], cones.soc_G)[:, 0]
    bends = (2.0 * inverse[:, None] * MIRROR).reshape(-1, 1) * cones.soc_rows
    gap = reach**2 - y @ y
    ball = 2.0 * np.eye(len(y)) / gap + 4.0 * np.outer(y, y) / gap**2
    hessian = weight * objective.P + rows.T @ rows + pulls.T @ pulls + ball
    hessian -= cones.soc_rows.T @ bends
    return _barrier_slope(objective, cones, y, weight, reach), hessian


def _form(soc: Array) -> Array:
    """head^2 - |tail|^2 without cancellation, (q,)."""
    tail = np.hypot(soc[:, 1], soc[:, 2])
    return (soc[:, 0] - tail) * (soc[:, 0] + tail)


class _Active(NamedTuple):
    """Boundary pieces that carry a multiplier: planes (half-spaces, cone tips), round cones."""

    plane_h: Array
    plane_G: Array
    round_h: Array
    round_G: Array
    multipliers: Array


def _read_active(cones: Cones, y: Array, weight: float) -> _Active:
    """At the end of the path either the slack or the multiplier is large (complementarity)."""
    threshold = 1.0 / np.sqrt(weight)
    lin, soc = cones.at(y)
    lin_force = 1.0 / (weight * lin)
    soc_force = 2.0 * MIRROR * soc / (weight * _form(soc))[:, None]
    on = lin_force > threshold
    pressed = soc_force[:, 0] > threshold
    tip = pressed & (soc[:, 0] < threshold)
    rim = pressed & ~tip
    k = len(y)
    return _Active(
        np.concatenate([cones.lin_h[on], cones.soc_h[tip].ravel()]),
        np.concatenate([cones.lin_G[on], cones.soc_G[tip].reshape(-1, k)]),
        cones.soc_h[rim],
        cones.soc_G[rim],
        np.concatenate([lin_force[on], soc_force[tip].ravel(), 2.0 / (weight * _form(soc[rim]))]),
    )


def _polish(objective: Objective, cones: Cones, y: Array, weight: float) -> Array:
    """Newton's method on  grad objective = sum multiplier grad g,  g = 0  on the active pieces.

    Returns y unchanged when the result is not admissible or has moved further than the path's own
    error allows (no strict complementarity: the barrier's answer is then the better one).
    """
    active = _read_active(cones, y, weight)
    k, planes = len(y), len(active.plane_h)
    point, forces = y, active.multipliers
    best, best_error = y, np.inf
    for _ in range(12):
        soc = active.round_h + active.round_G @ point
        normals = np.concatenate(
            [active.plane_G, np.einsum("jak,ja->jk", active.round_G, MIRROR * soc)]
        )
        values = np.concatenate([active.plane_h + active.plane_G @ point, 0.5 * _form(soc)])
        error = np.concatenate([objective.slope(point) - normals.T @ forces, values])
        worst = float(np.abs(error).max(initial=0.0))
        if worst >= best_error:
            break
        best, best_error = point, worst
        curve = np.einsum(
            "jak,a,jal,j->kl", active.round_G, MIRROR, active.round_G, forces[planes:]
        )
        blank = np.zeros((len(values), len(values)))
        jacobian = np.block([[objective.P - curve, -normals.T], [normals, blank]])
        step = np.linalg.lstsq(jacobian, -error, rcond=1e-13)[0]
        point, forces = point + step[:k], forces + step[k:]
    near = np.linalg.norm(best - y) <= 1e-5 * (1.0 + np.linalg.norm(y))
    admissible = cones.slack(best).min(initial=np.inf) >= -1e-13 * (1.0 + np.linalg.norm(best))
    return best if near and admissible and best_error < 1e-9 else y
