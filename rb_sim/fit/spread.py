"""How sure the numbers of a fit are: standard errors, correlations, and what is not determined.

    cov = D (J^T J)^-1 D^T s^2

with J the Jacobian by the numbers of the search, D the derivatives of the numbers themselves by
these and s^2 the variance of the weighted residuals (Bard, Nonlinear Parameter Estimation, 1974,
ch. 7).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rb_sim.fit.limits import untold

SHARE = 0.1
"""Of a combination without effect, from which on a number belongs to it."""
NOISELESS = 1e-9
"""Mean square of weighted residuals below which they are without noise."""


class Spread(NamedTuple):
    """Of the numbers of a fit."""

    errors: np.ndarray
    """standard errors, infinite for what is not determined."""
    correlation: np.ndarray
    undetermined: list[list[int]]
    """which numbers belong to each combination without effect."""


def spread_of(
    J: np.ndarray, least: float, variance: float, slopes: np.ndarray, scales: np.ndarray
) -> Spread:
    """least: singular value of J, relative to the largest, that says nothing."""
    _, s, Vt = np.linalg.svd(J, full_matrices=False)
    weak = untold(s, least)
    inverse = np.where(weak, 0.0, 1.0 / np.where(weak, 1.0, s) ** 2)
    covariance = slopes @ ((Vt.T * inverse) @ Vt * variance) @ slopes.T
    errors = np.sqrt(np.diag(covariance))
    correlation = covariance / np.maximum(np.outer(errors, errors), 1e-300)
    undetermined = []
    for row in Vt[weak]:
        way = np.abs(slopes @ row) / scales
        moved = np.flatnonzero(way > SHARE * way.max())
        errors[moved] = np.inf
        undetermined.append(moved.tolist())
    return Spread(errors, correlation, undetermined)


def noisy(r: np.ndarray, is_angle: np.ndarray) -> int:
    """How many residuals have noise: attitudes that are all written as the identity have none, and
    would make the others' look smaller."""
    kinds = [is_angle == k for k in (False, True)]
    return sum(int(kind.sum()) for kind in kinds if np.mean(r[kind] ** 2) > NOISELESS)
