"""The friction problem of several contacts at once, and how far from its solution a reaction is.

    u = W r + q,    K* contains u + mu |u_T| n,    K contains r,    one orthogonal to the other

contact by contact: W is the Delassus matrix, q the velocity without reactions (restitution and
gaps as a bias on its normal components), K the friction cone |r_T| <= mu r_n, K* its dual.  The
term mu |u_T| is De Saxce's: with it the law is Coulomb's, without it the problem is convex and
contacts that slip would open.  Components: normal, first and second tangent of each contact.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rb_sim.contact.solvers.arrays import times
from rb_sim.maths.jit import entry


class FrictionProblem(NamedTuple):
    """A problem of n contacts."""

    W: np.ndarray
    """Delassus matrix [1/kg], shape (3n, 3n), symmetric and positive semidefinite."""
    q: np.ndarray
    """velocity without reactions [m/s], shape (3n,)."""
    mu: np.ndarray
    """coefficients of friction, shape (n,)."""


@entry
def onto_cone(x, y, z, mu):
    """The point of |(y, z)| <= mu x nearest to (x, y, z)."""
    size = math.sqrt(y * y + z * z)
    if size <= mu * x:
        return x, y, z
    if mu * size <= -x:
        return 0.0, 0.0, 0.0
    near = (x + mu * size) / (1.0 + mu * mu)
    return near, mu * near * y / size, mu * near * z / size


@entry
def natural_map(W, q, mu, r):
    """r_i - P_K(r_i - (u_i + mu |u_T| n) / w_i) of every contact, w_i the largest of its own block.

    Zero at a solution, and of the size of the error near one [N s]; shape (3n,).
    """
    u, out = np.empty(r.shape[0]), np.empty(r.shape[0])
    times(W, r, u)
    for i in range(mu.shape[0]):
        k = 3 * i
        for p in range(k, k + 3):
            u[p] += q[p]
        size = max(W[k, k], W[k + 1, k + 1], W[k + 2, k + 2])
        slip = math.sqrt(u[k + 1] ** 2 + u[k + 2] ** 2)
        x = r[k] - (u[k] + mu[i] * slip) / size
        y, z = r[k + 1] - u[k + 1] / size, r[k + 2] - u[k + 2] / size
        x, y, z = onto_cone(x, y, z, mu[i])
        out[k], out[k + 1], out[k + 2] = r[k] - x, r[k + 1] - y, r[k + 2] - z
    return out


def residual(problem: FrictionProblem, r: np.ndarray) -> float:
    """How far r is from a solution, relative to the largest reaction or to what would be needed
    to stop the largest velocity."""
    error = natural_map(problem.W, problem.q, problem.mu, r)
    needed = np.abs(problem.q) / np.maximum(np.diag(problem.W), 1e-300)
    scale = max(float(np.abs(r).max(initial=0.0)), float(needed.max(initial=0.0)))
    return float(np.abs(error).max(initial=0.0)) / scale if scale > 0.0 else 0.0
