"""Whether what a fit leaves is noise: neighbours in time are then independent.

    rho = sum r_k r_k+1 / sum r_k^2

is about 0 for noise, with a standard deviation of 1 / sqrt(n), and near 1 for what a wrong model or
a search that ended elsewhere leaves (Durbin and Watson, Biometrika 37, 1950).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

FEW = 16
"""Samples below which nothing is said."""
SYSTEMATIC = 0.5
"""Correlation of neighbours from which on the rest is not noise."""
ROUNDING = 1e-7
"""Of the largest way: residuals below are of rounding and tolerances."""


def correlation(columns: Iterable[np.ndarray]) -> float:
    """Of neighbours in columns of residuals, each shape (n, 3), by their squares; 0 for too few."""
    products = squares = 0.0
    for r in columns:
        if len(r) >= FEW:
            products += float(np.sum(r[1:] * r[:-1]))
            squares += float(np.sum(r * r))
    return products / squares if squares > 0.0 else 0.0
