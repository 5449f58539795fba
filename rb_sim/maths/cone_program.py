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

from rb_sim.maths.cone_polish import polish
from rb_sim.maths.cones import MIRROR, Array, Cones, Objective, linear, lorentz_form

GROWTH = 30.0
"""factor between weights."""
SHARPEST = GROWTH**8
"""last weight of the objective (7e11); the duality gap is (number of barriers) / weight."""
CENTRED = 1e-2
"""squared Newton decrement below which a point is on the path: rounding allows no better."""
BALLS = (1e3, 1e6, 1e8)
"""radii of the ball, in turn; what still presses on the last one is unbounded."""
PRESSING = 1e-9
"""share of the objective's slope that the ball may carry before it counts as pressing."""
EARLY, CLEARLY = 1e4, 1e-3
"""from this weight on a share this large is the ball's for good: go on to the next ball."""


class Optimum(NamedTuple):
    """Answer of `minimise`."""

    y: Array
    """(k,)."""
    bounded: bool
    """False: the objective falls beyond every ball; y is then no answer."""
    gap: float
    """bound of the objective's error; 0 where the optimality conditions hold to round-off."""


FAR = 10.0
"""Size of a y of widest margin, over the unit of force, that counts as far out."""


def widest(cones: Cones) -> Optimum:
    """The y of the largest margin, at most one unit: the largest s such that y stays admissible
    after s has been taken off every half-space and head."""
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
    """A strictly admissible y of moderate size: the shortest with half the margin of the given one.

    Where something jams there are admissible states of any size, and `widest` may be far out.
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

    Give the objective with a slope of order one and unknowns of order one to 1e6.
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
    """Follow the central path to the weight SHARPEST, or as far as rounding lets it be found.

    Returns the point, its weight, and whether the ball presses on it.
    """
    y, weight, pressed = start, 1.0, False
    while True:
        ahead, found = _centre(objective, cones, y, weight, reach)
        if not found and weight > 1.0:
            return y, weight / GROWTH, pressed
        y = ahead
        pressure = 2.0 * float(np.linalg.norm(y)) / (weight * (reach**2 - float(y @ y)))
        pressed = pressure > max(PRESSING, 1.0 / weight)
        if weight >= SHARPEST or (weight >= EARLY and pressure > CLEARLY):
            return y, weight, pressed
        weight *= GROWTH


def _centre(
    objective: Objective, cones: Cones, y: Array, weight: float, reach: float
) -> tuple[Array, bool]:
    """Newton's method on the barrier function, with a line search on its directional slope.

    Returns the point and whether it is the minimiser, as far as it matters to the gap.
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
    """LAPACK's dtrtrs; SciPy is slow to import, and few runs need it."""
    from scipy.linalg import get_lapack_funcs

    (trtrs,) = get_lapack_funcs(("trtrs",), dtype=np.float64)
    return trtrs


def _solve_normal(root: Array, rhs: Array) -> Array:
    """(root^T root)^-1 rhs by a QR factorisation, which halves the digits that are lost."""
    scale = 1.0 / np.linalg.norm(root, axis=0)
    upper = np.linalg.qr(root * scale, mode="r")
    trtrs = _triangular_solver()
    half, _ = trtrs(upper, scale * rhs, trans=1)
    return scale * trtrs(upper, half)[0]


def _longest(cones: Cones, y: Array, step: Array, reach: float) -> float:
    """The longest step up to 1 that stays strictly inside."""
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
    """A matrix whose square root^T root is the Hessian of the barrier function, (m, k).

    Cone: the Hessian of -log(head^2 - |tail|^2) is (2 / form) V^2 with V = [[a, b], [b, 1 + b b /
    (1 + a)]], (a, b) = (head, -tail) / sqrt(form) (Nesterov & Todd 1997). Ball: likewise a square.
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
