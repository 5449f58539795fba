"""The last digits of a cone program: Newton's method on the pieces that are active."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rb_sim.maths.cones import MIRROR, Array, Cones, Objective, lorentz_form

STEP_RANK = 1e-13
"""Singular value of the optimality conditions, relative to the largest, at or below which a step of
Newton's method leaves its direction out. Finer than the rank rule: the next step mends."""


class Active(NamedTuple):
    """Boundary pieces that carry a multiplier: planes (half-spaces, cone tips), round cones."""

    plane_h: Array
    plane_G: Array
    round_h: Array
    round_G: Array
    multipliers: Array


def read_active(cones: Cones, y: Array, weight: float) -> Active:
    """At the end of the path either the slack or the multiplier is large (complementarity)."""
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
    """(k + p,): what is missing from each."""
    normals: Array
    """(p, k): grad g."""

    @property
    def worst(self) -> float:
        """The largest error."""
        return float(np.abs(self.error).max(initial=0.0))


def optimality(objective: Objective, active: Active, point: Array, forces: Array) -> Optimality:
    """What point (k,) and multipliers (p,) leave of them."""
    soc = active.round_h + active.round_G @ point
    curved = np.einsum("jak,ja->jk", active.round_G, MIRROR * soc)
    normals = np.concatenate([active.plane_G, curved])
    values = np.concatenate([active.plane_h + active.plane_G @ point, 0.5 * lorentz_form(soc)])
    return Optimality(
        np.concatenate([objective.slope(point) - normals.T @ forces, values]), normals
    )


def newton_step(objective: Objective, active: Active, forces: Array, now: Optimality) -> np.ndarray:
    """(k + p,): what Newton's method adds to the point and the multipliers."""
    bent = forces[len(active.plane_h) :]
    curve = np.einsum("jak,a,jal,j->kl", active.round_G, MIRROR, active.round_G, bent)
    blank = np.zeros((len(forces), len(forces)))
    jacobian = np.block(
        [[objective.root.T @ objective.root - curve, -now.normals.T], [now.normals, blank]]
    )
    return np.linalg.lstsq(jacobian, -now.error, rcond=STEP_RANK)[0]


def polish(objective: Objective, cones: Cones, y: Array, weight: float) -> Array | None:
    """The optimum near y by Newton's method on the pieces that are active there.

    None when the result is not admissible or has moved further than the path's own error allows
    (no strict complementarity: the barrier's answer is then the better one).
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
